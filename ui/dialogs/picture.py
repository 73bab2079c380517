"""The dialog for saving what the 3-D view shows."""

from __future__ import annotations

from pathlib import Path

from PyQt6.QtWidgets import QComboBox, QDialog, QFileDialog, QWidget

from sketchterrain.ui.dialogs.sheet import button_row, column, form, note

_SIZES = ((1280, 720), (1920, 1080), (2560, 1440), (3840, 2160), (2048, 2048))


class PictureDialog(QDialog):
    """Asks how large and how good a picture shall be, then where to save it; see `size` and `path`."""

    def __init__(
        self, shown: tuple[int, int], folder: Path, name: str, parent: QWidget | None = None
    ) -> None:
        super().__init__(parent)
        self._start = folder / f"{name}.png"
        self.path: Path | None = None
        rows = column(self, "Save picture")
        self.sizes = QComboBox()
        self.sizes.setAccessibleName("Picture")
        if all(shown):
            self.sizes.addItem(f"As it is shown, {shown[0]} × {shown[1]}", None)
        for width, height in _SIZES:
            self.sizes.addItem(f"Best quality, {width} × {height}", (width, height))
        fields = form()
        fields.addRow("&Picture", self.sizes)
        rows.addLayout(fields)
        rows.addWidget(note("The best quality is drawn anew from where the eye is; that takes some seconds."))
        rows.addStretch(1)
        rows.addWidget(button_row(self, "Save…", on_accept=self._ask)[0])
        self.setMinimumWidth(420)

    @property
    def size_wanted(self) -> tuple[int, int] | None:
        """Width and height of a new picture, px; None: as it is shown."""
        size = self.sizes.currentData()
        return None if size is None else (int(size[0]), int(size[1]))

    def _ask(self) -> None:
        name, _ = QFileDialog.getSaveFileName(self, "Save picture", str(self._start), "Pictures (*.png)")
        if name:
            path = Path(name)
            self.path = path if path.suffix.lower() == ".png" else path.with_name(path.name + ".png")
            self.accept()
