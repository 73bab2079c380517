"""Properties of the selection, or of the active label without one."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from PyQt6.QtCore import QSignalBlocker
from PyQt6.QtWidgets import QLabel, QPushButton, QVBoxLayout, QWidget

from sketchterrain.document.edits import ACTIONS, ADDED_BIT
from sketchterrain.document.own_materials import with_materials
from sketchterrain.landforms.placement.feature_types import FILL_BIT, River
from sketchterrain.schema.layers import LAYERS, layer_of
from sketchterrain.schema.parameters import Parameter, Value
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
from sketchterrain.ui.panels.drapes import DrapePage
from sketchterrain.ui.panels.feature_page import FeaturePage
from sketchterrain.ui.panels.form import NumberRow, ParameterForm

_SHAPE = ACTIONS["add"].required
_HEIGHT = replace(_SHAPE["strength"], name="height", low=0.0, unit="m", help="from foot to top")
_DENSITY = replace(
    _SHAPE["strength"], name="density", high=1.0, help="share of the trees that the ground can carry"
)
_RADIUS = replace(_SHAPE["radius"], help="how far it extends from its centre")


class PlacedForm(QWidget):
    """Numbers of a placed object: a feature, a river and one of its control points, or a lake.

    `line` describes it; `layer` and `label` are those of its swatch.
    """

    def __init__(self, document: Document, workspace: Workspace) -> None:
        super().__init__()
        self._document, self._workspace = document, workspace
        self._shown: tuple[Placement, Selection] | None = None
        self._pending: tuple[Placement, Selection, float, float] | None = None  # a moved control point
        self.layer, self.label, self.line = "", 1, ""
        self.rows = {
            "height": NumberRow(_HEIGHT, has_reset=False, decimals=1),
            "density": NumberRow(_DENSITY, has_reset=False, decimals=2),
            "radius": NumberRow(_RADIUS, has_reset=False, decimals=1),
            "width": NumberRow(ACTIONS["width"].required["width"], has_reset=False, decimals=1),
            "x": NumberRow(_SHAPE["x"], title="East", has_reset=False, decimals=1),
            "y": NumberRow(_SHAPE["y"], title="North", has_reset=False, decimals=1),
        }
        self.points = described(
            NumberBox(0, 0, decimals=0),
            "Control point",
            "The river runs through its control points, from the spring, 1, to the mouth",
        )
        self.points.setSpecialValueText("none")
        self._points, self._note = QWidget(), faint_label()
        title = QLabel("Control &point")
        title.setBuddy(self.points)
        row(self._points, (title, 1), self.points)
        *sizes, x, y = self.rows.values()
        column(self, *sizes, self._points, x, y, self._note)
        self.points.valueChanged.connect(self._select_point)
        for name, field in self.rows.items():
            field.edited.connect(partial(self._apply, name))

    def show_selection(self, placed: Placement, selection: Selection) -> None:
        if self._shown is not None and self._shown[1] != selection:
            for field in self.rows.values():
                field.finish()  # the text being typed is for the previous object
        self._shown = placed, selection
        self.label, shown = 1, set[str]()
        point, river = commands.find_point(placed, selection), commands.find_river(placed, selection)
        lake = commands.find_lake(placed, selection)
        if point is not None:
            self.layer, self.line = commands.name_of(placed, selection), _origin(selection.id)
            self._show_feature(point)
            shown = {"density" if LAYERS[self.layer].is_share else "height", "radius", "x", "y"}
        elif river is not None:
            self.layer, self.label = layer_of(river.id), max(river.label, 1)
            self._show_river(placed, river, selection)
            shown = {"width", "x", "y"}
        elif lake is not None:
            self.layer, self.label = layer_of(lake.id), max(lake.label, 1)  # 0: filled by a river
            self.line = f"painted with label {lake.label}" if lake.label else "filled by a river"
            self._note.setText(
                f"Water level: {number(lake.level, decimals=1)} m, as high as its rim allows. "
                f"Depth: {number(lake.depth, decimals=1)} m."
            )
        for name, field in self.rows.items():
            field.setVisible(name in shown)
        self._points.setVisible(river is not None)
        self._note.setVisible(point is None)

    def _show_feature(self, point: np.void) -> None:
        east, north = self._document.sketch.size
        self.rows["radius"].set_slider_range(max(east, north) / 1000, max(east, north))
        values = commands.values_of(self._document.sketch, point)
        height = values.pop("strength")
        self._show_place(values.pop("x"), values.pop("y"), is_enabled=True)
        for name, value in {**values, "height": height, "density": min(height, 1.0)}.items():
            self.rows[name].show_value(value)

    def _show_river(self, placed: Placement, river: River, selection: Selection) -> None:
        steps = np.diff(river.centreline[:, :2], axis=0)
        length = float(np.hypot(steps[:, 0], steps[:, 1]).sum())
        self.line = f"{number(length / 1000, decimals=2)} km, painted with label {river.label}"
        width = commands.width_of(self._document.sketch, placed, selection) or float(np.median(river.width))
        self.rows["width"].show_value(width)
        index, count = selection.index, len(river.points)
        with QSignalBlocker(self.points):
            self.points.setSuffix(f" of {count}")
            self.points.setRange(0, count)
            self.points.setValue(0 if index is None else index + 1)
        if index is None or not 0 <= index < count:
            for name in ("x", "y"):
                self.rows[name].setEnabled(False)
            self._note.setText("Select a control point here, in the sketch or in the view to move it.")
            return
        joins = index == count - 1 and commands.find_parent_river(placed, river) is not None
        x, y, level = river.points[index].tolist()[:3]
        if self._pending is not None and self._pending[0] is placed and self._pending[1] == selection:
            x, y = self._pending[2:]
        self._show_place(x, y, is_enabled=not joins)
        self._note.setText(
            "Here it joins another river, and follows it."
            if joins
            else f"Water level: {number(level, decimals=1)} m."
        )

    def _show_place(self, x: float, y: float, *, is_enabled: bool) -> None:
        for name, end, value in zip(("x", "y"), self._document.sketch.size, (x, y), strict=True):
            self.rows[name].setEnabled(is_enabled)
            self.rows[name].set_slider_range(0.0, end)
            self.rows[name].show_value(value)

    def _select_point(self, number: float) -> None:
        if self._shown is not None:
            index = int(number) - 1 if number else None
            self._workspace.selection = replace(self._shown[1], index=index)

    def _apply(self, name: str, value: float, key: object) -> None:
        if self._shown is None:
            return
        (placed, selection), sketch = self._shown, self._document.sketch
        kind = commands.name_of(placed, selection)
        position = {each: self.rows[each].number for each in ("x", "y")} | {name: value}
        x, y = position["x"], position["y"]
        if name == "width":
            changed, title = commands.widened(sketch, selection, value), f"Set the width of {kind}"
        elif selection.kind == "course":
            changed, title = commands.point_moved(sketch, placed, selection, x, y), f"Move a point of {kind}"
            self._pending = placed, selection, x, y
        elif name in ("x", "y"):
            changed = commands.with_values(sketch, placed, selection, "move", x=x, y=y)
            title = f"Move {kind}"
        elif name == "radius":
            changed = commands.with_values(sketch, placed, selection, "resize", radius=value)
            title = f"Resize {kind}"
        else:
            changed = commands.with_values(sketch, placed, selection, "strength", strength=value)
            title = f"Set {name} of {kind}"
        self._document.do(title, changed, merge=key)


def _origin(feature: int) -> str:
    if feature & int(FILL_BIT):
        return "placed in unpainted terrain"
    return "added by hand" if feature & ADDED_BIT else "placed where it was painted"


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
        self.form = PlacedForm(document, workspace)
        self._note = faint_label("Locked: painting does not change it.")
        self.lock = _button("lock", "Loc&k", "Leave it as it is, whatever is painted")
        self.lock.setCheckable(True)
        self.reset = _button("reset", "&Reset", "Restore it as it was generated")
        self.delete = _button("delete", "&Delete", "Delete it; undo restores it")
        self.lock.toggled.connect(lambda on: self._apply(lock if on else unlock))
        self.reset.clicked.connect(partial(self._apply, reset))
        self.delete.clicked.connect(partial(self._apply, delete))
        buttons = row(None, (self.lock, 1), (self.reset, 1), (self.delete, 1), spacing=SMALL)
        column(self, self._head, self.form, self._note, buttons, spacing=MARGIN)
        document.sketch_changed.connect(self.refresh)
        workspace.selection_changed.connect(self.refresh)
        link.placed_changed.connect(self.refresh)
        self.refresh()

    def refresh(self, *_: object) -> None:
        selection = self._workspace.selection
        if selection is None or not selection.is_placed:
            return
        placed, selection = self._link.placed, self._existing_selection()
        self.form.setVisible(selection is not None)
        for button in (self.lock, self.reset, self.delete):
            button.setEnabled(selection is not None)
        if selection is None:
            self._head.show_text("Gone", "The selection no longer exists.")
            self._note.hide()
            return
        self.form.show_selection(placed, selection)
        title = commands.name_of(placed, selection).capitalize()
        self._head.show_text(title, self.form.line, (self.form.layer, self.form.label))
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
        self.feature_page = FeaturePage(document, workspace)
        self.drape_page = DrapePage(document, workspace)
        self.label_page = LabelPage(document, workspace)
        self.back = QPushButton()
        self.back.setToolTip("Clear the selection and show the active label")
        self.back.clicked.connect(self._clear_selection)
        pages = self.selection_page, self.feature_page, self.drape_page
        self.add(*pages, self.back, self.label_page)
        self._pages = *pages, self.label_page
        workspace.selection_changed.connect(self._refresh)
        workspace.label_changed.connect(self._refresh)
        self._refresh()

    def _refresh(self) -> None:
        selection = self._workspace.selection
        shown: QWidget = self.label_page
        if selection is not None and selection.is_draped and selection.id < 0:
            shown = self.drape_page
        elif selection is not None:
            shown = self.selection_page if selection.is_placed else self.feature_page
        for page in self._pages:
            page.setVisible(page is shown)
        self.back.setVisible(selection is not None)
        title = f"Back to {label_title(self._workspace.layer, self._workspace.label).lower()}"
        self.back.setText(title)
        self.back.setAccessibleName(title)

    def _clear_selection(self) -> None:
        self._workspace.selection = None
