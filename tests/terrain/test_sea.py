"""Coasts: profiles of bed, beach and cliff; what stays as it is; the sea of a painted sketch."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from sketchterrain.document.sketch import Sketch
from sketchterrain.generation.building import build
from sketchterrain.geometry.lattice import to_lattice
from sketchterrain.landforms.placement.feature_types import ShapeField
from sketchterrain.landforms.placement.sea import Sea, create_sea
from sketchterrain.schema.materials import MATERIALS
from sketchterrain.terrain.evaluator import Evaluator
from sketchterrain.terrain.layers.layer import MASKS, WorldSettings
from sketchterrain.terrain.layers.relief import ReliefLayer
from sketchterrain.terrain.layers.sea import SeaLayer, raised_lowland

from .conftest import CASES, Waves, feature, heights_at, winding_sea

EXTENT, COAST = 4096.0, 2048.0
LEVEL, SHELF, DEPTH, BEACH, REACH = 2.0, 700.0, 30.0, 40.0, 320.0
SLOPE = 0.05
DRY = {"aridity": 1.0}  # hardly any streams


def straight_sea() -> Sea:
    """A sea east of x = COAST."""
    spacing, count = 16.0, 256
    inside = np.broadcast_to((np.arange(count) + 0.5) * spacing - COAST, (count, count))
    coast = ShapeField(8.0, 8.0, spacing, np.clip(inside, -500, 900).astype(np.float32))
    depth = replace(coast, inside=np.full(inside.shape, DEPTH, np.float32))
    return Sea(LEVEL, BEACH, SHELF, coast, depth)


def flood(level: float = LEVEL) -> Sea:
    """All ground below a level."""
    return Sea(level, BEACH, SHELF, None, None)


def test_a_painted_bed_follows_its_profile(make_recipe, context) -> None:
    """Slope at the waterline, greatest depth at the shelf's end; the ground below has no effect."""
    recipe = make_recipe(*CASES["mountain"], sea=straight_sea(), fidelity=1.0)
    d = np.array([0.5, 5.0, 100.0, 350.0, 699.0, 750.0, 1500.0])
    t = np.minimum(d / SHELF, 1)
    bars = 0.15 * DEPTH * t**2 * (3 - 2 * t)  # banks and hollows
    expected = LEVEL - DEPTH * t**2 * (3 - 2 * t) - SLOPE * SHELF * t * (1 - t) ** 2
    for y in (100.0, 700.0, 2000.0, 4000.0):
        found = heights_at(recipe, context, COAST + d, y)
        assert (np.abs(found - expected) < bars + 1e-3).all()
    assert np.ptp(heights_at(recipe, context, COAST + 1500.0, np.arange(500.0, 3500.0, 100.0))) > 1.0


def test_land_beside_a_painted_sea_is_above_it(make_recipe, context) -> None:
    """It begins at the level with the beach's slope, and from the reach on only lowland is raised."""
    ground = {"relief": ReliefLayer(Waves(120.0)), "fidelity": 1.0}
    bare, recipe = make_recipe(**ground), make_recipe(sea=straight_sea(), **ground)
    y = np.linspace(0, EXTENT, 400)
    shore = [heights_at(recipe, context, COAST - x, y) - LEVEL for x in (0.25, 0.5)]
    np.testing.assert_allclose(shore[1] - shore[0], 0.25 * SLOPE, atol=0.004)
    x = COAST - np.geomspace(0.2, 2000, 40)[:, None]
    ground, land = heights_at(bare, context, x, y), heights_at(recipe, context, x, y)
    assert (land > LEVEL).all()
    raised = LEVEL + raised_lowland(ground - LEVEL)
    assert (land <= raised + 1e-3).all()
    inland = (COAST - x[:, 0]) > REACH
    np.testing.assert_allclose(land[inland], raised[inland], atol=1e-4)
    high = inland[:, None] & (ground > LEVEL + 8.0)
    np.testing.assert_array_equal(land[high], ground[high])
    assert high.sum() > 1000


def test_slopes_are_continuous_across_coasts(make_recipe, context) -> None:
    """From step to step they change no more than without a sea, but for the cliffs' own curvature."""
    x = np.arange(1200.0, 2900.0, 0.5)
    for sea in (winding_sea(), straight_sea(), flood()):
        # Without the noise that is as fine as the steps.
        ground = heights_at(
            make_recipe(sea=sea, ground={"relief": 15.0}), context, x, np.array([[1700.0], [2050.0]]), 32.0
        )
        slope = np.diff(ground, axis=1) / 0.5
        assert np.abs(np.diff(slope, axis=1)).max() < 0.04


def test_an_unpainted_sea_changes_only_ground_near_its_level(make_recipe, context) -> None:
    rng = np.random.default_rng(4)
    x, y = rng.uniform(-EXTENT, 2 * EXTENT, (2, 20000))
    bare = heights_at(make_recipe(), context, x, y).astype(np.float64) - LEVEL
    found = heights_at(make_recipe(sea=flood()), context, x, y).astype(np.float64) - LEVEL
    swash = 0.1 * BEACH
    near = np.abs(bare) < swash
    np.testing.assert_allclose(found[~near], bare[~near], atol=1e-5)
    u = bare[near] / swash
    np.testing.assert_allclose(found[near], bare[near] * (1 - 0.75 * (1 - u**2) ** 2), atol=1e-5)
    assert (np.sign(found[np.abs(bare) > 1e-3]) == np.sign(bare[np.abs(bare) > 1e-3])).all()
    assert near.sum() > 500


def test_masks_of_the_sea(make_recipe, context) -> None:
    """Water is 3/4 at the waterline and 1 where the sea is deep; no forest and no rock in it."""
    forest = feature("forest", COAST, COAST, 1500, 0.9)
    x = COAST + np.array([-300.0, -41.0, -20.0, -0.01, 0.01, 350.0, 700.0])
    recipe = make_recipe(forest, *CASES["mountain"], sea=straight_sea(), fidelity=1.0)
    lattice = to_lattice(x, EXTENT), to_lattice(np.full(x.size, COAST), EXTENT)
    masks = Evaluator(recipe, context).points(*lattice, cell_size=0.0)[1]
    water, wood, rock = (masks[:, MASKS.index(name)] for name in ("water", "forest", "mountain"))
    np.testing.assert_allclose(water[[0, 1, 3, 4, 5, 6]], [0, 0, 0.75, 0.75, 0.875, 1], atol=1e-3)
    assert 0.1 < water[2] < 0.3
    assert (wood[3:] == 0).all()
    assert (rock[3:] < 1e-3).all()


def square_sketch(**changes: Any) -> Sketch:
    """A square island of half the sketch's width."""
    image = np.ones((64, 64), np.uint8)
    image[16:48, 16:48] = 0
    return Sketch(extent=EXTENT, **({"layers": {"sea": image}, "fidelity": 1.0, "climate": DRY} | changes))


def test_paint_is_the_coast_at_fidelity_1(context) -> None:
    """All of the paint is under water, all other ground above it, also beyond the sketch."""
    terrain = build(square_sketch(ground={"relief": 80.0}), device=context)
    assert terrain.features.sea_level == 0.0
    step = (np.arange(-16, 48) + 0.5) * 128.0
    wet = terrain.heights(*np.meshgrid(step, step)) < 0
    island = np.zeros((64, 64), bool)
    island[24:40, 24:40] = True
    border = island ^ ndimage.binary_erosion(island) | (ndimage.binary_dilation(island) ^ island)
    assert (wet == ~island)[~border].all()
    assert (wet == ~island)[border].mean() > 0.98


def test_labels_have_their_own_depths(context) -> None:
    image = np.ones((64, 64), np.uint8)
    image[:, 32:] = 2
    image[:, 28:36] = 0
    labels = {("sea", 1): {"depth": 10.0}, ("sea", 2): {"depth": 90.0}}
    sketch = square_sketch(layers={"sea": image}, labels=labels, coast={"shelf": 300.0, "sea_level": 12.0})
    shallow, deep = build(sketch, device=context).heights([300.0, 3800.0], [2000.0, 2000.0])
    assert shallow == pytest.approx(12.0 - 10.0, abs=1.6)
    assert deep == pytest.approx(12.0 - 90.0, abs=13.6)


def test_a_stroke_changes_only_what_is_near_it() -> None:
    """Parts of the coast that a stroke does not reach are the same items."""
    image = np.ones((512, 512), np.uint8)
    image[100:400, 100:400] = 0
    painted = image.copy()
    painted[240:260, 395:405] = 1
    sketches = [Sketch(extent=8192.0, layers={"sea": each}) for each in (image, painted)]
    old, new = (SeaLayer.of(create_sea(each)) for each in sketches)
    world = WorldSettings(8192.0, sketches[0].seed, sketches[0].fidelity)
    assert old.key() == new.key()
    change = new.change(old, world)
    assert change is not None
    boxes = change.boxes * world.unit
    assert 0 < len(change.added) < 30
    assert boxes[:, 0].min() > 3500.0  # the island's west is as it was


def test_sand_covers_beaches_and_the_bed(context) -> None:
    terrain = build(square_sketch(ground={"relief": 4.0}, climate={}), device=context)
    tile = terrain.tile(3, 2, 4)
    share = tile.materials[..., MATERIALS.index("sand")]
    near = (tile.height > -3) & (tile.height < 0.3)
    assert near.any()
    assert share[near].mean() > 0.95
    inland = build(square_sketch(layers={"sea": np.zeros((64, 64), np.uint8)}, climate={}), device=context)
    assert inland.features.sea_level is None
    assert inland.tile(3, 2, 4).materials[..., MATERIALS.index("sand")].max() < 1e-6


def test_coasts_continue_beyond_the_sketch(context) -> None:
    """Without end and with the same bits in tiles and at points, and nowhere straight for long."""
    image = np.zeros((64, 64), np.uint8)
    image[:, 30:] = 1
    terrain = build(square_sketch(layers={"sea": image}), device=context)
    north = np.arange(2, 7) * EXTENT
    across = np.arange(-2000.0, 6000.0, 40.0)
    coasts = [across[np.argmax(terrain.heights(across, np.full(across.size, y)) < 0)] for y in north]
    assert np.ptp(coasts) > 150
    for key in ((2, 1, 5), (1, 3_000_000, 5), (4, -70_000_000, 70_000_000)):
        tile = terrain.tile(*key)
        west, _, _, top = tile.bounds
        at = tile.cell_size * np.arange(0, tile.height.shape[0], 16)
        x, y = np.meshgrid(west + at, top - at)
        found = terrain.heights(x, y, cell_size=tile.cell_size)
        np.testing.assert_array_equal(found, tile.height[::16, ::16])
    assert terrain.tile(1, 3_000_000, 5).height.max() < 0
    assert terrain.tile(1, -3_000_000, 5).height.min() > 0
