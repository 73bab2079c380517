"""Draped layers: their list, and pages with the style of a layer and the properties of a feature."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from PyQt6.QtCore import pyqtSignal
from PyQt6.QtGui import QIcon
from PyQt6.QtWidgets import QComboBox, QLabel, QPushButton, QWidget

from sketchterrain.document.drapes import DRAPE, DrapeClass, DrapedLayer, draped_layer
from sketchterrain.errors import one_line
from sketchterrain.schema.parameters import Parameter, Value
from sketchterrain.schema.styles import STYLE
from sketchterrain.ui.actions import ContextMenu
from sketchterrain.ui.commands import reported
from sketchterrain.ui.look.layer_colours import colour_swatch
from sketchterrain.ui.look.theme import MARGIN, SMALL, SPACING, column, described, heading, row, tool_button
from sketchterrain.ui.models import drapes as model
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Selection, Workspace
from sketchterrain.ui.panels.controls import CollapsibleGroup, PageHead, scroll_past
from sketchterrain.ui.panels.form import ParameterForm, TextRow
from sketchterrain.ui.panels.layer_list import ROW_HEIGHT, LayerList, Row

_OF_LAYER: Final = ("opacity", "blend", "finest", "coarsest", "title", "table", "band", "crs")
_MOST: Final = 4  # rows of the list that are seen at once
_OTHERS: Final = "All other features"


class DrapeList(QWidget):
    """The draped layers, the highest on top, with commands for the chosen one."""

    add_requested = pyqtSignal()
    save_requested = pyqtSignal(int, bool)  # a layer, and whether under another name
    zoom_requested = pyqtSignal(int)

    def __init__(self, document: Document, workspace: Workspace) -> None:
        super().__init__()
        self._document, self._workspace = document, workspace
        self._selected: tuple[Selection | None, object] = (None, None)  # and its file
        self.list = LayerList(can_move=True)
        self.list.setAccessibleName("Draped layers")
        self.list.setToolTip("Draped layers, the highest on top. Space shows or hides one, Del removes it")
        add, tip = self.add_requested.emit, "Show vectors or rasters on the terrain"
        self.buttons = {
            "add": tool_button("add", "Add draped layers", add, tip=tip),
            "raise": tool_button("up", "Raise", partial(self._move, 1), tip="Draw it over the next layer"),
            "lower": tool_button(
                "down", "Lower", partial(self._move, -1), tip="Draw it beneath the next layer"
            ),
            "zoom": tool_button("fit", "Zoom to the layer", self._zoom, tip="Show all of it"),
            "remove": tool_button(
                "delete", "Remove", self._remove, tip="Remove it from the sketch; its file stays"
            ),
        }
        line = row(None, (heading("Draped layers"), 1), *self.buttons.values(), spacing=0)
        line.setContentsMargins(SPACING, SMALL, SPACING, 0)
        column(self, line, self.list, spacing=0)
        self.list.label_activated.connect(lambda name, _: self._choose(int(name)))
        self.list.eye_clicked.connect(lambda name: self._toggle_visible(int(name)))
        self.list.lock_clicked.connect(lambda name: self._toggle_locked(int(name)))
        self.list.delete_requested.connect(self._remove)
        self.list.menu_requested.connect(lambda place: self.menu().popup(place))
        self.list.moved.connect(self._drop)
        for signal in (document.sketch_changed, document.drapes.changed, workspace.look_changed):
            signal.connect(self.refresh)
        workspace.selection_changed.connect(self.refresh)
        self.refresh()

    @property
    def _chosen(self) -> int:
        """The number of the chosen layer, or that of the selected feature; -1 without one."""
        selection = self._workspace.selection
        number = -1 if selection is None or not selection.is_draped else selection.layer
        return number if number < len(self._document.sketch.drapes) else -1

    def refresh(self, *_: object) -> None:
        layers, chosen = self._document.sketch.drapes, self._chosen
        selection, file = self._workspace.selection, None
        if selection is not None and chosen >= 0:
            file = layers[chosen].path if selection.id < 0 else layers[chosen].source_key
        before, self._selected = self._selected, (selection, file)
        if before[0] == selection and before[1] != file:  # its number is that of another layer or feature now
            self._workspace.selection = None
            return
        rows = [self._row(number, layer) for number, layer in enumerate(layers)][::-1]
        self.list.show_rows(rows, len(rows) - 1 - chosen if chosen >= 0 else -1)
        self.list.setVisible(bool(rows))
        self.list.setFixedHeight(min(len(rows), _MOST) * ROW_HEIGHT + SMALL)
        for name, button in self.buttons.items():
            button.setVisible(bool(rows) or name == "add")
            button.setEnabled(chosen >= 0 or name == "add")

    def add(self, layers: list[DrapedLayer]) -> None:
        """Add layers above the others and choose the last one."""
        with reported(self._document.message.emit, self.refresh):
            model.add_drapes(self._document, self._workspace, layers)

    def menu(self) -> ContextMenu:
        menu, number, document = ContextMenu(self), self._chosen, self._document
        if number < 0:
            menu.add_command("add", "&Add draped layers", self.add_requested.emit)
            return menu
        for kind in ("point", "line", "area"):
            draw = menu.add_command("line", f"Draw {kind}s", partial(self._draw, kind))
            draw.setEnabled(not model.refusal(document, self._workspace, number))
        menu.addSeparator()
        is_vector = document.drapes.table(number) is not None
        for text, other in (("&Save layer", False), ("Save layer &as…", True)):
            save = menu.add_command("save", text, partial(self.save_requested.emit, number, other))
            save.setEnabled(is_vector and (other or bool(self._layer(number).edits)))
        menu.add_command("restart", "&Update", partial(self.update_file, number))
        menu.add_command("fit", "&Zoom to the layer", self._zoom)
        menu.add_command("delete", "&Remove", self._remove)
        return menu

    def _layer(self, number: int) -> DrapedLayer:
        return self._document.sketch.drapes[number]

    def _row(self, number: int, layer: DrapedLayer) -> Row:
        current = self._document.drapes.current
        parts = [one_line(Path(layer.path).name)]
        if current is None or number >= len(current.layers) or current.layers[number] != layer:
            parts.append("reading …")
        elif current.sources[number] is None:
            parts.append("not readable")
        parts += [f"{len(layer.edits)} edited"] if layer.edits else []
        is_raster = len(parts) == 1 and self._document.drapes.table(number) is None
        colours = ("#808080", "#b0b0b0") if is_raster else (layer.style["colour"], layer.style["fill"])
        locked = self._workspace.look(model.look_key(layer)).locked
        return Row(str(number), 0, layer.title, " · ".join(parts), layer["visible"] == 1, locked, colours)

    def _choose(self, number: int) -> None:
        self._workspace.selection = Selection("drape", -1, layer=number)

    def _toggle_visible(self, number: int) -> None:
        shown = self._layer(number)["visible"]
        model.change_drape(self._document, number, "Hide" if shown else "Show", visible=1 - shown)

    def _toggle_locked(self, number: int) -> None:
        self._workspace.toggle_look(model.look_key(self._layer(number)), "locked")

    def _move(self, by: int) -> None:
        model.move_drape(self._document, self._workspace, self._chosen, self._chosen + by)

    def _drop(self, start: int, before: int) -> None:
        """Move the layer of a row before another row; rows run from the highest layer to the lowest."""
        last = len(self.list.rows) - 1
        model.move_drape(self._document, self._workspace, last - start, last - (before - (before > start)))

    def _zoom(self) -> None:
        self.zoom_requested.emit(self._chosen)

    def update_file(self, number: int) -> None:
        """Accept a layer's file as it is now."""
        with reported(self._document.message.emit, self.refresh):
            digest = draped_layer(Path(self._layer(number).path))["sha256"]
            model.change_drape(self._document, number, "Update", sha256=digest)

    def _remove(self) -> None:
        if self._chosen >= 0:
            model.remove_drape(self._document, self._workspace, self._chosen)

    def _draw(self, kind: str) -> None:
        self._workspace.drape_kind = kind
        self._choose(self._chosen)
        self._workspace.tool = "line"


class DrapePage(QWidget):
    """Settings of the chosen layer, and the style of its features or of a class of them."""

    def __init__(self, document: Document, workspace: Workspace) -> None:
        super().__init__()
        self._document, self._workspace = document, workspace
        self._number, self._index = -1, -1  # of the layer, and of the class, -1 for all others
        self._head = PageHead()
        self.layer_form = ParameterForm(DRAPE[name] for name in _OF_LAYER)
        self.style_form = ParameterForm(STYLE.values())
        self.by = described(scroll_past(QComboBox()), "Property", "Its values make classes of features")
        tip = "Make a class of each value of the property, in a colour of its own"
        self.classify = described(QPushButton("Classif&y"), "Classify", tip)
        self.classes = described(scroll_past(QComboBox()), "Class", "The features whose style is below")
        self.add = tool_button("add", "New class", tip="Style features with another value differently")
        self.remove = tool_button("delete", "Remove class", tip="Style its features as all others")
        self.value = TextRow(Parameter("value", str, "", 0, 200, "", "of the property"), has_reset=False)
        by = row(None, QLabel("Classes by"), (self.by, 1), self.classify, spacing=SMALL)
        classes = row(None, (self.classes, 1), self.add, self.remove, spacing=SMALL)
        styles = QWidget()
        column(styles, by, classes, self.value, self.style_form, spacing=SPACING)
        groups = CollapsibleGroup("Style", styles), CollapsibleGroup("Layer", self.layer_form, is_open=False)
        column(self, self._head, *groups, spacing=MARGIN)
        for form in (self.layer_form, self.style_form):
            form.edited.connect(self._set)
        self.value.edited.connect(lambda value, _: self._set_class(self._index, str(value)))
        self.classify.clicked.connect(self._classify)
        self.by.activated.connect(lambda _: self._set("by", self.by.currentText()))
        self.classes.activated.connect(lambda at: self._show_class(at - 1))
        self.add.clicked.connect(lambda: self._set_class(len(self._layer.classes), "new"))
        self.remove.clicked.connect(lambda: self._set_class(self._index, None))
        for signal in (document.sketch_changed, document.drapes.changed, workspace.selection_changed):
            signal.connect(self.refresh)
        self.refresh()

    @property
    def _layer(self) -> DrapedLayer:
        return self._document.sketch.drapes[self._number]

    def refresh(self, *_: object) -> None:
        selection, layers = self._workspace.selection, self._document.sketch.drapes
        number = -1 if selection is None or selection.id >= 0 or not selection.is_draped else selection.layer
        if number != self._number:
            for form in (self.layer_form, self.style_form) if self._number < len(layers) else ():
                form.finish()
            self._number, self._index = number, -1
        if not 0 <= number < len(layers):
            self._number = -1
            return
        layer = self._layer
        self._head.show_text(layer.title, one_line(layer.path))
        self.layer_form.show_values(layer.values)
        self.by.clear()  # `activated` is of the user's choices only
        table = self._document.drapes.table(number)
        self.by.addItems(dict.fromkeys(["", *(() if table is None else table.fields), layer["by"]]))
        self.by.setCurrentText(layer["by"])
        self.classify.setEnabled(bool(layer["by"]))
        self._show_class(min(self._index, len(layer.classes) - 1))

    def _show_class(self, index: int) -> None:
        self._index, layer = index, self._layer
        self.classes.clear()
        for at in range(-1, len(layer.classes)):
            style = layer.style_of(at)
            title = _OTHERS if at < 0 else layer.classes[at].value or "(empty)"
            self.classes.addItem(QIcon(colour_swatch(style["colour"], style["fill"], 16)), title)
        self.classes.setCurrentIndex(index + 1)
        for widget in (self.remove, self.value):
            widget.setVisible(index >= 0)
        self.add.setEnabled(bool(layer["by"]))
        own = layer.style if index < 0 else layer.classes[index].style
        if index >= 0:
            self.value.show_value(layer.classes[index].value)
        self.style_form.show_values(layer.style_of(index))
        for name, field in self.style_form.rows.items():
            field.show_reset(name in own if index >= 0 else own[name] != STYLE[name].default)

    def _set(self, name: str, value: Value | None, key: object = None) -> None:
        """Set a value of the layer, or a style of the shown class; None is the default, or the layer's."""
        default = {**DRAPE, **STYLE}[name].default
        changes: dict[str, Any] = {name: default if value is None else value}
        with reported(self._document.message.emit, self.refresh):
            if self._index >= 0 and name in STYLE:
                style = {**self._layer.classes[self._index].style, name: value}
                own = {each: given for each, given in style.items() if given is not None}
                changes = self._with_class(self._index, replace(self._layer.classes[self._index], style=own))
            title = f"Set {name.replace('_', ' ')} of"
            model.change_drape(self._document, self._number, title, merge=key, **changes)

    def _with_class(self, index: int, *changed: DrapeClass) -> dict[str, Any]:
        """Return the change that replaces a class by its index, adds one after the last, or removes one."""
        classes = self._layer.classes
        return {"classes": (*classes[:index], *changed, *classes[index + 1 :])}

    def _classify(self) -> None:
        with reported(self._document.message.emit, self.refresh):
            model.classify(self._document, self._number, self._layer["by"])

    def _set_class(self, index: int, value: str | None) -> None:
        """Set the value of a class, add one after the last, or remove one."""
        classes = self._layer.classes
        style = classes[index].style if index < len(classes) else {"colour": model.distinct_colour(index)}
        with reported(self._document.message.emit, self.refresh):
            changes = self._with_class(index, *(() if value is None else (DrapeClass(value, style),)))
            self._index = min(index, len(changes["classes"]) - 1)
            model.change_drape(self._document, self._number, "Set classes of", **changes)
