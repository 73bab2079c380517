"""Adherence on cases with known results, and the bounds that terrains must satisfy."""

import json
import math
from dataclasses import dataclass

import numpy as np
import pytest
from scipy import ndimage

from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch
from sketchterrain.io.resources import preset_names
from sketchterrain.placement.shapes import label_shapes
from sketchterrain.terrain.adherence import agreement, measure_adherence
from sketchterrain.terrain.building import build
from sketchterrain.terrain.terrain import Terrain

from .conftest import tiers

SIDE = 128
HEIGHT = 100.0

_LAYERS = ("mountain", "hill")
_NEAR = 1.5  # px: half the width of the outline
_BESIDE = (3.0, 9.0)  # px: the bands on both sides to which the outline is compared


@dataclass(frozen=True)
class Naturalness:
    """Ratio of the terrain along painted outlines of mountains and hills to bands 3 to 9 pixels away.

    1 where an outline is invisible; creases or steps make it larger. None without mountains and hills.
    """

    curvature: float | None
    slope: float | None


def measure_naturalness(terrain: Terrain) -> Naturalness:
    """Measure the visibility of painted outlines at the sketch's pixels and their resolution."""
    sketch, step = terrain.sketch, terrain.sketch.pixel_size
    painted = [sketch.layers[name] > 0 for name in _LAYERS if sketch.layers[name].any()]
    if not painted:
        return Naturalness(None, None)
    x = (np.arange(-1, sketch.width_px + 1) + 0.5) * step
    y = (sketch.height_px - np.arange(-1, sketch.height_px + 1) - 0.5) * step
    height = terrain.heights(x[None, :], y[:, None], cell_size=step).astype(np.float64)
    curvature, slope = _derivatives(height, step)
    return Naturalness(
        curvature=float(np.mean([outline_ratio(curvature, area) for area in painted])),
        slope=float(np.mean([outline_ratio(slope, area) for area in painted])),
    )


def outline_ratio(quantity: np.ndarray, painted: np.ndarray) -> float:
    """Return the mean of a quantity (height, width) ≥ 0 along an outline over that of bands beside it."""
    inside = np.asarray(ndimage.distance_transform_edt(painted))
    outside = np.asarray(ndimage.distance_transform_edt(~painted))
    depth = np.maximum(inside, outside)
    along = depth < _NEAR
    beside = (depth > _BESIDE[0]) & (depth < _BESIDE[1])
    bands = [quantity[beside & side] for side in (painted, ~painted)]
    usual = np.mean([band.mean() for band in bands if band.size])
    return float(quantity[along].mean() / max(float(usual), 1e-12))


def _derivatives(height: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return |Laplacian| (1/m) and slope of all but the outermost samples."""
    middle = height[1:-1, 1:-1]
    across, down = (height[1:-1, 2:], height[1:-1, :-2]), (height[2:, 1:-1], height[:-2, 1:-1])
    laplacian = (sum(across) + sum(down) - 4.0 * middle) / step**2
    slope = np.hypot(across[0] - across[1], down[0] - down[1]) / (2.0 * step)
    return np.abs(laplacian), slope


def disc(row: float, column: float, radius: float, side: int = SIDE) -> np.ndarray:
    rows, columns = np.mgrid[:side, :side]
    return np.hypot(rows - row, columns - column) < radius


def measured(painted: np.ndarray, effect: np.ndarray, *, height: float = HEIGHT, pixel: float = 10.0):
    image = painted.astype(np.uint8)
    sketch = Sketch(extent=pixel * SIDE, layers={"mountain": image})
    shapes = label_shapes("mountain", image)
    requested = np.full(len(shapes), height)
    return agreement(sketch, shapes, effect.astype(np.float32), requested, has_height=True)[0]


def test_agreement_of_shapes_is_as_computed_by_hand() -> None:
    painted = disc(60, 60, 20)
    (shape,) = measured(painted, HEIGHT * painted)
    assert (shape.iou, shape.spill, shape.lost, shape.capped) == (1.0, 0, False, False)
    assert shape.reached == shape.asked == HEIGHT
    # A quarter of the height is the border.
    assert measured(painted, 0.24 * HEIGHT * painted)[0].lost
    assert measured(painted, 0.26 * HEIGHT * painted)[0].iou == 1.0
    painted = disc(30, 30, 12) | disc(90, 90, 12)
    first, second = measured(painted, HEIGHT * disc(30, 30, 12))
    assert (first.lost, first.iou) == (False, 1.0)
    assert (second.lost, second.iou, second.reached) == (True, 0.0, 0.0)

    painted, there = np.zeros((SIDE, SIDE), bool), np.zeros((SIDE, SIDE), bool)
    painted[40:60, 40:60] = True
    there[40:60, 45:65] = True
    (shape,) = measured(painted, HEIGHT * there)
    assert shape.iou == pytest.approx(15 / 25)
    assert shape.spill == 5 * 20

    painted = disc(60, 60, 10)
    (shape,) = measured(painted, 5000.0 * painted, height=5000.0)
    inradius = label_shapes("mountain", painted.astype(np.uint8))[0].depth.max()
    assert shape.capped
    assert shape.asked == pytest.approx(inradius * 10.0 * math.tan(math.radians(70.0)))

    painted = np.zeros((SIDE, SIDE), bool)
    painted[20:25, 20:100] = True  # five pixels wide
    painted[60, 60] = True
    narrow, speck = measured(painted, 0.0 * painted)
    assert narrow.lost
    assert speck.lost
    assert narrow.iou is speck.iou is narrow.reached is None


def test_adherence_of_a_preset_as_json(valley) -> None:
    found = measure_adherence(valley)
    report = json.loads(json.dumps(found.as_dict()))
    assert report["lost"] == 0
    painted = {name for name, image in valley.sketch.layers.items() if image.any()}
    assert painted - {"material"} == set(report["layers"])
    for name, layer in report["layers"].items():
        assert layer["shapes"] == len(label_shapes(name, valley.sketch.layers[name]))
    assert all(river["descending"] == 1.0 for river in report["rivers"])


def test_every_single_pixel_has_an_effect(context) -> None:
    mountain, hill, forest = (np.zeros((SIDE, SIDE), np.uint8) for _ in range(3))
    mountain[10:120:12, 10:120:12] = 1
    hill[16:120:12, 16:120:12] = 1
    forest[10:120:12, 16:120:12] = 1
    sketch = Sketch(extent=2048.0, layers={"mountain": mountain, "hill": hill, "forest": forest})
    assert measure_adherence(build(sketch, device=context)).lost == 0


def test_noise_has_no_outline_and_a_step_has() -> None:
    area = disc(64, 64, 30)
    noise = np.abs(np.random.default_rng(1).normal(size=area.shape))
    assert outline_ratio(noise, area) == pytest.approx(1.0, abs=0.15)
    distance = np.abs(np.hypot(*(np.mgrid[:SIDE, :SIDE] - 64)) - 30)
    assert outline_ratio(np.where(distance < 1.5, 5.0, 1.0), area) > 4.0


def mean_overlap(terrain: Terrain) -> float:
    """Return the mean overlap; assert that nothing is lost, and that peaks have the requested height."""
    found = measure_adherence(terrain)
    assert found.lost == 0
    assert found.peaks.measured or not terrain.sketch.layers["mountain"].any()
    if found.peaks.measured:
        assert found.peaks.least == pytest.approx(1.0, abs=0.1)
        assert found.peaks.most == pytest.approx(1.0, abs=0.1)
    return found.mean_iou


def hand_painted_layers(layer: str) -> dict[str, np.ndarray]:
    """Return blobs, strokes, a ring and a cross, 256² pixels."""
    side = 256
    rows, columns = np.mgrid[:side, :side]
    image = np.zeros((side, side), bool)
    image |= disc(50, 50, 26, side)
    image |= np.hypot((rows - 60) / 34, (columns - 190) / 18) < 1.0
    turn = np.arctan2(rows - 185, columns - 60)
    image |= np.hypot(rows - 185, columns - 60) < 32 + 7 * np.cos(3 * turn)
    image |= np.abs(np.hypot(rows - 200, columns - 190) - 28) < 9
    image |= (np.abs(rows - 120 - 0.2 * (columns - 130)) < 8) & (np.abs(columns - 130) < 50)
    return {layer: image.astype(np.uint8)}


@tiers(
    ("layer", "fidelity", "least"),
    [("mountain", 0.8, 0.75), ("forest", 1.0, 0.92)],
    [("mountain", 1.0, 0.92), ("hill", 0.8, 0.75), ("hill", 1.0, 0.92), ("forest", 0.8, 0.75)],
)
def test_blobs_strokes_and_rings_match_their_paint(layer, fidelity, least, context) -> None:
    overlaps = []
    for seed in (1, 2):
        labels, layers = {("mountain", 1): {"height": 300.0, "multitude": 3}}, hand_painted_layers(layer)
        sketch = Sketch(extent=4096.0, seed=seed, fidelity=fidelity, layers=layers, labels=labels)
        overlaps.append(mean_overlap(build(sketch, device=context)))
    assert np.mean(overlaps) >= least


@tiers(
    ("presets", "fidelity", "least"),
    [(("valley_river",), 0.8, 0.75)],
    [(preset_names(), 0.8, 0.75), (preset_names(), 1.0, 0.92)],
)
def test_presets_match_their_paint_and_outlines_are_invisible(presets, fidelity, least, context) -> None:
    overlaps = []
    for name in presets:
        terrain = build(load_sketch(name).replace(fidelity=fidelity), device=context)
        overlaps.append(mean_overlap(terrain))
        natural = measure_naturalness(terrain)
        if fidelity == 0.8 and natural.slope is not None:
            assert natural.slope == pytest.approx(1.03, abs=0.05), name
            assert natural.curvature == pytest.approx(1.0, abs=0.1), name
    assert np.mean(overlaps) >= least


@tiers(
    ("name", "seed"),
    [("rolling_hills", 12)],
    [("rolling_hills", 1), ("valley_river", 7), ("desert_mountains", 2)],
)
def test_hills_reach_the_height_of_their_label(name, seed, context) -> None:
    found = measure_adherence(build(load_sketch(name).replace(seed=seed), device=context))
    reached = [s.reached / s.asked for s in found.shapes if s.layer == "hill" and s.reached and s.asked]
    assert reached
    assert max(abs(ratio - 1.0) for ratio in reached) < 0.1


def test_a_mountain_without_strength_is_lost(context) -> None:
    terrain = build(
        Sketch(extent=1280.0, layers={"mountain": disc(60, 60, 20).astype(np.uint8)}), device=context
    )
    terrain.recipe.points.painted["strength"] = 0.0
    found = measure_adherence(terrain)
    assert (found.lost, found.peaks.least) == (1, 0.0)
