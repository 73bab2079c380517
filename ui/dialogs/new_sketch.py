"""The dialogs for a new sketch and for saving a picture of the 3-D view."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
from PyQt6.QtWidgets import QDialog, QFileDialog, QWidget

from sketchterrain.sketch import SKETCH, Sketch
from sketchterrain.sketch.starter import starter_sketch
from sketchterrain.ui.dialogs.form import EXTENT, NAME, Field, Form, button_row, column

_SIZES = {
    f"{width} × {height}": (width, height)
    for width, height in ((512, 512), (768, 512), (1024, 1024), (1536, 1024), (2048, 2048), (4096, 4096))
}
_OTHER = "Other"
_SIDES = (32, 16384)  # px
_SEEDS = 1_000_000
_PICTURES = ((1280, 720), (1920, 1080), (2560, 1440), (3840, 2160), (2048, 2048))


class NewSketchDialog(QDialog):
    """Asks for the size and extent of a new sketch; see `sketch` when it was accepted."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        rows = column(self, "New sketch")
        sizes = {title: title for title in (*_SIZES, _OTHER)}
        self.form = Form(
            NAME,
            Field("sheet", "&Sheet", next(iter(_SIZES)), "Pixels that you paint on", choices=sizes),
            Field("width", "&Width", 512, "Pixels from west to east", range=_SIDES, unit="px", decimals=0),
            Field(
                "height", "Hei&ght", 512, "Pixels from north to south", range=_SIDES, unit="px", decimals=0
            ),
            EXTENT,
            Field("starter", "", False, words="With a mountain and a river to begin with"),
        )
        self.form["name"].setMaxLength(int(SKETCH["name"].high))
        self.form["name"].selectAll()
        rows.addWidget(self.form)
        rows.addStretch(1)
        rows.addWidget(button_row(self, "Create")[0])
        self.form.changed.connect(self._show)
        self.setMinimumWidth(420)
        self._show()

    def sketch(self) -> Sketch:
        """Return the new sketch, with a seed of its own."""
        values = self.form.values
        if values["starter"] and self.form["starter"].isEnabled():
            begun = starter_sketch()
        else:
            width, height = self._pixels()
            begun = Sketch(layers={"mountain": np.zeros((height, width), np.uint8)})
        return begun.replace(
            name=values["name"].strip() or "Untitled",
            extent=float(values["extent"]),
            seed=random.randrange(_SEEDS),  # noqa: S311 - a terrain, no secret
        )

    def _pixels(self) -> tuple[int, int]:
        values = self.form.values
        return _SIZES.get(values["sheet"], (values["width"], values["height"]))

    def _show(self) -> None:
        width, height = self._pixels()
        self.form.enable(self.form["sheet"].currentData() == _OTHER, "width", "height")
        self.form["width"].setValue(width)
        self.form["height"].setValue(height)
        self.form.enable((width, height) == (512, 512), "starter")
        pixel = self.form["extent"].value() / max(width, height)
        east, north = width * pixel / 1000.0, height * pixel / 1000.0
        self.form.note.setText(f"{east:.3g} km × {north:.3g} km of land, {pixel:.3g} m a pixel.")


class PictureDialog(QDialog):
    """Asks how large a picture shall be (`shown`: the size of the view, px), then where to save it."""

    def __init__(
        self, shown: tuple[int, int], folder: Path, name: str, parent: QWidget | None = None
    ) -> None:
        super().__init__(parent)
        self._start = folder / f"{name}.png"
        self.path: Path | None = None
        rows = column(self, "Save picture")
        sizes = {"": f"As it is shown, {shown[0]} × {shown[1]}"} if all(shown) else {}
        sizes |= {f"{w} {h}": f"Best quality, {w} × {h}" for w, h in _PICTURES}
        self.form = Form(Field("size", "&Picture", next(iter(sizes)), choices=sizes))
        self.form.note.setText(
            "The best quality is drawn anew from where the eye is; that takes some seconds."
        )
        rows.addWidget(self.form)
        rows.addStretch(1)
        rows.addWidget(button_row(self, "Save…", on_accept=self._ask)[0])
        self.setMinimumWidth(420)

    @property
    def render_size(self) -> tuple[int, int] | None:
        """Width and height of a new picture, px; None: as it is shown."""
        size = [int(side) for side in self.form.values["size"].split()]
        return (size[0], size[1]) if size else None

    def _ask(self) -> None:
        name, _ = QFileDialog.getSaveFileName(self, "Save picture", str(self._start), "Pictures (*.png)")
        if name:
            path = Path(name)
            self.path = path if path.suffix.lower() == ".png" else path.with_name(path.name + ".png")
            self.accept()
