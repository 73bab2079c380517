"""The shores of lakes as lines: where a field of distances changes its sign. No Qt."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from sketchterrain.features import ShapeField

__all__ = ["shore_lines"]

_MOST = 768  # samples along a side of a field that are looked at


def shore_lines(field: ShapeField) -> npt.NDArray[np.float64]:
    """Return the border of a shape.

    Parameters
    ----------
    field : ShapeField

    Returns
    -------
    (n, 4) float64
        Straight pieces: x, y of one end and of the other (m).
    """
    step = max(-(-max(field.inside.shape) // _MOST), 1)
    inside = np.asarray(field.inside[::step, ::step], np.float64)
    inside = np.where(inside == 0.0, 1e-9, inside)
    south, north = inside[:-1], inside[1:]
    corners = np.stack([south[:, :-1], south[:, 1:], north[:, :-1], north[:, 1:]])
    rows, columns = np.nonzero(np.any((corners > 0.0) != (corners[0] > 0.0), axis=0))
    a, b, c, d = corners[:, rows, columns]
    zero, one = np.zeros_like(a), np.ones_like(a)
    # Where each of a square's sides is crossed, from its south-west corner: south, north, west, east.
    with np.errstate(divide="ignore", invalid="ignore"):
        at = np.stack(
            [
                np.stack([a / (a - b), zero], -1),
                np.stack([c / (c - d), one], -1),
                np.stack([zero, a / (a - c)], -1),
                np.stack([one, b / (b - d)], -1),
            ],
            axis=1,
        )
    crossed = np.stack([a * b < 0.0, c * d < 0.0, a * c < 0.0, b * d < 0.0], axis=1)
    at += np.stack([columns, rows], axis=-1)[:, None, :]
    twice = crossed.sum(axis=1) == 2
    once = at[twice][crossed[twice]].reshape(-1, 4)
    saddles = at[~twice][:, [[0, 2], [1, 3]]].reshape(-1, 4)
    pieces = np.concatenate([once, saddles]) * (field.spacing * step)
    return np.asarray(pieces + np.array([field.west, field.south, field.west, field.south]))
