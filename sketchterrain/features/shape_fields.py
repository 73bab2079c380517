"""Painted shapes as fields of signed distance, their outline rounded a little."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from sketchterrain.features.catalogue import ShapeField
from sketchterrain.features.rounding import gaussian_filter
from sketchterrain.features.shapes import EDGE_OVERHANG

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import Float64Array
    from sketchterrain.features.shapes import Shape
    from sketchterrain.sketch import Sketch


# Standard deviation of the blur that rounds an outline at fidelity 0, pixels.
_BLUR = 4.0
# A blur is no wider than this share of the shape's greatest depth: a small shape keeps its form.
_BLUR_SHARE = 0.5


def shape_field(sketch: Sketch, shape: Shape, *, margin: float) -> ShapeField:
    """Return the distance to a shape's border at the centres of the pixels in and around it.

    The border runs midway between painted and other pixels. It is rounded the more the lower the fidelity,
    and moved so that the shape keeps its area. Beyond the sketch's edge a shape that touches it goes on.

    Parameters
    ----------
    sketch
        Where it was painted.
    shape
        One of its shapes.
    margin
        How far the outermost samples lie outside the shape, at least (m).
    """
    height, width = sketch.height_px, sketch.width_px
    over = round(EDGE_OVERHANG * max(height, width))
    # Distances shrink by up to two pixels where the border is moved.
    rim = int(np.ceil(margin / sketch.pixel_size)) + 3
    north, south = over * (shape.rows.start == 0), over * (shape.rows.stop == height)
    west, east = over * (shape.columns.start == 0), over * (shape.columns.stop == width)
    mask = np.pad(shape.mask, ((north, south), (west, east)), mode="edge")
    mask = np.pad(mask, rim)
    inside = _rounded(_signed_distance(mask), mask, (1.0 - sketch.fidelity) * _BLUR)
    pixel = sketch.pixel_size
    return ShapeField(
        west=(shape.columns.start - west - rim + 0.5) * pixel,
        south=(height - shape.rows.stop - south - rim + 0.5) * pixel,
        spacing=pixel,
        inside=np.ascontiguousarray(inside[::-1] * pixel, dtype=np.float32),
    )


def _signed_distance(mask: npt.NDArray[np.bool_]) -> Float64Array:
    """Distance of pixel centres from the border, in pixels: positive inside."""
    within, beyond = ndimage.distance_transform_edt(mask), ndimage.distance_transform_edt(~mask)
    return np.asarray(np.where(mask, within - 0.5, 0.5 - beyond), dtype=np.float64)


def _rounded(distance: Float64Array, mask: npt.NDArray[np.bool_], blur: float) -> Float64Array:
    """Blur a distance and shift it so that as many pixels are inside as before."""
    sigma = min(blur, _BLUR_SHARE * float(distance.max()))
    if sigma <= 0:
        return distance
    smooth = gaussian_filter(distance, sigma, axes=(0, 1))
    rank = mask.size - int(np.count_nonzero(mask))
    below, above = np.partition(smooth.ravel(), [rank - 1, rank])[[rank - 1, rank]]
    return np.asarray(smooth - 0.5 * (below + above))
