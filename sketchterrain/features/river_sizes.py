"""How wide and deep a river is along its skeleton: what its labels say, or as wide as it was painted."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.features.river_path import arc_length, smoothed
from sketchterrain.features.rounding import RATIO_STEP, gaussian_filter, rounded

if TYPE_CHECKING:
    from sketchterrain.features.skeleton import Skeleton
    from sketchterrain.sketch.document import Sketch


_DEPTH_POWER = 0.6  # how depth follows width along a river
_SMOOTH = 6.0  # px along the course
_MOST_MORE = 1.5  # px that a stroke is wider than twice the distance to its border
_NARROWEST, _WIDEST = 0.5, 2000.0  # m


def painted_sizes(
    sketch: Sketch, skeleton: Skeleton, pixels: Int64Array, *, joins: bool = False
) -> tuple[Float64Array, Float64Array, int]:
    """Read a river's sizes from its labels, or from the stroke where a label's width is 0.

    There the label's depth is that of the stroke's mean width, and the depth follows the width.

    Parameters
    ----------
    sketch : Sketch
    skeleton : Skeleton
    pixels : (n,) int64
        The path, upstream first.
    joins : bool
        Whether it ends on another river's middle, so that its last pixels are that river's.

    Returns
    -------
    widths, depths : (n,) float64
        Metres, smoothed.
    label : int
        That of most of it.
    """
    labels = sketch.layers["river"][skeleton.rows[pixels], skeleton.columns[pixels]]
    within = math.ceil(float(skeleton.depth[pixels[-1]])) + 1
    own = len(labels) - within if joins and within < len(labels) else len(labels)
    labels[own:] = labels[own - 1]
    main = int(np.argmax(np.bincount(labels, minlength=256)))
    widths, depths = np.zeros(len(pixels)), np.zeros(len(pixels))
    as_painted = np.zeros(len(pixels), dtype=np.bool_)
    for label in np.unique(labels):
        properties, here = sketch.properties("river", int(label)), labels == label
        widths[here], depths[here] = max(properties["width"], _NARROWEST), properties["depth"]
        as_painted[here] = properties["width"] == 0.0
    if as_painted.any():
        wide = stroke_widths(sketch, skeleton, pixels)
        wide[own:] = wide[own - 1]
        wide = np.clip(smoothed(wide[:, None], _SMOOTH)[:, 0], _NARROWEST, _WIDEST)
        follows = depth_ratio(wide / wide[as_painted].mean())
        widths, depths = np.where(as_painted, wide, widths), np.where(as_painted, depths * follows, depths)
    if labels.min() != labels.max():
        widths, depths = (gaussian_filter(each, _SMOOTH) for each in (widths, depths))
    return widths, depths, main


def depth_ratio(width_ratio: Float64Array) -> Float64Array:
    """Return how many times deeper a river is that is so many times wider."""
    return rounded(width_ratio**_DEPTH_POWER, RATIO_STEP)


def stroke_widths(sketch: Sketch, skeleton: Skeleton, pixels: Int64Array) -> Float64Array:
    """Width (m) of the painted stroke at each pixel of a path: its area over its length.

    Twice the distance to the border alone is up to a pixel too little.
    """
    at = np.stack([skeleton.rows[pixels], skeleton.columns[pixels]], axis=-1)
    least, most = 2.0 * skeleton.depth[pixels], 2.0 * skeleton.depth[pixels] + _MOST_MORE
    reach = math.ceil(0.5 * float(most.max()))
    low, high = np.maximum(at.min(axis=0) - reach, 0), at.max(axis=0) + reach + 1
    area = np.argwhere(sketch.layers["river"][low[0] : high[0], low[1] : high[1]] > 0) + low
    nearest = cKDTree(np.stack([skeleton.rows, skeleton.columns], axis=-1)).query(area)[1]
    count = np.bincount(nearest, minlength=len(skeleton.rows))[pixels].astype(np.float64)
    arc = arc_length(at.astype(np.float64))
    step = np.gradient(arc) if len(arc) > 1 else np.ones(1)
    count = np.minimum(count, most * step)
    area_of, length = (gaussian_filter(each, _SMOOTH / 3.0) for each in (count, step))
    return np.asarray(np.clip(area_of / length, np.maximum(least, 1.0), most) * sketch.pixel_size)
