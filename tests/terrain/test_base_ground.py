"""Painted features over elevation data: what nodes hold, heights that are reached, and how water leaves."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, correlate1d, gaussian_filter
from skimage.morphology import reconstruction

from sketchterrain.document.sketch import Sketch
from sketchterrain.elevation.surface import Heights
from sketchterrain.landforms import painted_ground as grounds
from sketchterrain.landforms.base_ground import BaseGround
from sketchterrain.landforms.hydrology.courses import course_through
from sketchterrain.landforms.painted_ground import PaintedLand, PaintedWater, Sources
from sketchterrain.landforms.placement.placement import place
from sketchterrain.landforms.relief_fields import UnpaintedSettings
from sketchterrain.landforms.uplift import painted_outline, uplift_features
from sketchterrain.stages.runner import Runner
from sketchterrain.terrain.layers.relief import UnpaintedNodes

EXTENT, SIDE = 12000.0, 128
SPACING = EXTENT / 256
MIDDLE, RADIUS = (6000.0, 6000.0), 1700.0
DRY = PaintedWater()
RUN = Runner()


@dataclass(frozen=True)
class Waves:
    """Tilted waves up to a western rim (m), as elevation data."""

    rim: float = -1e9

    @property
    def id(self) -> bytes:
        return np.float64(self.rim).tobytes()

    @property
    def patchwork(self):
        return SimpleNamespace(reach=np.array([[max(self.rim, -4000.0), -4000.0, 16000.0, 16000.0]]))

    def heights(self, x, y, cell):
        del cell
        rng, height, slopes = np.random.default_rng(5), 900.0 + 0.02 * x + 0.03 * y, np.zeros((2, *x.shape))
        for length in np.geomspace(1500.0, 6000.0, 12):
            angle, phase = 2.0 * np.pi * rng.random(2)
            east, north = np.cos(angle) * 2.0 * np.pi / length, np.sin(angle) * 2.0 * np.pi / length
            turn = x * east + y * north + phase
            height = height + 0.012 * length * np.sin(turn)
            slopes += 0.012 * length * np.cos(turn) * np.array([east, north]).reshape(2, *[1] * x.ndim)
        return Heights(height, *slopes, np.ones(x.shape), np.ones(x.shape), np.zeros((0, *x.shape)))

    def weight(self, x, y):
        del y
        return np.clip((x - self.rim) / 2000.0, 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class Built:
    """A painted region at level 0."""

    nodes: grounds.PaintedNodes
    total: np.ndarray  # m
    before: np.ndarray  # without features
    weight: np.ndarray
    x: np.ndarray
    y: np.ndarray
    zone: np.ndarray
    land: PaintedLand

    @property
    def change(self) -> np.ndarray:
        return self.total - self.before


def painted(*shapes, labels=None):
    """Return a sketch with circles (layer, label, middle, radius)."""
    column, row = np.meshgrid(np.arange(SIDE) + 0.5, SIDE - np.arange(SIDE) - 0.5)
    x, y = column * EXTENT / SIDE, row * EXTENT / SIDE
    layers = {}
    for layer, label, middle, radius in shapes:
        image = layers.setdefault(layer, np.zeros((SIDE, SIDE), np.uint8))
        image[np.hypot(x - middle[0], y - middle[1]) < radius] = label
    return Sketch(extent=EXTENT, seed=4, layers=layers, labels=labels or {})


def land_of(sketch, data=None):
    run = Runner()
    outlines = {name: painted_outline(sketch, name, SPACING, run) for name in ("mountain", "hill")}
    points = place(sketch, seed=sketch.seed)
    found = {name: outline for name, outline in outlines.items() if outline is not None}
    return PaintedLand(uplift_features(sketch, points, run, data), found)


def region_of(base):
    settings = UnpaintedSettings.from_sketch(painted())
    ground = base and BaseGround(base, SPACING, UnpaintedNodes(settings))
    return Sources(settings, ground)


def ground_of(region, land, water=DRY, run=RUN, levels=grounds.FINE):
    return run(grounds.painted_ground, region, land, water, levels, hashed=False)


def build(sketch, base=None, water=DRY, run=RUN, data=False):
    region = region_of(base or Waves())
    heights = grounds.data_heights(region, water, run) if data else None
    land = land_of(sketch, heights)
    ground = ground_of(region, land, water, run)
    raster, flow = ground.raster, grounds.painted_flow(region, ground, water, run)
    blended = run(grounds.blended_ground, region, water.bare, grounds.FINE, hashed=False)
    uplift = grounds._uplift(region, land, water, grounds.FINE, run)
    nodes, where = raster.levels[0], flow.raster
    x, y = where.positions().T.reshape(2, *where.shape)
    before = blended[-1].flow.height
    return Built(nodes, flow.height, before, blended[-1].weight, x, y, uplift.zone, land)


def read(nodes):
    """Return what the terrain's splines read at nodes."""
    for axis in (0, 1):
        nodes = correlate1d(nodes, [0.125, 0.75, 0.125], axis, mode="nearest")
    return nodes


def depths(height):
    """Return how deep nodes lie in closed depressions."""
    height = np.where(np.isnan(height), np.nanmin(height), height)
    full = height.copy()
    full[1:-1, 1:-1] = height.max()
    return reconstruction(full, height, method="erosion") - height


@pytest.fixture(scope="module")
def mountain():
    shapes = ("mountain", 1, MIDDLE, RADIUS), ("hill", 1, (9500.0, 9500.0), 900.0)
    labels = {("mountain", 1): {"height": 500.0}, ("hill", 1): {"height": 100.0}}
    return build(painted(*shapes, labels=labels))


@pytest.fixture(scope="module")
def beside():
    """Nothing painted, and data east of a rim."""
    return build(painted(), Waves(rim=5000.0))


def test_towards_the_rim_of_data_nodes_hold_the_share_of_procedural_ground(beside):
    bare = ground_of(region_of(None), beside.land).raster.levels[0].height
    at = 0, beside.nodes.column, beside.nodes.row, *bare.shape
    bare = bare + region_of(Waves(rim=5000.0)).base.window(*at).around
    assert np.nanmax(np.abs(beside.nodes.height[beside.weight == 1.0])) == 0.0
    assert np.allclose(beside.nodes.height, (1.0 - beside.weight) * bare, atol=1e-3, equal_nan=True)


def test_features_add_nothing_outside_of_their_zones_and_take_nothing_away(mountain):
    inside = ~np.isnan(mountain.total)
    assert np.all(mountain.change[inside & ~mountain.zone] == 0.0)
    assert np.all(mountain.nodes.height[inside & ~mountain.zone] == 0.0)
    assert mountain.change[inside].min() >= 0.0
    # no wall at the border of zones
    rim = mountain.zone & binary_dilation(~mountain.zone, iterations=2)
    assert mountain.change[rim].max() < 1.0


def test_added_heights_are_reached(mountain):
    change = read(np.nan_to_num(mountain.change))
    for middle, radius, height in ((MIDDLE, RADIUS, 500.0), ((9500.0, 9500.0), 900.0, 100.0)):
        near = np.hypot(mountain.x - middle[0], mountain.y - middle[1]) < radius
        assert change[near].max() == pytest.approx(height, rel=0.02, abs=5.0)


def test_summits_reach_elevations_above_the_datum(monkeypatch):
    properties = Sketch.properties
    monkeypatch.setattr(
        Sketch,
        "properties",
        lambda *at: {**properties(*at), "reach": "absolute"} if at[2] == 2 else properties(*at),
    )
    labels = {
        ("mountain", 1): {"height": 300.0},
        ("mountain", 2): {"height": 1700.0},
        ("hill", 2): {"height": 50.0},
    }
    shapes = (
        ("mountain", 2, MIDDLE, RADIUS),
        ("mountain", 1, (2500.0, 2500.0), 1200.0),
        ("hill", 2, (9800.0, 9800.0), 900.0),
    )
    built = build(painted(*shapes, labels=labels), data=True)
    change = read(np.nan_to_num(built.change))
    total = built.before + change
    near = {
        middle: np.hypot(built.x - middle[0], built.y - middle[1]) < radius for _, _, middle, radius in shapes
    }
    assert total[near[MIDDLE]].max() == pytest.approx(1700.0, rel=0.02, abs=5.0)
    assert change[near[2500.0, 2500.0]].max() == pytest.approx(300.0, rel=0.02, abs=5.0)
    # the ground is higher than the hill
    assert change[near[9800.0, 9800.0]].max() < 1.0


@pytest.mark.filterwarnings("ignore:Setting the shape on a NumPy array:DeprecationWarning")  # scikit-image's
def test_valleys_of_data_go_on_through_features(mountain):
    zone = mountain.zone
    assert depths(mountain.total)[zone].sum() <= depths(mountain.before)[zone].sum() + 50.0
    assert depths(mountain.total)[zone].max() <= depths(mountain.before)[zone].max() + 2.0
    # more is added to spurs of the data than to their hollows
    curved = mountain.before - gaussian_filter(np.nan_to_num(mountain.before), 6.0)
    core = np.hypot(mountain.x - MIDDLE[0], mountain.y - MIDDLE[1]) < 0.6 * RADIUS
    assert np.corrcoef(curved[core], mountain.change[core])[0, 1] > 0.2


def test_a_river_through_a_mountain_stays_on_the_data():
    points = np.array([[x, y, 30.0, 2.0] for x, y in ((6500.0, 11000.0), (6100.0, 6000.0), (5000.0, 500.0))])
    course = course_through(points, 1, 1, parent=None, joint=-1, taper=1.0)
    slope = np.full(len(course.line), 0.01)
    water = PaintedWater((course,), (slope,), (np.full(len(slope), 100.0),), (slope,))
    built = build(
        painted(("mountain", 1, MIDDLE, RADIUS), labels={("mountain", 1): {"height": 500.0}}), water=water
    )
    near = np.min(
        np.hypot(built.x[..., None] - course.line[::5, 0], built.y[..., None] - course.line[::5, 1]), axis=-1
    )
    assert built.change[near < 0.5 * SPACING].max() < 60.0
    assert read(np.nan_to_num(built.change)).max() == pytest.approx(500.0, rel=0.02, abs=5.0)


def test_relief_without_a_layer_is_the_data_and_the_other_layer(mountain):
    region, nodes = region_of(Waves()), mountain.nodes.height
    features = mountain.land.features
    for removed in (features.is_rock, ~features.is_rock):
        left = (
            grounds.ground_without(region, ground_of(region, mountain.land), mountain.land, DRY, removed, RUN)
            .levels[0]
            .height
        )
        own, others = (
            np.min(
                [
                    np.hypot(mountain.x - x, mountain.y - y) / r
                    for x, y, r in np.array(features[:3])[:, some].T
                ],
                0,
            )
            for some in (removed, ~removed)
        )
        inside = ~np.isnan(nodes)
        assert np.allclose(left[inside & (own > 2.3)], nodes[inside & (own > 2.3)], atol=0.01)
        assert left[inside & (others > 2.3)].max() < 1.0


def test_streams_are_barred_by_data_and_rock_is_theirs_under_painted_rock(mountain, beside):
    region = region_of(Waves(rim=5000.0))
    flow = grounds.painted_flow(region, ground_of(region, beside.land), DRY, RUN)
    x = flow.raster.positions()[:, 0].reshape(flow.raster.shape)
    assert np.array_equal(flow.barred, x > 5000.0)
    core = np.hypot(mountain.x - MIDDLE[0], mountain.y - MIDDLE[1]) < 0.5 * RADIUS
    assert mountain.nodes.rock[core].min() == 255


def test_coarser_nodes_fit_their_own_weights_of_the_data(beside):
    region = region_of(Waves(rim=5000.0))
    raster = ground_of(region, beside.land).raster
    other = region.base
    for level, nodes in enumerate(raster.levels[:5]):
        data = other.window(level, nodes.column, nodes.row, *nodes.height.shape)
        assert np.nanmax(np.abs(nodes.height[data.weight == 1.0]), initial=0.0) < 1e-6
        total = nodes.height + data.weight * data.height
        # The ground beside the data continues them: nothing is missing at any level.
        assert np.nanmin(total) > np.nanmin(raster.beside.height) - 5.0
