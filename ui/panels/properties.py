"""Properties of the selection, or of the active label without one."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from PyQt6.QtCore import QSignalBlocker
from PyQt6.QtWidgets import QPushButton, QWidget

from sketchterrain.document.edits import ACTIONS, ADDED_BIT
from sketchterrain.document.own_materials import with_materials
from sketchterrain.document.sketch import Sketch
from sketchterrain.landforms.placement.feature_types import FILL_BIT, River
from sketchterrain.schema.layers import LAYERS, layer_of
from sketchterrain.schema.parameters import Parameter, Sentinel, Value, parameter_table
from sketchterrain.ui import commands
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.engine.protocol import Placement
from sketchterrain.ui.look.theme import MARGIN, SMALL, column, described, icon, row
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.selection import delete, lock, reset, unlock
from sketchterrain.ui.models.workspace import Selection, Workspace
from sketchterrain.ui.panels.controls import (
    PageHead,
    ScrollingPanel,
    faint_label,
    label_title,
    number,
    title_from_key,
)
from sketchterrain.ui.panels.drapes import DrapePage
from sketchterrain.ui.panels.feature_page import FeaturePage
from sketchterrain.ui.panels.form import ParameterForm

_SHAPE, _WIDTH = ACTIONS["add"].required, ACTIONS["width"].required["width"]
_TREES, _EXTENT = "share of the trees that the ground can carry", "how far it extends from its centre"
_POINTS = "the river runs through its control points, from the spring, 1, to the mouth"
_PARAMETERS = parameter_table(
    replace(_SHAPE["strength"], name="height", low=0.0, unit="m", help="from foot to top"),
    replace(_SHAPE["strength"], name="density", high=1.0, help=_TREES),
    *(replace(_SHAPE["radius"], help=_EXTENT), _WIDTH),
    Parameter("point", int, 0, 0, 1, "", _POINTS, sentinel=Sentinel(0, "None", 1)),
    *(_SHAPE["x"], _SHAPE["y"]),
)
_TITLES, _PLACE = {"point": "Control point", "x": "East", "y": "North"}, ("x", "y")


class _Shown(NamedTuple):
    """What its page shows of a placed object: a label, a line, values by parameters and a note."""

    label: tuple[str, int]
    line: str
    values: Mapping[str, float]
    note: str = ""
    is_fixed: bool = False  # whether it cannot be moved


def _describe(sketch: Sketch, placed: Placement, selection: Selection) -> _Shown:
    """Describe a feature, a river and one of its control points, or a lake."""
    point, river = commands.find_point(placed, selection), commands.find_river(placed, selection)
    if river is not None:
        return _describe_river(sketch, placed, selection, river)
    if point is not None:
        kind, values = commands.name_of(placed, selection), commands.values_of(sketch, point)
        height = values.pop("strength")
        main = {"density": min(height, 1.0)} if LAYERS[kind].is_share else {"height": height}
        return _Shown((kind, 1), _origin(selection.id), {**main, **values})
    lake = commands.find_lake(placed, selection)
    assert lake is not None  # noqa: S101 # the selection exists
    line = f"painted with label {lake.label}" if lake.label else "filled by a river"
    level, depth = (number(each, decimals=1) for each in (lake.level, lake.depth))
    note = f"Water level: {level} m, as high as its rim allows. Depth: {depth} m."
    return _Shown((layer_of(lake.id), max(lake.label, 1)), line, {}, note)


def _describe_river(sketch: Sketch, placed: Placement, selection: Selection, river: River) -> _Shown:
    length = float(np.hypot(*np.diff(river.centreline[:, :2], axis=0).T).sum())
    line = f"{number(length / 1000, decimals=2)} km, painted with label {river.label}"
    width = commands.width_of(sketch, placed, selection) or float(np.median(river.width))
    at, count, label = selection.index, len(river.points), (layer_of(river.id), max(river.label, 1))
    if at is None or not 0 <= at < count:
        note = "Select a control point here, in the sketch or in the view to move it."
        return _Shown(label, line, {"width": width, "point": 0, "x": 0.0, "y": 0.0}, note, is_fixed=True)
    x, y, level = river.points[at].tolist()[:3]
    joins = at == count - 1 and commands.find_parent_river(placed, river) is not None
    note = f"Water level: {number(level, decimals=1)} m."
    note = "Here it joins another river, and follows it." if joins else note
    return _Shown(label, line, {"width": width, "point": at + 1, "x": x, "y": y}, note, joins)


def _origin(feature: int) -> str:
    if feature & int(FILL_BIT):
        return "placed in unpainted terrain"
    return "added by hand" if feature & ADDED_BIT else "placed where it was painted"


class LabelPage(QWidget):
    """The declared parameters of the active label."""

    def __init__(self, document: Document, workspace: Workspace) -> None:
        super().__init__()
        self._document, self._workspace = document, workspace
        self._head, self.form = PageHead(), ParameterForm()
        self._shown = workspace.layer, workspace.label
        column(self, self._head, self.form, spacing=MARGIN)
        self.form.edited.connect(self._set)
        workspace.label_changed.connect(self._show)
        document.sketch_changed.connect(self._show)
        self._show()

    def _show(self) -> None:
        sketch, layer, label = self._document.sketch, self._workspace.layer, self._workspace.label
        if self._shown != (layer, label):
            self.form.finish()  # the text being typed is for the previous label
        self._shown = (layer, label)
        self._head.show_text(label_title(layer, label), LAYERS[layer].help, (layer, label))
        self.form.declare(with_materials(LAYERS[layer].parameters, sketch.material_table).values())
        self.form.show_values(sketch.properties(layer, label))

    def _set(self, name: str, value: Value | None, key: object) -> None:
        changed = commands.set_property(self._document.sketch, *self._shown, name, value)
        verb, title = "Reset" if value is None else "Set", title_from_key(name).lower()
        self._document.do(f"{verb} {title} of {label_title(*self._shown).lower()}", changed, merge=key)


class SelectionPage(QWidget):
    """Form and actions for the selected feature, river or lake."""

    def __init__(self, document: Document, workspace: Workspace, link: EngineLink) -> None:
        super().__init__()
        self._document, self._workspace, self._link = document, workspace, link
        self._shown: Selection | None = None
        self._moved: tuple[Placement, Selection, dict[str, float]] | None = None  # a control point
        self._head, self.form, self._text = PageHead(), ParameterForm(), faint_label()
        self._note = faint_label("Locked: painting does not change it.")
        self.lock = _button("lock", "Loc&k", "Leave it as it is, whatever is painted")
        self.lock.setCheckable(True)
        self.reset = _button("reset", "&Reset", "Restore it as it was generated")
        self.delete = _button("delete", "&Delete", "Delete it; undo restores it")
        self.form.edited.connect(self._set)
        self.lock.toggled.connect(lambda on: self._apply(lock if on else unlock))
        self.reset.clicked.connect(partial(self._apply, reset))
        self.delete.clicked.connect(partial(self._apply, delete))
        buttons = row(None, (self.lock, 1), (self.reset, 1), (self.delete, 1), spacing=SMALL)
        column(self, self._head, self.form, self._text, self._note, buttons, spacing=MARGIN)
        document.sketch_changed.connect(self.refresh)
        workspace.selection_changed.connect(self.refresh)
        link.placed_changed.connect(self.refresh)
        self.refresh()

    def refresh(self, *_: object) -> None:
        selection = self._workspace.selection
        if selection is None or not selection.is_placed:
            return
        if self._shown != selection:
            self.form.finish()  # the text being typed is for the previous object
        placed, selection = self._link.placed, self._existing_selection()
        self._shown = selection
        self.form.setVisible(selection is not None)
        for button in (self.lock, self.reset, self.delete):
            button.setEnabled(selection is not None)
        if selection is None:
            self._head.show_text("Gone", "The selection no longer exists.")
            for label in (self._text, self._note):
                label.hide()
            return
        sketch, is_feature = self._document.sketch, selection.kind == "feature"
        shown = _describe(sketch, placed, selection)
        self._head.show_text(commands.name_of(placed, selection).capitalize(), shown.line, shown.label)
        self._show_values(shown, placed, selection)
        self._text.setText(shown.note)
        self._text.setVisible(bool(shown.note))
        locked = is_feature and commands.is_locked(sketch, selection)
        with QSignalBlocker(self.lock):
            self.lock.setChecked(locked)
        self.lock.setVisible(is_feature)
        self.lock.setText("Unloc&k" if locked else "Loc&k")
        self.reset.setEnabled(commands.is_edited(sketch, placed, selection))
        self._note.setVisible(locked)

    def _show_values(self, shown: _Shown, placed: Placement, selection: Selection) -> None:
        (east, north), river = self._document.sketch.size, commands.find_river(placed, selection)
        count, longer = 1 if river is None else len(river.points), max(east, north)
        changes: dict[str, dict[str, Any]] = {
            "radius": {"soft_range": (longer / 1000, longer)},
            "point": {"high": count, "soft_range": (1, count), "unit": f"of {count}"},
            **{name: {"soft_range": (0.0, end)} for name, end in (("x", east), ("y", north))},
        }
        declared = [replace(_PARAMETERS[name], **changes.get(name, {})) for name in shown.values]
        self.form.declare(declared, titles=_TITLES, has_reset=False, decimals=2)
        is_moved = self._moved and self._moved[0] is placed and self._moved[1] == selection
        self.form.show_values({**shown.values, **(self._moved[2] if self._moved and is_moved else {})})
        for name in _PLACE if shown.values else ():
            self.form.rows[name].setEnabled(not shown.is_fixed)

    def _existing_selection(self) -> Selection | None:
        """Return the selection if it exists, without a control point that the river has no longer."""
        placed, selection = self._link.placed, self._workspace.selection
        if selection is None or not commands.exists(placed, selection):
            return None
        river = commands.find_river(placed, selection)
        is_gone = river is not None and selection.index is not None and selection.index >= len(river.points)
        return replace(selection, index=None) if is_gone else selection

    def _set(self, name: str, value: float, key: object) -> None:
        placed, selection, sketch = self._link.placed, self._shown, self._document.sketch
        if selection is None:
            return
        if name == "point":
            self._workspace.selection = replace(selection, index=int(value) - 1 if value else None)
            return
        kind = commands.name_of(placed, selection)
        place = {each: self.form.rows[each].number for each in _PLACE} | {name: value}
        if name == "width":
            changed, title = commands.widened(sketch, selection, value), f"Set the width of {kind}"
        elif selection.kind == "course":
            self._moved = placed, selection, place
            changed = commands.point_moved(sketch, placed, selection, place["x"], place["y"])
            title = f"Move a point of {kind}"
        elif name in _PLACE:
            changed, title = commands.with_values(sketch, placed, selection, "move", **place), f"Move {kind}"
        elif name == "radius":
            changed = commands.with_values(sketch, placed, selection, "resize", radius=value)
            title = f"Resize {kind}"
        else:
            changed = commands.with_values(sketch, placed, selection, "strength", strength=value)
            title = f"Set {name} of {kind}"
        self._document.do(title, changed, merge=key)

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
