"""Properties of the selected vector."""

from dataclasses import replace

from PyQt6.QtWidgets import QComboBox, QLabel, QWidget

from sketchterrain.document.parameters import Parameter, Value
from sketchterrain.document.vector_edits import set_value, vertices_of
from sketchterrain.document.vectors import LINE, VECTOR_LAYERS, VectorLayer, vector_parameters
from sketchterrain.ui import commands
from sketchterrain.ui.look.theme import MARGIN, column, described, row
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.vectors import change_vectors, curves_of, find_vector
from sketchterrain.ui.models.workspace import Selection, Workspace
from sketchterrain.ui.panels.controls import PageHead, label_title, number, scroll_past, title_from_key
from sketchterrain.ui.panels.form import ParameterForm

_NAME = Parameter("name", str, "", 0, 200, "characters", "")
_HELP = {
    "width": "from bank to bank",
    "smooth": "its vertices are the control points of a smooth curve",
    "directed": "it runs from its first vertex to its last one, not downhill",
}
_OF_LINES = tuple(_HELP)


class VectorPage(QWidget):
    """Label, name and properties of a vector; those that are not its own are its label's."""

    def __init__(self, document: Document, workspace: Workspace) -> None:
        super().__init__()
        self._document, self._workspace = document, workspace
        self._shown: Selection | None = None
        self._head = PageHead()
        self.label = described(scroll_past(QComboBox()), "Label", "Its label, which it has properties of")
        title = QLabel("La&bel")
        title.setBuddy(self.label)
        self.forms = {name: _form(name) for name in VECTOR_LAYERS}
        column(self, self._head, row(None, (title, 1), self.label), *self.forms.values(), spacing=MARGIN)
        for form in self.forms.values():
            form.edited.connect(self._set)
            form.reset_requested.connect(lambda name: self._set(name, None, object()))
        self.label.activated.connect(lambda _: self._set("label", self.label.currentData(), object()))
        for signal in (document.sketch_changed, workspace.selection_changed, workspace.look_changed):
            signal.connect(self.refresh)
        self.refresh()

    def refresh(self, *_: object) -> None:
        selection, sketch = self._workspace.selection, self._document.sketch
        before = self._shown
        if before is not None and (selection is None or replace(before, index=selection.index) != selection):
            self.forms[before.kind].finish()  # the text being typed is for the previous one
        self._shown = None
        if selection is None or not selection.is_vector:
            return
        feature = find_vector(sketch, selection)
        self.setEnabled(feature is not None and not self._workspace.refusal(selection.kind))
        if feature is None:
            self._head.show_text("Gone", "The selection no longer exists.")
            return
        self._shown = selection
        name, own = selection.kind, feature.properties
        self._head.show_text(
            str(own.get("name", name.capitalize())),
            _facts(sketch.vectors[name], selection.id),
            (name, feature.label),
        )
        self.label.clear()
        for label in sorted({*commands.labels_of(sketch, name), feature.label}):
            self.label.addItem(label_title(name, label), label)
        self.label.setCurrentIndex(self.label.findData(feature.label))
        values = {"name": "", "smooth": 0, "directed": 0, **sketch.properties(name, feature.label), **own}
        for each, form in self.forms.items():
            form.setVisible(each == name)
        self.forms[name].show_values(values)
        for key, field in self.forms[name].rows.items():
            field.setVisible(feature.kind == LINE or key not in _OF_LINES)
            if field.reset is not None:
                field.reset.setVisible(key in own)

    def _set(self, name: str, value: Value | None, key: object) -> None:
        shown, sketch = self._shown, self._document.sketch
        if shown is not None and find_vector(sketch, shown) is not None:
            own = None if value == "" else value
            changed = set_value(sketch.vectors[shown.kind], shown.id, name, own)
            title = f"Set {title_from_key(name).lower()} of"
            change_vectors(self._document, self._workspace, title, changed, merge=key)


def _form(layer: str) -> ParameterForm:
    declared = {name: each for name, each in vector_parameters(layer).items() if name != "flow"}
    # Without the sentinel of a width: nothing is painted.
    rows = [replace(each, help=_HELP.get(name, each.help), sentinel=None) for name, each in declared.items()]
    form = ParameterForm([_NAME, *rows])
    for field in form.rows.values():
        if field.reset is not None:
            field.reset.setToolTip("Back to its label's")
    return form


def _facts(layer: VectorLayer, name: int) -> str:
    """Return length or area, and how many vertices there are."""
    shape = curves_of(layer).shapes[layer.index(name)]
    length, area = number(shape.length / 1000, decimals=2), number(shape.area / 1e6, decimals=2)
    size = f"{area} km²" if shape.area > 0.0 else f"{length} km"
    return f"{size}, {len(vertices_of(layer, name))} vertices"
