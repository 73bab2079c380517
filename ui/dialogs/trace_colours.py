"""The colours of a map as a table: each with its share, and what it becomes."""

from __future__ import annotations

from collections.abc import Sequence

from PyQt6.QtCore import QSize, pyqtSignal
from PyQt6.QtGui import QColor, QIcon, QPixmap
from PyQt6.QtWidgets import QComboBox, QFrame, QGridLayout, QLabel, QScrollArea, QWidget

from sketchterrain.sketch import LAYERS
from sketchterrain.trace.legend import INK, NOTHING, Meaning
from sketchterrain.trace.picture_colours import FoundColour
from sketchterrain.ui.look.layer_colours import swatch
from sketchterrain.ui.look.theme import SMALL, SPACING, tabular

_SWATCH = 16  # px
_MOST = 24  # rows
_LABELS = 3  # of each layer that are offered
_TALLEST = 7  # rows seen at once


def meaning_box(*, special: bool = True) -> QComboBox:
    """Return a box with everything that a colour can stand for."""
    box = QComboBox()
    box.setIconSize(QSize(_SWATCH, _SWATCH))
    if special:
        box.addItem("Nothing", NOTHING)
        box.addItem("Lettering, outlines", INK)
    for label in range(1, _LABELS + 1):
        for name, layer in LAYERS.items():
            title = layer.title if label == 1 else f"{layer.title} {label}"
            box.addItem(QIcon(swatch(name, label, _SWATCH)), title, Meaning(name, label))
    box.setMaxVisibleItems(box.count())
    return box


class ColourTable(QScrollArea):
    """A row for each colour; `changed` tells that one became something else."""

    changed = pyqtSignal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setWidgetResizable(True)
        self.setAccessibleName("Colours of the map")
        self._rest: tuple[Meaning | None, ...] = ()
        self.boxes: list[QComboBox] = []

    @property
    def meanings(self) -> tuple[Meaning | None, ...]:
        """What each colour stands for."""
        return (*(box.currentData() for box in self.boxes), *self._rest)

    def show_colours(self, colours: Sequence[FoundColour], meanings: Sequence[Meaning | None]) -> None:
        """Show the colours of another map."""
        self._rest = tuple(meanings[_MOST:])
        self.boxes = []
        page = QWidget()
        rows = QGridLayout(page)
        rows.setContentsMargins(0, 0, SPACING, 0)
        rows.setHorizontalSpacing(SPACING)
        rows.setVerticalSpacing(SMALL)
        for row, (colour, meaning) in enumerate(zip(colours[:_MOST], meanings, strict=False)):
            shown = QPixmap(2 * _SWATCH, _SWATCH)
            shown.fill(QColor(*colour.rgb))
            picture = QLabel()
            picture.setPixmap(shown)
            picture.setToolTip(colour.code)
            share = QLabel(f"{100.0 * colour.share:.1f}\u202f%")
            share.setFont(tabular(share.font()))
            box = meaning_box()
            box.setAccessibleName(f"What {colour.code} becomes")
            box.setToolTip(f"What {colour.code} becomes")
            box.setCurrentIndex(_place_of(box, meaning))
            box.currentIndexChanged.connect(self._tell)
            self.boxes.append(box)
            rows.addWidget(picture, row, 0)
            rows.addWidget(share, row, 1)
            rows.addWidget(box, row, 2)
        rows.setColumnStretch(2, 1)
        rows.setRowStretch(len(self.boxes), 1)
        self.setWidget(page)
        if self.boxes:
            height = self.boxes[0].sizeHint().height() + SMALL
            self.setMinimumHeight(min(len(self.boxes), _TALLEST) * height)

    def _tell(self, _: int) -> None:
        self.changed.emit()


def _place_of(box: QComboBox, meaning: Meaning | None) -> int:
    wanted = NOTHING if meaning is None else meaning
    # Not by findData: to Qt equal values of Python's are different ones.
    places = [place for place in range(box.count()) if box.itemData(place) == wanted]
    if not places:
        box.addItem(str(wanted), wanted)
    return places[0] if places else box.count() - 1
