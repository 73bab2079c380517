"""Properties of what is selected, or else of the label that one paints with."""

from __future__ import annotations

from PyQt6.QtWidgets import QPushButton, QWidget

from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Workspace
from sketchterrain.ui.panels.chosen_page import ChosenPage
from sketchterrain.ui.panels.group import ScrollingPanel
from sketchterrain.ui.panels.label_page import LabelPage, label_title


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
        workspace.chosen_changed.connect(self._switch)
        workspace.label_changed.connect(self._name_label)
        self._name_label()
        self._switch()

    def _switch(self) -> None:
        selected = self._workspace.chosen is not None
        self.chosen_page.setVisible(selected)
        self.back.setVisible(selected)
        self.label_page.setVisible(not selected)

    def _name_label(self) -> None:
        title = f"Back to {label_title(self._workspace.layer, self._workspace.label).lower()}"
        self.back.setText(title)
        self.back.setAccessibleName(title)

    def _select_nothing(self) -> None:
        self._workspace.chosen = None
