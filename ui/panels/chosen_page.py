"""What is selected of what was generated: its page, and what can be done with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from PyQt6.QtCore import QSignalBlocker
from PyQt6.QtWidgets import QHBoxLayout, QPushButton, QVBoxLayout, QWidget

from sketchterrain.ui.commands.chosen_parts import is_there, name_of, river_of
from sketchterrain.ui.commands.placed_edits import is_edited, is_locked
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.engine.protocol import Placed
from sketchterrain.ui.look.icons import icon
from sketchterrain.ui.look.theme import MARGIN, SMALL
from sketchterrain.ui.models.chosen_acts import delete, lock, reset, unlock
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Chosen, Workspace
from sketchterrain.ui.panels.feature_form import FeatureForm
from sketchterrain.ui.panels.lake_form import LakeForm
from sketchterrain.ui.panels.page_head import PageHead
from sketchterrain.ui.panels.river_form import RiverForm
from sketchterrain.ui.panels.text import faint_label


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
        workspace.chosen_changed.connect(self.refresh)
        link.placed_changed.connect(self.refresh)
        self.refresh()

    def refresh(self) -> None:
        """Show what is selected, as it is now."""
        if self._workspace.chosen is None:
            return
        placed, chosen = self._link.placed, self._chosen()
        if placed is None or chosen is None:
            self._show_gone()
            return
        for kind, form in self.forms.items():
            form.setVisible(kind == chosen.kind)
        self.forms[chosen.kind].show_chosen(placed, chosen)
        self._show_head(placed, chosen)
        self._show_actions(placed, chosen)

    def _chosen(self) -> Chosen | None:
        """Return what is selected if it is there; without its control point if the river became shorter."""
        placed, chosen = self._link.placed, self._workspace.chosen
        if placed is None or chosen is None or not is_there(placed, chosen):
            return None
        river = river_of(placed, chosen)
        gone = river is not None and chosen.index is not None and chosen.index >= len(river.points)
        return replace(chosen, index=None) if gone else chosen

    def _show_head(self, placed: Placed, chosen: Chosen) -> None:
        form = self.forms[chosen.kind]
        title = name_of(placed, chosen).capitalize()
        self._head.show_label(title, form.line, form.layer, form.label)

    def _show_actions(self, placed: Placed, chosen: Chosen) -> None:
        sketch = self._document.sketch
        is_feature = chosen.kind == "feature"
        held = is_feature and is_locked(sketch, chosen)
        with QSignalBlocker(self.lock):
            self.lock.setChecked(held)
        self.lock.setVisible(is_feature)
        self.lock.setEnabled(True)
        self.lock.setText("Unloc&k" if held else "Loc&k")
        self.reset.setEnabled(is_edited(sketch, placed, chosen))
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

    def _act(self, act: Callable[[Document, Workspace, Placed, Chosen], None]) -> None:
        placed, chosen = self._link.placed, self._chosen()
        if placed is not None and chosen is not None:
            act(self._document, self._workspace, placed, chosen)

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
