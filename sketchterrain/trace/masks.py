"""What is painted on one layer of a paint program: all that is not transparent, or not the paper's colour."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sketchterrain.sketch.label_colours import to_oklab

if TYPE_CHECKING:
    from sketchterrain.trace.picture import Picture

__all__ = ["painted"]

_OTHER = 0.2  # Oklab: farther from the paper's colour is paint; half as far as what is painted most plainly
_SAME = 0.04  # Oklab: a picture that differs by less is of one colour
_ROWS = 512


def painted(picture: Picture) -> tuple[npt.NDArray[np.bool_], str]:
    """Return where a layer is painted, and how that was told.

    A layer that is transparent somewhere is painted where it is more than half opaque. Any other has a paper:
    the colour that most of its border has. White strokes on black are paint, and so are black ones on white.

    Returns
    -------
    numpy.ndarray
        bool, (height, width).
    str
        In words, for a person.
    """
    rgba = picture.rgba
    if picture.see_through:
        return rgba[..., 3] >= 128, "what is opaque is painted"
    paper = _paper(rgba)
    origin = to_oklab(np.array(paper) / 255.0)
    far = np.empty(rgba.shape[:2], dtype=np.float32)
    for top in range(0, len(rgba), _ROWS):
        colours = to_oklab(rgba[top : top + _ROWS, :, :3] / 255.0)
        far[top : top + _ROWS] = np.sqrt(((colours - origin) ** 2).sum(axis=-1))
    farthest = float(far.max())
    code = "#{:02x}{:02x}{:02x}".format(*paper)
    if farthest < _SAME:
        return np.zeros(far.shape, dtype=bool), f"it is all {code}, so nothing is painted"
    return far > min(_OTHER, 0.5 * farthest), f"its border is {code}, so what is not is painted"


def _paper(rgba: npt.NDArray[np.uint8]) -> tuple[int, int, int]:
    """Return the colour that most of the border has."""
    border = np.concatenate([rgba[0], rgba[-1], rgba[:, 0], rgba[:, -1]])[:, :3]
    coarse = (border >> 4).astype(np.int32)
    cells = (coarse[:, 0] << 8) | (coarse[:, 1] << 4) | coarse[:, 2]
    most = np.bincount(cells).argmax()
    red, green, blue = (int(value) for value in np.rint(border[cells == most].mean(axis=0)))
    return red, green, blue
