"""Plateaus: profile, rock layers, tiers and canyons; what stays as it is."""

from typing import Any

import numpy as np
import pytest

from sketchterrain.document.sketch import Sketch
from sketchterrain.generation.building import build
from sketchterrain.landforms.placement.feature_types import VISIBLE_SHARE
from sketchterrain.landforms.placement.plateaus import create_plateaus, layer_phase, noise_limit
from sketchterrain.measure.adherence import measure_adherence
from sketchterrain.terrain.evaluator import Evaluator
from sketchterrain.terrain.host_heights import host_heights
from sketchterrain.terrain.layers.plateaus import PlateausLayer
from sketchterrain.terrain.layers.relief import ReliefLayer

from .conftest import PLATEAUS, Cone, plateau

FLAT = {"relief": 0.0, "wavelength": 1600.0, "roughness": 0.45}
SIZE = 128
ROW, COLUMN = np.mgrid[:SIZE, :SIZE]
X, Y, RADIUS, HEIGHT = 2000.0, 2000.0, 600.0, 160.0


def painted(*shapes: Any, rivers: Any = None, labels: Any = (), **settings: Any) -> Sketch:
    """Return a sketch of 2048 m with masks of plateaus as labels 1, 2, … over a plain."""
    image = np.zeros((SIZE, SIZE), np.uint8)
    for label, shape in enumerate(shapes, 1):
        image[shape] = label
    layers = {"plateau": image}
    if rivers is not None:
        layers["river"] = rivers.astype(np.uint8)
    properties = {("plateau", label): each for label, each in enumerate(labels, 1)}
    dry = {"aridity": 1.0}  # hardly any streams
    return Sketch(
        extent=2048.0, seed=3, layers=layers, labels=properties, ground=FLAT, climate=dry, **settings
    )


def disc(x: float, y: float, radius: float) -> Any:
    return np.hypot(COLUMN - x, ROW - y) < radius


def along(recipe: Any, distance: Any, *, cell: float = 0.0) -> np.ndarray:
    """Return heights at distances eastward of the middle."""
    return host_heights(recipe, X + np.asarray(distance), np.full(np.shape(distance), Y), cell_size=cell)


def test_a_smooth_plateau_has_talus_a_cliff_and_a_flat_top(make_recipe, monkeypatch) -> None:
    monkeypatch.setattr("sketchterrain.terrain.layers.plateaus.CLIFF_NOISE", 0.0)
    monkeypatch.setattr("sketchterrain.terrain.layers.relief._LEVEL", 0.0)  # no roughness of level ground
    mesa = plateau(X, Y, RADIUS, HEIGHT, strata=0.0, foot=0.4)
    recipe = make_recipe(plateaus=(mesa,), ground=FLAT)
    start, cliff, talus = mesa.cliff_start, mesa.cliff_width, mesa.talus_width
    at = RADIUS - np.array([start + cliff + 1.0, start, 0.0, start - talus - 1.0])
    expected = np.array([1.0, 0.4, VISIBLE_SHARE, 0.0]) * mesa.top
    assert along(recipe, at) == pytest.approx(expected, abs=0.02 * HEIGHT)
    assert np.ptp(along(recipe, np.arange(0.0, at[0], 20.0))) == 0.0
    assert (along(recipe, np.arange(at[3], 2000.0, 50.0)) == 0.0).all()

    x = np.arange(at[0] - 20.0, at[3] + 20.0, 0.25)
    slope = np.diff(along(recipe, x)) / 0.25
    assert slope.max() <= 0.0
    steep = np.degrees(np.arctan(-slope.min()))
    assert 55.0 < steep < 76.0
    # No corner at the foot or at the rim.
    assert np.abs(np.diff(slope)).max() < 0.15


def test_layers_are_ledges_at_the_same_elevations_all_around(make_recipe) -> None:
    mesa = plateau(X, Y, RADIUS, 256.0, strata=1.0, cliffness=0.5)
    recipe = make_recipe(plateaus=(mesa,), ground=FLAT)
    found = np.concatenate([along(recipe, side * np.arange(200.0, 800.0, 0.5)) for side in (-1, 1)])
    found = found[(found > 0.35 * 256.0) & (found < 0.9 * 256.0)]
    phase = layer_phase(found / mesa.layer_thickness)
    # Most of the ground is on ledges, at the tops of layers.
    assert (np.abs(phase - np.round(phase)) < 0.25).mean() > 0.65


def test_mountains_stand_on_the_top_and_nothing_beyond_the_talus_changes(make_recipe) -> None:
    mesa, mountain = plateau(X, Y, 700.0, 100.0), ReliefLayer(Cone(600.0))
    with_mesa, without = make_recipe(relief=mountain, plateaus=(mesa,)), make_recipe(relief=mountain)
    on_top = np.arange(0.0, 500.0, 10.0)
    raised = along(with_mesa, on_top) - along(without, on_top)
    assert raised == pytest.approx(np.full(on_top.shape, mesa.top), abs=1e-3)
    far = 700.0 + mesa.talus_width - mesa.cliff_start + noise_limit(4096.0, 0.8, 700.0)
    beyond = np.arange(far, 2000.0, 10.0)
    np.testing.assert_array_equal(along(with_mesa, beyond), along(without, beyond))


def test_the_order_of_plateaus_changes_no_bit(make_recipe, context) -> None:
    x, y = np.random.default_rng(2).integers(0, 1 << 24, (2, 4000))
    recipe = make_recipe(plateaus=PLATEAUS)
    shuffled = make_recipe(plateaus=PLATEAUS[::-1])
    items = [each[PlateausLayer].items(each.world).tobytes() for each in (recipe, shuffled)]
    assert items[0] == items[1]
    for cell in (0.0, 16.0):
        one, two = (Evaluator(each, context).points(x, y, cell_size=cell) for each in (recipe, shuffled))
        for a, b in zip(one, two, strict=True):
            np.testing.assert_array_equal(a, b)


def test_small_shapes_are_lower_and_neighbours_are_level() -> None:
    sketch = painted(
        disc(40, 64, 30) | disc(100, 30, 3) | disc(100, 90, 20), labels=[{"height": 90.0, "strata": 0.5}]
    )
    first, *rest = create_plateaus(sketch, lambda x, _: 0.002 * x)
    by_size = sorted((first, *rest), key=lambda each: each.shape.inside.max())
    assert by_size[0].height < 0.8 * 90.0
    assert by_size[1].height == by_size[2].height == 90.0
    for each in by_size:
        phase = float(layer_phase(np.array(each.top / each.layer_thickness)))
        assert phase == pytest.approx(round(phase), abs=1e-3)
    assert by_size[1].top == by_size[2].top
    assert create_plateaus(painted(), lambda x, _: x) == ()


def test_a_higher_plateau_stands_on_a_lower_one(context) -> None:
    low, high = {"height": 60.0}, {"height": 120.0}
    sketch = painted(disc(64, 64, 45), disc(64, 64, 18), labels=[low, high])
    terrain = build(sketch, device=context)
    x = 1024.0 + np.array([0.0, 500.0, 1000.0])
    top, tier, plain = terrain.heights(x, np.full(3, 1024.0))
    assert top - plain == pytest.approx(120.0, abs=16.0)
    assert tier - plain == pytest.approx(60.0, abs=8.0)
    # No moat between them.
    ring = terrain.heights(1024.0 + np.arange(0.0, 500.0, 5.0), np.full(100, 1024.0))
    assert ring.min() >= tier - 1.0


def test_a_river_flows_in_a_canyon_at_the_level_of_the_plain(context) -> None:
    river = np.zeros((SIZE, SIZE), bool)
    river[:, 63:66] = True
    shape = (np.abs(COLUMN - 64) < 50) & (np.abs(ROW - 64) < 35)
    terrain = build(painted(shape, rivers=river, labels=[{"height": 100.0}]), device=context)
    y = np.arange(600.0, 1500.0, 50.0)
    (course,) = terrain.recipe.rivers
    assert course.centreline[:, 2].max() < 5.0
    assert terrain.heights(np.full(len(y), 1032.0), y).max() < 5.0
    for side in (-1, 1):
        assert terrain.heights(np.full(len(y), 1032.0 + side * 250.0), y).min() > 80.0
    lines = [each.line for each in terrain.recipe.resolutions]
    assert any("cuts a canyon through plateau 1" in line for line in lines)


def test_hills_on_a_plateau_are_as_high_as_elsewhere(context) -> None:
    hill = np.where(disc(64, 50, 14) | disc(64, 80, 10), 1, 0).astype(np.uint8)
    table = painted(disc(64, 64, 50), labels=[{"height": 100.0}])
    sketch = table.replace(
        layers=dict(table.layers) | {"hill": hill},
        labels=dict(table.labels) | {("hill", 1): {"height": 70.0}},
    )
    adherence = measure_adherence(build(sketch, device=context))
    hills = [each for each in adherence.shapes if each.layer == "hill"]
    assert len(hills) == 2
    for each in hills:
        assert 0.85 <= each.reached / each.built <= 1.15
        assert each.iou > 0.6
    assert adherence.layers["plateau"].iou_mean > 0.85
