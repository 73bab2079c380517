"""Edits of placed features, rivers and lakes: the next recipe has the values that were set."""

import math
from functools import partial

import numpy as np
import pytest

from sketchterrain.document.edits import ADDED_BIT, MAX_EDITS
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch
from sketchterrain.errors import InputError
from sketchterrain.generation.building import make_recipe
from sketchterrain.schema.layers import LAYERS
from sketchterrain.stages.runner import Results
from sketchterrain.ui import commands as edits
from sketchterrain.ui.commands import exists, find_parent_river, find_point, find_river, name_of
from sketchterrain.ui.engine.protocol import Placement
from sketchterrain.ui.models.selection import handles_of
from sketchterrain.ui.models.workspace import Selection

MEMORY = Results()


def placed_of(sketch: Sketch) -> Placement:
    recipe = make_recipe(sketch, memory=MEMORY)
    points = np.concatenate([recipe.points.painted, recipe.points.fill.within(0.0, 0.0, *sketch.size)])
    points = points[np.argsort(points["id"])]
    return Placement(1, points, tuple(recipe.rivers), tuple(recipe.lakes), orphans=recipe.orphans)


@pytest.fixture(scope="module")
def sketch() -> Sketch:
    """Two mountains, a hill, a forest, a lake, and a river with a tributary."""
    side = 96
    row, column = np.mgrid[:side, :side]
    blank = np.zeros((side, side), np.uint8)
    mountain, hill, forest, lake, river = (blank.copy() for _ in range(5))
    mountain[np.hypot(row - 20, column - 20) < 12] = 1
    mountain[np.hypot(row - 24, column - 66) < 10] = 2
    hill[np.hypot(row - 74, column - 18) < 8] = 1
    forest[40:60, 10:24] = 1
    lake[np.hypot(row - 76, column - 78) < 7] = 1
    river[44:46, 30:90] = 1
    river[45:70, 76:78] = 1  # away from the middle, where the handle of the width is
    return Sketch(
        extent=3000.0,
        fidelity=1.0,
        density={"forest": 4.0},
        layers={"mountain": mountain, "hill": hill, "forest": forest, "lake": lake, "river": river},
        labels={("mountain", 1): {"multitude": 1}, ("mountain", 2): {"multitude": 3}},
    )


@pytest.fixture(scope="module")
def placed(sketch: Sketch) -> Placement:
    return placed_of(sketch)


def first(placed: Placement, kind: int | None = None, *, painted: bool = True) -> Selection:
    """Return a mountain, or a grove where nothing is painted."""
    kind = (0 if painted else 3) if kind is None else kind
    found = placed.points[(placed.points["type"] == kind) & (placed.points["painted"] == painted)]
    return Selection("feature", int(found["id"][0]))


def painted_mountains(placed: Placement) -> np.ndarray:
    return placed.points[(placed.points["type"] == 0) & placed.points["painted"]]


def unjoined(placed: Placement) -> Selection:
    """Return a river that joins no other one."""
    return Selection(
        "course", next(each.id for each in placed.rivers if find_parent_river(placed, each) is None)
    )


def by_role(placed: Placement, selection: Selection, role: str):
    return next(each for each in handles_of(placed, selection) if each.role == role)


def test_a_dragged_feature_moves_and_keeps_its_shape(sketch, placed):
    moved, both = sketch, [first(placed, painted=painted) for painted in (True, False)]
    for x, selection in zip((2000.0, 300.0), both, strict=True):
        moved = edits.dragged(moved, placed, by_role(placed, selection, "move"), x, 2345.6789)
    now = placed_of(moved)
    for x, selection in zip((2000.0, 300.0), both, strict=True):
        before, after = find_point(placed, selection), find_point(now, selection)
        assert (after["x"], after["y"]) == (x, 2345.679), selection
        for key in ("type", "radius", "peakiness", "erosion"):
            assert after[key] == before[key], selection


def test_radius_height_and_width_follow_their_handles(sketch, placed):
    selection = first(placed)
    handle = by_role(placed, selection, "radius")
    changed = edits.dragged(sketch, placed, handle, handle.base_x, handle.base_y - 321.0)
    high = Selection("feature", int(painted_mountains(placed)["id"][1]))
    changed = edits.with_values(changed, placed, high, "strength", strength=777.0)
    assert edits.values_of(changed, find_point(placed, high))["strength"] == 777.0
    now = placed_of(changed)
    assert find_point(now, selection)["radius"] == np.float32(321.0)
    assert find_point(now, high)["strength"] == pytest.approx(777.0, rel=0.3)
    grove = edits.with_values(sketch, placed, first(placed, 3), "strength", strength=40.0)
    assert grove.edits[0].strength == 1.0

    selection, changed, now = unjoined(placed), sketch, placed
    for width in (30.0, 140.0):
        handle = by_role(now, selection, "width")
        away = np.array([handle.x - handle.base_x, handle.y - handle.base_y])
        away *= 0.5 * width / np.hypot(*away)
        changed = edits.dragged(changed, now, handle, handle.base_x + away[0], handle.base_y + away[1])
        now = placed_of(changed)
        handle = by_role(now, selection, "width")
        drawn_width = 2.0 * math.hypot(handle.x - handle.base_x, handle.y - handle.base_y)
        assert drawn_width == pytest.approx(width, rel=0.15)
    assert [each.action for each in changed.edits] == ["width"]


def test_a_control_point_can_be_dragged_repeatedly(sketch, placed):
    selection = unjoined(placed)
    index = len(find_river(placed, selection).points) // 2
    rng = np.random.default_rng(3)
    changed, now = sketch, placed
    for _ in range(3):
        handle = next(each for each in handles_of(now, selection) if each.selection.index == index)
        x, y = handle.x + rng.uniform(-60, 60), handle.y + rng.uniform(-60, 60)
        changed = edits.dragged(changed, now, handle, x, y)
        now = placed_of(changed)
        assert np.hypot(*(find_river(now, selection).points[:, :2] - [x, y]).T).min() < 0.01
        assert now.orphans == ()
    assert len(changed.edits) == 1, "the same point, dragged again, is the same edit"
    # An edit of a neighbouring point is separate.
    other = next(each for each in handles_of(now, selection) if each.selection.index == index + 1)
    both = edits.dragged(changed, now, other, other.x + 30.0, other.y - 30.0)
    assert len(both.edits) == 2
    assert edits.reset(both, placed_of(both), other.selection).edits == changed.edits
    assert edits.reset(both, now, selection).edits == ()


def test_a_drag_before_the_last_one_is_placed_replaces_it(sketch, placed):
    selection = unjoined(placed)
    handle = next(each for each in handles_of(placed, selection) if each.selection.index == 5)
    once = edits.dragged(sketch, placed, handle, handle.x + 10.0, handle.y)
    twice = edits.dragged(once, placed, handle, handle.x, handle.y + 25.0)
    assert [(each.x, each.y) for each in twice.edits] == [(round(handle.x, 3), round(handle.y + 25.0, 3))]


def test_a_dragged_locked_feature_stays_locked(sketch, placed):
    lock, both = sketch, [first(placed, painted=painted) for painted in (True, False)]
    for selection in both:
        lock = edits.locked(lock, placed, selection)
        assert edits.is_locked(lock, selection), selection
        assert edits.locked(lock, placed, selection) is lock, selection
    held, changed = placed_of(lock), lock
    for x, selection in zip((2200.0, 500.0), both, strict=True):
        assert find_point(held, selection) == find_point(placed, selection), selection
        changed = edits.dragged(changed, held, by_role(held, selection, "move"), 2100.0, 2300.0)
        changed = edits.dragged(changed, held, by_role(held, selection, "move"), x, 2400.0)
    assert sorted(each.action for each in changed.edits) == ["lock", "lock", "move", "move"]
    now, free = placed_of(changed), changed
    for x, selection in zip((2200.0, 500.0), both, strict=True):
        after = find_point(now, selection)
        assert (after["x"], after["y"]) == (x, 2400.0), selection
        assert after["strength"] == find_point(placed, selection)["strength"], selection
        free = edits.unlocked(free, selection)
        assert not edits.is_locked(free, selection), selection
        assert edits.unlocked(free, selection) is free, selection
    now = placed_of(free)
    assert [find_point(now, selection)["x"] for selection in both] == [2200.0, 500.0]


def test_deleted_objects_are_gone_until_reset(sketch, placed):
    lake = Selection("water", next(each.id for each in placed.lakes if each.label))
    gone, all_four = sketch, (first(placed), first(placed, painted=False), unjoined(placed), lake)
    for selection in all_four:
        gone = edits.deleted(edits.reset(gone, placed, selection), selection)
    now, back = placed_of(gone), gone
    for selection in all_four:
        assert exists(placed, selection)
        assert not exists(now, selection)
        assert edits.is_edited(gone, placed, selection)
        back = edits.reset(back, now, selection)
        assert not edits.is_edited(back, placed, selection)
    assert back.edits == ()


def test_an_added_feature_can_be_dragged_reset_and_deleted(sketch, placed):
    changed = edits.added(sketch, "mountain", 2400.0, 700.0, 400.0, 300.0)
    now = placed_of(changed)
    selection = Selection("feature", int(now.points["id"][now.points["id"] & ADDED_BIT > 0][0]))
    assert find_point(now, selection)["x"] == 2400.0
    changed = edits.dragged(changed, now, by_role(now, selection, "move"), 2500.0, 800.0)
    assert find_point(placed_of(changed), selection)["x"] == 2500.0
    assert [each.action for each in edits.reset(changed, now, selection).edits] == ["add"]
    assert edits.deleted(changed, selection).edits == ()
    assert edits.added(sketch, "forest", 0.0, 0.0, 100.0, 300.0).edits[0].strength == 1.0
    with pytest.raises(InputError):
        edits.added(sketch, "castle", 0.0, 0.0, 100.0, 300.0)


def test_values_are_clamped_and_confluences_cannot_be_moved(sketch, placed):
    selection = first(placed)
    for action, given, expected in (
        ("resize", {"radius": 0.0}, {"radius": 0.1}),
        ("strength", {"strength": 1e9}, {"strength": 9000.0}),
        ("move", {"x": 1e12, "y": -1e12}, {"x": 1e7, "y": -1e7}),
    ):
        assert edits.with_values(sketch, placed, selection, action, **given).edits[0].values == expected
    assert edits.widened(sketch, unjoined(placed), 0.0).edits[0].width == 0.5
    with pytest.raises(InputError, match="number"):
        edits.with_values(sketch, placed, selection, "resize", radius=float("nan"))

    child = next(each for each in placed.rivers if find_parent_river(placed, each) is not None)
    selection = Selection("course", child.id)
    last = len(child.points) - 1
    assert last not in [each.selection.index for each in handles_of(placed, selection)]
    assert edits.point_moved(sketch, placed, Selection("course", child.id, last), 0.0, 0.0) is sketch


def test_edits_of_missing_objects_change_nothing(placed, sketch):
    river, lake = (LAYERS[name].code << 48 | 7 for name in ("river", "lake"))
    missing = Selection("feature", 7), Selection("course", river), Selection("water", lake)
    for selection, name in zip(missing, ("feature", "river", "lake"), strict=True):
        assert handles_of(placed, selection) == ()
        assert not exists(placed, selection)
        assert name_of(placed, selection) == name
        for command, values in (
            *((partial(edits.with_values, x=0.0, y=0.0), ("move",)), (edits.locked, ())),
            *((partial(edits.with_values, radius=10.0), ("resize",)), (edits.point_moved, (0.0, 0.0))),
            (partial(edits.with_values, strength=10.0), ("strength",)),
        ):
            assert command(sketch, placed, selection, *values) is sketch
        assert edits.width_of(sketch, placed, selection) is None
    assert edits.widened(sketch, Selection("water", 7), 10.0) is sketch
    short = Selection("course", placed.rivers[0].id, 100_000)
    assert not edits.is_edited(sketch, placed, short)
    assert edits.point_moved(sketch, placed, short, 0.0, 0.0) is sketch


@pytest.mark.slow
def test_random_drags_stay_valid():
    sketch = load_sketch("valley_river")
    now = placed_of(sketch)
    rng = np.random.default_rng(8)
    everything = [Selection("feature", int(each)) for each in rng.choice(now.points["id"], 12, replace=False)]
    everything += [Selection("course", each.id) for each in now.rivers]
    touched: set[object] = set()
    for number in range(60):
        selection = everything[rng.integers(len(everything))]
        handles = handles_of(now, selection)
        if not handles:
            continue
        handle = handles[rng.integers(len(handles))]
        spread = 40.0 if handle.role == "point" else 300.0
        x, y = handle.x + rng.normal(0.0, spread), handle.y + rng.normal(0.0, spread)
        sketch = edits.dragged(sketch, now, handle, x, y)
        touched.add((handle.role, handle.selection))
        if rng.random() < 0.2:
            sketch = edits.locked(sketch, now, selection)
        if number % 10 == 9:
            now = placed_of(sketch)
            assert np.isfinite(now.points["strength"]).all()
            assert not [each for each in now.orphans if "river" not in each]
    assert len(sketch.edits) < 2 * len(touched) + len(everything)
    assert len(sketch.edits) <= MAX_EDITS
