"""Lines of one width through clicked points: rivers, and ridges that shall be as thin."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from sketchterrain.sketch import LAYERS, Sketch
from sketchterrain.sketch.box import Box, around
from sketchterrain.sketch.document import LabelImage
from sketchterrain.ui.painting.shapes import Dab, paint_sweep, snapped
from sketchterrain.ui.painting.stroke import THINNEST, smooth_dabs


def line_width(sketch: Sketch, layer: str, label: int, brush: float) -> float:
    """Return how wide a line of a label is painted, px.

    Parameters
    ----------
    sketch, layer, label
        A label that has a width, as rivers have, is painted as wide as that, never thinner than a pixel.
    brush
        Radius (px) of the brush, for all others.
    """
    if "width" not in LAYERS[layer].parameters:
        return 2.0 * brush
    width = sketch.properties(layer, label)["width"]
    assert isinstance(width, float)  # noqa: S101 # declared so
    return max(width / sketch.pixel_size, 2.0 * THINNEST)


def line_path(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the smooth curve through points as a polyline, to be shown while points are added.

    Parameters
    ----------
    points
        px to the right and down, centres of pixels at +0.5.
    """
    return [(x, y) for x, y, _ in _path(points, THINNEST)]


def draw_line(
    image: LabelImage, points: Sequence[tuple[float, float]], width: float, label: int
) -> Box | None:
    """Paint the smooth curve through points, with round ends.

    Parameters
    ----------
    image : (height, width) uint8
        Painted into.
    points
        One or more: px to the right and down, centres of pixels at +0.5; they may lie outside of the image.
    width
        px; at least one is taken.
    label
        0 … 255.

    Returns
    -------
    Box or None
        Around the pixels painted; None if none were.
    """
    path = _path(points, max(snapped(0.5 * width), THINNEST))
    box = None
    for start, end in [*pairwise(path), *zip(path[:1] + path[-1:], path[:1] + path[-1:], strict=True)]:
        box = around(box, paint_sweep(image, start, end, label))
    return box


def _path(points: Sequence[tuple[float, float]], radius: float) -> list[Dab]:
    dabs: list[Dab] = []
    for x, y in points:
        dab = snapped(x), snapped(y), radius
        if not dabs or dab != dabs[-1]:
            dabs.append(dab)
    path = dabs[:1]
    for piece in range(len(dabs) - 1):
        near = max(piece - 1, 0)
        path += smooth_dabs(dabs[near : piece + 3], piece - near)[1:]
    return path
