"""Fields of relief of unpainted ground: gentle swells, ranges of mountains and hills by their density.

Relief is what the ground shall rise above its valleys (m); uplift, which the solver of `drainage` takes, is
proportional to it. Far beyond the sketch ranges rise in proportion to what is painted, so that the land goes
on behind it: they raise valleys and ridges, from outside of all cells that meet the painted region.
"""
# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, floor, pi, sqrt
from statistics import NormalDist
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sketchterrain.document.label_layers import labels_in
from sketchterrain.geometry.hashing import hash_keys, rounded
from sketchterrain.landforms.hashed_noise import compiled, gradient_noise, value_noise_row
from sketchterrain.landforms.mesh import SIDE, SITE_BITS, UNIT_BITS, base_level
from sketchterrain.landforms.placement.feature_types import TYPES
from sketchterrain.landforms.placement.heights import unpainted_height

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch

_KAPPA = 3.3  # height of ridges above valleys over uplift and r0, in cells of the mesh
_STRETCH = 2.0  # length of ranges over their width
_ARID, _PEDIMENTS = 0.5, 4.0  # aridity from which ground is more uneven and more level, and how fast
_DEVIATION = 0.262  # of the noise of ranges
_ACROSS = sqrt(0.75)
# Ranges beyond the sketch: distances from its square where they begin and are as high as anywhere, their
# width (L), and share of the land; how much of their height is relief, and how much their valleys rise.
_RANGES_FROM, _RANGES_FULL, _RANGE_WIDTH, _RANGE_SHARE = 2.4, 6.5, 3.0, 0.5
_RANGE_RELIEF, _RANGE_VALLEYS = 0.65, 0.45
_LOW_RANGES, _LOW_SLOPE = 150.0, 0.03  # m, and over the extent: height around level sketches
_RANGE_SLOPE = 0.12  # greatest height over the extent
_SKETCH_SIDE = 256 >> SITE_BITS  # L


@dataclass(frozen=True)
class UnpaintedSettings:
    """What unpainted ground depends on: lengths and heights in m, densities in features per km²."""

    extent: float
    seed: int
    relief: float = 40.0
    wavelength: float = 1600.0
    roughness: float = 0.45
    mountain_density: float = 0.0
    hill_density: float = 0.0
    mountain_height: float = 600.0
    hill_height: float = 80.0
    pediments: float = 0.0  # 0 … 1: how much of the ground is nearly level
    surroundings: float = 0.0  # height of ranges beyond the sketch
    rocky_surroundings: bool = False  # whether they are mountains

    @classmethod
    def from_sketch(cls, sketch: Sketch) -> UnpaintedSettings:
        """Return the settings of a sketch: its ground, densities, and heights of the layers' label 1."""
        ground, density, aridity = sketch.ground, sketch.density, float(sketch.climate["aridity"])
        mountain, hill = (unpainted_height(sketch, name) for name in ("mountain", "hill"))
        highest, rocky = _highest(sketch)
        return cls(
            sketch.extent,
            sketch.seed,
            float(ground["relief"]),
            float(ground["wavelength"]),
            float(ground["roughness"]),
            float(density.get("mountain", 0.0)),
            float(density.get("hill", 0.0)),
            mountain,
            hill,
            min(max(_PEDIMENTS * (aridity - _ARID), 0.0), 1.0),
            min(float(ground["surroundings"]) * highest, _RANGE_SLOPE * sketch.extent),
            rocky,
        )

    @property
    def painted(self) -> UnpaintedSettings:
        """Settings of the painted region, which surroundings do not reach."""
        return replace(self, surroundings=0.0, rocky_surroundings=False)

    @property
    def spacing(self) -> float:
        """Spacing r0 of the nodes of level 0 (m)."""
        return self.extent / 256.0

    @property
    def ground_relief(self) -> float:
        """Relief of the ground (m): less where the whole sketch is smaller than its wavelength."""
        return self.relief * min(1.0, self.extent / self.wavelength)


def _highest(sketch: Sketch) -> tuple[float, bool]:
    """Return the greatest height (m) of painted labels, at least that of hills, and whether it is rock."""
    hills = min(_LOW_RANGES, _LOW_SLOPE * sketch.extent), False
    found = [
        (unpainted_height(sketch, layer, label), layer != "hill")
        for layer in ("mountain", "hill", "plateau")
        for label in labels_in(sketch.layers[layer])
    ]
    return max((hills, *found))


class UpliftFields(NamedTuple):
    """Parameters of the fields of relief (m) that uplift is derived from; lengths in mesh units."""

    key: np.uint64
    roughness: float
    ground: float  # relief (m)
    ground_scale: float  # 1 / wavelength
    pediments: float  # 0 … 1: how much of the ground is nearly level
    mountain: float  # height (m), 0: none
    mountain_scale: float
    mountain_threshold: float
    hill: float
    hill_scale: float
    hill_threshold: float
    per_relief: float  # uplift per m of relief
    range: float  # height (m) of ranges beyond the sketch
    range_threshold: float
    range_rock: float  # 0 … 1


def _share(density: float, radius: float) -> float:
    """Return the share of ground covered by features of a density (1/km²), of 0.4 … 1 of a radius (m)."""
    mean_square = (1.0 - 0.16) / (2.0 * 0.9162907318741551) * radius * radius
    return 1.0 - exp(-density * 1e-6 * pi * mean_square)


def _threshold(share: float) -> float:
    """Return the height of the noise of ranges that a share of the plane exceeds."""
    if share <= 0.0:
        return 1e9
    share = min(share, 0.98)
    return float(rounded(-_DEVIATION * NormalDist().inv_cdf(share), 2.0**-20))


def uplift_fields(settings: UnpaintedSettings) -> UpliftFields:
    """Return the parameters of the fields of relief."""
    unit = settings.spacing / SIDE  # m
    mountain, hill = TYPES["mountain"], TYPES["hill"]
    wide = min(mountain.fill_radius, mountain.fill_extent * settings.extent)
    small = min(hill.fill_radius, hill.fill_extent * settings.extent)
    return UpliftFields(
        np.uint64(hash_keys(settings.seed, "unpainted uplift")),
        settings.roughness,
        settings.ground_relief,
        unit / settings.wavelength,
        settings.pediments,
        min(settings.mountain_height, mountain.fill_slope * wide),
        unit / (2.6 * wide),
        _threshold(_share(settings.mountain_density, wide)),
        min(settings.hill_height, hill.fill_slope * small),
        unit / (2.6 * small),
        _threshold(_share(settings.hill_density, small)),
        1.0 / (_KAPPA * settings.spacing),
        settings.surroundings,
        _threshold(_RANGE_SHARE),
        float(settings.rocky_surroundings),
    )


@compiled
def range_noise(key, x, y):
    """Return noise of joined, elongated shapes, their direction varying over the land; a swing per unit."""
    turn = 2.0 * gradient_noise(key, 0.11 * x, 0.11 * y)
    total = squares = 0.0
    for k in range(3):
        weight = max(0.0, 1.0 - abs(1.5 * turn - (k - 1.0)))
        if (k == 0 and turn < -2.0 / 3.0) or (k == 2 and turn > 2.0 / 3.0):
            weight = 1.0
        if weight == 0.0:
            continue
        if k == 0:
            along, across = -0.5 * x + _ACROSS * y, -_ACROSS * x - 0.5 * y
        elif k == 1:
            along, across = x, y
        else:
            along, across = 0.5 * x + _ACROSS * y, -_ACROSS * x + 0.5 * y
        own = key + np.uint64(101 * (k + 1))
        total += weight * gradient_noise(own, along / _STRETCH, across)
        squares += weight * weight
    value = total / sqrt(squares)
    return value + 0.35 * gradient_noise(key + np.uint64(7), 2.1 * x, 2.1 * y)


@compiled
def _smooth(t):
    t = min(max(t, 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@compiled
def range_at(fields, x, y):
    """Return the height (m) of ranges beyond the sketch at a point (mesh units): 0 near its square."""
    scale, half = 1.0 / (1 << UNIT_BITS), 0.5 * _SKETCH_SIDE
    east, north = max(abs(x * scale - half) - half, 0.0), max(abs(y * scale - half) - half, 0.0)
    far = (sqrt(east * east + north * north) - _RANGES_FROM) / (_RANGES_FULL - _RANGES_FROM)
    if far <= 0.0 or fields.range <= 0.0:
        return 0.0
    u, v = x * (scale / _RANGE_WIDTH), y * (scale / _RANGE_WIDTH)
    above = (range_noise(fields.key + np.uint64(3000), u, v) - fields.range_threshold) / _DEVIATION
    height = 0.85 + 0.5 * gradient_noise(fields.key + np.uint64(15), 0.6 * u, 0.6 * v)
    return _smooth(far) * _smooth(0.5 + 0.42 * above) * height * fields.range


@compiled
def relief_at(fields, x, y):
    """Return the relief (m) of ground above its valleys at a point (mesh units), and the mountains' share."""
    key = fields.key
    u, v = x * fields.ground_scale, y * fields.ground_scale
    swell = gradient_noise(key + np.uint64(11), 0.5 * u, 0.5 * v) + 0.5 * gradient_noise(
        key + np.uint64(12), u, v
    )
    swell += 0.9 * gradient_noise(key + np.uint64(14), x * 2.0**-13, y * 2.0**-13)
    ground = fields.ground * (0.6 - 0.35 * fields.pediments + (0.7 + 0.7 * fields.pediments) * swell)
    ground = max(ground, 0.12 * fields.ground)
    square = ground * ground
    share = 0.0
    if fields.mountain_threshold < 1e8:
        u, v = x * fields.mountain_scale, y * fields.mountain_scale
        above = (range_noise(key + np.uint64(1000), u, v) - fields.mountain_threshold) / _DEVIATION
        share = _smooth(0.5 + 0.42 * above)
        height = (
            share * fields.mountain * (0.85 + 0.4 * gradient_noise(key + np.uint64(13), 0.6 * u, 0.6 * v))
        )
        square += height * height
    if fields.hill_threshold < 1e8:
        u, v = x * fields.hill_scale, y * fields.hill_scale
        above = (range_noise(key + np.uint64(2000), u, v) - fields.hill_threshold) / _DEVIATION
        height = _smooth(0.5 + 0.7 * above) * fields.hill
        square += height * height
    beyond = range_at(fields, x, y)
    if beyond > 0.0:
        share = max(share, fields.range_rock * min(beyond / (0.6 * fields.range), 1.0))
        square += _RANGE_RELIEF * beyond * _RANGE_RELIEF * beyond
    return sqrt(square), share


@compiled
def vertex_relief(fields, centre):
    """Return the relief (m) at vertices, of shape (rows, columns, 2)."""
    result = np.empty(centre.shape[:3])
    for j, i, half in np.ndindex(result.shape):
        result[j, i, half], _ = relief_at(fields, centre[j, i, half, 0], centre[j, i, half, 1])
    return result


@compiled
def valley_rise(fields, centre):
    """Return what ranges beyond the sketch raise valleys by (m), at vertices (rows, columns, 2)."""
    rise = np.empty(centre.shape[:3])
    for j, i, half in np.ndindex(rise.shape):
        beyond = range_at(fields, centre[j, i, half, 0], centre[j, i, half, 1])
        rise[j, i, half] = _RANGE_VALLEYS * beyond
    return rise


@compiled
def site_relief(fields, column, row, x, y):
    """Return the relief (m) at sites by their offsets (L)."""
    relief = np.empty(x.shape)
    for j, i in np.ndindex(x.shape):
        east = ((column + i) << UNIT_BITS) + floor(x[j, i] * (1 << UNIT_BITS))
        north = ((row + j) << UNIT_BITS) + floor(y[j, i] * (1 << UNIT_BITS))
        relief[j, i], _ = relief_at(fields, east, north)
    return relief


@compiled
def _relief_nodes(fields, level, column, row, rows, columns):
    """Return relief (m) and the mountains' share at nodes."""
    relief, share = np.empty((rows, columns)), np.empty((rows, columns))
    for j, i in np.ndindex(rows, columns):
        relief[j, i], share[j, i] = relief_at(
            fields, ((column + i) << level) * SIDE, ((row + j) << level) * SIDE
        )
    return relief, share


@compiled
def relief_raster(fields, level, column, row, rows, columns):
    """Return relief (m) and the mountains' share at nodes, below level 3 interpolated between its nodes."""
    if level >= 3:
        return _relief_nodes(fields, level, column, row, rows, columns)
    relief, share = np.empty((rows, columns)), np.empty((rows, columns))
    bits = 3 - level
    first_column, first_row = column >> bits, row >> bits
    width = ((column + columns - 1) >> bits) - first_column + 2
    height = ((row + rows - 1) >> bits) - first_row + 2
    coarse, coarse_share = _relief_nodes(fields, 3, first_column, first_row, height, width)
    scale = 1.0 / (1 << bits)
    for j in range(rows):
        q = (row + j) >> bits
        v = (row + j - (q << bits)) * scale
        q -= first_row
        for i in range(columns):
            p = (column + i) >> bits
            u = (column + i - (p << bits)) * scale
            p -= first_column
            for source, target in ((coarse, relief), (coarse_share, share)):
                south = source[q, p] + u * (source[q, p + 1] - source[q, p])
                north = source[q + 1, p] + u * (source[q + 1, p + 1] - source[q + 1, p])
                target[j, i] = south + v * (north - south)
    return relief, share


@compiled
def roughened(fields, relief, level, column, row):
    """Return uplift at nodes, varied over 8 and 16 nodes of level 0."""
    rows, columns = relief.shape
    uplift, noise = np.empty((rows, columns)), np.empty(columns)
    x, step = (column << level) * SIDE, SIDE << level
    for j in range(rows):
        y = ((row + j) << level) * SIDE
        noise[:] = 0.0
        value_noise_row(fields.key + np.uint64(21), x, step, y, 8, 1.0, noise)
        value_noise_row(fields.key + np.uint64(22), x, step, y, 7, 0.9, noise)
        for i in range(columns):
            uplift[j, i] = relief[j, i] * fields.per_relief * max(1.0 + fields.roughness * noise[i], 0.15)
    return uplift


@compiled
def mean_ground(mesh, fields, level, column, row, rows, columns):
    """Return heights (m) of the smooth mean of the ground, and the mountains' share."""
    height, share = np.empty((rows, columns)), np.empty((rows, columns))
    for j, i in np.ndindex(rows, columns):
        x, y = ((column + i) << level) * SIDE, ((row + j) << level) * SIDE
        relief, share[j, i] = relief_at(fields, x, y)
        height[j, i] = base_level(mesh, x, y) + 0.85 * relief + 0.6 * _RANGE_VALLEYS * range_at(fields, x, y)
    return height, share
