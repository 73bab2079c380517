"""Features, rivers and fields packed for the kernels."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt
from scipy.ndimage import spline_filter

from sketchterrain.array_types import BoolArray, Float64Array, LatticeArray, StructuredArray
from sketchterrain.io.resources import kernel_columns, kernel_constants, kernel_struct
from sketchterrain.placement.feature_types import FEATURE_TYPES, River, ShapeField, crest_offsets
from sketchterrain.terrain.centrelines import (
    PreparedCentreline,
    flatten_to_arcs,
    meetings_on,
    prepare_centreline,
    tolerance_cell,
)
from sketchterrain.terrain.lattice import metres_per_unit, to_lattice
from sketchterrain.terrain.noise import OctaveTable, band_weight, octave_table
from sketchterrain.terrain.recipe import FINEST_CELL, TerrainRecipe

# The noise seldom leaves ±0.55 of its bound, so this brings the ground to about the requested relief.
_GROUND_SPAN = 1.8
# Ridges move outlines further than the warp does; the noise stays within [-1, 1].
_SPUR_WARPS = 1.0
_SAG = 0.5  # share of height lost at the ends of a crest whose half length equals the width of its flanks
# How far gullies and the roughness of bare rock go up and down, in wavelengths of their own.
_GULLY_DEPTH = 0.165
_CRAG_DEPTH = 0.05
_DIRECTION_BITS = 11
(_FRACTION_BITS,) = (int(bits) for bits in kernel_constants("world.clh", "FRACTION_BITS"))
SLOT_MOUNTAIN, SLOT_HILL, SLOT_FOREST, SLOT_DUNE = (
    int(slot)
    for slot in kernel_constants("world.clh", "SLOT_MOUNTAIN", "SLOT_HILL", "SLOT_FOREST", "SLOT_DUNE")
)
"""Indices of a block's lists by kind of feature; dunes have one for each style from `SLOT_DUNE` on."""
FEATURE: Final = kernel_columns("world.clh", "FeatureRow")
"""Columns of packed features."""
ARC: Final = kernel_columns("world.clh", "ArcRow")
SECTION: Final = kernel_columns("world.clh", "SectionRow")
"""Columns of packed arcs of rivers, and of rivers at one end of an arc."""
LAKE: Final = kernel_columns("lakes.clh", "LakeRow")
"""Columns of packed lakes."""
_SLOTS = ("mountain", "hill", "forest")  # then the styles of dunes

# By river: edits elsewhere do not change it.
_centreline_cache: WeakKeyDictionary[River, tuple[tuple[float, bytes, bytes], PreparedCentreline]] = (
    WeakKeyDictionary()
)

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
class PackedWorld:
    """Scalars (1,) and octaves for one cell size."""

    scalars: StructuredArray  # ``TerrainParams`` of ``kernels/world.clh``
    styles: StructuredArray  # ``DuneStyle``, at least one row
    octaves: OctaveTable


@dataclass(frozen=True)
class PackedFeatures:
    """Features that may affect the blocks of one launch, in the order of their ids."""

    at: LatticeArray  # (n, 2) centres, lattice units
    row: Float64Array  # (n, 12) columns of `FEATURE`
    support: Float64Array  # (n,) radius of influence, m
    slot: LatticeArray  # (n,) kind of feature: the index of its list in a block

    def __getitem__(self, name: str) -> Float64Array:
        """Return a column of `FEATURE`, shape (n,)."""
        return self.row[:, FEATURE[name]]


@dataclass(frozen=True)
class PackedRivers:
    """Arcs of all centrelines (``Rivers`` of ``kernels/world.clh``)."""

    start: LatticeArray  # (n, 2) upstream ends, lattice units
    arc: Float64Array  # (n, 8) columns of `ARC`
    up: Float64Array  # (n, 4) columns of `SECTION`
    down: Float64Array  # (n, 4)

    @property
    def chord(self) -> Float64Array:
        """Vectors from the upstream to the downstream ends (m), shape (n, 2)."""
        return self.arc[:, [ARC["chord_east"], ARC["chord_north"]]]

    def ends(self, name: str) -> tuple[Float64Array, Float64Array]:
        """Return a column of `SECTION` at the upstream and at the downstream ends, shape (n,) each."""
        return self.up[:, SECTION[name]], self.down[:, SECTION[name]]

    @property
    def support(self) -> Float64Array:
        """Greatest distance (m) of any effect of an arc from the box around its two ends, shape (n,)."""
        sagitta = 0.5 * np.abs(self.arc[:, ARC["arc_bend"]]) * np.hypot(*self.chord.T)
        return np.asarray(np.maximum(*self.ends("valley_radius")) + sagitta)


def effective_cell(cell_size: float) -> float:
    """Return the cell size, but not below the one that resolves every octave."""
    return max(cell_size, FINEST_CELL)


def pack_world(recipe: TerrainRecipe, cell_size: float, *, real: npt.DTypeLike) -> PackedWorld:
    """Return the scalars and octaves of a recipe, with ``real`` for the kernels' REAL."""
    cell = effective_cell(cell_size)
    octaves = octave_table(recipe.stacks, extent=recipe.extent, seed=recipe.seed, cell_size=cell)
    unit = metres_per_unit(recipe.extent)
    reals = {
        "metres_per_unit": unit,
        "units_per_metre": 1 / unit,
        "inverse_cell": 1 / cell,
        "half_relief": recipe.ground["relief"] / 2 * _GROUND_SPAN,
        "warp": recipe.warp,
        "ridge_depth": recipe.ridge_depth,
        "spur": _SPUR_WARPS * recipe.warp,
        "gully_depth": _depth_scale("gully", recipe, _GULLY_DEPTH),
        "crag_depth": _depth_scale("crag", recipe, _CRAG_DEPTH),
    }
    integers = {}
    for name, (first, last) in octaves.ranges.items():
        integers[f"{name}_first"], integers[f"{name}_last"] = first, last
    integers |= {"dune_styles": len(recipe.dune_styles), "unused": 0}
    scalars = _filled(kernel_struct("world.clh", "TerrainParams", real), [reals | integers])
    return PackedWorld(scalars, _pack_styles(recipe, cell, real), octaves)


def _depth_scale(stack: str, recipe: TerrainRecipe, depth: float) -> float:
    """Return metres per amplitude of a stack whose octaves are each ``depth`` of their wavelength deep."""
    noise = next(each for each in recipe.stacks if each.name == stack)
    unit = metres_per_unit(recipe.extent)
    longest = 2.0 ** round(np.log2(noise.wavelength / unit)) * unit
    return float(depth * longest / (1 - noise.gain))


def _pack_styles(recipe: TerrainRecipe, cell: float, real: npt.DTypeLike) -> StructuredArray:
    empty = dict.fromkeys(("east", "north", "unused", "unit", "visible"), 0) | {"period_bits": _FRACTION_BITS}
    rows = []
    unit = metres_per_unit(recipe.extent)
    for wavelength, wind in recipe.dune_styles:
        # Crests run across the wind. Scale the direction so that a wavelength is a power of two.
        units = wavelength / unit
        bits = int(np.ceil(np.log2(units))) + _DIRECTION_BITS
        bits = max(bits, _FRACTION_BITS)
        scale = 2.0**bits / units
        towards = np.deg2rad(wind + 180)
        rows.append(
            {
                "east": round(np.sin(towards) * scale),
                "north": round(np.cos(towards) * scale),
                "period_bits": bits,
                "unused": 0,
                "unit": 2.0**-_FRACTION_BITS,
                "visible": band_weight(wavelength, cell),
            }
        )
    return _filled(kernel_struct("world.clh", "DuneStyle", real), rows or [empty])


def _filled(dtype: np.dtype[np.void], rows: Sequence[Mapping[str, float]]) -> npt.NDArray[np.void]:
    """Return an array of a kernel's struct; rows have exactly the struct's members."""
    for row in rows:
        if set(row) != set(dtype.names or ()):
            raise ValueError(f"expected the members {dtype.names}, got {sorted(row)}")
    return np.array([tuple(row[name] for name in dtype.names or ()) for row in rows], dtype=dtype)


def support_radii(recipe: TerrainRecipe) -> float:
    """Return the radius of influence of features over their radius.

    The warp moves a point by up to its length in each direction, and a spur adds to that.
    """
    return float(1 + (np.sqrt(2) + _SPUR_WARPS) * recipe.warp)


def noise_weight(recipe: TerrainRecipe, radius: Float64Array) -> Float64Array:
    """Return the weight of noise in mountains of a ground radius (m).

    It is less in those wider than the noise, which would cover ridges with bumps.
    """
    return np.asarray(np.minimum((recipe.ridge_wavelength / radius) ** 2, 1.0))


def slot_count(recipe: TerrainRecipe) -> int:
    """Return the number of kinds of feature lists of a block."""
    return len(_SLOTS) + len(recipe.dune_styles)


def pack_features(recipe: TerrainRecipe, features: StructuredArray, cell_size: float) -> PackedFeatures:
    """Return the features as kernels read them, without those too small for the cell size.

    Features narrower than two cells fade out: strength × (0 at a radius of one cell … 1 at two).
    """
    cell = effective_cell(cell_size)
    radius = features["radius"].astype(np.float64)
    fade = np.clip(radius / cell - 1, 0, 1)
    fade = fade * fade * (3 - 2 * fade)
    visible = fade > 0
    features, radius, fade = features[visible], radius[visible], fade[visible]
    row = np.zeros((features.size, 12))
    crest = crest_offsets(features)
    core = 1 - np.hypot(*crest.T)  # the crest and the flanks around it end where the feature does
    half_crest = crest / core[:, None]
    square = (half_crest**2).sum(axis=1)
    for name, values in {
        "inverse_radius": 1 / (core * radius),
        "feature_strength": features["strength"] * fade,
        "feature_peakiness": features["peakiness"],
        "feature_flank": np.where(features["painted"], recipe.flank, 1.0),
        "feature_erosion": features["erosion"],
        "widest_gully": features["gullies"] * radius,
        "noise_weight": noise_weight(recipe, radius),
        "crest_east": half_crest[:, 0],
        "crest_north": half_crest[:, 1],
        "inverse_crest_square": np.divide(1, square, out=np.zeros(len(square)), where=square > 0),
        "crest_sag": _SAG * np.sqrt(square),
    }.items():
        row[:, FEATURE[name]] = values
    at = to_lattice(np.stack([features["x"], features["y"]], axis=-1), recipe.extent)
    # Padded for rounding.
    support = radius * support_radii(recipe) * (1 + 1e-5) + 2 * metres_per_unit(recipe.extent)
    return PackedFeatures(at, row, support, _slots(recipe, features))


def _slots(recipe: TerrainRecipe, features: StructuredArray) -> LatticeArray:
    slot = np.empty(features.size, dtype=np.int64)
    for number, name in enumerate(_SLOTS):
        slot[features["type"] == FEATURE_TYPES.index(name)] = number
    is_dune = features["type"] == FEATURE_TYPES.index("dune")
    for number, (wavelength, wind) in enumerate(recipe.dune_styles):
        of_style = is_dune & (features["wavelength"] == wavelength) & (features["wind"] == wind)
        slot[of_style] = len(_SLOTS) + number
    return slot


def pack_rivers(recipe: TerrainRecipe, cell_size: float = FINEST_CELL) -> PackedRivers:
    """Return the rivers' centrelines as arcs, within 1 % of the cell size of their splines.

    Where rivers meet, both have the same point. An arc's weight in a blend is its length, but at most half a
    width: otherwise a straight river would dominate a winding one beside it.
    """
    cell, unit = tolerance_cell(cell_size), metres_per_unit(recipe.extent)
    courses, anchors = [], []
    for anchor, course in prepared_centrelines(recipe):
        courses.append(flatten_to_arcs(course, cell_size=cell, least=unit))
        anchors.append(np.tile(anchor, (len(courses[-1].bend), 1)))
    if not courses:
        empty = np.zeros((0, 4))
        return PackedRivers(np.zeros((0, 2), np.int64), np.zeros((0, 8)), empty, empty)
    starts, ends = (np.concatenate([c.points[part] for c in courses]) for part in (slice(-1), slice(1, None)))
    anchor = np.concatenate(anchors)
    start, end = (to_lattice(each[:, :2], recipe.extent) + anchor for each in (starts, ends))
    vector = (end - start) * unit
    length2 = np.sum(vector**2, axis=1)
    valid = length2 > 0
    weight = np.minimum(np.sqrt(length2), 0.5 * (starts[:, 3] + ends[:, 3]))
    arc = np.zeros((len(start), 8))
    for name, values in {
        "chord_east": vector[:, 0],
        "chord_north": vector[:, 1],
        "inverse_chord_square": 1 / np.where(valid, length2, 1),
        "arc_weight": weight,
        "arc_bend": np.concatenate([course.bend for course in courses]),
    }.items():
        arc[:, ARC[name]] = values
    return PackedRivers(start[valid], arc[valid], starts[valid, 2:], ends[valid, 2:])


def prepared_centrelines(recipe: TerrainRecipe) -> list[tuple[LatticeArray, PreparedCentreline]]:
    """Return each river's source on the lattice and its prepared centreline from there; cached by river."""
    unit = metres_per_unit(recipe.extent)
    meeting = np.array([river.centreline[-1, :2] for river in recipe.rivers]).reshape(-1, 2)
    found = []
    for river, radii in zip(recipe.rivers, recipe.valley_radii, strict=True):
        # Arcs are fitted relative to the source: far from the origin they would round otherwise.
        anchor = to_lattice(river.centreline[0, :2], recipe.extent)
        away = np.append(anchor * unit, 0.0)
        local = replace(river, points=river.points - away, centreline=river.centreline - away)
        met = meeting - away[:2]
        key = recipe.extent, radii.tobytes(), meetings_on(local, met).tobytes()
        if river not in _centreline_cache or _centreline_cache[river][0] != key:
            _centreline_cache[river] = key, prepare_centreline(local, radii, met)
        found.append((anchor, _centreline_cache[river][1]))
    return found


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


@dataclass(frozen=True)
class PackedLakes:
    """Columns of ``Lakes`` in ``kernels/lakes.clh`` besides the fields, for one cell size."""

    row: Float64Array  # (n, 8) columns of `LAKE`; the first is the field's samples per lattice unit
    visible: BoolArray  # (n,) whether anything of a lake is left at the cell size

    def __getitem__(self, name: str) -> Float64Array:
        """Return a column of `LAKE`, shape (n,)."""
        return self.row[:, LAKE[name]]


@dataclass(frozen=True)
class PackedCovers:
    """Columns that ``create_covers`` in ``kernels/materials.clh`` adds to the fields."""

    form: npt.NDArray[np.int32]  # (n, 4) the fields' form with the material's index in the last column
    shape: Float64Array  # (n, 4)


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
    row = np.zeros((len(fade), 8))
    row[:, 0] = fields.scale
    for name, values in {
        "inverse_margin": 1 / fields.margin,
        "lake_level": level,
        "lake_visible": fade,
        "lake_depth": deep,
        "inverse_shelf": 1 / shelf,
        "shore_drop": shore * shelf,
        "beach_rise": rise,
    }.items():
        row[:, LAKE[name]] = values
    return PackedLakes(row, fade > 0)


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
