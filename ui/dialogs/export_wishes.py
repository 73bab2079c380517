"""Which files an export shall write, as controls: the command line's choices, with what they take."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from PyQt6.QtCore import pyqtSignal
from PyQt6.QtWidgets import QCheckBox, QWidget

from sketchterrain.disk import gibibytes
from sketchterrain.errors import InputError
from sketchterrain.sizes import check_size, memory_needed
from sketchterrain.sketch import Sketch
from sketchterrain.ui.dialogs.kept_controls import Kept, call_on_change, set_values, values_of
from sketchterrain.ui.dialogs.sheet import choice_box, form, note, part
from sketchterrain.ui.export_wish import Wish

_SIZES: Final = (257, 513, 1025, 2049, 4097, 8193)
_FOLIAGE: Final = {
    "csv": "Trees and shrubs as a table (CSV)",
    "ply": "Trees and shrubs as a point cloud (PLY)",
    "both": "As a table and as a point cloud",
    "none": "None",
}
_MAPS: Final = {"": "None", "png": "As a picture (PNG)", "svg": "As vectors (SVG)"}
_VIEWS: Final = {
    "auto": "From the best place",
    "ground": "From near the ground",
    "hill": "From a hill",
    "air": "From the air",
    "": "None",
}
# Of a vertex: 4 of height.tif, 2 of height.png, 3 of normals, 8 of materials, compressed to about two thirds.
_DISK = 11


class ExportWishes(QWidget):
    """Asks how large, and which files besides."""

    changed = pyqtSignal()
    mark = "report.json"
    """Name of a file that an export leaves."""

    def __init__(
        self, sketch: Sketch, kept: Mapping[str, object] | None = None, parent: QWidget | None = None
    ) -> None:
        super().__init__(parent)
        self._sketch = sketch
        self.problem = ""
        self.sizes = choice_box({size: self._size_text(size) for size in _SIZES})
        self.sizes.setCurrentIndex(_SIZES.index(1025))
        self.foliage, self.maps, self.views = (choice_box(each) for each in (_FOLIAGE, _MAPS, _VIEWS))
        self.grass = QCheckBox("Grass, flowers and ferns too (millions)")
        self._told = note()
        fields = form()
        for title, control, tip in (
            ("&Heights", self.sizes, "Samples of heights, normals and materials"),
            ("&Plants", self.foliage, "Which file holds the plants"),
            ("", self.grass, "Only a point cloud holds so many"),
            ("&Map", self.maps, "A topographic map"),
            ("Pre&view", self.views, "A rendered picture"),
        ):
            fields.addRow(title, control)
            control.setToolTip(tip)
            control.setAccessibleName(title.replace("&", "") or "Grass")
        rows = part(self)
        rows.addLayout(fields)
        rows.addWidget(self._told)
        self._controls: dict[str, QWidget] = {
            "size": self.sizes,
            "plants": self.foliage,
            "grass": self.grass,
            "map": self.maps,
            "view": self.views,
        }
        set_values(self._controls, kept or {})
        call_on_change(self._controls, self._show)
        self._show()

    @property
    def samples(self) -> int:
        """Vertices along the longer side."""
        return int(self.sizes.currentData())

    def kept(self) -> Kept:
        """Return what is set, to be kept."""
        return values_of(self._controls)

    def wish(self, folder: Path, device: str | None) -> Wish:
        """Return what is asked for, into a folder, on a device."""
        view = str(self.views.currentData())
        return Wish(
            folder,
            size=self.samples,
            foliage=str(self.foliage.currentData()),
            grass=self.grass.isChecked() and self.grass.isEnabled(),
            preview=bool(view),
            view=view or "auto",
            map=str(self.maps.currentData()) or None,
            device=device,
        )

    def _size_text(self, size: int) -> str:
        east, north = self._sketch.size
        short = max(2, round((size - 1) * min(east, north) / max(east, north)) + 1)
        columns, rows = (size, short) if east >= north else (short, size)
        return f"{columns} × {rows}, {max(east, north) / (size - 1):.3g} m apart"

    def _show(self, *_: object) -> None:
        self.problem = ""
        try:
            check_size(self._sketch, self.samples)
        except InputError as error:
            self.problem = str(error)
        self.grass.setEnabled(self.foliage.currentData() in ("ply", "both"))
        east, north = self._sketch.size
        disk = _DISK * self.samples**2 * min(east, north) / max(east, north) / (1 << 20)
        room = f"{disk:.0f} MiB" if disk < 1024 else gibibytes(disk * (1 << 20))
        plants = "" if self.foliage.currentData() == "none" else " without the plants"
        needed = gibibytes(memory_needed(self._sketch, self.samples))
        self._told.setText(
            f"height.tif, height.png, normal.png, materials.png and features.json: about {room}{plants}. "
            f"Takes about {needed} of memory."
        )
        self.changed.emit()
