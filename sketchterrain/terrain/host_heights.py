"""Terrain heights on the host, in plain NumPy float64.

Used to route rivers before any device is opened, and to check the kernels. Only + - * / and sqrt are used, so
that results are the same on every machine.
"""

from dataclasses import dataclass

import numpy as np

from sketchterrain.array_types import Float64Array, LatticeArray
from sketchterrain.io.resources import kernel_constants
from sketchterrain.placement.feature_types import area_profile, cubic
from sketchterrain.terrain.centrelines import nearest_on_arc
from sketchterrain.terrain.culling import features_near
from sketchterrain.terrain.host_relief import (
    ErodibleHeight,
    ReliefNoise,
    SamplePoints,
    crags,
    gullies,
    hills,
    mountains,
    relief_noise_at,
    stack_heights,
)
from sketchterrain.terrain.lattice import metres_per_unit, to_lattice
from sketchterrain.terrain.noise import OctaveTable, ValueSlope, fbm, fbm_slope
from sketchterrain.terrain.packing import (
    ARC,
    LAKE,
    SECTION,
    SLOT_DUNE,
    SLOT_FOREST,
    PackedFeatures,
    PackedFields,
    PackedRivers,
    PackedWorld,
    effective_cell,
    pack_features,
    pack_fields,
    pack_lakes,
    pack_rivers,
    pack_world,
)
from sketchterrain.terrain.recipe import TerrainRecipe

_RIM, _BEACH, _WATERSIDE, _SHARPNESS, _SOFTNESS = kernel_constants(
    "lakes.clh", "RIM", "BEACH", "WATERSIDE", "SHARPNESS", "SOFTNESS"
)
(_COVER_NOISE,) = kernel_constants("height.clh", "COVER_NOISE_CONTRAST")
_CREST_SHIFT, _DUNE_LEVEL, _VIGOUR_MIN, _VIGOUR_RANGE, _VIGOUR_START = kernel_constants(
    "height.clh", "CREST_SHIFT", "DUNE_LEVEL", "VIGOUR_MIN", "VIGOUR_RANGE", "VIGOUR_START"
)
_FOREST_RAGGED, _FOREST_START, _INVERSE_FOREST_RANGE = kernel_constants(
    "height.clh", "FOREST_RAGGED", "FOREST_START", "INVERSE_FOREST_RANGE"
)
_WINDWARD, _LEE, _ROCK_HEIGHT, _INVERSE_ROCK_RANGE = kernel_constants(
    "height.clh", "WINDWARD", "LEE", "ROCK_HEIGHT", "INVERSE_ROCK_RANGE"
)
_NEARNESS, _WEIGHT_SCALE, _BANK_WIDTH, _BANK_RISE, _FLOODPLAIN_SLOPE, _CHANNEL_CELLS, _MATERIAL_CELLS = (
    kernel_constants(
        "rivers.clh",
        "NEARNESS",
        "WEIGHT_SCALE",
        "BANK_WIDTH",
        "BANK_RISE",
        "FLOODPLAIN_SLOPE",
        "CHANNEL_CELLS",
        "MATERIAL_CELLS",
    )
)

_ZERO = np.zeros(1)
_LEVEL = ErodibleHeight(ValueSlope(_ZERO, _ZERO, _ZERO), _ZERO, _ZERO)


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


def apply_lakes(
    recipe: TerrainRecipe, height: Float64Array, x: LatticeArray, y: LatticeArray, *, cell: float
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return the terrain with lakes, and the masks ``water`` and ``lake``, at lattice positions."""
    fields = pack_fields(recipe, [lake.shape for lake in recipe.lakes])
    packed = pack_lakes(recipe, fields, cell)
    weights, own, top, visible, deepest = np.zeros((5, *height.shape))
    nearest = np.ones(height.shape)
    for i in np.flatnonzero(packed.visible):
        inverse_margin, level, fade, depth, inverse_shelf, slope, rise = (packed[name][i] for name in LAKE)
        d = field_distance(fields, int(i), x, y)
        s = np.clip(-d * inverse_margin, 0, 1)
        t = np.clip(d * inverse_shelf, 0, 1)
        bed = level - depth * t**2 * (3 - 2 * t) - slope * t * (1 - t) ** 2
        weight = fade * (1 - s) ** 2 / (s**2 + _SHARPNESS) ** 2
        weights += weight
        own += weight * (bed + rise * (1 - np.maximum(1 - _BEACH * s, 0) ** 2))
        top += weight * (level + rise)
        visible += weight * fade
        nearest, deepest = np.minimum(nearest, s), np.maximum(deepest, t)
    near = weights > 0
    own, top, visible = (part[near] / weights[near] for part in (own, top, visible))
    s, t, ground = nearest[near], deepest[near], height[near]
    result, (water, lake) = height.copy(), np.zeros((2, *height.shape))
    terrain = ground + visible * _soft_positive(top - ground) * (1 - s**4) * (1 - s**2)
    result[near] = terrain + (own - terrain) * visible * cubic(np.maximum(s - _RIM, 0) / (1 - _RIM))
    water[near] = visible * (0.75 * np.maximum(1 - _WATERSIDE * s, 0) + 0.25 * t)
    lake[near] = visible * cubic(s / _RIM)
    return result, water, lake


def _soft_positive(x: Float64Array) -> Float64Array:
    near = np.clip(x, -_SOFTNESS, _SOFTNESS) + _SOFTNESS
    return np.asarray(near**2 / (4 * _SOFTNESS) + np.maximum(x - _SOFTNESS, 0))


@dataclass(frozen=True)
class HostSamples:
    """Heights (m) and masks (0 … 1) at points; see ``TerrainSample`` in ``kernels/world.clh``."""

    height: Float64Array
    mountain: Float64Array
    dune: Float64Array
    forest: Float64Array
    water: Float64Array
    lake: Float64Array


def host_heights(
    recipe: TerrainRecipe, x: Float64Array, y: Float64Array, *, cell_size: float = 0.0
) -> Float64Array:
    """Return heights (m) at points in metres (any shape), in float64."""
    x, y = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
    ground = host_samples(
        recipe,
        to_lattice(x.ravel(), recipe.extent),
        to_lattice(y.ravel(), recipe.extent),
        cell_size=cell_size,
    )
    return ground.height.reshape(x.shape)


def relief_noise(
    recipe: TerrainRecipe, x: LatticeArray, y: LatticeArray, *, cell_size: float = 0.0
) -> ReliefNoise:
    """Return the noise that shapes mountains and hills at lattice positions of shape (n,)."""
    world = pack_world(recipe, cell_size, real=np.float64)
    return relief_noise_at(world.scalars[0], world.octaves, x, y)


def host_samples(
    recipe: TerrainRecipe, x: LatticeArray, y: LatticeArray, *, cell_size: float = 0.0
) -> HostSamples:
    """Return the terrain at lattice positions of shape (n,), in float64."""
    world = pack_world(recipe, cell_size, real=np.float64)
    w, octaves = world.scalars[0], world.octaves
    packed = _packed_around(recipe, x, y, cell_size)
    relief = relief_noise_at(w, octaves, x, y)
    points = SamplePoints(x, y, metres_per_unit(recipe.extent), relief.bend)
    height, mountain, dune = _dry(world, packed, points, relief)
    cover, share = _areas(packed, points, slot=SLOT_FOREST)
    mottle = _COVER_NOISE * fbm(octaves, "mottle", x, y)
    forest = (
        share
        * _rise(cover + _FOREST_RAGGED * mottle, _FOREST_START, 1 / _INVERSE_FOREST_RANGE)
        * _rise(cover, 0, 1 / _INVERSE_FOREST_RANGE)
    )
    cell = 1 / float(w["inverse_cell"])
    water, lake = np.zeros((2, *x.shape))
    if recipe.lakes:
        height, water, lake = apply_lakes(recipe, height, x, y, cell=cell)
    rivers = pack_rivers(recipe, cell_size)
    if len(rivers.start):
        carved, river = _carved(height, rivers, points, cell=cell)
        height = carved + (np.minimum(carved, height) - carved) * lake
        water = np.maximum(water, river)
    return HostSamples(height, mountain, dune, forest, water, lake)


def dry_heights(
    recipe: TerrainRecipe, x: LatticeArray, y: LatticeArray, *, cell_size: float = 0.0
) -> Float64Array:
    """Return heights (m) without rivers and lakes at lattice positions of shape (n,)."""
    world = pack_world(recipe, cell_size, real=np.float64)
    relief = relief_noise_at(world.scalars[0], world.octaves, x, y)
    points = SamplePoints(x, y, metres_per_unit(recipe.extent), relief.bend)
    return _dry(world, _packed_around(recipe, x, y, cell_size), points, relief)[0]


def _dry(
    world: PackedWorld, packed: PackedFeatures, points: SamplePoints, relief: ReliefNoise
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return heights (m) without water, and the masks of mountains and of dunes."""
    w, octaves, x, y = world.scalars[0], world.octaves, points.x, points.y
    height = w["half_relief"] * fbm(octaves, "ground", x, y)
    eroded, mountain = _eroded(w, octaves, packed, points, relief)
    height = height + eroded.value + mountain * crags(w, octaves, x, y, *eroded[1:])
    dune, styles = np.zeros(x.shape), range(int(w["dune_styles"]))
    crest = fbm(octaves, "crest", x, y) if styles else dune
    for number in styles:
        cover, amplitude = _areas(packed, points, slot=SLOT_DUNE + number)
        height = height + cover * amplitude * _dune_pattern(world.styles[number], x, y, crest)
        dune = np.maximum(dune, cover)
    return height, mountain, dune


def host_slope(
    recipe: TerrainRecipe, x: LatticeArray, y: LatticeArray, *, cell_size: float = 0.0
) -> ValueSlope:
    """Return heights (m) and slopes of ground, hills and mountains with their gullies, without crags.

    Slopes of gullies are taken with the direction of each wave held constant, as the filter takes them.
    """
    world = pack_world(recipe, cell_size, real=np.float64)
    w, octaves = world.scalars[0], world.octaves
    relief = relief_noise_at(w, octaves, x, y)
    points = SamplePoints(x, y, metres_per_unit(recipe.extent), relief.bend)
    eroded, _ = _eroded(w, octaves, _packed_around(recipe, x, y, cell_size), points, relief)
    ground = fbm_slope(octaves, "ground", x, y)
    scale = w["half_relief"] * np.array([1, w["units_per_metre"], w["units_per_metre"]])
    return ValueSlope(*(a + b * by for a, b, by in zip(eroded, ground, scale, strict=True)))


def _packed_around(
    recipe: TerrainRecipe, x: LatticeArray, y: LatticeArray, cell_size: float
) -> PackedFeatures:
    block = np.array([[x.min(), y.min(), x.max(), y.max()]])
    near = features_near(recipe, block, min_radius=effective_cell(cell_size))
    return pack_features(recipe, near, cell_size)


def _eroded(
    w: np.void, octaves: OctaveTable, packed: PackedFeatures, points: SamplePoints, relief: ReliefNoise
) -> tuple[ValueSlope, Float64Array]:
    """Return hills and mountains with their gullies, and the mountain mask."""
    massif, weight = mountains(packed, points, relief.spur)
    rise = stack_heights(
        stack_heights(_LEVEL, hills(packed, points), relief.swell), massif, relief.mountain_factor(weight)
    )
    cut = gullies(w, octaves, points.x, points.y, rise)
    height = ValueSlope(*(a + b for a, b in zip(rise.height, cut, strict=True)))
    return height, _rise(massif.height.value, _ROCK_HEIGHT, 1 / _INVERSE_ROCK_RANGE)


def _rise(x: Float64Array, start: float, width: float) -> Float64Array:
    t = np.clip((x - start) / width, 0, 1)
    return np.asarray(t * t * (3 - 2 * t))


def _areas(packed: PackedFeatures, points: SamplePoints, *, slot: int) -> tuple[Float64Array, Float64Array]:
    pairs = points.pairs_within_support(packed, slot)
    cover = area_profile(points.distance_to_crests(packed, pairs)[0].value)
    strength = packed["feature_strength"][pairs.feature]
    total, weights, strengths = (points.summed(pairs, each) for each in (cover**4, cover, cover * strength))
    mean = np.where(weights > 1e-6, strengths / np.maximum(weights, 1e-6), 0)
    return np.minimum(np.sqrt(np.sqrt(total)), 1), mean


def _dune_pattern(style: np.void, x: LatticeArray, y: LatticeArray, crest: Float64Array) -> Float64Array:
    bits = int(style["period_bits"])
    phase = x * style["east"] + y * style["north"]
    t = (phase & ((1 << bits) - 1)) / 2.0**bits + _CREST_SHIFT * crest
    t = t - np.floor(t)
    up = t / _WINDWARD
    lee = np.maximum(1 - (t - _WINDWARD) / _LEE, 0)
    profile = np.where(t < _WINDWARD, up * up * (2 - up), lee**2)
    pattern = profile * (_VIGOUR_MIN + _VIGOUR_RANGE * _rise(crest, _VIGOUR_START, 1))
    return np.asarray(_DUNE_LEVEL + (pattern - _DUNE_LEVEL) * style["visible"])


def _carved(
    height: Float64Array, rivers: PackedRivers, points: SamplePoints, *, cell: float
) -> tuple[Float64Array, Float64Array]:
    weights, nearest = np.zeros(height.shape), np.full(height.shape, 1e30)
    sums = np.zeros((4, *height.shape))
    for i in range(len(rivers.start)):
        chord, bend = rivers.chord[i], rivers.arc[i, ARC["arc_bend"]]
        contribution = rivers.arc[i, ARC["arc_weight"]]
        dx = (points.x - rivers.start[i, 0]) * points.unit
        dy = (points.y - rivers.start[i, 1]) * points.unit
        t, d2 = nearest_on_arc(chord, bend, np.stack([dx, dy], axis=-1))
        here = rivers.up[i][:, None] + (rivers.down[i] - rivers.up[i])[:, None] * t
        width, radius = here[SECTION["half_width"]], here[SECTION["valley_radius"]]
        share2 = d2 / radius**2
        inside = np.maximum(1 - share2, 0)
        contribution = contribution * inside**2 * (_WEIGHT_SCALE * width / (d2 + width**2 * _NEARNESS)) ** 4
        weights += contribution
        sums += contribution * here
        nearest = np.minimum(nearest, d2 / (width * np.maximum(inside * (1 + share2), 1e-6)))
    near = weights > 1e-30
    surface, half_width, depth, radius = sums[:, near] / weights[near]
    d = np.sqrt(nearest[near] * half_width)
    ground = height[near]

    channel = _rise(2 * half_width / cell, _CHANNEL_CELLS, _CHANNEL_CELLS)
    bank = _BANK_RISE * depth
    across = d / half_width
    bed = -depth * np.maximum(1 - across**2, 0)
    rise = bank * _rise(across, 1, _BANK_WIDTH)
    flat = _FLOODPLAIN_SLOPE * np.maximum(d - half_width, 0)
    enforced = surface + flat + bank + (rise + bed - bank) * channel
    edge = (1 + _BANK_WIDTH) * half_width
    s = np.clip((d - edge) / np.maximum(radius - edge, edge), 0, 1)
    terrain = ground + np.maximum(surface + bank - ground, 0) * (1 - s**4) * (1 - s**2)
    carved, mask = height.copy(), np.zeros(height.shape)
    carved[near] = terrain + (enforced - terrain) * cubic(s)
    mask[near] = np.maximum(1 - d / (4 * np.maximum(half_width, _MATERIAL_CELLS * cell)), 0)
    return carved, mask
