"""The dialog for a new sketch: how many pixels, how much land."""

from __future__ import annotations

import random

import numpy as np
from PyQt6.QtWidgets import QCheckBox, QComboBox, QDialog, QWidget

from sketchterrain.sketch import SKETCH, Sketch
from sketchterrain.sketch.starter import starter_sketch
from sketchterrain.ui.dialogs.sheet import (
    add_rows,
    button_row,
    column,
    extent_box,
    form,
    name_line,
    note,
    pixel_box,
)

_SIZES = {
    "512 × 512": (512, 512),
    "768 × 512": (768, 512),
    "1024 × 1024": (1024, 1024),
    "1536 × 1024": (1536, 1024),
    "2048 × 2048": (2048, 2048),
    "4096 × 4096": (4096, 4096),
    "Other": None,
}
_SEEDS = 1_000_000


class NewSketchDialog(QDialog):
    """Asks what a new sketch shall be like; see `sketch` when it was accepted."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        rows = column(self, "New sketch")
        self.name = name_line("My terrain")
        self.name.selectAll()
        self.sheet = QComboBox()
        self.sheet.addItems(_SIZES)
        self.columns, self.rows = pixel_box(512), pixel_box(512)
        self.extent = extent_box()
        self.starter = QCheckBox("With a mountain and a river to begin with")
        self._told = note()
        fields = form()
        controls: tuple[tuple[str, QWidget, str], ...] = (
            ("&Name", self.name, "What the sketch is called"),
            ("&Sheet", self.sheet, "Pixels that you paint on"),
            ("&Width", self.columns, "Pixels from west to east"),
            ("Hei&ght", self.rows, "Pixels from north to south"),
            ("&Extent", self.extent, SKETCH["extent"].help[:1].upper() + SKETCH["extent"].help[1:]),
        )
        add_rows(fields, controls)
        fields.addRow("", self.starter)
        rows.addLayout(fields)
        rows.addWidget(self._told)
        rows.addStretch(1)
        rows.addWidget(button_row(self, "Create")[0])
        self.sheet.currentTextChanged.connect(self._show)
        for box in (self.columns, self.rows, self.extent):
            box.valueChanged.connect(self._show)
        self.setMinimumWidth(420)
        self._show()

    def sketch(self) -> Sketch:
        """Return the new sketch, with a seed of its own."""
        if self.starter.isChecked() and self.starter.isEnabled():
            begun = starter_sketch()
        else:
            width, height = self._pixels()
            begun = Sketch(layers={"mountain": np.zeros((height, width), np.uint8)})
        return begun.replace(
            name=self.name.text().strip() or "Untitled",
            extent=self.extent.value(),
            seed=random.randrange(_SEEDS),  # noqa: S311 - a terrain, no secret
        )

    def _pixels(self) -> tuple[int, int]:
        chosen = _SIZES[self.sheet.currentText()]
        return chosen or (self.columns.value(), self.rows.value())

    def _show(self, *_: object) -> None:
        width, height = self._pixels()
        other = _SIZES[self.sheet.currentText()] is None
        for box, value in ((self.columns, width), (self.rows, height)):
            box.setEnabled(other)
            if not other:
                box.setValue(value)
        self.starter.setEnabled((width, height) == (512, 512))
        pixel = self.extent.value() / max(width, height)
        east, north = width * pixel / 1000.0, height * pixel / 1000.0
        self._told.setText(f"{east:.3g} km × {north:.3g} km of land, {pixel:.3g} m a pixel.")
