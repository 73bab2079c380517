"""Stage 1 (Zaaijer 2013 §4.2): a painted shape becomes point features, its user features.

Summits come first: `multitude` of them, thrown like darts. Support follows, lower than the summits: discs
that overlap along the shape's medial axis, so that a long range is one ridge and no string of pearls, then
the largest discs that fill the remaining holes, as far as the fidelity asks.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.features.darts import throw_spine, throw_summits
from sketchterrain.features.hashing import hash_unit, value_noise
from sketchterrain.features.holes import fill_holes
from sketchterrain.features.rules import LAYER_CODES, TYPES
from sketchterrain.features.shape_pixels import LEAST_DISC, Pixels

if TYPE_CHECKING:
    from sketchterrain.features.shapes import Shape

USER_FEATURE = np.dtype(
    [
        ("id", "u8"),  # layer code · 2⁴⁸ + pixel index
        ("type", "u1"),
        ("label", "u1"),
        ("row", "i4"),
        ("column", "i4"),
        ("disc", "f8"),  # px, radius of the part of the shape that it stands for
        ("share", "f8"),  # of the label's strength
        ("summit", "?"),
    ]
)
"""A user feature; positions are pixels of the sketch."""


def pixel_id(layer: str, row: Int64Array, column: Int64Array, image_width: int) -> npt.NDArray[np.uint64]:
    """Stable id of what stands on a pixel of a layer; its top bit is clear."""
    index = np.asarray(row).astype(np.int64) * image_width + np.asarray(column)
    return np.asarray(index + (LAYER_CODES[layer] << 48)).astype(np.uint64)


def mean_size(area: int, multitude: int) -> float:
    """Radius (px) of each of `multitude` equal discs with the shape's area, in steps of 2^(1/8).

    The steps keep a dab at a shape's edge from changing all of its features.
    """
    radius = max(math.sqrt(area / (math.pi * multitude)), LEAST_DISC)
    return float(2.0 ** (round(8.0 * math.log2(radius)) / 8.0))


def user_features(shape: Shape, *, multitude: int, fidelity: float, seed: int) -> npt.NDArray[np.void]:
    """Break a shape into user features.

    Parameters
    ----------
    shape : Shape
        Of a layer of point features.
    multitude : int
        How many summits to aim for, 1 or more. Fewer come where the shape has no room; never none.
    fidelity : float
        0 … 1: how much of the shape the union of the discs shall cover, from 60 % to 99.5 %.
    seed : int
        Seed of the terrain.

    Returns
    -------
    Array of ``USER_FEATURE``, summits first. Depends on nothing but this shape and the arguments.
    """
    mean = mean_size(shape.area, multitude)
    pixels = Pixels.from_shape(shape, most=1.25 * mean, seed=seed)
    if shape.area == 1:  # sketches may be sprinkled with thousands of them
        summits = chosen = np.zeros(1, dtype=np.int64)
    else:
        summits = throw_summits(shape, pixels, mean, multitude)
        spine = throw_spine(shape, pixels, summits, fidelity)
        support = fill_holes(shape, pixels, np.concatenate([summits, spine]), fidelity)
        chosen = np.concatenate([summits, spine, support])

    result = np.zeros(len(chosen), dtype=USER_FEATURE)
    result["row"] = pixels.row[chosen] + int(shape.rows.start)
    result["column"] = pixels.column[chosen] + int(shape.columns.start)
    result["id"] = pixel_id(shape.layer, result["row"], result["column"], shape.image_width)
    result["type"], result["label"] = LAYER_CODES[shape.layer], shape.label
    result["disc"] = pixels.disc[chosen]
    result["summit"][: len(summits)] = True
    result["share"] = _shares(shape, result, fidelity, seed)
    return result


def _shares(shape: Shape, features: npt.NDArray[np.void], fidelity: float, seed: int) -> Float64Array:
    """Strength relative to the label's: the largest summit has it whole, and no other has more."""
    rule = TYPES[shape.layer]
    disc, summit = features["disc"], features["summit"]
    largest = float(disc[summit].max())
    size = np.minimum(disc / largest, 1.0) ** rule.size_power
    scale = 2.5 * largest
    swing = value_noise(seed, f"{shape.layer} support", features["column"] / scale, features["row"] / scale)
    low, high = rule.support
    share = np.where(summit, 1.0, low + (high - low) * swing) * size
    whole = summit & (disc == largest)
    pixel = features["id"].astype(np.uint64)
    # Only summits differ at random: neighbouring discs of a ridge would look like a string of pearls.
    swing = np.where(summit, rule.variation * (2.0 * hash_unit(seed, "strength", pixel) - 1.0), 0.0)
    share = np.where(whole, 1.0, np.minimum(share * (1.0 + swing), 1.0))
    return np.asarray(np.maximum(share, rule.held * fidelity**4))
