"""Properties of the selection, or else of the label in use."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from PyQt6.QtCore import QSignalBlocker
from PyQt6.QtWidgets import QHBoxLayout, QPushButton, QVBoxLayout, QWidget

from sketchterrain.document.parameter_types import Value
from sketchterrain.document.parameters import LAYERS
from sketchterrain.ui.commands.placed_edits import exists, find_river, is_edited, is_locked, name_of
from sketchterrain.ui.commands.settings import reset_property, set_property
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.engine.protocol import Placement
from sketchterrain.ui.look.theme import MARGIN, SMALL, icon
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.selection import delete, lock, reset, unlock
from sketchterrain.ui.models.workspace import Selection, Workspace
from sketchterrain.ui.panels.form import ParameterForm
from sketchterrain.ui.panels.numbers import label_title, setting_title
from sketchterrain.ui.panels.parts import PageHead, ScrollingPanel, faint_label
from sketchterrain.ui.panels.placed_forms import FeatureForm, LakeForm, RiverForm


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
        self._head.show_text(label_title(layer, label), LAYERS[layer].help, (layer, label))
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


def _of(layer: str, label: int, name: str) -> str:
    return f"{setting_title(name).lower()} of {label_title(layer, label).lower()}"


class ChosenPage(QWidget):
    """Position, size and strength of a feature; width and control points of a river; level of a lake."""

    def __init__(
        self, document: Document, workspace: Workspace, link: EngineLink, parent: QWidget | None = None
    ) -> None:
        super().__init__(parent)
        self._document = document
        self._workspace = workspace
        self._link = link
        self._head = PageHead(self)
        self.forms: dict[str, FeatureForm | RiverForm | LakeForm] = {
            "feature": FeatureForm(document, self),
            "river": RiverForm(document, workspace, self),
            "lake": LakeForm(self),
        }
        self._note = faint_label("Locked: it stays as it is, whatever is painted.", self)
        self.lock = _button("lock", "Loc&k", "Keep it as it is, whatever is painted", self)
        self.lock.setCheckable(True)
        self.reset = _button("reset", "&Reset", "Make it again as it was generated", self)
        self.delete = _button("delete", "&Delete", "Take it away; undo brings it back", self)
        self.lock.toggled.connect(self._lock)
        self.reset.clicked.connect(self._reset)
        self.delete.clicked.connect(self._delete)
        self._lay_out()
        document.sketch_changed.connect(self.refresh)
        workspace.selection_changed.connect(self.refresh)
        link.placed_changed.connect(self.refresh)
        self.refresh()

    def refresh(self) -> None:
        """Show what is selected, as it is now."""
        if self._workspace.selection is None:
            return
        placed, selection = self._link.placed, self._chosen()
        if placed is None or selection is None:
            self._show_gone()
            return
        for kind, form in self.forms.items():
            form.setVisible(kind == selection.kind)
        self.forms[selection.kind].show_chosen(placed, selection)
        self._show_head(placed, selection)
        self._show_actions(placed, selection)

    def _chosen(self) -> Selection | None:
        """Return what is selected if it is there; without its control point if the river became shorter."""
        placed, selection = self._link.placed, self._workspace.selection
        if placed is None or selection is None or not exists(placed, selection):
            return None
        river = find_river(placed, selection)
        gone = river is not None and selection.index is not None and selection.index >= len(river.points)
        return replace(selection, index=None) if gone else selection

    def _show_head(self, placed: Placement, selection: Selection) -> None:
        form = self.forms[selection.kind]
        title = name_of(placed, selection).capitalize()
        self._head.show_text(title, form.line, (form.layer, form.label))

    def _show_actions(self, placed: Placement, selection: Selection) -> None:
        sketch = self._document.sketch
        is_feature = selection.kind == "feature"
        held = is_feature and is_locked(sketch, selection)
        with QSignalBlocker(self.lock):
            self.lock.setChecked(held)
        self.lock.setVisible(is_feature)
        self.lock.setEnabled(True)
        self.lock.setText("Unloc&k" if held else "Loc&k")
        self.reset.setEnabled(is_edited(sketch, placed, selection))
        self.delete.setEnabled(True)
        self._note.setVisible(held)

    def _show_gone(self) -> None:
        self._head.show_text("Gone", "What was selected is not there any more.")
        for form in self.forms.values():
            form.hide()
        self._note.hide()
        for button in (self.lock, self.reset, self.delete):
            button.setEnabled(False)

    def _lock(self, held: bool) -> None:
        self._act(lock if held else unlock)

    def _reset(self) -> None:
        self._act(reset)

    def _delete(self) -> None:
        self._act(delete)

    def _act(self, act: Callable[[Document, Workspace, Placement, Selection], None]) -> None:
        placed, selection = self._link.placed, self._chosen()
        if placed is not None and selection is not None:
            act(self._document, self._workspace, placed, selection)

    def _lay_out(self) -> None:
        down = QVBoxLayout(self)
        down.setContentsMargins(0, 0, 0, 0)
        down.setSpacing(MARGIN)
        down.addWidget(self._head)
        for form in self.forms.values():
            down.addWidget(form)
        down.addWidget(self._note)
        across = QHBoxLayout()
        across.setSpacing(SMALL)
        for button in (self.lock, self.reset, self.delete):
            across.addWidget(button, 1)
        down.addLayout(across)


def _button(name: str, text: str, tip: str, parent: QWidget) -> QPushButton:
    button = QPushButton(icon(name), text, parent)
    button.setAccessibleName(text.replace("&", ""))
    button.setToolTip(tip)
    return button


class PropertiesPanel(ScrollingPanel):
    """A form for a label, or for a feature, a river or a lake that is selected."""

    def __init__(
        self, document: Document, workspace: Workspace, link: EngineLink, parent: QWidget | None = None
    ) -> None:
        super().__init__(parent)
        self._workspace = workspace
        self.chosen_page = ChosenPage(document, workspace, link, self)
        self.label_page = LabelPage(document, workspace, self)
        self.back = QPushButton(self)
        self.back.setToolTip("Select nothing, and show the label that is painted with")
        self.back.clicked.connect(self._select_nothing)
        self.add(self.chosen_page)
        self.add(self.back)
        self.add(self.label_page)
        workspace.selection_changed.connect(self._switch)
        workspace.label_changed.connect(self._name_label)
        self._name_label()
        self._switch()

    def _switch(self) -> None:
        selected = self._workspace.selection is not None
        self.chosen_page.setVisible(selected)
        self.back.setVisible(selected)
        self.label_page.setVisible(not selected)

    def _name_label(self) -> None:
        title = f"Back to {label_title(self._workspace.layer, self._workspace.label).lower()}"
        self.back.setText(title)
        self.back.setAccessibleName(title)

    def _select_nothing(self) -> None:
        self._workspace.selection = None
