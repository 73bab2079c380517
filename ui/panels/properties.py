"""Properties of the selection, or of the active label without one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from PyQt6.QtCore import QSignalBlocker
from PyQt6.QtWidgets import QPushButton, QVBoxLayout, QWidget

from sketchterrain.document.parameter_types import Value
from sketchterrain.document.parameters import LAYERS
from sketchterrain.ui.commands.placed_edits import exists, find_river, is_edited, is_locked, name_of
from sketchterrain.ui.commands.settings import reset_property, set_property
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.engine.protocol import Placement
from sketchterrain.ui.look.theme import MARGIN, SMALL, column, icon, row
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.selection import delete, lock, reset, unlock
from sketchterrain.ui.models.workspace import Selection, Workspace
from sketchterrain.ui.panels.form import ParameterForm
from sketchterrain.ui.panels.numbers import label_title, title_from_key
from sketchterrain.ui.panels.parts import PageHead, ScrollingPanel, faint_label
from sketchterrain.ui.panels.placed_forms import FeatureForm, LakeForm, RiverForm


class LabelPage(QWidget):
    """A form for each layer's declared parameters; that of the active layer is visible."""

    def __init__(self, document: Document, workspace: Workspace) -> None:
        super().__init__()
        self._document, self._workspace = document, workspace
        self._head = PageHead()
        self.forms: dict[str, ParameterForm] = {}
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
        if layer not in self.forms:
            form = self.forms[layer] = ParameterForm(LAYERS[layer].parameters.values())
            form.edited.connect(self._set)
            form.reset_requested.connect(self._reset)
            self._column.addWidget(form)
        self.forms[layer].show_values(self._document.sketch.properties(layer, label))
        for name, form in self.forms.items():
            form.setVisible(name == layer)

    def _set(self, name: str, value: Value, key: object) -> None:
        if self._shown is not None:
            changed = set_property(self._document.sketch, *self._shown, name, value)
            self._document.do(f"Set {self._property_title(name)}", changed, merge=key)

    def _reset(self, name: str) -> None:
        if self._shown is not None:
            changed = reset_property(self._document.sketch, *self._shown, name)
            self._document.do(f"Reset {self._property_title(name)}", changed)

    def _property_title(self, name: str) -> str:
        label = "" if self._shown is None else label_title(*self._shown)
        return f"{title_from_key(name).lower()} of {label.lower()}"


class SelectionPage(QWidget):
    """Form and actions for the selected feature, river or lake."""

    def __init__(self, document: Document, workspace: Workspace, link: EngineLink) -> None:
        super().__init__()
        self._document, self._workspace, self._link = document, workspace, link
        self._head = PageHead()
        self.forms: dict[str, FeatureForm | RiverForm | LakeForm] = {
            "feature": FeatureForm(document),
            "river": RiverForm(document, workspace),
            "lake": LakeForm(),
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
        if self._workspace.selection is None:
            return
        placed, selection = self._link.placed, self._existing_selection()
        for kind, form in self.forms.items():
            form.setVisible(selection is not None and kind == selection.kind)
        for button in (self.lock, self.reset, self.delete):
            button.setEnabled(selection is not None)
        if placed is None or selection is None:
            self._head.show_text("Gone", "The selection no longer exists.")
            self._note.hide()
            return
        form = self.forms[selection.kind]
        form.show_selection(placed, selection)
        self._head.show_text(name_of(placed, selection).capitalize(), form.line, (form.layer, form.label))
        sketch, is_feature = self._document.sketch, selection.kind == "feature"
        locked = is_feature and is_locked(sketch, selection)
        with QSignalBlocker(self.lock):
            self.lock.setChecked(locked)
        self.lock.setVisible(is_feature)
        self.lock.setText("Unloc&k" if locked else "Loc&k")
        self.reset.setEnabled(is_edited(sketch, placed, selection))
        self._note.setVisible(locked)

    def _existing_selection(self) -> Selection | None:
        """Return the selection if it exists, without a control point that the river has no longer."""
        placed, selection = self._link.placed, self._workspace.selection
        if placed is None or selection is None or not exists(placed, selection):
            return None
        river = find_river(placed, selection)
        is_gone = river is not None and selection.index is not None and selection.index >= len(river.points)
        return replace(selection, index=None) if is_gone else selection

    def _apply(
        self, command: Callable[[Document, Workspace, Placement, Selection], None], _: object = None
    ) -> None:
        placed, selection = self._link.placed, self._existing_selection()
        if placed is not None and selection is not None:
            command(self._document, self._workspace, placed, selection)


def _button(name: str, text: str, tip: str) -> QPushButton:
    button = QPushButton(icon(name), text)
    button.setAccessibleName(text.replace("&", ""))
    button.setToolTip(tip)
    return button


class PropertiesPanel(ScrollingPanel):
    """Shows the page of the selection, or else that of the active label."""

    def __init__(self, document: Document, workspace: Workspace, link: EngineLink) -> None:
        super().__init__()
        self._workspace = workspace
        self.selection_page = SelectionPage(document, workspace, link)
        self.label_page = LabelPage(document, workspace)
        self.back = QPushButton()
        self.back.setToolTip("Clear the selection and show the active label")
        self.back.clicked.connect(self._clear_selection)
        self.add(self.selection_page, self.back, self.label_page)
        workspace.selection_changed.connect(self._refresh)
        workspace.label_changed.connect(self._refresh)
        self._refresh()

    def _refresh(self) -> None:
        is_selected = self._workspace.selection is not None
        self.selection_page.setVisible(is_selected)
        self.back.setVisible(is_selected)
        self.label_page.setVisible(not is_selected)
        title = f"Back to {label_title(self._workspace.layer, self._workspace.label).lower()}"
        self.back.setText(title)
        self.back.setAccessibleName(title)

    def _clear_selection(self) -> None:
        self._workspace.selection = None
