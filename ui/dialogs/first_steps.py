"""How to paint a terrain, in a minute: what a new user reads once."""

from __future__ import annotations

from PyQt6.QtWidgets import QDialog, QGridLayout, QLabel, QWidget

from sketchterrain.ui.dialogs.sheet import button_row, column, fix_width, heading, note
from sketchterrain.ui.look.icons import icon
from sketchterrain.ui.look.theme import MARGIN

_STEPS = (
    (
        "layers",
        "Choose a layer",
        "Mountains, hills, rivers, dunes, forests, lakes or materials, at the left or with 1 … 7.",
    ),
    (
        "brush",
        "Paint where it should be",
        "The terrain follows at the right. Rivers: a line (L) along their course.",
    ),
    (
        "settings",
        "Say what it is like",
        "Properties: how high, how sharp, how wide. A new label is another kind.",
    ),
    (
        "target",
        "Make it hold to the sketch",
        "World: fidelity from loose to exact; another seed is another terrain.",
    ),
    (
        "select",
        "Move what was generated",
        "With V, click a mountain or a river and drag it or its handles, in either view.",
    ),
    ("export", "Take it with you", "File ▸ Export terrain writes heights, materials, plants and maps."),
)


class FirstStepsDialog(QDialog):
    """Six steps."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        rows = column(self, "First steps")
        rows.addWidget(heading("A terrain in a minute"))
        grid = QGridLayout()
        grid.setHorizontalSpacing(MARGIN)
        grid.setVerticalSpacing(2)
        grid.setColumnStretch(1, 1)
        for number, (name, title, said) in enumerate(_STEPS):
            mark = QLabel()
            mark.setPixmap(icon(name).pixmap(28, 28))
            words = QLabel(title)
            font = words.font()
            font.setBold(True)
            words.setFont(font)
            grid.addWidget(mark, 3 * number, 0, 2, 1)
            grid.addWidget(words, 3 * number, 1)
            grid.addWidget(note(said), 3 * number + 1, 1)
            grid.setRowMinimumHeight(3 * number + 2, MARGIN)
        rows.addLayout(grid)
        rows.addStretch(1)
        rows.addWidget(button_row(self, "", cancel="Start")[0])
        fix_width(self, 500)
