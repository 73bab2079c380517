"""The gullies that erosion cuts and the roughness of bare rock, in plain NumPy float64.

What ``kernels/erosion.clh`` is measured against.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.terrain.octaves import UNSKEW
from sketchterrain.terrain.reference_noise import Slope, fbm, gradients, skewed

if TYPE_CHECKING:
    from sketchterrain.array_types import Float64Array, LatticeArray
    from sketchterrain.terrain.octaves import OctaveTable
    from sketchterrain.terrain.reference_relief import Rise


_TALUS = 2.1445069205095586
_WAVES, _PIVOT, _FEED, _CALM, _SHARP, _GENTLE, _ROUGH = 1.4, 2.2e-10 * 2.0**31, 0.55, 0.3, 0.35, 0.5, 0.7


def deepest_gullies(
    w: np.void, octaves: OctaveTable, erosion: Float64Array, widest: Float64Array
) -> Float64Array:
    """Return by how much (m) `gullies` lowers ground, at most, and raises it but for 18 %.

    Parameters
    ----------
    w, octaves
    erosion, widest : (n,) float64
        At most.
    """
    steepest = 1 / (1 + _GENTLE / _TALUS) ** 2  # the most that the slope's say can be
    depths = (_depth(w, octaves, i, erosion, widest) for i in range(*octaves.ranges["gully"]))
    return steepest * sum(depths, np.zeros(erosion.shape))


def _depth(
    w: np.void, octaves: OctaveTable, i: int, erosion: Float64Array, widest: Float64Array
) -> Float64Array:
    """Depth (m) of an octave's gullies where the slope has its full say."""
    t = np.clip((widest * (octaves.scale[i, 1] * w["units_per_metre"]) - 0.5) * 2, 0, 1)
    return np.asarray(w["gully_depth"] * octaves.scale[i, 0] * erosion * t * t * (3 - 2 * t))


def gullies(w: np.void, octaves: OctaveTable, x: LatticeArray, y: LatticeArray, rise: Rise) -> Slope:
    """Return what erosion adds to the height, with its slope per metre, the waves' directions held."""
    value, east_sum, north_sum = np.zeros((3, *x.shape))
    leans = [np.broadcast_to(part, x.shape) for part in rise.height[1:]]
    for i in range(*octaves.ranges["gully"]):
        whole = np.broadcast_to(_depth(w, octaves, i, rise.erosion, rise.widest), x.shape)
        here = whole > 0  # elsewhere nothing is added
        if not here.any():
            continue
        east = leans[0][here] + _FEED * east_sum[here]
        north = leans[1][here] + _FEED * north_sum[here]
        square = east * east + north * north
        across = _WAVES / np.sqrt(np.maximum(square, 1e-12))
        cosine, sine, weight = _waves(octaves, i, x[here], y[here], -north * across, east * across)
        even = 1 / np.sqrt(cosine**2 + sine**2 + _CALM * weight**2)
        v = cosine * even
        per_metre = octaves.scale[i, 1] * w["units_per_metre"]
        depth = whole[here] * square / ((square + _GENTLE**2) * (1 + square / _TALUS**2))
        value[here] += depth * (v + _SHARP * (v * v - 0.5))
        lean = depth * (1 + 2 * _SHARP * v) * -sine * even * 2 * np.pi * per_metre * across
        east_sum[here] -= lean * north
        north_sum[here] += lean * east
    return Slope(value, east_sum, north_sum)


def _waves(
    octaves: OctaveTable, i: int, x: LatticeArray, y: LatticeArray, east: Float64Array, north: Float64Array
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Sum an octave's waves (turns a cell eastward and northward) over the corners around each place."""
    cell_u, cell_v, fu, fv = skewed(octaves, i, x, y)
    if octaves.form[i, 2]:
        east, north = north, -east
    lower = fu > fv
    sums = np.zeros((3, *x.shape))
    for iu, iv in ((0, 0), (lower.astype(np.int64), (~lower).astype(np.int64)), (1, 1)):
        du, dv = fu - iu, fv - iv
        d = np.stack([du, dv]) - (du + dv) * UNSKEW
        g = gradients(cell_u + iu, cell_v + iv, seed=int(octaves.form[i, 1]))
        say = np.maximum(0.5 - (d * d).sum(axis=0), 0) ** 2
        angle = 2 * np.pi * (east * (d[0] - _PIVOT * g[0]) + north * (d[1] - _PIVOT * g[1]))
        sums += say * np.stack([np.cos(angle), np.sin(angle), np.ones(x.shape)])
    return sums[0], sums[1], sums[2]


def crags(
    w: np.void,
    octaves: OctaveTable,
    x: LatticeArray,
    y: LatticeArray,
    east: Float64Array,
    north: Float64Array,
) -> Float64Array:
    """Return what the roughness of bare rock adds to mountains of a slope."""
    square = east * east + north * north
    return np.asarray(w["crag_depth"] * square / (square + _ROUGH) * fbm(octaves, "crag", x, y))
