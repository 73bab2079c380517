"""Adherence on cases with known results, and the bounds that terrains must satisfy."""

import json
from dataclasses import dataclass

import numpy as np
import pytest
from scipy import ndimage

from sketchterrain.document.edits import Edit
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch
from sketchterrain.generation.building import build, relief_without
from sketchterrain.generation.terrain import Terrain
from sketchterrain.io.resources import preset_names
from sketchterrain.landforms.placement.heights import ShapeHeight
from sketchterrain.landforms.placement.placement import place
from sketchterrain.landforms.placement.shapes import label_shapes
from sketchterrain.measure.adherence import (
    Adherence,
    SampledTerrain,
    agreement,
    measure_adherence,
    measure_layer,
)
from tests.landforms.sketches import SKETCHES

from .conftest import tiers

SIDE = 128
HEIGHT = 100.0

SUMMITS = ("mountain", "hill")
LEAST_OVERLAP = {
    ("mountain", 0.8): 0.78,
    ("mountain", 1.0): 0.80,
    ("hill", 0.8): 0.60,
    ("hill", 1.0): 0.66,
    ("forest", 0.8): 0.75,
    ("forest", 1.0): 0.92,
}
"""Least mean overlap of painted and affected areas by layer and fidelity."""
FINER = 0.03  # of the same for forests of presets and sketches, whose outlines are longer
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
    painted = [sketch.layers[name] > 0 for name in SUMMITS if sketch.layers[name].any()]
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


def measured(painted: np.ndarray, effect: np.ndarray, *, asked: float = HEIGHT, built: float = HEIGHT):
    shapes = label_shapes("mountain", painted.astype(np.uint8))
    heights = [ShapeHeight(asked, built)] * len(shapes)
    return agreement(shapes, effect.astype(np.float32), np.full(len(shapes), built), heights)[0]


def test_agreement_of_shapes_is_as_computed_by_hand() -> None:
    painted = disc(60, 60, 20)
    (shape,) = measured(painted, HEIGHT * painted)
    assert (shape.iou, shape.spill, shape.lost, shape.limited) == (1.0, 0, False, False)
    assert shape.reached == shape.asked == shape.built == HEIGHT
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

    painted = np.zeros((SIDE, SIDE), bool)
    painted[20:25, 20:100] = True  # five pixels wide
    painted[60, 60] = True
    narrow, speck = measured(painted, 0.0 * painted)
    assert narrow.lost
    assert speck.lost
    assert narrow.iou is speck.iou is narrow.reached is None

    painted = disc(60, 60, 20)  # effects are compared with the height that is built
    (shape,) = measured(painted, 0.5 * HEIGHT * painted, asked=5.0 * HEIGHT)
    assert (shape.asked, shape.built, shape.reached) == (500.0, 100.0, 50.0)
    assert shape.limited
    assert shape.iou == 1.0


def test_a_cone_is_affected_above_a_quarter_of_its_height() -> None:
    painted, away = disc(64, 64, 40), np.hypot(*(np.mgrid[:SIDE, :SIDE] - 64))
    for radius, iou in ((40.0, 0.75**2), (160.0 / 3.0, 1.0), (64.0, (1 / 1.2) ** 2)):
        (shape,) = measured(painted, HEIGHT * np.maximum(1.0 - away / radius, 0.0))
        assert shape.iou == pytest.approx(iou, abs=0.02)
        assert shape.reached == HEIGHT
    assert shape.spill == pytest.approx(np.pi * (48**2 - 40**2), rel=0.02)


@pytest.mark.slow
def test_mountains_are_removed_on_the_same_network_of_valleys(context) -> None:
    layers = {"mountain": disc(40, 40, 16).astype(np.uint8), "hill": disc(96, 96, 12).astype(np.uint8)}
    even = {("mountain", 1): {"strata": 0.0}}  # layers of rock move with the ground below them
    terrain = build(Sketch(extent=4096.0, layers=layers, labels=even), device=context)
    sampled = SampledTerrain.evaluate(terrain)
    for layer, row, reach in (("mountain", 40, 16), ("hill", 96, 12)):
        effect = measure_layer(sampled, layer)[1].affected
        without, _ = terrain.evaluator.updated(
            terrain.recipe.with_layers([relief_without(terrain.sketch, layer, terrain.memory)])
        )
        change = sampled.height - without.points(sampled.x, sampled.y, cell_size=0.0)[0]
        change = change.reshape(SIDE, SIDE)
        far = ~disc(row, row, 2.5 * reach)
        assert np.median(np.abs(change[far])) == 0.0, layer
        # Streams through them come from there. Drained anew, a quarter of it or more would change.
        assert (np.abs(change[far]) > 1.0).mean() < 0.1, layer
        assert effect[disc(row, row, 0.5 * reach)].mean() > 0.9, layer


def test_every_single_pixel_has_an_effect(context) -> None:
    mountain, hill, forest = (np.zeros((SIDE, SIDE), np.uint8) for _ in range(3))
    mountain[10:120:12, 10:120:12] = 1
    hill[16:120:12, 16:120:12] = 1
    forest[10:120:12, 16:120:12] = 1
    sketch = Sketch(extent=2048.0, layers={"mountain": mountain, "hill": hill, "forest": forest})
    found = measure_adherence(build(sketch, device=context))
    assert found.lost == 0
    report = json.loads(json.dumps(found.as_dict()))
    assert report["lost"] == 0
    numbers = {name: len(label_shapes(name, image)) for name, image in sketch.layers.items() if image.any()}
    assert {name: layer["shapes"] for name, layer in report["layers"].items()} == numbers


def test_noise_has_no_outline_and_a_step_has() -> None:
    area = disc(64, 64, 30)
    noise = np.abs(np.random.default_rng(1).normal(size=area.shape))
    assert outline_ratio(noise, area) == pytest.approx(1.0, abs=0.15)
    distance = np.abs(np.hypot(*(np.mgrid[:SIDE, :SIDE] - 64)) - 30)
    assert outline_ratio(np.where(distance < 1.5, 5.0, 1.0), area) > 4.0


HARD = {
    "broad_hills": (0.55, 0.85, 2.0),  # a label of 60 m touches higher ones
    "childs_drawing": (0.4, 0.7, 1.2),  # a river crosses mountains
    "range_across": (0.55, 0.85, 1.5),  # a label touches a higher one
    "alpine_range": (0.55, 0.85, 1.45),
}
"""Least overlap, least and greatest share of its height of any shape of sketches that are hard to obey."""
ON_TOP = {"plateau_canyon"}
"""Sketches with hills on plateaus, which level them."""


def check_adherence(found: Adherence, fidelity: float, name: str = "") -> None:
    """Assert that areas overlap, that nothing is lost, and that summits have the heights built for them."""
    least_overlap, low, high = HARD.get(name, (0.55, 0.8, 1.3))
    wrong = [f"{found.lost} lost"] if found.lost else []
    for shape in found.shapes:
        if shape.layer in SUMMITS and shape.iou is not None:
            height = shape.reached / shape.built
            if shape.iou < least_overlap or not low <= height <= high:
                where = f"{shape.layer} {shape.label} at pixel {shape.id}"
                wrong.append(f"{where}: overlap {shape.iou:.2f}, {height:.2f} of {shape.built:.0f} m")
    if found.peaks.median is not None and not 0.88 <= found.peaks.median <= 1.1:
        wrong.append(f"median of heights {found.peaks.median:.3f}")
    for kind, layer in found.layers.items():
        least = LEAST_OVERLAP.get((kind, fidelity), 0.0) - (FINER if name and kind == "forest" else 0.0)
        if name != "childs_drawing" and layer.iou_mean is not None and layer.iou_mean < least:
            wrong.append(f"{kind}: mean overlap {layer.iou_mean:.3f} < {least}")
    assert not wrong


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
    ("layer", "fidelity", "seed"),
    [("mountain", 0.8, 1)],
    [(layer, fidelity, 2) for layer in ("mountain", "hill", "forest") for fidelity in (0.8, 1.0)],
    [
        ("mountain", 1.0, 1),
        *((layer, fidelity, 1) for layer in ("hill", "forest") for fidelity in (0.8, 1.0)),
    ],
)
def test_blobs_strokes_and_rings_match_their_paint(layer, fidelity, seed, context) -> None:
    labels = {("mountain", 1): {"multitude": 3}}
    layers = hand_painted_layers(layer)
    sketch = Sketch(extent=4096.0, seed=seed, fidelity=fidelity, layers=layers, labels=labels)
    check_adherence(measure_adherence(build(sketch, device=context)), fidelity)


@tiers(
    ("name", "fidelity"),
    [],
    [(name, 0.8) for name in ("valley_river", *preset_names()[::2])],
    [
        *((name, 0.8) for name in preset_names()[1::2] if name != "valley_river"),
        *((name, 1.0) for name in preset_names()),
    ],
)
def test_presets_match_their_paint_and_fronts_are_no_walls(name, fidelity, context) -> None:
    terrain = build(load_sketch(name).replace(fidelity=fidelity), device=context)
    check_adherence(measure_adherence(terrain), fidelity, name)
    if fidelity == 0.8:
        check_naturalness(terrain)


def check_naturalness(terrain: Terrain) -> None:
    natural = measure_naturalness(terrain)
    if natural.slope is not None:
        # Fronts of mountains are steeper than what lies behind and before them.
        assert 0.95 < natural.slope < 1.65
        assert 0.9 < natural.curvature < 1.2


@tiers(
    ("name", "seed"),
    [],
    [(name, 0) for name in SKETCHES],
    [(name, seed) for name in SKETCHES for seed in (1, 2)],
)
def test_painted_sketches_match_their_paint(name, seed, context) -> None:
    found = measure_adherence(build(SKETCHES[name](seed), device=context))
    if name in ON_TOP:
        assert found.layers["plateau"].iou_mean > 0.85
    else:
        check_adherence(found, 0.8, name)


def test_a_mountain_whose_features_are_deleted_is_lost(context) -> None:
    painted = Sketch(extent=1280.0, layers={"mountain": disc(60, 60, 20).astype(np.uint8)})
    edits = tuple(Edit("delete", int(each)) for each in place(painted, seed=painted.seed)["id"])
    found = measure_adherence(build(painted.replace(edits=edits), device=context))
    assert found.lost == 1
    assert found.peaks.least == pytest.approx(0.0, abs=0.01)  # of the height built for it
