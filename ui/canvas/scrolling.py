"""Moving what is on an image."""

from __future__ import annotations

from PyQt6.QtCore import QRect
from PyQt6.QtGui import QImage, QPainter

__all__ = ["scrolled"]


def scrolled(image: QImage, right: int, down: int) -> list[QRect]:
    """Move the pixels of an image; return the areas that are left to draw."""
    width, height = image.width(), image.height()
    if abs(right) >= width or abs(down) >= height:
        return [image.rect()]
    moved = image.copy(max(-right, 0), max(-down, 0), width - abs(right), height - abs(down))
    painter = QPainter(image)
    painter.setCompositionMode(QPainter.CompositionMode.CompositionMode_Source)
    painter.drawImage(max(right, 0), max(down, 0), moved)
    painter.end()
    bared = []
    if right:
        bared.append(QRect(0 if right > 0 else width + right, 0, abs(right), height))
    if down:
        bared.append(QRect(0, 0 if down > 0 else height + down, width, abs(down)))
    return bared
