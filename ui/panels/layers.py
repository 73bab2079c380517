"""Layers panel: labels, visibility, locks and opacity."""

from collections.abc import Mapping
from functools import partial

from PyQt6.QtCore import QSignalBlocker, QSize, Qt
from PyQt6.QtWidgets import QLabel

from sketchterrain.document.label_layers import MAX_LABELS, LabelImage, label_areas
from sketchterrain.document.sketch import Sketch
from sketchterrain.schema.layers import LANE_WIDTHS, LAYERS
from sketchterrain.ui import commands
from sketchterrain.ui.actions import ContextMenu
from sketchterrain.ui.look.theme import MARGIN, SMALL, SPACING, column, described, row, tabular, tool_button
from sketchterrain.ui.models.background import BackgroundReader
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Workspace
from sketchterrain.ui.panels.controls import SLIDER_STEPS, Panel, label_title, number, slider, with_unit
from sketchterrain.ui.panels.drapes import DrapeList
from sketchterrain.ui.panels.layer_list import LayerList, Row

_AT_ONCE = 1 << 22  # px that are counted at once, in some ms; more are on a thread


def _areas_of(images: Mapping[str, LabelImage]) -> dict[str, dict[int, int]]:
    """Return the pixels of each layer's labels."""
    return {name: label_areas(image) for name, image in images.items()}


def label_detail(sketch: Sketch, layer: str, label: int, pixels: int) -> str:
    """Return for example ``"900 m · 1.2 km²"``."""
    shown = LAYERS[layer].main
    main = with_unit(shown, sketch.properties(layer, label)[shown.name])
    if (not main[0].isdigit() and not LAYERS[layer].is_painted) or (shown.kind is not str and not shown.unit):
        main = f"{shown.name} {main}"
    area = pixels * sketch.pixel_size**2  # m²
    drawn = commands.vector_counts(sketch, layer).get(label, 0)
    main += f" · {drawn} drawn" if drawn else ""
    if not area:
        return main if drawn else f"{main} · not {'painted' if LAYERS[layer].is_painted else 'drawn'}"
    if area < 1e4:
        return f"{main} · {number(area, decimals=0)} m²"
    return f"{main} · {number(area / 1e6, decimals=1 if area >= 1e6 else 2)} km²"


def label_colours(sketch: Sketch, layer: str, label: int) -> tuple[str, str]:
    """Return the colours of the borders and insides of a label's vectors."""
    own, look = sketch.properties(layer, label), LAYERS[layer]
    value = own.get(look.by, 0.0)
    if look.kind == "way" and look.by:
        value = (value or LANE_WIDTHS[layer] * own["lanes"]) + 2.0 * own["shoulder"]
    return look.class_of(value).colours


class LayersPanel(Panel):
    """List of layers and labels, opacity of the active layer, and commands for labels."""

    usual, smallest = QSize(300, 400), QSize(220, 160)

    def __init__(self, document: Document, workspace: Workspace) -> None:
        super().__init__()
        self._document, self._workspace = document, workspace
        self.drapes = DrapeList(document, workspace)
        self._areas: dict[str, dict[int, int]] = {name: {} for name in LAYERS}
        self._last_label = dict.fromkeys(LAYERS, 1)
        self.list = LayerList()
        self.opacity = described(slider(), "Opacity of the layer", "Opacity of the active layer")
        self._percent = QLabel()
        self._percent.setFont(tabular(self._percent.font()))
        self._percent.setFixedWidth(self._percent.fontMetrics().horizontalAdvance("100 %") + 2)
        self._percent.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        new_tip = "Another label of this layer, with properties of its own"
        delete_tip = "Delete this label, its paint and vectors"
        clear_tip = "Erase all paint and vectors of this layer"
        self.add = tool_button("add", "New label", self.new_label, tip=new_tip)
        self.remove = tool_button("delete", "Delete label", self.delete_label, tip=delete_tip)
        self.clear = tool_button("eraser", "Clear layer", self.clear_layer, tip=clear_tip)
        title = QLabel("&Opacity")
        title.setBuddy(self.opacity)
        buttons = row(None, self.add, self.remove, self.clear, spacing=0)
        items = (title, (self.opacity, 1), self._percent, buttons)
        bottom = row(None, *items, margins=(MARGIN, SMALL, SPACING, SMALL))
        column(self, (self.list, 1), bottom, self.drapes, margins=(SMALL, SMALL, SMALL, 0), spacing=0)
        self._images: dict[str, LabelImage] = {}  # of `_areas`
        self._counting = BackgroundReader(self)
        self._connect()
        self._show_sketch()

    def new_label(self) -> None:
        """Add a label with default properties to the active layer and use it."""
        self._add_label(None)

    def copy_label(self) -> None:
        """Add a label with the active label's properties and use it."""
        self._add_label(self._workspace.label)

    def delete_label(self) -> None:
        layer, label = self._workspace.layer, self._workspace.label
        title = label_title(layer, label).lower()
        changed = commands.delete_label(self._document.sketch, layer, label)
        if changed is self._document.sketch:
            self._document.message.emit(f"No {title} to delete")
        elif self._check_unlocked(layer):
            others = [each for each in self._labels(layer) if each != label]
            self._document.do(f"Delete {title}", changed)
            self._workspace.use_label(layer, min(others, key=lambda each: abs(each - label), default=1))

    def clear_layer(self) -> None:
        layer = self._workspace.layer
        changed = commands.clear_layer(self._document.sketch, layer)
        if changed is self._document.sketch:
            self._document.message.emit(f"No {LAYERS[layer].title.lower()} are painted or drawn")
        elif self._check_unlocked(layer):
            self._document.do(f"Clear {LAYERS[layer].title.lower()}", changed)

    def use_layer(self, layer: str) -> None:
        """Activate a layer, with its last label."""
        labels = self._labels(layer)
        last = self._last_label[layer]
        self._workspace.use_label(layer, last if last in labels else labels[0])

    def menu(self) -> ContextMenu:
        layer = self._workspace.layer
        look = self._workspace.look(layer)
        title = LAYERS[layer].title.lower()
        menu = ContextMenu(self)
        for name, text, callback, button in (
            ("add", "&New label", self.new_label, self.add),
            ("", "&Copy label", self.copy_label, self.add),
            ("delete", "&Delete label", self.delete_label, self.remove),
            ("eraser", f"C&lear {title}", self.clear_layer, self.clear),
        ):
            menu.add_command(name, text, callback).setEnabled(button.isEnabled())
        menu.addSeparator()
        eye = ("eye-off", "&Hide") if look.visible else ("eye", "S&how")
        lock = ("unlock", "Un&lock") if look.locked else ("lock", "Loc&k")
        toggle = partial(self._workspace.toggle_look, layer)
        menu.add_command(eye[0], f"{eye[1]} {title}", partial(toggle, "visible"))
        menu.add_command("eye", f"Show &only {title}, or all", partial(self._workspace.show_only, layer))
        menu.add_command(lock[0], f"{lock[1]} {title}", partial(toggle, "locked"))
        return menu

    def _add_label(self, source: int | None) -> None:
        sketch, layer = self._document.sketch, self._workspace.layer
        with commands.reported(self._document.message.emit):
            label = commands.free_label(sketch, layer)
            verb, named = ("New", label) if source is None else ("Copy", source)
            changed = commands.new_label(sketch, layer, label, source=source)
            self._document.do(f"{verb} {label_title(layer, named).lower()}", changed)
            self._workspace.use_label(layer, label)

    def _check_unlocked(self, layer: str) -> bool:
        is_locked = self._workspace.look(layer).locked
        if is_locked:
            self._document.message.emit(f"{LAYERS[layer].title} are locked")
        return not is_locked

    def _connect(self) -> None:
        workspace = self._workspace
        self.list.label_activated.connect(workspace.use_label)
        self.list.layer_activated.connect(self.use_layer)
        self.list.eye_clicked.connect(lambda name: workspace.toggle_look(name, "visible"))
        self.list.lock_clicked.connect(lambda name: workspace.toggle_look(name, "locked"))
        self.list.delete_requested.connect(self.delete_label)
        self.list.menu_requested.connect(lambda place: self.menu().popup(place))
        self.opacity.valueChanged.connect(
            lambda step: workspace.set_look(workspace.layer, opacity=step / SLIDER_STEPS)
        )
        workspace.label_changed.connect(self._refresh)
        workspace.look_changed.connect(self._refresh)
        self._document.sketch_changed.connect(self._show_sketch)

    def _show_sketch(self) -> None:
        layers = self._document.sketch.layers.items()
        images = {name: image for name, image in layers if self._images.get(name) is not image}
        count, show = partial(_areas_of, images), partial(self._show_areas, images)
        self._counting.cancel()
        if sum(image.size for image in images.values()) > _AT_ONCE:
            self._counting.read(count, show)
            self._refresh()
        else:
            show(count())

    def _show_areas(self, images: dict[str, LabelImage], areas: dict[str, dict[int, int]]) -> None:
        self._images |= images
        self._areas |= areas
        self._refresh()

    def _refresh(self, *_: object) -> None:
        workspace = self._workspace
        layer, label = workspace.layer, workspace.label
        self._last_label[layer] = label
        rows = [row for name in LAYERS for row in self._rows(name)]
        current = next(i for i, row in enumerate(rows) if (row.layer, row.label) == (layer, label))
        self.list.show_rows(rows, current)
        look = workspace.look(layer)
        self.opacity.setEnabled(LAYERS[layer].is_painted)
        self._percent.setText(f"{round(100 * look.opacity)} %")
        with QSignalBlocker(self.opacity):
            self.opacity.setValue(round(look.opacity * SLIDER_STEPS))
        self.add.setEnabled(len(self._labels(layer)) < MAX_LABELS)
        used = {*self._areas[layer], *commands.vector_counts(self._document.sketch, layer)}
        declared = (layer, label) in self._document.sketch.labels
        self.remove.setEnabled((declared or label in used) and not look.locked)
        self.clear.setEnabled(bool(used) and not look.locked)

    def _labels(self, layer: str) -> list[int]:
        """Return the labels of a layer that have a row."""
        labels = {label for name, label in self._document.sketch.labels if name == layer}
        labels |= {*self._areas[layer], *commands.vector_counts(self._document.sketch, layer)}
        if layer == self._workspace.layer:
            labels.add(self._workspace.label)
        return sorted(labels) or [1]

    def _rows(self, layer: str) -> list[Row]:
        look = self._workspace.look(layer)
        labels = self._labels(layer)
        return [
            Row(
                layer,
                label,
                LAYERS[layer].title if labels == [1] else label_title(layer, label),
                label_detail(self._document.sketch, layer, label, self._areas[layer].get(label, 0)),
                look.visible if label == labels[0] else None,
                look.locked if label == labels[0] else None,
                None if LAYERS[layer].is_painted else label_colours(self._document.sketch, layer, label),
            )
            for label in labels
        ]
