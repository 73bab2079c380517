"""Gullies on the host, in float64 (``kernels/layers/erosion.clh``)."""

import numpy as np

from sketchterrain.array_types import Float64Array, LatticeArray
from sketchterrain.io.resources import kernel_constants
from sketchterrain.terrain.layers.layer import HostSite
from sketchterrain.terrain.noise import OctaveTable, ValueSlope, simplex_corners

TALUS, FEED, GENTLE, _WAVES, _PIVOT, _CALM, _SHARP = kernel_constants(
    "layers/erosion.clh", "TALUS", "FEED", "GENTLE", "WAVES", "PIVOT", "CALM", "SHARP"
)
_PIVOT *= 2.0**31  # the kernel multiplies gradients of 32-bit integers

GULLY_PEAK = 1.25
"""Bound of an octave of gullies, over its depth."""

STEEPEST = GENTLE * TALUS
"""Square of the slope on which gullies are deepest."""


def gully_steepness(square: Float64Array) -> Float64Array:
    """Return the share of its depth that an octave of gullies has, by the square of a slope."""
    return square / ((square + GENTLE**2) * (1 + square / TALUS**2))


def gully_octave(
    octaves: OctaveTable, i: int, site: HostSite, depth: Float64Array, rise: ValueSlope, total: ValueSlope
) -> ValueSlope:
    """Return the sum of octaves of gullies with one more; its slope per metre is that of constant waves."""
    east = rise.east + FEED * total.east
    north = rise.north + FEED * total.north
    square = east * east + north * north
    across = _WAVES / np.sqrt(np.maximum(square, 1e-12))
    cosine, sine, weight = _waves(octaves, i, site.x, site.y, -north * across, east * across)
    even = 1 / np.sqrt(cosine**2 + sine**2 + _CALM * weight**2)
    wave = cosine * even
    per_metre = octaves.scale[i, 1] / site.sampling.unit
    depth = depth * gully_steepness(square)
    lean = depth * (1 + 2 * _SHARP * wave) * -sine * even * 2 * np.pi * per_metre * across
    return ValueSlope(
        total.value + depth * (wave + _SHARP * (wave * wave - 0.5)),
        total.east - lean * north,
        total.north + lean * east,
    )


def _waves(
    octaves: OctaveTable, i: int, x: LatticeArray, y: LatticeArray, east: Float64Array, north: Float64Array
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Sum an octave's waves (turns per cell eastward and northward) over the corners around each point."""
    if octaves.form[i, 2]:
        east, north = north, -east
    cosine, sine, total = np.zeros((3, *x.shape))
    for (dx, dy), (gx, gy), near in simplex_corners(octaves, i, x, y):
        weight = near**2
        angle = 2 * np.pi * (east * (dx - _PIVOT * gx) + north * (dy - _PIVOT * gy))
        cosine += weight * np.cos(angle)
        sine += weight * np.sin(angle)
        total += weight
    return cosine, sine, total
