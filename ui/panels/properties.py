"""Properties of the selection, or of the active label without one."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from PyQt6.QtCore import QSignalBlocker
from PyQt6.QtWidgets import QComboBox, QLabel, QPushButton, QWidget

from sketchterrain.document.edits import ACTIONS, ADDED_BIT
from sketchterrain.document.own_materials import with_materials
from sketchterrain.document.sketch import Sketch
from sketchterrain.features.edits import change_layer, network_layers
from sketchterrain.features.table import AREA, KINDS, LINE, POINT, vector_parameters
from sketchterrain.geometry.splines import arc_length
from sketchterrain.landforms.placement.feature_types import FILL_BIT, River
from sketchterrain.schema.layers import LAYERS, layer_of
from sketchterrain.schema.parameters import Parameter, Sentinel, Value, parameter_table
from sketchterrain.ui import commands
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.engine.protocol import Placement
from sketchterrain.ui.look.theme import MARGIN, SMALL, column, described, icon, row
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.features import SelectedFeature, change_features, refusal, set_property
from sketchterrain.ui.models.selection import delete, lock, reset, unlock
from sketchterrain.ui.models.workspace import Selection, Workspace
from sketchterrain.ui.panels.controls import (
    PageHead,
    ScrollingPanel,
    faint_label,
    label_title,
    number,
    scroll_past,
    title_from_key,
)
from sketchterrain.ui.panels.drapes import DrapePage
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
    length = float(arc_length(river.centreline)[-1])
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
            self.form.finish()
            self.form.declare(())
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


_NAME = Parameter("name", str, "", 0, 200, "characters", "")
_TEXT = Parameter("text", str, "", 0, 10_000, "", "")
_HELP = {
    "smooth": "its vertices are the control points of a smooth curve",
    "directed": "it runs from its first vertex to its last one, not downhill",
}
_OF_LINES = ("width", *_HELP)


class FeaturePage(QWidget):
    """Label, name and properties of a feature; those that are not its own are its label's.

    Properties of a draped feature are texts; their values keep their types.
    """

    def __init__(self, document: Document, workspace: Workspace) -> None:
        super().__init__()
        self._document, self._workspace = document, workspace
        self._shown: SelectedFeature | None = None
        self._head, self.form = PageHead(), ParameterForm()
        tip = "Its label, which it has properties of; of roads, railways and paths the kind of way too"
        self.label = described(scroll_past(QComboBox()), "Label", tip)
        title = QLabel("La&bel")
        title.setBuddy(self.label)
        self._labels = QWidget()
        row(self._labels, (title, 1), self.label)
        column(self, self._head, self._labels, self.form, spacing=MARGIN)
        self.form.edited.connect(self._set)
        self.label.activated.connect(lambda _: self._set_label(*self.label.currentData()))
        signals = document.sketch_changed, document.drapes.changed, workspace.selection_changed
        for signal in (*signals, workspace.look_changed):
            signal.connect(self.refresh)
        self.refresh()

    def refresh(self, *_: object) -> None:
        selection, before = self._workspace.selection, self._shown
        if before is not None and (selection is None or replace(selection, index=None) != before.whole):
            self.form.finish()  # the text being typed is for the previous one
        own = self._shown = SelectedFeature.find(self._document, selection)
        problem = "" if own is None else refusal(self._document, self._workspace, own.selection)
        self.setEnabled(own is not None and not problem)
        self.form.setToolTip(problem)
        if own is None:
            self._head.show_text("Gone", "The selection no longer exists.")
            self.form.declare(())
        elif own.selection.is_vector:
            self._show_vector(own, own.selection.kind)
        else:
            self._show_draped(own, own.table.fields)

    def _show_vector(self, shown: SelectedFeature, name: str) -> None:
        sketch, own, feature = self._document.sketch, shown.feature.properties, shown.feature
        layer, own_label = LAYERS[name], (name, feature.label)
        title = str(own.get("name", layer.title if layer.kind == "land" else name.capitalize()))
        self._head.show_text(title, _size(shown), own_label)
        self._labels.show()
        labels = {
            (each, label)
            for each in network_layers(name)
            for label in commands.labels_of(sketch, each) or [1]
        }
        ordered = sorted(labels | {own_label}, key=lambda pair: (pair[0] != name, *pair))
        self.label.clear()
        for pair in ordered:
            self.label.addItem(label_title(*pair), pair)
        self.label.setCurrentIndex(ordered.index(own_label))
        left_out = "flow" if layer.is_water else "directed"
        declared = with_materials(vector_parameters(name), sketch.material_table)
        rows = [
            replace(each, help=_HELP.get(key, each.help)) for key, each in declared.items() if key != left_out
        ]
        if layer.is_painted:  # but vectors are not: no width is as wide as painted
            rows = [replace(each, sentinel=None) for each in rows]
        self.form.declare([_NAME, *rows])
        values = {"name": "", "smooth": 0, "directed": 0, **sketch.properties(name, feature.label), **own}
        self.form.show_values(values)
        for key, field in self.form.rows.items():
            field.setVisible(feature.kind == LINE or key not in _OF_LINES)
            field.show_reset(key in own, "Back to its label's")

    def _show_draped(self, own: SelectedFeature, fields: Iterable[str]) -> None:
        selection, feature = own.selection, own.feature
        title = self._document.sketch.drapes[selection.layer].title
        self._head.show_text(f"{KINDS[feature.kind].capitalize()} {feature.id} of {title}", _size(own))
        self._labels.hide()
        names = dict.fromkeys([*fields, *feature.properties])
        self.form.declare(
            (replace(_TEXT, name=name) for name in names), titles={name: name for name in names}
        )
        self.form.show_values({name: str(feature.properties.get(name, "")) for name in names})
        for name, field in self.form.rows.items():
            field.show_reset(name in feature.properties, "Remove its value")

    def _set_label(self, layer: str, label: int) -> None:
        """Set the label, of a way also its kind: it moves to the layer of that."""
        own, target = self._shown, self._document.sketch.vectors[layer]
        if own is None or layer == own.selection.kind:
            self._set("label", label, object())
        elif own.selection.is_vector:
            changed = change_layer(own.table, target, own.selection.id, label)
            title = f"Make {label_title(layer, label).lower()} of"
            change_features(self._document, self._workspace, title, own.selection, *changed)
            self._workspace.selection = Selection(layer, int(changed[1].ids[-1]))

    def _set(self, name: str, value: Value | None, key: object) -> None:
        shown = self._shown
        own = None if shown is None else SelectedFeature.find(self._document, shown.selection)
        if own is not None:
            with commands.reported(self._document.message.emit, self.refresh):
                set_property(self._document, self._workspace, own, name, value, key)


def _size(own: SelectedFeature) -> str:
    """Return length or area, and how many vertices there are."""
    if own.feature.kind == POINT:
        return ""
    length, area = number(own.shape.length / 1000, decimals=2), number(own.shape.area / 1e6, decimals=2)
    return f"{f'{area} km²' if own.feature.kind == AREA else f'{length} km'}, {len(own.places)} vertices"


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
