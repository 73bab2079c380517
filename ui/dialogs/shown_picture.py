"""A picture in a dialog, as large as there is room."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from PyQt6.QtCore import QSize, Qt
from PyQt6.QtGui import QImage, QPixmap, QResizeEvent
from PyQt6.QtWidgets import QLabel, QSizePolicy

_LEAST = QSize(320, 220)


class ShownPicture(QLabel):
    """A picture, as large as there is room."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self._pixels: QPixmap | None = None
        self.setAccessibleName(name)
        self.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.setMinimumSize(_LEAST)
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Ignored)

    def show_pixels(self, rgba: npt.NDArray[np.uint8]) -> None:
        """Show uint8, (height, width, 4)."""
        height, width = rgba.shape[:2]
        image = QImage(rgba.tobytes(), width, height, 4 * width, QImage.Format.Format_RGBA8888)
        self._pixels = QPixmap.fromImage(image.copy())
        self._fit()

    def clear(self) -> None:
        """Show nothing."""
        self._pixels = None
        super().clear()

    def resizeEvent(self, event: QResizeEvent | None) -> None:
        """Fit the picture again."""
        super().resizeEvent(event)
        self._fit()

    def _fit(self) -> None:
        if self._pixels is not None:
            ratio = self.devicePixelRatioF()
            how = (Qt.AspectRatioMode.KeepAspectRatio, Qt.TransformationMode.SmoothTransformation)
            scaled = self._pixels.scaled(self.size() * ratio, *how)
            scaled.setDevicePixelRatio(ratio)
            self.setPixmap(scaled)
