"""Properties of the selected vector."""

from dataclasses import replace

from PyQt6.QtWidgets import QComboBox, QLabel, QWidget

from sketchterrain.document.own_materials import with_materials
from sketchterrain.features.edits import change_layer, network_layers, set_value
from sketchterrain.features.picking import curves_of
from sketchterrain.features.table import LINE, VectorLayer, vector_parameters
from sketchterrain.schema.layers import LAYERS, VECTOR_LAYERS
from sketchterrain.schema.parameters import Parameter, Value
from sketchterrain.ui.commands import labels_of
from sketchterrain.ui.look.theme import MARGIN, column, described, row
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.vectors import change_vectors, find_vector
from sketchterrain.ui.models.workspace import Selection, Workspace
from sketchterrain.ui.panels.controls import PageHead, label_title, number, scroll_past, title_from_key
from sketchterrain.ui.panels.form import ParameterForm

_NAME = Parameter("name", str, "", 0, 200, "characters", "")
_HELP = {
    "smooth": "its vertices are the control points of a smooth curve",
    "directed": "it runs from its first vertex to its last one, not downhill",
}
_OF_LINES = ("width", *_HELP)


class VectorPage(QWidget):
    """Label, name and properties of a vector; those that are not its own are its label's."""

    def __init__(self, document: Document, workspace: Workspace) -> None:
        super().__init__()
        self._document, self._workspace = document, workspace
        self._shown: Selection | None = None
        self._head = PageHead()
        tip = "Its label, which it has properties of; of roads, railways and paths the kind of way too"
        self.label = described(scroll_past(QComboBox()), "Label", tip)
        title = QLabel("La&bel")
        title.setBuddy(self.label)
        self._declared = {name: vector_parameters(name) for name in VECTOR_LAYERS}
        self.forms = {name: self._form(name) for name in VECTOR_LAYERS}
        labels = row(None, (title, 1), self.label)
        self._column = column(self, self._head, labels, *self.forms.values(), spacing=MARGIN)
        self.label.activated.connect(lambda _: self._set_label(*self.label.currentData()))
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
            str(own.get("name", LAYERS[name].title if LAYERS[name].kind == "land" else name.capitalize())),
            _facts(sketch.vectors[name], selection.id),
            (name, feature.label),
        )
        own_label = (name, feature.label)
        labels = {(each, label) for each in network_layers(name) for label in labels_of(sketch, each) or [1]}
        ordered = sorted(labels | {own_label}, key=lambda pair: (pair[0] != name, *pair))
        self.label.clear()
        for pair in ordered:
            self.label.addItem(label_title(*pair), pair)
        self.label.setCurrentIndex(ordered.index(own_label))
        declared = with_materials(vector_parameters(name), sketch.material_table)
        if declared != self._declared[name]:  # the sketch has other materials
            self._declared[name] = declared
            self.forms[name].deleteLater()
            self.forms[name] = self._form(name)
            self._column.addWidget(self.forms[name])
        values = {"name": "", "smooth": 0, "directed": 0, **sketch.properties(name, feature.label), **own}
        for each, form in self.forms.items():
            form.setVisible(each == name)
        self.forms[name].show_values(values)
        for key, field in self.forms[name].rows.items():
            field.setVisible(feature.kind == LINE or key not in _OF_LINES)
            if field.reset is not None:
                field.reset.setVisible(key in own)

    def _set_label(self, layer: str, label: int) -> None:
        """Set the label, of a way also its kind: it moves to the layer of that."""
        shown, sketch = self._shown, self._document.sketch
        if shown is None or layer == shown.kind:
            self._set("label", label, object())
        elif find_vector(sketch, shown) is not None:
            changed = change_layer(sketch.vectors[shown.kind], sketch.vectors[layer], shown.id, label)
            change_vectors(
                self._document, self._workspace, f"Make {label_title(layer, label).lower()} of", *changed
            )
            self._workspace.selection = Selection(layer, int(changed[1].ids[-1]))

    def _set(self, name: str, value: Value | None, key: object) -> None:
        shown, sketch = self._shown, self._document.sketch
        if shown is not None and find_vector(sketch, shown) is not None:
            own = None if value == "" else value
            changed = set_value(sketch.vectors[shown.kind], shown.id, name, own)
            title = f"Set {title_from_key(name).lower()} of"
            change_vectors(self._document, self._workspace, title, changed, merge=key)

    def _form(self, layer: str) -> ParameterForm:
        left_out = ("flow",) if LAYERS[layer].is_water else ("directed",)
        declared = {name: each for name, each in self._declared[layer].items() if name not in left_out}
        rows = [replace(each, help=_HELP.get(name, each.help)) for name, each in declared.items()]
        if LAYERS[layer].is_painted:  # but vectors are not: no width is as wide as painted
            rows = [replace(each, sentinel=None) for each in rows]
        form = ParameterForm([_NAME, *rows])
        for field in form.rows.values():
            if field.reset is not None:
                field.reset.setToolTip("Back to its label's")
        form.edited.connect(self._set)
        return form


def _facts(layer: VectorLayer, name: int) -> str:
    """Return length or area, and how many vertices there are."""
    shape = curves_of(layer).shapes[layer.index(name)]
    length, area = number(shape.length / 1000, decimals=2), number(shape.area / 1e6, decimals=2)
    size = f"{area} km²" if shape.area > 0.0 else f"{length} km"
    return f"{size}, {len(layer.vertices_of(name))} vertices"
