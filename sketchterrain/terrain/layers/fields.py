"""Painted shapes as signed distance fields, read by quadratic B-splines (``kernels/fields.clh``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.ndimage import spline_filter

from sketchterrain.array_types import BoolArray, Float64Array, LatticeArray, StructuredArray
from sketchterrain.geometry.box_index import BoxIndex, content_items
from sketchterrain.geometry.lattice import metres_per_unit, to_lattice
from sketchterrain.landforms.placement.feature_types import ShapeField

# Samples repeated around a field, so that a spline at its rim reads the rim only.
_PAD = 2
# The margin ends slightly inside the field's rim, so that rounding leaves no effect there.
_WITHIN = 0.999
_ROUNDING = 2  # lattice units
_MARGIN = 2  # samples: the support of a field's spline


@dataclass(frozen=True)
class PackedFields:
    """Distance fields (``Fields`` of ``kernels/fields.clh``) of lakes or covers."""

    at: LatticeArray  # (n, 2) first samples, lattice units
    far: LatticeArray  # (n, 2) last samples, lattice units, rounded up
    form: npt.NDArray[np.int32]  # (n, 4) index of the first sample, columns, rows, 0
    scale: Float64Array  # (n,) samples per lattice unit
    margin: Float64Array  # (n,) distance of the outermost samples outside the shape, m
    depth: Float64Array  # (n,) greatest distance inside, m
    samples: Float64Array  # spline coefficients of all fields, m

    @cached_property
    def boxes(self) -> LatticeArray:
        """Boxes that the fields affect, shape (n, 4), lattice units."""
        return np.concatenate([self.at - _ROUNDING, self.far + _ROUNDING], axis=1)

    @cached_property
    def index(self) -> BoxIndex:
        """Index of the boxes."""
        return BoxIndex(self.boxes)


@dataclass(frozen=True)
class FieldRows:
    """Fields of shapes with what kernels read of each besides, at one cell size."""

    fields: PackedFields
    columns: Mapping[str, int]  # of rows, by name
    row: Float64Array  # (n, columns)
    visible: BoolArray  # (n,) whether anything of a shape is left at the cell size

    def __getitem__(self, name: str) -> Float64Array:
        """Return a column, shape (n,)."""
        return self.row[:, self.columns[name]]


def pack_fields(fields: Sequence[ShapeField], extent: float, *, is_blurred: bool = False) -> PackedFields:
    """Return spline coefficients by which fields interpolate their samples; if blurred, the samples."""
    unit, pad = metres_per_unit(extent), 1 if is_blurred else _PAD
    count = len(fields)
    at, far = np.zeros((2, count, 2), np.int64)
    form = np.zeros((count, 4), np.int32)
    scale, margin, depth = np.zeros((3, count))
    samples, first = [np.zeros(0)], 0
    for i, field in enumerate(fields):
        spline = field.inside.astype(np.float64)
        if not is_blurred:
            spline = np.asarray(spline_filter(spline, order=2, mode="mirror"))
        coefficients = np.pad(spline, pad, mode="edge")
        rows, columns = coefficients.shape
        corner = np.array([field.west, field.south]) - pad * field.spacing
        at[i] = to_lattice(corner, extent)
        far[i] = at[i] + np.ceil(np.array([columns, rows]) * field.spacing / unit).astype(np.int64)
        form[i] = first, columns, rows, 0
        scale[i] = unit / field.spacing
        rim = np.concatenate([coefficients[[0, -1]].ravel(), coefficients[:, [0, -1]].ravel()])
        margin[i] = max(-_WITHIN * float(rim.max()), 1e-3)
        depth[i] = max(float(field.inside.max()), 0.25 * field.spacing)
        samples.append(coefficients.ravel())
        first += coefficients.size
    return PackedFields(at, far, form, scale, margin, depth, np.concatenate(samples))


def field_items(
    fields: Sequence[ShapeField], settings: Sequence[tuple[float, ...]], extent: float
) -> StructuredArray:
    """Return items of fields by their contents, with the settings that their layer reads."""
    unit = metres_per_unit(extent)
    contents, low, high = [], np.zeros((len(fields), 2), np.int64), np.zeros((len(fields), 2), np.int64)
    for i, (field, values) in enumerate(zip(fields, settings, strict=True)):
        place = np.array([field.west, field.south, field.spacing, *field.inside.shape, *values])
        contents.append((place.tobytes(), field.inside.tobytes()))
        corner, size = np.array([field.west, field.south]), np.array(field.inside.shape[::-1]) - 1
        low[i] = np.floor((corner - _MARGIN * field.spacing) / unit)
        high[i] = np.ceil((corner + (size + _MARGIN) * field.spacing) / unit)
    return content_items(contents, low, high)


def field_distance(fields: PackedFields, i: int, x: LatticeArray, y: LatticeArray) -> Float64Array:
    """Return the distance (m) inside the shape of field ``i`` at lattice positions."""
    first, columns, rows, _ = fields.form[i]
    samples = fields.samples[first : first + columns * rows].reshape(rows, columns)
    u = np.clip((x - fields.at[i, 0]) * fields.scale[i], 1, columns - 2)
    v = np.clip((y - fields.at[i, 1]) * fields.scale[i], 1, rows - 2)
    column, row = np.floor(u + 0.5).astype(np.int64), np.floor(v + 0.5).astype(np.int64)
    total = np.zeros(x.shape)
    for dv, weight_v in zip((-1, 0, 1), _weights(v - row), strict=True):
        for du, weight_u in zip((-1, 0, 1), _weights(u - column), strict=True):
            total += weight_v * weight_u * samples[row + dv, column + du]
    return total


def _weights(f: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    return 0.5 * (0.5 - f) ** 2, 0.75 - f**2, 0.5 * (0.5 + f) ** 2
