"""Pictures that lie under and over the paint: the terrain's relief, and how far it does what was painted."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from PyQt6.QtGui import QColor, QImage

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.ui.engine.messages import Adherence, Relief

__all__ = ["AGREEMENT", "PAPER", "adherence_image", "relief_image"]

PAPER = QColor(247, 245, 240)
"""What nothing is painted on."""

AGREEMENT = {
    "as painted": QColor(0, 158, 115),
    "missing": QColor(230, 130, 0),
    "spill": QColor(204, 70, 150),
}
"""Okabe and Ito's colours for what is painted and shown, only painted, only shown."""

_LEVEL = 196.0  # shade from which the paper is bare; level ground has a little less
_DARKEST = (0.44, 0.42, 0.41)  # of the paper's red, green and blue, in the deepest shade
_TINT = 0.62  # opacity of the colours of agreement


def relief_image(relief: Relief) -> QImage:
    """Return the relief as light and shade on paper."""
    share = np.minimum(np.arange(256, dtype=np.float32) / _LEVEL, 1.0)[:, None]
    paper = np.array([PAPER.red(), PAPER.green(), PAPER.blue()], np.float32)
    colours = paper * (np.array(_DARKEST, np.float32) * (1.0 - share) + share)
    red, green, blue = np.rint(colours).astype(np.uint32).T
    table: npt.NDArray[np.uint32] = np.uint32(0xFF000000) | red << 16 | green << 8 | blue
    return _owned(table[relief.shade], QImage.Format.Format_RGB32)


def adherence_image(adherence: Adherence, layer: str) -> QImage | None:
    """Return where a layer is as painted, missing or spilt; None if that was not measured."""
    if layer not in adherence.images:
        return None
    painted, shown = adherence.images[layer]
    table = np.zeros(4, np.uint32)
    for at, name in ((3, "as painted"), (1, "missing"), (2, "spill")):
        colour = AGREEMENT[name]
        red, green, blue = (round(part * _TINT) for part in (colour.red(), colour.green(), colour.blue()))
        table[at] = round(255 * _TINT) << 24 | red << 16 | green << 8 | blue
    pixels = table[painted.astype(np.uint8) | shown.astype(np.uint8) << 1]
    return _owned(pixels, QImage.Format.Format_ARGB32_Premultiplied)


def _owned(pixels: npt.NDArray[np.uint32], form: QImage.Format) -> QImage:
    height, width = pixels.shape
    return QImage(np.ascontiguousarray(pixels).tobytes(), width, height, 4 * width, form).copy()
