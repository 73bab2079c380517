"""Properties of the selection, or of the active label without one."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from PyQt6.QtCore import QSignalBlocker
from PyQt6.QtWidgets import QLabel, QPushButton, QVBoxLayout, QWidget

from sketchterrain.document.edits import ACTIONS, ADDED_BIT
from sketchterrain.document.layers import LAYERS, POINT_LAYERS, layer_of
from sketchterrain.document.own_materials import with_materials
from sketchterrain.document.parameters import Parameter, Value
from sketchterrain.landforms.placement.feature_types import FILL_BIT, River
from sketchterrain.ui import commands
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.engine.protocol import Placement
from sketchterrain.ui.look.theme import MARGIN, SMALL, column, described, icon, row
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.selection import delete, lock, reset, unlock
from sketchterrain.ui.models.workspace import Selection, Workspace
from sketchterrain.ui.panels.controls import (
    NumberBox,
    PageHead,
    ScrollingPanel,
    faint_label,
    label_title,
    number,
    title_from_key,
)
from sketchterrain.ui.panels.drapes import DrapedFeaturePage, DrapePage
from sketchterrain.ui.panels.form import NumberRow, ParameterForm
from sketchterrain.ui.panels.vector_page import VectorPage

_SHAPE = ACTIONS["add"].required
_HEIGHT = replace(_SHAPE["strength"], name="height", low=0.0, unit="m", help="from foot to top")
_DENSITY = replace(
    _SHAPE["strength"], name="density", high=1.0, help="share of the trees that the ground can carry"
)
_RADIUS = replace(_SHAPE["radius"], help="how far it extends from its centre")
_X, _Y = _SHAPE["x"], _SHAPE["y"]


class FeatureForm(QWidget):
    """Position, size and strength of a feature."""

    def __init__(self, document: Document) -> None:
        super().__init__()
        self._document = document
        self._shown: tuple[Placement, Selection] | None = None
        self.layer, self.label, self.line = POINT_LAYERS[0], 1, ""
        self.rows = {
            "height": NumberRow(_HEIGHT, has_reset=False, decimals=1),
            "density": NumberRow(_DENSITY, has_reset=False, decimals=2),
            "radius": NumberRow(_RADIUS, has_reset=False, decimals=1),
            "x": NumberRow(_X, title="East", has_reset=False, decimals=1),
            "y": NumberRow(_Y, title="North", has_reset=False, decimals=1),
        }
        column(self, *self.rows.values())
        for name, field in self.rows.items():
            field.edited.connect(partial(self._apply, name))

    def show_selection(self, placed: Placement, selection: Selection) -> None:
        point = commands.find_point(placed, selection)
        if point is None:
            return
        if self._shown is not None and self._shown[1] != selection:
            for field in self.rows.values():
                field.finish()  # the text being typed is for the previous feature
        self._shown = placed, selection
        self.layer, self.line = commands.name_of(placed, selection), _origin(selection.id)
        east, north = self._document.sketch.size
        self.rows["x"].set_slider_range(0.0, east)
        self.rows["y"].set_slider_range(0.0, north)
        self.rows["radius"].set_slider_range(max(east, north) / 1000, max(east, north))
        values = commands.values_of(self._document.sketch, point)
        height = values.pop("strength")
        for name, value in {**values, "height": height, "density": min(height, 1.0)}.items():
            self.rows[name].show_value(value)
        self.rows["height"].setVisible(not LAYERS[self.layer].is_share)
        self.rows["density"].setVisible(LAYERS[self.layer].is_share)

    def _apply(self, name: str, value: float, key: object) -> None:
        if self._shown is None:
            return
        placed, selection = self._shown
        kind = commands.name_of(placed, selection)
        action, values, title = "strength", {"strength": value}, f"Set {name} of {kind}"
        if name in ("x", "y"):
            position = {each: self.rows[each].number for each in ("x", "y")}
            action, values, title = "move", position | {name: value}, f"Move {kind}"
        elif name == "radius":
            action, values, title = "resize", {"radius": value}, f"Resize {kind}"
        changed = commands.with_values(self._document.sketch, placed, selection, action, **values)
        self._document.do(title, changed, merge=key)


def _origin(feature: int) -> str:
    if feature & int(FILL_BIT):
        return "placed in unpainted terrain"
    return "added by hand" if feature & ADDED_BIT else "placed where it was painted"


class RiverForm(QWidget):
    """The width of a river and the position of one control point."""

    def __init__(self, document: Document, workspace: Workspace) -> None:
        super().__init__()
        self._document, self._workspace = document, workspace
        self._shown: tuple[Placement, Selection] | None = None
        self._pending: tuple[Placement, Selection, float, float] | None = None  # a moved point
        self.layer, self.label, self.line = "", 1, ""
        self.width_row = NumberRow(ACTIONS["width"].required["width"], has_reset=False, decimals=1)
        self.points = described(
            NumberBox(0, 0, decimals=0),
            "Control point",
            "The river runs through its control points, from the spring, 1, to the mouth",
        )
        self.points.setSpecialValueText("none")
        self.east = NumberRow(_X, title="East", has_reset=False, decimals=1)
        self.north = NumberRow(_Y, title="North", has_reset=False, decimals=1)
        self._note = faint_label()
        title = QLabel("Control &point")
        title.setBuddy(self.points)
        points = row(None, (title, 1), self.points)
        column(self, self.width_row, points, self.east, self.north, self._note)
        self.points.valueChanged.connect(self._select_point)
        self.width_row.edited.connect(self._set_width)
        self.east.edited.connect(lambda value, key: self._move(float(value), self.north.number, key))
        self.north.edited.connect(lambda value, key: self._move(self.east.number, float(value), key))

    def show_selection(self, placed: Placement, selection: Selection) -> None:
        river = commands.find_river(placed, selection)
        if river is None:
            return
        if self._shown is not None and self._shown[1] != selection:
            for field in (self.width_row, self.east, self.north):
                field.finish()  # the text being typed is for the previous river
        self._shown = placed, selection
        self.layer, self.label = layer_of(river.id), max(river.label, 1)
        steps = np.diff(river.centreline[:, :2], axis=0)
        length = float(np.hypot(steps[:, 0], steps[:, 1]).sum())
        self.line = f"{number(length / 1000, decimals=2)} km, painted with label {river.label}"
        width = commands.width_of(self._document.sketch, placed, selection) or float(np.median(river.width))
        self.width_row.show_value(width)
        with QSignalBlocker(self.points):
            self.points.setSuffix(f" of {len(river.points)}")
            self.points.setRange(0, len(river.points))
            self.points.setValue(0 if selection.index is None else selection.index + 1)
        self._show_point(placed, river, selection)

    def _show_point(self, placed: Placement, river: River, selection: Selection) -> None:
        index, count = selection.index, len(river.points)
        is_point = index is not None and 0 <= index < count
        joins = is_point and index == count - 1 and commands.find_parent_river(placed, river) is not None
        for field in (self.east, self.north):
            field.setEnabled(is_point and not joins)
        if index is None or not is_point:
            self._note.setText("Select a control point here, in the sketch or in the view to move it.")
            return
        x, y, level = river.points[index].tolist()[:3]
        if self._pending is not None and self._pending[0] is placed and self._pending[1] == selection:
            x, y = self._pending[2:]
        for field, end, value in zip(
            (self.east, self.north), self._document.sketch.size, (x, y), strict=True
        ):
            field.set_slider_range(0.0, end)
            field.show_value(value)
        self._note.setText(
            "Here it joins another river, and follows it."
            if joins
            else f"Water level: {number(level, decimals=1)} m."
        )

    def _select_point(self, number: float) -> None:
        if self._shown is not None:
            index = int(number) - 1 if number else None
            self._workspace.selection = replace(self._shown[1], index=index)

    def _set_width(self, width: float, key: object) -> None:
        if self._shown is not None:
            changed = commands.widened(self._document.sketch, self._shown[1], width)
            self._document.do(f"Set the width of {commands.name_of(*self._shown)}", changed, merge=key)

    def _move(self, x: float, y: float, key: object) -> None:
        if self._shown is not None:
            changed = commands.point_moved(self._document.sketch, *self._shown, x, y)
            self._pending = (*self._shown, x, y)
            self._document.do(f"Move a point of {commands.name_of(*self._shown)}", changed, merge=key)


class LakeForm(QWidget):
    """Level and depth of a lake."""

    def __init__(self) -> None:
        super().__init__()
        self.layer, self.label, self.line = "", 1, ""
        self._text = faint_label()
        column(self, self._text)

    def show_selection(self, placed: Placement, selection: Selection) -> None:
        lake = commands.find_lake(placed, selection)
        if lake is None:
            return
        self.layer, self.label = layer_of(lake.id), max(lake.label, 1)  # 0: not painted but filled by a river
        self.line = f"painted with label {lake.label}" if lake.label else "filled by a river"
        self._text.setText(
            f"Water level: {number(lake.level, decimals=1)} m, as high as its rim allows. "
            f"Depth: {number(lake.depth, decimals=1)} m."
        )


class LabelPage(QWidget):
    """A form for each layer's declared parameters; that of the active layer is visible."""

    def __init__(self, document: Document, workspace: Workspace) -> None:
        super().__init__()
        self._document, self._workspace = document, workspace
        self._head = PageHead()
        self.forms: dict[str, ParameterForm] = {}
        self._declared: dict[str, Mapping[str, Parameter]] = {}
        self._shown: tuple[str, int] | None = None
        self._column: QVBoxLayout = column(self, self._head, spacing=MARGIN)
        workspace.label_changed.connect(self._show)
        document.sketch_changed.connect(self._show)
        self._show()

    def _show(self) -> None:
        layer, label = self._workspace.layer, self._workspace.label
        if self._shown != (layer, label) and self._shown is not None:
            self.forms[self._shown[0]].finish()  # the text being typed is for the previous label
        self._shown = (layer, label)
        self._head.show_text(label_title(layer, label), LAYERS[layer].help, (layer, label))
        parameters = with_materials(LAYERS[layer].parameters, self._document.sketch.material_table)
        if self._declared.get(layer, parameters) != parameters:  # the sketch has other materials
            self.forms.pop(layer).deleteLater()
        if layer not in self.forms:
            self._declared[layer] = parameters
            form = self.forms[layer] = ParameterForm(parameters.values())
            form.edited.connect(self._set)
            self._column.addWidget(form)
        self.forms[layer].show_values(self._document.sketch.properties(layer, label))
        for name, form in self.forms.items():
            form.setVisible(name == layer)

    def _set(self, name: str, value: Value | None, key: object) -> None:
        if self._shown is not None:
            changed = commands.set_property(self._document.sketch, *self._shown, name, value)
            verb, title = "Reset" if value is None else "Set", title_from_key(name).lower()
            self._document.do(f"{verb} {title} of {label_title(*self._shown).lower()}", changed, merge=key)


class SelectionPage(QWidget):
    """Form and actions for the selected feature, river or lake."""

    def __init__(self, document: Document, workspace: Workspace, link: EngineLink) -> None:
        super().__init__()
        self._document, self._workspace, self._link = document, workspace, link
        self._head = PageHead()
        self.forms: dict[str, FeatureForm | RiverForm | LakeForm] = {
            "feature": FeatureForm(document),
            "course": RiverForm(document, workspace),
            "water": LakeForm(),
        }
        self._note = faint_label("Locked: painting does not change it.")
        self.lock = _button("lock", "Loc&k", "Leave it as it is, whatever is painted")
        self.lock.setCheckable(True)
        self.reset = _button("reset", "&Reset", "Restore it as it was generated")
        self.delete = _button("delete", "&Delete", "Delete it; undo restores it")
        self.lock.toggled.connect(lambda on: self._apply(lock if on else unlock))
        self.reset.clicked.connect(partial(self._apply, reset))
        self.delete.clicked.connect(partial(self._apply, delete))
        buttons = row(None, (self.lock, 1), (self.reset, 1), (self.delete, 1), spacing=SMALL)
        column(self, self._head, *self.forms.values(), self._note, buttons, spacing=MARGIN)
        document.sketch_changed.connect(self.refresh)
        workspace.selection_changed.connect(self.refresh)
        link.placed_changed.connect(self.refresh)
        self.refresh()

    def refresh(self, *_: object) -> None:
        selection = self._workspace.selection
        if selection is None or not selection.is_placed:
            return
        placed, selection = self._link.placed, self._existing_selection()
        for kind, form in self.forms.items():
            form.setVisible(selection is not None and kind == selection.kind)
        for button in (self.lock, self.reset, self.delete):
            button.setEnabled(selection is not None)
        if selection is None:
            self._head.show_text("Gone", "The selection no longer exists.")
            self._note.hide()
            return
        form = self.forms[selection.kind]
        form.show_selection(placed, selection)
        title = commands.name_of(placed, selection).capitalize()
        self._head.show_text(title, form.line, (form.layer, form.label))
        sketch, is_feature = self._document.sketch, selection.kind == "feature"
        locked = is_feature and commands.is_locked(sketch, selection)
        with QSignalBlocker(self.lock):
            self.lock.setChecked(locked)
        self.lock.setVisible(is_feature)
        self.lock.setText("Unloc&k" if locked else "Loc&k")
        self.reset.setEnabled(commands.is_edited(sketch, placed, selection))
        self._note.setVisible(locked)

    def _existing_selection(self) -> Selection | None:
        """Return the selection if it exists, without a control point that the river has no longer."""
        placed, selection = self._link.placed, self._workspace.selection
        if selection is None or not commands.exists(placed, selection):
            return None
        river = commands.find_river(placed, selection)
        is_gone = river is not None and selection.index is not None and selection.index >= len(river.points)
        return replace(selection, index=None) if is_gone else selection

    def _apply(
        self, command: Callable[[Document, Workspace, Placement, Selection], None], _: object = None
    ) -> None:
        placed, selection = self._link.placed, self._existing_selection()
        if selection is not None:
            command(self._document, self._workspace, placed, selection)


def _button(name: str, text: str, tip: str) -> QPushButton:
    return described(QPushButton(icon(name), text), text.replace("&", ""), tip)


class PropertiesPanel(ScrollingPanel):
    """Shows the page of the selection, or else that of the active label."""

    def __init__(self, document: Document, workspace: Workspace, link: EngineLink) -> None:
        super().__init__()
        self._workspace = workspace
        self.selection_page = SelectionPage(document, workspace, link)
        self.vector_page = VectorPage(document, workspace)
        self.drape_page = DrapePage(document, workspace)
        self.draped_feature_page = DrapedFeaturePage(document, workspace)
        self.label_page = LabelPage(document, workspace)
        self.back = QPushButton()
        self.back.setToolTip("Clear the selection and show the active label")
        self.back.clicked.connect(self._clear_selection)
        pages = self.selection_page, self.vector_page, self.drape_page, self.draped_feature_page
        self.add(*pages, self.back, self.label_page)
        self._pages = *pages, self.label_page
        workspace.selection_changed.connect(self._refresh)
        workspace.label_changed.connect(self._refresh)
        self._refresh()

    def _refresh(self) -> None:
        selection = self._workspace.selection
        shown: QWidget = self.label_page
        if selection is not None and selection.is_draped:
            shown = self.drape_page if selection.id < 0 else self.draped_feature_page
        elif selection is not None:
            shown = self.vector_page if selection.is_vector else self.selection_page
        for page in self._pages:
            page.setVisible(page is shown)
        self.back.setVisible(selection is not None)
        title = f"Back to {label_title(self._workspace.layer, self._workspace.label).lower()}"
        self.back.setText(title)
        self.back.setAccessibleName(title)

    def _clear_selection(self) -> None:
        self._workspace.selection = None
