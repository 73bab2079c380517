"""Properties of the selected feature, of a layer of the sketch or of a draped one."""

from collections.abc import Iterable
from dataclasses import replace

from PyQt6.QtWidgets import QComboBox, QLabel, QWidget

from sketchterrain.document.own_materials import with_materials
from sketchterrain.features.edits import change_layer, network_layers
from sketchterrain.features.table import AREA, KINDS, LINE, POINT, VectorLayer, vector_parameters
from sketchterrain.schema.layers import LAYERS
from sketchterrain.schema.parameters import Parameter, Value
from sketchterrain.ui.commands import labels_of, reported
from sketchterrain.ui.look.theme import MARGIN, column, described, row
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.features import SelectedFeature, change_features, refusal, set_property
from sketchterrain.ui.models.workspace import Selection, Workspace
from sketchterrain.ui.panels.controls import PageHead, label_title, number, scroll_past
from sketchterrain.ui.panels.form import ParameterForm

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
        elif isinstance(own.table, VectorLayer):
            self._show_vector(own, own.selection.kind)
        else:
            self._show_draped(own, own.table.fields)

    def _show_vector(self, shown: SelectedFeature, name: str) -> None:
        sketch, own, feature = self._document.sketch, shown.feature.properties, shown.feature
        layer, own_label = LAYERS[name], (name, feature.label)
        title = str(own.get("name", layer.title if layer.kind == "land" else name.capitalize()))
        self._head.show_text(title, _size(shown), own_label)
        self._labels.show()
        labels = {(each, label) for each in network_layers(name) for label in labels_of(sketch, each) or [1]}
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
        elif isinstance(own.table, VectorLayer):
            changed = change_layer(own.table, target, own.selection.id, label)
            title = f"Make {label_title(layer, label).lower()} of"
            change_features(self._document, self._workspace, title, own.selection, *changed)
            self._workspace.selection = Selection(layer, int(changed[1].ids[-1]))

    def _set(self, name: str, value: Value | None, key: object) -> None:
        shown = self._shown
        own = None if shown is None else SelectedFeature.find(self._document, shown.selection)
        if own is not None:
            with reported(self._document.message.emit, self.refresh):
                set_property(self._document, self._workspace, own, name, value, key)


def _size(own: SelectedFeature) -> str:
    """Return length or area, and how many vertices there are."""
    if own.feature.kind == POINT:
        return ""
    length, area = number(own.shape.length / 1000, decimals=2), number(own.shape.area / 1e6, decimals=2)
    return f"{f'{area} km²' if own.feature.kind == AREA else f'{length} km'}, {len(own.places)} vertices"
