"""Packing of lakes and covers into the arrays that kernels read (``kernels/fields.clh``)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import spline_filter

from sketchterrain.terrain.lattice import metres_per_unit, to_lattice

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from sketchterrain.features import ShapeField
    from sketchterrain.terrain.recipe import TerrainRecipe

# Samples repeated around a field, so that a spline at its rim reads the rim only.
_PAD = 2
# The margin ends slightly inside the field's rim, so that rounding leaves no effect there.
_WITHIN = 0.999
# Metres of shelf per metre of depth, if the lake is wide enough; slopes of the shore.
_SHELF_RUN = 8.0
_SHORE_SHARE = 0.5
_STEEPEST_SHORE = 0.2
_STEEPEST_BED = 1.0
# Half the width of a cover's border, in samples, at fidelity 1 and at 0; small shapes have narrower ones.
_BORDER = (0.35, 3.0)
_BORDER_DEPTHS = 0.5


@dataclass(frozen=True)
class PackedFields:
    """Distance fields (``Fields`` of ``kernels/fields.clh``) of lakes or covers."""

    at: npt.NDArray[np.int64]  # (n, 2) first samples, lattice units
    far: npt.NDArray[np.int64]  # (n, 2) last samples, lattice units, rounded up
    form: npt.NDArray[np.int32]  # (n, 4) index of the first sample, columns, rows, 0
    scale: npt.NDArray[np.float64]  # (n,) samples per lattice unit
    margin: npt.NDArray[np.float64]  # (n,) distance of the outermost samples outside the shape, m
    depth: npt.NDArray[np.float64]  # (n,) greatest distance inside, m
    samples: npt.NDArray[np.float64]  # spline coefficients of all fields, m


@dataclass(frozen=True)
class PackedLakes:
    """Columns of ``Lakes`` in ``kernels/lakes.clh`` besides the fields, for one cell size."""

    shape: npt.NDArray[np.float64]  # (n, 4)
    profile: npt.NDArray[np.float64]  # (n, 4)
    visible: npt.NDArray[np.bool_]  # (n,) whether anything of a lake is left at the cell size


@dataclass(frozen=True)
class PackedCovers:
    """Columns that ``create_covers`` in ``kernels/materials.clh`` adds to the fields."""

    form: npt.NDArray[np.int32]  # (n, 4) the fields' form with the material's index in the last column
    shape: npt.NDArray[np.float64]  # (n, 4)


def pack_fields(recipe: TerrainRecipe, fields: Sequence[ShapeField]) -> PackedFields:
    """Return the spline coefficients that make each field interpolate its samples."""
    unit = metres_per_unit(recipe.extent)
    count = len(fields)
    at, far = np.zeros((2, count, 2), np.int64)
    form = np.zeros((count, 4), np.int32)
    scale, margin, depth = np.zeros((3, count))
    samples, first = [np.zeros(0)], 0
    for i, field in enumerate(fields):
        spline = np.asarray(spline_filter(field.inside.astype(np.float64), order=2, mode="mirror"))
        coefficients = np.pad(spline, _PAD, mode="edge")
        rows, columns = coefficients.shape
        corner = np.array([field.west, field.south]) - _PAD * field.spacing
        at[i] = to_lattice(corner, recipe.extent)
        far[i] = at[i] + np.ceil(np.array([columns, rows]) * field.spacing / unit).astype(np.int64)
        form[i] = first, columns, rows, 0
        scale[i] = unit / field.spacing
        rim = np.concatenate([coefficients[[0, -1]].ravel(), coefficients[:, [0, -1]].ravel()])
        margin[i] = max(-_WITHIN * float(rim.max()), 1e-3)
        depth[i] = max(float(field.inside.max()), 0.25 * field.spacing)
        samples.append(coefficients.ravel())
        first += coefficients.size
    return PackedFields(at, far, form, scale, margin, depth, np.concatenate(samples))


def pack_lakes(recipe: TerrainRecipe, fields: PackedFields, cell: float) -> PackedLakes:
    """Return the lakes' profiles; lakes narrower than two cells fade out and vanish at one.

    A lake is at most as deep as its greatest distance from the shore, so that its bed is no steeper than 45°.
    """
    level = np.array([lake.level for lake in recipe.lakes], dtype=np.float64)
    requested = np.array([lake.depth for lake in recipe.lakes], dtype=np.float64)
    deep = np.minimum(requested, _STEEPEST_BED * fields.depth)
    shelf = np.minimum(0.9 * fields.depth, _SHELF_RUN * deep)
    shore = np.minimum(_SHORE_SHARE * deep / shelf, _STEEPEST_SHORE)
    # The beach is a parabola over half the margin that starts with the shore's slope.
    rise = shore * fields.margin / 4
    fade = np.clip(2 * fields.depth / cell - 1, 0, 1)
    fade = fade * fade * (3 - 2 * fade)
    shape = np.stack([fields.scale, 1 / fields.margin, level, fade], axis=-1)
    profile = np.stack([deep, 1 / shelf, shore * shelf, rise], axis=-1)
    return PackedLakes(shape, profile, fade > 0)


def pack_covers(recipe: TerrainRecipe, fields: PackedFields) -> PackedCovers:
    """Return the covers' borders: wider at lower fidelity, and never wider than the fields' margins."""
    spacing = np.array([cover.shape.spacing for cover in recipe.covers], dtype=np.float64)
    sharp, loose = _BORDER
    half = spacing * (loose + (sharp - loose) * recipe.fidelity)
    half = np.minimum(half, np.maximum(_BORDER_DEPTHS * fields.depth, sharp * spacing))
    # Noise moves the border by up to its own width (``kernels/materials.clh``).
    half = np.minimum(half, fields.margin / 2)
    strength = np.array([cover.strength for cover in recipe.covers], dtype=np.float64)
    form = fields.form.copy()
    form[:, 3] = [cover.material for cover in recipe.covers]
    shape = np.stack([fields.scale, 0.5 / half, strength, np.zeros(len(half))], axis=-1)
    return PackedCovers(form, shape)
