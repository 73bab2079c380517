from dataclasses import replace

import numpy as np
import pytest

from sketchterrain.document.edits import Edit
from sketchterrain.document.sketch import Sketch
from sketchterrain.generation.building import make_recipe
from sketchterrain.geometry.hashing import rounded
from sketchterrain.landforms.edits import apply_fill_edits, apply_painted_edits
from sketchterrain.landforms.placement.feature_types import FEATURE_TYPES, FILL_BIT, lock_edit, move_edit
from sketchterrain.landforms.placement.fill import Fill
from sketchterrain.landforms.placement.placement import place
from sketchterrain.stages.runner import Results

SIDE = 128
MEMORY = Results()


def _recipe(sketch):
    """Return a sketch's recipe; what does not depend on the edits is computed once for all tests."""
    return make_recipe(sketch, memory=MEMORY)


def _image(*discs):
    rows, columns = np.ogrid[:SIDE, :SIDE]
    image = np.zeros((SIDE, SIDE), np.uint8)
    for row, column, radius in discs:
        image[(rows - row) ** 2 + (columns - column) ** 2 <= radius**2] = 1
    return image


def _of(points, name):
    found = points[points["id"] == name]
    assert len(found) == 1
    return found[0]


@pytest.fixture(scope="module")
def sketch():
    """Two mountains, a hill, a forest, and a river with a tributary."""
    layers = {
        "mountain": _image((30, 30, 12), (30, 95, 10)),
        "hill": _image((60, 20, 8)),
        "forest": _image((60, 110, 8)),
        "river": _with_a_bow(),
    }
    labels, density = {("forest", 1): {"conifers": 0.3}}, {"dune": 0.5, "forest": 2.0}
    return Sketch(labels=labels, extent=4096.0, seed=3, layers=layers, density=density)


@pytest.fixture(scope="module")
def painted(sketch):
    return place(sketch, seed=sketch.seed)


def test_each_edit_changes_its_feature_alone(painted):
    first, second, third, fourth = (int(name) for name in painted["id"][:4])
    edits = [
        Edit("move", first, x=-50.0, y=9000.0),
        Edit("resize", second, radius=77.0),
        Edit("strength", third, strength=12.0),
        Edit("delete", fourth),
    ]
    points = apply_painted_edits(painted, edits).points
    assert (_of(points, first)["x"], _of(points, first)["y"]) == (-50.0, 9000.0)
    assert _of(points, first)["radius"] == painted["radius"][0]
    assert _of(points, second)["radius"] == 77.0
    assert _of(points, third)["strength"] == 12.0
    assert fourth not in points["id"]
    assert points[3:].tobytes() == painted[4:].tobytes()
    assert (np.diff(points["id"].astype(object)) > 0).all()
    # A forest is never denser than full.
    forest = int(painted[painted["type"] == FEATURE_TYPES.index("forest")]["id"][0])
    points = apply_painted_edits(painted, [Edit("strength", forest, strength=40.0)]).points
    assert _of(points, forest)["strength"] == 1.0
    unedited = apply_painted_edits(painted, ())
    assert unedited.points.tobytes() == painted.tobytes()
    assert unedited.replaced.size == 0
    assert unedited.orphans == ()


def test_added_and_locked_features_have_their_values(painted):
    dune = Edit("add", type="dune", x=5.0, y=6.0, radius=70.0, strength=3.0, wavelength=20.0)
    points = apply_painted_edits(painted, [dune, Edit("move", dune.feature, x=1.0, y=2.0)]).points
    added = _of(points, dune.feature)
    assert FEATURE_TYPES[added["type"]] == "dune"
    assert (added["x"], added["y"], added["wavelength"], added["wind"]) == (1.0, 2.0, 20.0, 270.0)
    assert added["painted"]
    assert points["id"][-1] == dune.feature

    locks = [lock_edit(point) for point in painted]
    assert apply_painted_edits(painted[:0], locks).points.tobytes() == painted.tobytes()
    grove = Edit("add", type="forest", x=5.0, y=6.0, radius=70.0, strength=0.5)
    pines = Edit("add", type="forest", x=5.0, y=6.0, radius=70.0, strength=0.5, conifers=0.75)
    points = apply_painted_edits(painted, [grove, pines]).points
    assert _of(points, grove.feature)["peakiness"] == 0.0
    assert _of(points, pines.feature)["peakiness"] == 1.75


def test_edits_survive_distant_paint_and_are_orphans_without_their_feature(sketch, painted):
    name = int(painted["id"][0])
    edited = sketch.with_edit(Edit("move", name, x=500.0, y=700.0))
    more = edited.replace(layers={**sketch.layers, "hill": _image((60, 20, 8), (120, 120, 6))})
    moved = _of(_recipe(more).points.painted, name)
    assert (moved["x"], moved["y"]) == (500.0, 700.0)
    erased = _recipe(edited.replace(layers={"river": sketch.layers["river"]}))
    assert erased.orphans == (f"move of feature {name}: no such feature",)


def test_a_locked_feature_is_unchanged_whatever_is_painted(sketch, painted):
    mountain = painted[painted["type"] == 0][0]
    lock = lock_edit(mountain)
    assert apply_painted_edits(painted, [lock]).points.tobytes() == painted.tobytes()
    for image in (np.zeros((SIDE, SIDE), np.uint8), _image((34, 34, 20)), _image((110, 110, 10))):
        repainted = sketch.replace(layers={**sketch.layers, "mountain": image})
        found = apply_painted_edits(place(repainted, seed=sketch.seed), [lock])
        assert _of(found.points, int(mountain["id"])).tobytes() == mountain.tobytes()
        assert found.orphans == ()


def test_the_fill_is_edited_and_keeps_clear_of_moved_features(sketch, painted):
    mountain = painted[painted["type"] == 0][0]
    east, north = sketch.size
    moved = _recipe(sketch.with_edit(Edit("move", int(mountain["id"]), x=0.6 * east, y=0.1 * north)))
    fill = moved.points.fill.within(0, 0, east, north)
    dunes = fill[fill["type"] == FEATURE_TYPES.index("dune")]
    distance = np.hypot(dunes["x"] - 0.6 * east, dunes["y"] - 0.1 * north)
    assert len(dunes)
    assert (distance >= 0.8 * (dunes["radius"] + mountain["radius"]) - 0.01).all()

    fill = Fill.from_sketch(sketch, painted, seed=sketch.seed)
    there = fill.within(0, 0, *sketch.size)
    first, second, third = (int(name) for name in there["id"][:3])
    edits = [Edit("delete", first), Edit("move", second, x=10.0, y=10.0)]
    edits += [lock_edit(there[2]), Edit("delete", int(FILL_BIT) + 1)]
    edited = apply_fill_edits(fill, edits, size=sketch.size)
    assert edited.points["id"].tolist() == [second, third]
    assert edited.points[1].tobytes() == there[2].tobytes()
    assert len(edited.orphans) == 1
    rest = replace(fill, replaced=edited.replaced).within(0, 0, *sketch.size)
    assert rest.tobytes() == there[3:].tobytes()


def _rivers(sketch):
    recipe = _recipe(sketch)
    return {river.id: river for river in recipe.rivers if river.label}, recipe.orphans


def test_control_points_of_rivers_are_rounded(sketch):
    recipe = _recipe(sketch)
    ends = {river.centreline[-1, :2].tobytes() for river in recipe.rivers}
    for river in recipe.rivers:
        # Beyond the sketch a river may be cut between two control points.
        cut = river.points[[0, -1], :2]
        cut = cut[((cut < 0) | (cut > recipe.extent)).any(axis=1)]
        left_out = ends | {point.tobytes() for point in cut}
        own = np.array([point for point in river.points[:, :2] if point.tobytes() not in left_out])
        np.testing.assert_array_equal(rounded(own), own)


def _stem_and_tributary(rivers):
    assert len(rivers) == 2
    stem, tributary = sorted(rivers.values(), key=lambda river: -len(river.centreline))
    return stem, tributary


def test_a_tributary_follows_a_moved_river_and_the_water_still_falls(sketch):
    before, _ = _rivers(sketch)
    stem, tributary = _stem_and_tributary(before)
    joint = tributary.points[-1]
    nearest = int(np.argmin(np.hypot(*(stem.points[:, :2] - joint[:2]).T)))
    for index, change, least in ((len(stem.points) // 3, (30.0, 160.0), 0.0), (nearest, (0.0, -150.0), 20.0)):
        x, y = stem.points[index, :2] + change
        after, orphans = _rivers(sketch.with_edit(Edit("move_point", stem.id, index=index, x=x, y=y)))
        assert orphans == ()
        assert set(after) == set(before)
        line, end = after[stem.id].centreline, after[tributary.id].centreline[-1]
        assert np.hypot(line[:, 0] - x, line[:, 1] - y).min() < 1e-6
        assert all((np.diff(river.centreline[:, 2]) <= 1e-9).all() for river in after.values())
        assert np.hypot(*(line[:, :2] - end[:2]).T).min() < 1e-9  # it still ends on the stem
        assert np.hypot(*(end[:2] - joint[:2])) >= least


@pytest.mark.slow
def test_a_control_point_is_found_by_position_in_a_repainted_river(sketch):
    stem, _ = _stem_and_tributary(_rivers(sketch)[0])
    index = 16
    x, y = stem.points[index, 0], stem.points[index, 1] + 150.0
    edited = sketch.with_edit(move_edit(stem, index, x=x, y=y))
    after, orphans = _rivers(edited)
    assert orphans == ()
    plain = _rivers(sketch.with_edit(Edit("move_point", stem.id, index=index, x=x, y=y)))[0]
    np.testing.assert_array_equal(after[stem.id].centreline, plain[stem.id].centreline)
    again = edited.with_edit(move_edit(after[stem.id], index, x=x, y=y + 40.0))
    np.testing.assert_allclose(_rivers(again)[0][stem.id].points[index, :2], (x, y + 40.0))

    # A bow near the spring renumbers later control points; one within the bow is gone.
    bowed, orphans = _rivers(edited.replace(layers={**sketch.layers, "river": _with_a_bow(20, 45)}))
    assert orphans == ()
    found = np.hypot(*(bowed[stem.id].points[:, :2] - [x, y]).T)
    assert found.min() < 1e-6
    assert int(np.argmin(found)) != index
    gone = _rivers(edited.replace(layers={**sketch.layers, "river": _with_a_bow(70, 105)}))[1]
    assert len(gone) == 1
    assert "no control point near" in gone[0]


def _with_a_bow(start=None, stop=None):
    """Paint a river and its tributary, the stem with a bow to the south between two columns."""
    steps = np.arange(110) if start is None else np.linspace(0.0, 110.0, 600)
    bow = 0 if start is None else 22 * np.sin(np.pi * np.clip((steps + 10 - start) / (stop - start), 0, 1))
    stem = np.column_stack([100 - 0.2 * steps + bow, 10.0 + steps, np.full(len(steps), 1.2)])
    return _image(*stem, *[(58.0 + step, 60.0, 1.2) for step in range(34)])


def test_a_river_takes_an_edited_width_and_its_tributary_remains_without_it(sketch):
    stem, tributary = _stem_and_tributary(_rivers(sketch)[0])
    after, _ = _rivers(sketch.with_edit(Edit("width", stem.id, width=60.0)))
    middle = len(stem.points) // 2
    assert after[stem.id].mean_width[middle] > 3 * stem.mean_width[middle]
    np.testing.assert_array_equal(after[stem.id].centreline[:, :2], stem.centreline[:, :2])
    np.testing.assert_array_equal(after[tributary.id].centreline[:, :2], tributary.centreline[:, :2])

    after, orphans = _rivers(sketch.with_edit(Edit("delete", stem.id)))
    assert set(after) == {tributary.id}
    assert orphans == ()
    both = sketch.with_edit(Edit("delete", stem.id)).with_edit(Edit("delete", tributary.id))
    assert _rivers(both) == ({}, ())


def test_edits_without_their_river_or_lake_are_orphans(sketch):
    lost = (4 << 48) + 1
    stem, _ = _stem_and_tributary(_rivers(sketch)[0])
    painted = sketch.replace(layers={**sketch.layers, "lake": _image((110, 20, 6), (110, 60, 6))})
    first, second = (lake.id for lake in _recipe(painted).lakes if lake.label)
    edits = {
        Edit("width", lost, width=5.0): f"width of river {lost}: no such river",
        Edit("delete", lost): f"delete of river {lost}: no such river",
        Edit("width", 7, width=5.0): "width of river 7: no such river",
        Edit("resize", stem.id, radius=5.0): "a river supports only delete, move_point, width",
        Edit("move_point", stem.id, index=99_999, x=0.0, y=0.0): "no control point 99999: the river has "
        f"{len(stem.points)}",
        Edit("resize", second, radius=5.0): f"resize of lake {second}: a lake supports only delete",
    }
    edited = painted.replace(edits=(*edits, Edit("delete", first)))
    recipe = _recipe(edited)
    assert [lake.id for lake in recipe.lakes if lake.label] == [second]
    assert len(recipe.orphans) == len(edits)
    assert all(any(line in orphan for orphan in recipe.orphans) for line in edits.values())
    gone = _recipe(edited.replace(layers=sketch.layers)).orphans
    assert f"delete of lake {first}: no such lake" in gone
