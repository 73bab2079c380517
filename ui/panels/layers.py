"""The layers of a sketch: labels to paint with, visibility, locks, opacity."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Final

from PyQt6.QtCore import QObject, QPoint, QSignalBlocker, QSize, Qt, QTimer, pyqtSignal
from PyQt6.QtWidgets import QHBoxLayout, QLabel, QVBoxLayout, QWidget

from sketchterrain.document.label_layers import MAX_LABELS, LabelImage
from sketchterrain.document.parameters import LAYERS
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError
from sketchterrain.ui.commands.settings import (
    clear_layer,
    copy_label,
    delete_label,
    free_label,
    label_areas,
    new_label,
)
from sketchterrain.ui.look.theme import MARGIN, SMALL, SPACING, tabular, tool_button
from sketchterrain.ui.menus import ContextMenu
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Workspace
from sketchterrain.ui.panels.layer_list import LayerList, Row
from sketchterrain.ui.panels.numbers import WAY, label_title, number, slider, with_unit

_SLICE = 1 << 20  # px: a few ms


class AreaCount(QObject):
    """Counts label images; the newest of a layer counts."""

    counted = pyqtSignal(str, object)
    """A layer, and pixels by label."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._images: dict[str, LabelImage] = {}
        self._waiting: dict[str, tuple[int, dict[int, int]]] = {}
        self._timer = QTimer(self)
        self._timer.setInterval(0)
        self._timer.timeout.connect(self._go_on)

    def count(self, layers: Mapping[str, LabelImage]) -> None:
        """Count those layers whose images are others than before."""
        for name, image in layers.items():
            if self._images.get(name) is image:
                continue
            self._images[name] = image
            self._waiting[name] = (0, {})
            if image.size <= _SLICE:
                self._count_slice(name)
        if self._waiting:
            self._timer.start()

    def _go_on(self) -> None:
        name = next(iter(self._waiting), None)
        if name is None:
            self._timer.stop()
        else:
            self._count_slice(name)

    def _count_slice(self, name: str) -> None:
        image = self._images[name]
        top, areas = self._waiting[name]
        bottom = top + max(1, _SLICE // image.shape[1])
        for label, pixels in label_areas(image[top:bottom]).items():
            areas[label] = areas.get(label, 0) + pixels
        if bottom < image.shape[0]:
            self._waiting[name] = (bottom, areas)
        else:
            del self._waiting[name]
            self.counted.emit(name, areas)


_MAIN: Final = {
    "mountain": "height",
    "hill": "height",
    "river": "width",
    "dune": "height",
    "forest": "density",
    "lake": "depth",
    "material": "material",
}
"""The property that tells labels of a layer apart best."""


def label_detail(sketch: Sketch, layer: str, label: int, pixels: int) -> str:
    """Return for example ``"900 m · 1.2 km²"``."""
    name = _MAIN[layer]
    main = with_unit(LAYERS[layer].parameters[name], sketch.properties(layer, label)[name])
    if layer == "forest":
        main = f"density {main}"
    square = pixels * sketch.pixel_size**2
    return f"{main} · {_area(square)}" if square else f"{main} · not painted"


def _area(square_metres: float) -> str:
    if square_metres < 1e4:
        return f"{number(square_metres, decimals=0)} m²"
    return f"{number(square_metres / 1e6, decimals=1 if square_metres >= 1e6 else 2)} km²"


class LayersPanel(QWidget):
    """A list of layers and labels, the opacity of the layer in use, and what can be done with labels."""

    message = pyqtSignal(str)
    """Why something that was asked for is not done, one line."""

    def __init__(self, document: Document, workspace: Workspace, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._workspace = workspace
        self._areas: dict[str, dict[int, int]] = {name: {} for name in LAYERS}
        self._last_label = dict.fromkeys(LAYERS, 1)
        self.list = LayerList(self)
        self.opacity = slider(self)
        self.opacity.setAccessibleName("Opacity of the layer")
        self.opacity.setToolTip("How strongly the layer that is painted on covers what lies beneath")
        self._percent = QLabel(self)
        self.add = tool_button(
            "add", "New label", tip="Another label of this layer, with properties of its own", parent=self
        )
        self.remove = tool_button(
            "delete", "Delete label", tip="Delete this label and what is painted with it", parent=self
        )
        self.clear = tool_button(
            "eraser", "Clear layer", tip="Erase all that is painted on this layer", parent=self
        )
        self._count = AreaCount(self)
        self._lay_out()
        self._connect()
        self._count.count(document.sketch.layers)
        self._refresh()

    def new_label(self) -> None:
        """Paint with a new label of this layer from now on, with the default properties."""
        layer = self._workspace.layer
        label = self._free_label(layer)
        if label is not None:
            changed = new_label(self._document.sketch, layer, label)
            self._document.do(f"New {label_title(layer, label).lower()}", changed)
            self._workspace.use_label(layer, label)

    def copy_label(self) -> None:
        """Paint with a new label of this layer from now on, with this one's properties."""
        layer, source = self._workspace.layer, self._workspace.label
        label = self._free_label(layer)
        if label is not None:
            changed = copy_label(self._document.sketch, layer, label, source=source)
            self._document.do(f"Copy {label_title(layer, source).lower()}", changed)
            self._workspace.use_label(layer, label)

    def delete_label(self) -> None:
        """Delete the label in use and what is painted with it."""
        layer, label = self._workspace.layer, self._workspace.label
        changed = delete_label(self._document.sketch, layer, label)
        if changed is self._document.sketch:
            self.message.emit(f"There is nothing of {label_title(layer, label).lower()} to delete")
        elif self._is_free(layer):
            others = [each for each in self._labels(layer) if each != label]
            self._document.do(f"Delete {label_title(layer, label).lower()}", changed)
            self._workspace.use_label(layer, min(others, key=lambda each: abs(each - label), default=1))

    def clear_layer(self) -> None:
        """Erase all that is painted on the layer in use."""
        layer = self._workspace.layer
        changed = clear_layer(self._document.sketch, layer)
        if changed is self._document.sketch:
            self.message.emit(f"No {LAYERS[layer].title.lower()} are painted")
        elif self._is_free(layer):
            self._document.do(f"Clear {LAYERS[layer].title.lower()}", changed)

    def choose_layer(self, layer: str) -> None:
        """Paint on a layer, with the label that was used there last."""
        labels = self._labels(layer)
        last = self._last_label[layer]
        self._workspace.use_label(layer, last if last in labels else labels[0])

    def show_only(self, layer: str) -> None:
        """Show one layer and hide the others; all of them again if they are hidden already."""
        alone = all(self._workspace.look(name).visible == (name == layer) for name in LAYERS)
        for name in LAYERS:
            self._workspace.set_look(name, visible=alone or name == layer)

    def menu(self) -> ContextMenu:
        """Return what can be done with the label in use; it goes when it is closed."""
        layer = self._workspace.layer
        look = self._workspace.look(layer)
        title = LAYERS[layer].title.lower()
        menu = ContextMenu(self)
        for name, text, do, button in (
            ("add", "&New label", self.new_label, self.add),
            ("", "&Copy label", self.copy_label, self.add),
            ("delete", "&Delete label", self.delete_label, self.remove),
            ("eraser", f"C&lear {title}", self.clear_layer, self.clear),
        ):
            menu.add_command(name, text, do).setEnabled(button.isEnabled())
        menu.addSeparator()
        eye = ("eye-off", "&Hide") if look.visible else ("eye", "S&how")
        lock = ("unlock", "Un&lock") if look.locked else ("lock", "Loc&k")
        menu.add_command(eye[0], f"{eye[1]} {title}", partial(self._turn_eye, layer))
        menu.add_command("eye", f"Show &only {title}, or all", partial(self.show_only, layer))
        menu.add_command(lock[0], f"{lock[1]} {title}", partial(self._turn_lock, layer))
        return menu

    def sizeHint(self) -> QSize:
        """Return room for a row a layer."""
        return QSize(300, 400)

    def minimumSizeHint(self) -> QSize:
        """Return room for a few rows."""
        return QSize(220, 160)

    def _free_label(self, layer: str) -> int | None:
        try:
            return free_label(self._document.sketch, layer)
        except InputError as error:
            self.message.emit(str(error))
            return None

    def _is_free(self, layer: str) -> bool:
        """Whether a layer may be painted on; says so if it may not."""
        if self._workspace.look(layer).locked:
            self.message.emit(f"{LAYERS[layer].title} are locked")
        return not self._workspace.look(layer).locked

    def _connect(self) -> None:
        workspace = self._workspace
        self.list.selection.connect(workspace.use_label)
        self.list.layer_chosen.connect(self.choose_layer)
        self.list.eye_clicked.connect(self._turn_eye)
        self.list.lock_clicked.connect(self._turn_lock)
        self.list.delete_asked.connect(self.delete_label)
        self.list.menu_asked.connect(self._open_menu)
        self.add.clicked.connect(self.new_label)
        self.remove.clicked.connect(self.delete_label)
        self.clear.clicked.connect(self.clear_layer)
        self.opacity.valueChanged.connect(lambda at: workspace.set_look(workspace.layer, opacity=at / WAY))
        workspace.label_changed.connect(self._refresh)
        workspace.look_changed.connect(self._refresh)
        self._document.sketch_changed.connect(self._follow)
        self._count.counted.connect(self._take_areas)

    def _follow(self) -> None:
        self._count.count(self._document.sketch.layers)
        self._refresh()

    def _take_areas(self, layer: str, areas: dict[int, int]) -> None:
        if areas != self._areas[layer]:
            self._areas[layer] = areas
            self._refresh()

    def _refresh(self) -> None:
        workspace = self._workspace
        layer, label = workspace.layer, workspace.label
        self._last_label[layer] = label
        rows = [row for name in LAYERS for row in self._rows(name)]
        at = next(at for at, row in enumerate(rows) if (row.layer, row.label) == (layer, label))
        self.list.show_rows(rows, at)
        look = workspace.look(layer)
        self._percent.setText(f"{round(100 * look.opacity)} %")
        with QSignalBlocker(self.opacity):
            self.opacity.setValue(round(look.opacity * WAY))
        self.add.setEnabled(len(self._labels(layer)) < MAX_LABELS)
        declared = (layer, label) in self._document.sketch.labels
        self.remove.setEnabled((declared or label in self._areas[layer]) and not look.locked)
        self.clear.setEnabled(bool(self._areas[layer]) and not look.locked)

    def _labels(self, layer: str) -> list[int]:
        """Return the labels of a layer that have a row."""
        labels = {label for name, label in self._document.sketch.labels if name == layer}
        labels |= set(self._areas[layer])
        if layer == self._workspace.layer:
            labels.add(self._workspace.label)
        return sorted(labels) or [1]

    def _rows(self, layer: str) -> list[Row]:
        look = self._workspace.look(layer)
        labels = self._labels(layer)
        title = LAYERS[layer].title
        return [
            Row(
                layer,
                label,
                title if labels == [1] else label_title(layer, label),
                label_detail(self._document.sketch, layer, label, self._areas[layer].get(label, 0)),
                look.visible if label == labels[0] else None,
                look.locked if label == labels[0] else None,
            )
            for label in labels
        ]

    def _turn_eye(self, layer: str) -> None:
        self._workspace.set_look(layer, visible=not self._workspace.look(layer).visible)

    def _turn_lock(self, layer: str) -> None:
        self._workspace.set_look(layer, locked=not self._workspace.look(layer).locked)

    def _open_menu(self, place: QPoint) -> None:
        self.menu().popup(place)

    def _lay_out(self) -> None:
        self._percent.setFont(tabular(self._percent.font()))
        self._percent.setFixedWidth(self._percent.fontMetrics().horizontalAdvance("100 %") + 2)
        self._percent.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        title = QLabel("&Opacity", self)
        title.setBuddy(self.opacity)
        foot = QHBoxLayout()
        foot.setContentsMargins(MARGIN, SMALL, SPACING, SMALL)
        foot.setSpacing(SPACING)
        foot.addWidget(title)
        foot.addWidget(self.opacity, 1)
        foot.addWidget(self._percent)
        tools = QHBoxLayout()
        tools.setSpacing(0)
        for button in (self.add, self.remove, self.clear):
            tools.addWidget(button)
        foot.addLayout(tools)
        down = QVBoxLayout(self)
        down.setContentsMargins(SMALL, SMALL, SMALL, 0)
        down.setSpacing(0)
        down.addWidget(self.list, 1)
        down.addLayout(foot)
