"""The relief beneath the paint: what the terrain is, of one version, only what changed anew."""

from __future__ import annotations

import numpy as np

from sketchterrain.sketch import Sketch
from sketchterrain.ui.engine.relief import LARGEST, ReliefMaker, hill_shade

EVERYWHERE = (-np.inf, -np.inf, np.inf, np.inf)


class Ground:
    """A plane with a bump, that counts what it is asked."""

    def __init__(self, shape=(60, 90), bump=0.0):
        self.sketch = Sketch(extent=900.0, layers={"hill": np.zeros(shape, np.uint8)})
        self.bump = bump
        self.asked = 0

    def heights(self, x, y, *, cell_size=0.0):
        x, y = np.broadcast_arrays(x, y)
        self.asked += x.size
        inside = (np.abs(x - 300.0) < 50.0) & (np.abs(y - 200.0) < 50.0)
        return (0.1 * x + 0.2 * y + self.bump * inside).astype(np.float32)


BUMP = (250.0, 150.0, 350.0, 250.0)


def finish(maker):
    while maker.busy:
        made = maker.work(0.001)
    return made


def expected(ground):
    rows, columns = ground.sketch.height_px, ground.sketch.width_px
    size = ground.sketch.pixel_size
    x = (np.arange(columns) + 0.5) * size
    y = (rows - np.arange(rows) - 0.5) * size
    return ground.heights(x[None], y[:, None])


def test_heights_stand_at_pixel_centres_and_another_size_restarts() -> None:
    maker, ground = ReliefMaker(), Ground()
    maker.follow(ground, 3, [EVERYWHERE])
    made = finish(maker)
    assert (made.version, made.step) == (3, 1)
    assert np.array_equal(made.height, expected(ground))
    assert made.shade.shape == made.height.shape
    assert not maker.busy

    maker = ReliefMaker()
    maker.follow(Ground(), 1, [EVERYWHERE])
    maker.work(0.0)
    other = Ground(shape=(30, 40))
    maker.follow(other, 2, [EVERYWHERE])
    made = finish(maker)
    assert np.array_equal(made.height, expected(other))


def test_a_version_that_differs_nowhere_is_taken_over_while_one_is_made():
    maker, ground = ReliefMaker(), Ground()
    maker.follow(ground, 3, [EVERYWHERE])
    maker.work(0.0)
    asked = ground.asked
    maker.follow(ground, 4, [])
    assert finish(maker).version == 4
    assert ground.asked < asked + ground.sketch.width_px * ground.sketch.height_px
    maker.follow(ground, 5, [])
    assert not maker.busy


def test_only_what_changed_is_asked_again_and_the_shading_is_that_of_the_whole():
    maker = ReliefMaker()
    maker.follow(Ground(), 1, [EVERYWHERE])
    first = finish(maker)
    bumped = Ground(bump=40.0)
    maker.follow(bumped, 2, [BUMP])
    second = finish(maker)
    assert bumped.asked < 0.2 * first.height.size
    assert np.array_equal(second.height, expected(Ground(bump=40.0)))
    assert np.array_equal(second.shade, hill_shade(second.height, 10.0))
    assert np.array_equal(first.height, expected(Ground()))  # what was handed out stays


def test_each_relief_is_of_one_version_even_if_others_come_meanwhile():
    maker = ReliefMaker()
    grounds = [Ground(bump=10.0 * number) for number in range(6)]
    maker.follow(grounds[0], 0, [EVERYWHERE])
    made = []
    for number in range(1, 6):
        made.append(maker.work(0.0))
        maker.follow(grounds[number], number, [BUMP])
    while maker.busy:
        made.append(maker.work(0.0))
    made = [each for each in made if each is not None]
    assert [each.version for each in made] == sorted(each.version for each in made)
    assert made[-1].version == 5
    for each in made:
        assert np.array_equal(each.height, expected(grounds[each.version]))


def test_large_sketches_are_sampled_less_often_and_one_row_is_a_relief() -> None:
    for shape, step in [((1024, 10), 1), ((10, 1025), 2), ((4096, 2048), 4)]:
        maker = ReliefMaker()
        maker.follow(Ground(shape=shape), 1, [EVERYWHERE])
        made = finish(maker)
        assert made.step == step, (shape, step)
        assert max(made.height.shape) <= LARGEST, (shape, step)
        assert made.height.shape == tuple(-(-side // step) for side in shape), (shape, step)

    maker = ReliefMaker()
    maker.follow(Ground(shape=(1, 8)), 1, [EVERYWHERE])
    assert finish(maker).shade.shape == (1, 8)


def test_light_comes_from_the_north_west():
    level = np.zeros((5, 5), np.float32)
    down, across = np.mgrid[:5, :5].astype(np.float32)
    plain = int(hill_shade(level, 1.0)[2, 2])
    to_light = int(hill_shade(down + across, 1.0)[2, 2])  # rises to the south-east: faces the light
    away = int(hill_shade(-down - across, 1.0)[2, 2])
    assert away < plain < to_light
