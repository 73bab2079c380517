"""Material weights: rules against their formulas, and kernels against NumPy float64."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.material_rules import (
    DEFAULT_RULES,
    INPUTS,
    Factor,
    MaterialRule,
    RuleChange,
    resolved_rules,
)
from sketchterrain.document.store import load_sketch
from sketchterrain.generation.building import rebuild
from sketchterrain.geometry.lattice import metres_per_unit
from sketchterrain.schema.geology import ROCKS, Strata
from sketchterrain.schema.materials import MATERIALS
from sketchterrain.terrain.evaluator import Evaluator
from sketchterrain.terrain.host_heights import HostTerrain
from sketchterrain.terrain.layers.covers import CoversLayer
from sketchterrain.terrain.layers.fields import field_distance, pack_fields
from sketchterrain.terrain.layers.layer import MASKS
from sketchterrain.terrain.materials import pack_rules
from sketchterrain.terrain.noise import fbm
from sketchterrain.terrain.recipe import EVERYWHERE, TerrainRecipe, changed_areas
from tests import terrains
from tests.devices import each_other_device

from .conftest import CASES, LAKES, cover, straight_river

CLIMATES = (
    {"snow_line": 900.0, "tree_line": 500.0, "aridity": 0.2},
    {"snow_line": 1e4, "tree_line": 1e4, "aridity": 0.86},
    {"snow_line": -100.0, "tree_line": 40.0, "aridity": 0.55},
)

# `weights` evaluates the rules of `surfaces` at arbitrary inputs.
KERNEL = """
__kernel void weights(RULE_ARGUMENTS, __global const REAL *values, __global const REAL *masks,
                      __global REAL *out)
{
    COLLECT_RULES
    const size_t i = get_global_id(0);
    __global const REAL *v = values + 6 * i;
    SurfaceInputs inputs = {v[0], v[1], v[2], v[3], v[4], v[5]};
    for (int m = 0; m < MASKS; ++m) inputs.mask[m] = masks[MASKS * i + m];
    inputs.empty_masks = 0;
    REAL w[MATERIALS];
    lay_rules(rules, inputs, w);
    for (int m = 0; m < MATERIALS; ++m) out[MATERIALS * i + m] = w[m];
}
"""


NAMES = ("height", "steepness", "hollow", "mottle", "northness", "bedding", *MASKS)
Site = dict[str, np.ndarray]  # inputs of rules by name, arrays of one shape


def ramp(factor: Factor, inputs: Site) -> np.ndarray:
    total = sum(weight * inputs[name] for name, weight in factor.weights.items())
    t = np.clip((total - factor.start) / (factor.full - factor.start), 0, 1)
    return t if factor.shape == "straight" else t * t * (3 - 2 * t)


def rule_weights(rules, climate, site: Site) -> np.ndarray:
    """Return weights in float64: w ← w (1 − a), w_k ← w_k + a for each rule, on grass."""
    inputs = {name: np.asarray(values, np.float64) for name, values in site.items()}
    for line in ("snow_line", "tree_line"):
        inputs[f"above_{line}"] = inputs["height"] - climate[line]
    inputs["aridity"] = np.full(inputs["height"].shape, climate["aridity"])
    weights = np.zeros((*inputs["height"].shape, len(MATERIALS)))
    weights[..., MATERIALS.index("grass")] = 1
    for rule in rules:
        if any(factor.above_sea for factor in rule.factors):  # there is no sea
            continue
        cover = rule.cover * np.prod([ramp(factor, inputs) for factor in rule.factors], axis=0)
        weights *= 1 - np.asarray(cover)[..., None]
        weights[..., MATERIALS.index(rule.material)] += cover
    return weights


def hardness(c: np.ndarray, salt: int) -> np.ndarray:
    bed = np.floor(c)
    ids = bed.astype(np.int64) + salt
    low, high = (hash32(ids + k).view(np.int32) / 2.0**31 for k in (0, 1))
    t = np.clip((c - bed - 0.3) * 2.5, 0, 1)
    return low + (high - low) * t * t * (3 - 2 * t)


def hash32(ids: np.ndarray) -> np.ndarray:
    """Return ``mixed`` of kernels/hash.clh."""
    h = (ids & 0xFFFFFFFF).astype(np.uint32)
    for shift, factor in ((16, 0x7FEB352D), (15, 0x846CA68B)):
        h = (h ^ h >> np.uint32(shift)) * np.uint32(factor)
    return h ^ h >> np.uint32(16)


def beds(recipe: TerrainRecipe, x, y, z, slopes, mottle, cell_size: float) -> np.ndarray:
    """Return the bedding (kernels/strata.clh) at vertices of slopes eastward and northward."""
    across, unit = np.array(recipe.strata.across), metres_per_unit(recipe.extent)
    c = across[0] * unit * x + across[1] * unit * y + across[2] * z + 0.1 * mottle
    climb = 2 * cell_size * np.max([abs(across[k] + across[2] * slopes[k]) for k in (0, 1)], axis=0)
    coarse, fine = (np.clip(2 - 2 * finer * climb, 0, 1) for finer in (1, 3.7))
    sum_of_beds = 0.65 * coarse * hardness(c, 0) + 0.35 * fine * hardness(3.7 * c, 0x68E31DA4)
    return np.asarray(recipe.strata.rock.bedding * sum_of_beds)


def patch_weights(recipe: TerrainRecipe, x: np.ndarray, y: np.ndarray, cell_size: float) -> np.ndarray:
    """Return weights in float64 at the vertices (rows, columns) of a patch inside its border."""
    ground = HostTerrain(recipe).samples(x.ravel(), y.ravel(), cell_size=cell_size)
    z, inner = ground.height.reshape(x.shape), (slice(1, -1), slice(1, -1))
    east, north = z[1:-1, 2:] - z[1:-1, :-2], z[:-2, 1:-1] - z[2:, 1:-1]
    around = z[1:-1, 2:] + z[1:-1, :-2] + z[:-2, 1:-1] + z[2:, 1:-1]
    octaves = recipe.sampling(cell_size).octaves
    mottle = 2.2 * fbm(octaves, "mottle", x[inner], y[inner])
    hollow = (around - 4 * z[inner]) / (4 * cell_size)
    masks = [getattr(ground, name).reshape(x.shape)[inner] for name in MASKS]
    slopes = east / (2 * cell_size), north / (2 * cell_size)
    steepness = np.hypot(*slopes)
    northness = -slopes[1] / np.sqrt(1 + steepness**2)
    bedding = beds(recipe, x[inner], y[inner], z[inner], slopes, mottle, cell_size)
    values = (z[inner], steepness, hollow, mottle, northness, bedding, *masks)
    weights = rule_weights(recipe.material_rules, recipe.climate, dict(zip(NAMES, values, strict=True)))
    covers = recipe[CoversLayer]
    fields = pack_fields([cover.shape for cover in covers.covers], recipe.extent)
    packed = covers.pack(recipe.sampling(cell_size)).arrays
    for i, (_, inverse_width, strength, _) in enumerate(packed["cover_shape"]):
        d = field_distance(fields, i, x[inner], y[inner])
        t = np.clip(d * inverse_width + 0.5 * np.clip(mottle, -1, 1) + 0.5, 0, 1)
        cover = strength * t * t * (3 - 2 * t)
        weights *= 1 - cover[..., None]
        weights[..., packed["cover_form"][i, 3]] += cover
    return weights


def sites(count: int = 8_000, *, seed: int = 1, real: Any = np.float64) -> Site:
    """Points of all kinds, half of each mask 0 or 1."""
    rng = np.random.default_rng(seed)
    masks = np.clip(rng.uniform(-0.5, 1.5, (len(MASKS), count)), 0, 1)
    heights, steepness = rng.uniform(-50, 1500, count), rng.gamma(1.5, 0.4, count)
    hollow, mottle = rng.normal(0, 0.3, count), rng.normal(0, 0.5, count)
    northness = np.sin(np.arctan(steepness)) * np.cos(rng.uniform(0, 2 * np.pi, count))
    values = (heights, steepness, hollow, mottle, northness, rng.uniform(-1, 1, count), *masks)
    return {name: value.astype(real) for name, value in zip(NAMES, values, strict=True)}


@pytest.fixture
def weigh(with_kernel) -> Callable[..., np.ndarray]:
    """Return a function that evaluates a recipe's rules at sites on a device."""
    with_kernel("weights.cl", "tiles.cl", KERNEL)

    def run(recipe: TerrainRecipe, site: Site, context: ComputeContext) -> np.ndarray:
        real, rules = context.real_dtype, pack_rules(recipe)
        parts = [np.asarray(site[name], real) for name in NAMES]
        out = context.empty((len(parts[0]), len(MATERIALS)), real)
        table = (rules.form, rules.cover.astype(real), rules.ramp.astype(real))
        given = (*table, np.stack(parts[:6], axis=-1), np.stack(parts[6:], axis=-1))
        size, arrays = (len(parts[0]),), [context.upload(each) for each in given]
        context.launch("weights.cl", "weights", size, np.int32(rules.count), *arrays, out)
        return context.download(out, (len(parts[0]), len(MATERIALS)), real)

    return run


def some_rules(count: int = 12, *, seed: int = 7) -> tuple[MaterialRule, ...]:
    """Return rules that use every input."""
    rng = np.random.default_rng(seed)
    scale = {"height": 1e-3, "above_snow_line": 1e-3, "above_tree_line": -1e-3}

    def random_factor(first: str) -> Factor:
        names = {first, *rng.choice(list(INPUTS), 3)}
        weights = {name: scale.get(name, 1.0) * rng.uniform(0.3, 1.0) for name in names}
        start = rng.uniform(-0.5, 0.5)
        return Factor(start, start + rng.choice([-1, 1]) * rng.uniform(0.3, 1.5), "smooth", **weights)

    names = list(INPUTS)
    return tuple(
        MaterialRule(str(n), MATERIALS[n % 10], 0.9, (random_factor(names[n % 12]),) * (1 + n % 2))
        for n in range(count)
    )


def test_rules_have_the_weights_of_numpy(make_recipe, context, double_context, weigh) -> None:
    most = np.zeros(len(MATERIALS))
    for rules, climate in (
        *(((), CLIMATES[0]), ((MaterialRule("all", "snow"),), CLIMATES[0]), (some_rules(), CLIMATES[0])),
        *((DEFAULT_RULES, climate) for climate in CLIMATES),
    ):
        recipe = make_recipe(material_rules=tuple(rules), climate=climate)
        site = sites(5000, seed=2)
        expected = rule_weights(rules, climate, site)
        np.testing.assert_allclose(weigh(recipe, site, double_context), expected, atol=1e-12, rtol=0)
        np.testing.assert_allclose(expected.sum(axis=-1), 1, atol=1e-12)
        most = np.maximum(most, expected.max(axis=0))
        single = sites(5000, seed=2, real=np.float32)
        again = rule_weights(rules, climate, single)
        weights = weigh(recipe, single, context)
        np.testing.assert_allclose(weights, again, atol=2e-6, rtol=0)
        np.testing.assert_allclose(weights.astype(np.float64).sum(axis=-1), 1, atol=1e-6)
        assert weights.min() >= 0
    named = {"grass", *(rule.material for rule in DEFAULT_RULES)}
    assert all(most[MATERIALS.index(name)] > 0.7 for name in named)  # the sites reach every material


@each_other_device
def test_all_devices_have_the_same_weights(make_recipe, weigh, context, other) -> None:
    for rules in (DEFAULT_RULES, some_rules()):
        recipe, places = make_recipe(material_rules=rules), sites(real=np.float32)
        one, two = (weigh(recipe, places, each) for each in (context, ComputeContext(other)))
        np.testing.assert_array_equal(one, two)


def patch(recipe: TerrainRecipe, cell: float, west: float, north: float, side: int = 67) -> Any:
    """Lattice coordinates of a patch's columns and rows, and the true cell size."""
    unit = metres_per_unit(recipe.extent)
    step = round(cell / unit)
    x = round(west / unit) + step * np.arange(side)
    y = round(north / unit) - step * np.arange(side)
    return x, y, step * unit


@pytest.mark.parametrize("cell", [4.0, 16.0])
def test_surfaces_have_the_weights_of_numpy(cell, make_recipe, context, double_context) -> None:
    """Every kind of feature, water and a painted cover in one place."""
    recipe = make_recipe(
        *(one for ones in CASES.values() for one in ones),
        rivers=(straight_river(),),
        lakes=LAKES,
        covers=(cover(1900.0, 2000.0, 60.0, MATERIALS.index("snow"), 0.8),),
        climate={"snow_line": 500.0, "tree_line": 250.0, "aridity": 0.35},
    )
    x, y, cell = patch(recipe, cell, 2048 - 33 * cell, 2048 + 33 * cell)
    at_x, at_y = (each.astype(np.int64) for each in np.meshgrid(x, y))
    expected = patch_weights(recipe, at_x, at_y, cell)
    np.testing.assert_allclose(expected.sum(axis=-1), 1, atol=1e-12)
    for opened, tolerance in ((double_context, 1e-6), (context, 5e-4)):
        surface = Evaluator(recipe, opened).surface(x[None], y[None], cell_size=cell)
        np.testing.assert_allclose(surface.materials[0], expected, atol=tolerance, rtol=0)
        np.testing.assert_allclose(surface.materials.astype(np.float64).sum(axis=-1), 1, atol=1e-6)


LUSH = resolved_rules([RuleChange("lush", "grass", 0.9, "beach", (Factor(0.0, 0.4, wetness=1.0),))])
DESERT = load_sketch("desert_mountains")
DESERT_RULES = resolved_rules(DESERT.material_rules)
BARE = {"snow_line": 1e4, "tree_line": 1e4}
COLD = {"snow_line": 500.0, "tree_line": 400.0, "aridity": 0.1}
FACE = {"mountain": 1.0, "height": 750.0, "steepness": 1.25}
GULLY = {"mountain": 0.7, "hollow": 0.1}
# Material, climate, rules, inputs of the rules that are not 0, and the range of the weight.
SITES = [
    ("grass", BARE | {"aridity": 0.9}, DEFAULT_RULES, {"water": 0.55}, (0.0, 0.1)),
    ("grass", BARE | {"aridity": 0.9}, LUSH, {}, (0.0, 0.1)),
    ("grass", BARE | {"aridity": 0.9}, LUSH, {"water": 0.55}, (0.8, 1.0)),
    ("soil", BARE | {"aridity": 0.15}, DEFAULT_RULES, {"water": 0.65, "mottle": -0.5}, (0.5, 1.0)),
    ("grass", BARE | {"aridity": 0.15}, DEFAULT_RULES, {"water": 0.65, "mottle": 0.15}, (0.5, 1.0)),
    ("sand", BARE | {"aridity": 0.15}, DEFAULT_RULES, {"water": 0.65, "mottle": 0.5}, (0.5, 1.0)),
    # Snow covers gullies and leaves faces; scree covers gullies up to its angle of repose.
    ("snow", COLD, DEFAULT_RULES, FACE | {"hollow": 0.15}, (0.7, 1.0)),
    ("snow", COLD, DEFAULT_RULES, FACE | {"hollow": -0.05}, (0.0, 0.4)),
    ("snow", COLD, DEFAULT_RULES, FACE | {"steepness": 0.5}, (0.95, 1.0)),
    ("snow", COLD, DEFAULT_RULES, FACE | {"height": 560.0, "steepness": 0.5, "mottle": -0.4}, (0.0, 0.05)),
    ("scree", BARE | {"aridity": 0.1}, DEFAULT_RULES, GULLY | {"steepness": 0.7}, (0.7, 1.0)),
    ("scree", BARE | {"aridity": 0.1}, DEFAULT_RULES, GULLY | {"steepness": 0.2}, (0.0, 0.05)),
    ("rock", BARE | {"aridity": 0.1}, DEFAULT_RULES, GULLY | {"steepness": 1.4}, (0.9, 1.0)),
]


def material_at(name: str, climate: dict, rules=DEFAULT_RULES, **values: float) -> float:
    """Return the weight of a material at one place; inputs not given are 0, but water is wet."""
    values.setdefault("wetness", max(values.get("water", 0.0) - 0.2, 0.0) / 0.8)
    site = {name: np.full(1, values.get(name, 0.0)) for name in NAMES}
    return float(rule_weights(rules, climate, site)[0, MATERIALS.index(name)])


def test_default_rules_at_typical_sites() -> None:
    for material, climate, rules, inputs, (low, high) in SITES:
        assert low <= material_at(material, climate, rules, **inputs) <= high, (material, inputs)
    damp = BARE | {"aridity": 0.45}
    assert material_at("grass", damp, water=0.55) > material_at("grass", damp) + 0.3
    soil = partial(material_at, "soil", BARE | {"aridity": 0.2}, mottle=0.63)
    assert soil() < 0.01, "level ground is not bare"
    soil = partial(soil, steepness=0.55)
    assert soil(hollow=-0.05) > soil() + 0.1 > soil(hollow=0.05) + 0.12
    scree = partial(material_at, "scree", BARE | {"aridity": 0.2}, mottle=0.63)  # lies on steeper ground
    assert scree(steepness=0.7) + soil(steepness=0.7) > scree(steepness=0.55) + soil() + 0.08
    assert soil(wetness=0.8) < 0.1 * soil(), "valley floors are green"
    hill = partial(material_at, climate=BARE | {"aridity": 0.2}, steepness=0.4)
    assert hill("dry_grass", northness=-0.37) > hill("dry_grass", northness=0.37) + 0.5, "sunny slopes"
    assert hill("heath", northness=0.3, mottle=-0.3) > hill("heath", northness=-0.3, mottle=-0.3) + 0.2
    assert hill("heath", mottle=-0.6) > hill("heath", mottle=0.6) + 0.5, "in drifts"
    assert hill("grass", wetness=1.0, hollow=0.1) > 0.9, "lines of drainage are green"
    mountain = partial(material_at, climate=COLD, height=380.0)
    assert mountain("heath") > mountain("heath", height=800.0) + 0.3, "dwarf shrubs below the tree line"
    # The desert preset: slip faces are sand, flat open terrain is stony, hollows at feet have soil.
    for material, inputs in (
        ("sand", {"steepness": 1.3, "dune": 1.0}),
        ("scree", {"steepness": 0.05, "hollow": -0.02, "mottle": 0.8}),
        ("soil", {"steepness": 0.1, "hollow": 0.05}),
    ):
        own, default = (
            material_at(material, DESERT.climate, r, **inputs) for r in (DESERT_RULES, DEFAULT_RULES)
        )
        assert own > default + 0.3, material


def test_strata_follow_dip_and_rock(make_recipe) -> None:
    """Level beds depend on height alone, upright ones on the position across their strike."""
    thickness = ROCKS["limestone"].bed
    for dip, direction, across in ((0, 30, (0, 0, 1)), (90, 90, (1, 0, 0)), (90, 180, (0, -1, 0))):
        strata = Strata.from_settings({"rock": "limestone", "dip": dip, "dip_direction": direction})
        np.testing.assert_allclose(np.array(strata.across) * thickness, across, atol=1e-8)
        assert np.dot(strata.across[:2], strata.strike) == 0
    recipe = make_recipe()
    assert changed_areas(recipe, replace(recipe, strata=strata)) == [EVERYWHERE]
    ledge, rib = (material_at("grass", COLD, steepness=0.85, bedding=bedding) for bedding in (-0.8, 0.8))
    assert ledge > rib + 0.4


def test_a_sketch_overrides_the_table() -> None:
    before = terrains.painted()
    frost = (RuleChange("frost", "snow", 0.25, factors=()),)
    after, areas = rebuild(before, before.sketch.replace(material_rules=frost))
    assert areas == [EVERYWHERE]
    old, new = (terrain.raster(65) for terrain in (before, after))
    expected = 0.75 * old.materials
    expected[..., MATERIALS.index("snow")] += 0.25
    np.testing.assert_allclose(new.materials, expected, atol=1e-6)
    np.testing.assert_array_equal(old.height, new.height)
