from __future__ import annotations

import numpy as np

from sketchterrain.features.catalogue import River
from sketchterrain.features.contradictions import Resolution, crossings, mountain_numbers, resolutions
from sketchterrain.sketch.document import Sketch

SIZE = 40
X = np.arange(0.0, 400.0, 5.0)


def sketch(*columns: tuple[int, int]) -> Sketch:
    """Mountains from top to bottom between columns of 10 m."""
    layer = np.zeros((SIZE, SIZE), np.uint8)
    for first, end in columns:
        layer[:, first:end] = 1
    return Sketch(extent=10.0 * SIZE, layers={"mountain": layer})


def river(x: np.ndarray = X) -> River:
    line = np.column_stack([x, np.full(len(x), 200.0), 10 - 0.01 * x])
    ones = np.ones(len(x), np.float32)
    return River(1, 1, line[::10], ones[::10], ones[::10], line, ones, ones)


def told(plan: Sketch, line: np.ndarray = X, ground: float = 60.0) -> tuple[str, ...]:
    return tuple(each.line for each in resolved(plan, line, ground))


def resolved(plan: Sketch, line: np.ndarray = X, ground: float = 60.0) -> tuple[Resolution, ...]:
    return resolutions(plan, mountain_numbers(plan), [river(line)], [np.full(len(line), ground)], [])


def test_mountains_are_numbered_in_reading_order() -> None:
    numbers = mountain_numbers(sketch((5, 10), (20, 30)))
    assert numbers[0, [0, 5, 9, 10, 20, 29, 30]].tolist() == [0, 1, 1, 0, 2, 2, 0]


def test_crossings_are_the_runs_inside() -> None:
    plan = sketch((5, 10), (20, 30))
    found = crossings(plan, mountain_numbers(plan), river().centreline)
    assert [(run.first, run.last, run.mountain) for run in found] == [(10, 19, 1), (40, 59, 2)]
    outside = river().centreline + np.array([0.0, 900.0, 0.0])
    assert crossings(plan, mountain_numbers(plan), outside) == []


def test_a_river_crosses_springs_or_ends_in_a_mountain() -> None:
    assert told(sketch((10, 20))) == ("river 1 crosses mountain 1: valley cut 52 m",)
    assert told(sketch((0, 10))) == ("river 1 begins in mountain 1: springs there at 10 m",)
    assert told(sketch((30, 40))) == ("river 1 ends in mountain 1: valley cut 54 m",)
    assert told(sketch()) == ()
    # Above the ground it cuts nothing.
    assert told(sketch((10, 20)), ground=-5.0) == ("river 1 crosses mountain 1: valley cut 0 m",)


def test_resolutions_have_positions() -> None:
    (crosses,) = resolved(sketch((10, 20)))
    assert (crosses.x, crosses.y) == (145.0, 200.0)
    (begins,) = resolved(sketch((0, 10)))
    assert (begins.x, begins.y) == (X[0], 200.0)
    (ends,) = resolved(sketch((30, 40)))
    assert (ends.x, ends.y) == (X[-1], 200.0)
    (all_of_it,) = resolved(sketch((0, 40)))
    assert all_of_it.x == X[(len(X) - 1) // 2]
