"""The properties of the label that one paints with."""

from __future__ import annotations

from PyQt6.QtWidgets import QVBoxLayout, QWidget

from sketchterrain.sketch import LAYERS
from sketchterrain.sketch.parameter import Value
from sketchterrain.ui.commands.labels import reset_property, set_property
from sketchterrain.ui.look.theme import MARGIN
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Workspace
from sketchterrain.ui.panels.form import ParameterForm
from sketchterrain.ui.panels.page_head import PageHead
from sketchterrain.ui.panels.wording import title_of


class LabelPage(QWidget):
    """A form for each layer, made from its declaration; that of the layer in use is shown."""

    def __init__(self, document: Document, workspace: Workspace, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._workspace = workspace
        self._head = PageHead(self)
        self.forms: dict[str, ParameterForm] = {}
        self._shown: tuple[str, int] | None = None
        self._down = QVBoxLayout(self)
        self._down.setContentsMargins(0, 0, 0, 0)
        self._down.setSpacing(MARGIN)
        self._down.addWidget(self._head)
        workspace.label_changed.connect(self._show)
        document.sketch_changed.connect(self._show)
        self._show()

    def _show(self) -> None:
        layer, label = self._workspace.layer, self._workspace.label
        if self._shown != (layer, label) and self._shown is not None:
            self.forms[self._shown[0]].finish()  # what was typed belongs to the label that it was typed for
        self._shown = (layer, label)
        self._head.show_label(label_title(layer, label), LAYERS[layer].help, layer, label)
        self._form(layer).show_values(self._document.sketch.properties(layer, label))
        for name, form in self.forms.items():
            form.setVisible(name == layer)

    def _form(self, layer: str) -> ParameterForm:
        if layer not in self.forms:
            form = ParameterForm(LAYERS[layer].parameters.values())
            form.edited.connect(self._set)
            form.reset_asked.connect(self._reset)
            self._down.addWidget(form)
            self.forms[layer] = form
        return self.forms[layer]

    def _set(self, name: str, value: Value, key: object) -> None:
        if self._shown is None:
            return
        layer, label = self._shown
        changed = set_property(self._document.sketch, layer, label, name, value)
        self._document.do(f"Set {_of(layer, label, name)}", changed, merge=key)

    def _reset(self, name: str) -> None:
        if self._shown is None:
            return
        layer, label = self._shown
        changed = reset_property(self._document.sketch, layer, label, name)
        self._document.do(f"Reset {_of(layer, label, name)}", changed)


def label_title(layer: str, label: int) -> str:
    """Return what a label is called: ``"Mountains 2"``."""
    return f"{LAYERS[layer].title} {label}"


def _of(layer: str, label: int, name: str) -> str:
    return f"{title_of(name).lower()} of {label_title(layer, label).lower()}"
