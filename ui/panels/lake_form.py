"""A placed lake: its level and its depth. Both follow from the paint and the ground around it."""

from __future__ import annotations

from PyQt6.QtWidgets import QVBoxLayout, QWidget

from sketchterrain.ui.commands.chosen_parts import lake_of
from sketchterrain.ui.engine.protocol import Placed
from sketchterrain.ui.models.workspace import Chosen
from sketchterrain.ui.panels.text import faint_label
from sketchterrain.ui.panels.wording import number


class LakeForm(QWidget):
    """What a lake is like."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.layer, self.label, self.line = "lake", 1, ""
        self._text = faint_label("", self)
        down = QVBoxLayout(self)
        down.setContentsMargins(0, 0, 0, 0)
        down.addWidget(self._text)

    def show_chosen(self, placed: Placed, chosen: Chosen) -> None:
        """Show a lake that is there."""
        lake = lake_of(placed, chosen)
        if lake is None:
            return
        self.label = max(lake.label, 1)  # 0: nobody painted it, a river fills it
        self.line = f"painted with label {lake.label}" if lake.label else "filled by a river"
        self._text.setText(
            f"Its water stands at {number(lake.level, decimals=1)} m, as high as its rim can hold, and is "
            f"{number(lake.depth, decimals=1)} m deep."
        )
