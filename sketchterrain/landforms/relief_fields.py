"""Fields of relief of unpainted ground: gentle swells, ranges of mountains and hills by their density.

Relief is what the ground shall rise above its valleys (m); uplift, which the solver of `drainage` takes, is
proportional to it. Far beyond the sketch ranges rise in proportion to what is painted, so that the land goes
on behind it: they raise valleys and ridges, from outside of all cells that meet the painted region.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, pi
from statistics import NormalDist
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.document.label_layers import labels_in
from sketchterrain.geometry.hashing import hash_keys, rounded
from sketchterrain.host.library import host_function
from sketchterrain.io.resources import kernel_constants
from sketchterrain.landforms.mesh import SIDE, UNIT
from sketchterrain.landforms.placement.feature_types import TYPES
from sketchterrain.landforms.placement.heights import unpainted_height

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch

_KAPPA = 3.3  # height of ridges above valleys over uplift and r0, in cells of the mesh
_ARID, _PEDIMENTS = 0.5, 4.0  # aridity from which ground is more uneven and more level, and how fast
_DEVIATION = 0.262  # of the noise of ranges
(_RANGE_VALLEYS,) = kernel_constants("host/relief.h", "RANGE_VALLEYS")
_RANGE_SHARE = 0.5  # of the land beyond the sketch
_LOW_RANGES, _LOW_SLOPE = 150.0, 0.03  # m, and over the extent: height around level sketches
_RANGE_SLOPE = 0.12  # greatest height over the extent


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


def relief_at(fields: UpliftFields, points: Int64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return relief (m), the mountains' share, and what ranges raise valleys by (m), at points (…, 2)."""
    found = np.empty((3, *points.shape[:-1]))
    relief, share, beyond = found.reshape(3, -1)
    host_function("relief_at_points")(fields, points.reshape(-1, 2), relief, share, beyond)
    return found[0], found[1], _RANGE_VALLEYS * found[2]


def site_relief(
    fields: UpliftFields, column: int, row: int, x: Float64Array, y: Float64Array
) -> Float64Array:
    """Return the relief (m) at sites by their offsets (L)."""
    offset = np.floor(UNIT * np.stack([x, y], axis=-1)).astype(np.int64)
    return relief_at(fields, _grid(UNIT * column, UNIT * row, UNIT, x.shape) + offset)[0]


def _grid(west: int, south: int, step: int, shape: tuple[int, ...]) -> Int64Array:
    """Return x and y of a grid of points, (rows, columns, 2)."""
    rows, columns = shape
    x, y = np.meshgrid(west + step * np.arange(columns), south + step * np.arange(rows))
    return np.stack([x, y], axis=-1)


def relief_raster(
    fields: UpliftFields, level: int, column: int, row: int, rows: int, columns: int
) -> tuple[Float64Array, Float64Array]:
    """Return relief (m) and the mountains' share at nodes, below level 3 interpolated between its nodes."""
    bits = max(3 - level, 0)
    first_column, first_row = column >> bits, row >> bits
    shape = rows, columns
    if bits:
        shape = (
            ((row + rows - 1) >> bits) - first_row + 2,
            ((column + columns - 1) >> bits) - first_column + 2,
        )
    step = SIDE << (level + bits)
    relief, share, _ = relief_at(fields, _grid(step * first_column, step * first_row, step, shape))
    if not bits:
        return relief, share
    fine = np.empty((rows, columns)), np.empty((rows, columns))
    for source, target in zip((relief, share), fine, strict=True):
        host_function("interpolated_nodes")(bits, column, row, source, target)
    return fine
