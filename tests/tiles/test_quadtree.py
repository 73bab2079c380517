from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.tiles.quadtree import TileKey, inside_frustum, select_tiles

EYES = [(100.0, 100.0), (4096.0, 2048.0), (-7000.3, 12.5), (1e8 + 0.7, -3e7)]


def owners(keys, extent, points):
    """How many of the tiles cover each point, half-open to the east and north."""
    count = np.zeros(len(points), dtype=int)
    for level, col, row in keys:
        width = extent * 2.0**-level
        place = np.floor(points / width)
        count += (place[:, 0] == col) & (place[:, 1] == row)
    return count


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("split", [0.3, 0.7, 1.5])
def test_every_point_within_reach_lies_in_exactly_one_tile(eye, split):
    keys = select_tiles(eye, 4096.0, draw_distance=9000.0, split=split, finest=8)
    rng = np.random.default_rng(1)
    bearing = rng.uniform(0, 2 * np.pi, 2000)
    reach = 9000.0 * rng.uniform(0, 1, 2000) ** 2
    points = np.asarray(eye) + np.stack([np.cos(bearing), np.sin(bearing)], axis=1) * reach[:, None]
    assert (owners(keys, 4096.0, points) == 1).all()


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("clearance", [0.0, 35.0])
def test_neighbours_differ_by_one_level_at_most(eye, clearance):
    keys = select_tiles(eye, 4096.0, draw_distance=20000.0, split=0.7, clearance=clearance, finest=9)
    # The tile that lies just across the middle of each edge is as fine as this one, one coarser, or finer.
    centres = np.array([((k.col + 0.5), (k.row + 0.5)) for k in keys]) * np.array(
        [[4096.0 * 2.0**-k.level] for k in keys]
    )
    lookup = {key: key.level for key in keys}
    for key, centre in zip(keys, centres, strict=True):
        width = 4096.0 * 2.0**-key.level
        for step in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            across = centre + np.asarray(step) * width * 0.5000001
            for other in range(key.level, -13, -1):
                w = 4096.0 * 2.0**-other
                found = lookup.get(TileKey(other, int(across[0] // w), int(across[1] // w)))
                if found is not None:
                    assert key.level - found <= 1
                    break


def test_tiles_shrink_towards_the_eye():
    keys = select_tiles((1000.0, 1000.0), 4096.0, draw_distance=30000.0, split=0.5)
    assert [key.level for key in keys][:1] == [14]
    levels = np.array([key.level for key in keys])
    assert levels[:20].mean() > levels[-20:].mean() + 8


def test_clearance_limits_the_finest_level():
    keys = select_tiles((0.0, 0.0), 4096.0, draw_distance=5000.0, split=0.5, clearance=100.0)
    assert min(4096.0 * 2.0**-key.level for key in keys) > 0.5 * 0.5 * 100.0


def test_frustum_leaves_out_what_is_behind_and_keeps_what_is_ahead():
    ahead = np.array([[1.0, 0.0, 0.0, 0.0]])  # x ≥ 0
    everything = set(select_tiles((0.0, 0.0), 4096.0, draw_distance=6000.0))
    seen = set(select_tiles((0.0, 0.0), 4096.0, draw_distance=6000.0, frustum=ahead))
    assert seen < everything
    assert all((key.col + 1) * 2.0**-key.level >= 0 for key in seen)
    assert {key for key in everything if key.col >= 0} <= seen


def test_height_range_culls_ground_below_the_view():
    above = np.array([[0.0, 0.0, 1.0, -500.0]])  # z ≥ 500

    def flat(west, south, east, north):
        return np.zeros(len(west)), np.full(len(west), 400.0)

    assert select_tiles((0.0, 0.0), 4096.0, draw_distance=6000.0, frustum=above, height_range=flat) == []


def test_boxes_that_touch_the_frustum_are_inside():
    planes = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 10.0]])
    low = np.array([[-2.0, 0.0, 0.0], [-2.0, 0.0, 0.0], [1.0, 0.0, 11.0]])
    high = np.array([[-1.0, 1.0, 1.0], [1.0, 1.0, 1.0], [2.0, 1.0, 12.0]])
    assert inside_frustum(planes, low, high).tolist() == [False, True, False]


def test_nearest_first_and_no_tile_twice():
    keys = select_tiles((123.0, 456.0), 1000.0, draw_distance=8000.0)
    assert len(set(keys)) == len(keys)
    width = np.array([1000.0 * 2.0**-k.level for k in keys])
    low = np.array([[k.col, k.row] for k in keys]) * width[:, None]
    gap = np.maximum(np.maximum(low - [123.0, 456.0], [123.0, 456.0] - (low + width[:, None])), 0)
    assert (np.diff(np.hypot(*gap.T)) >= 0).all()


@pytest.mark.parametrize("bad", [{"draw_distance": 0.0}, {"draw_distance": 10.0, "split": 0.0}])
def test_wrong_numbers_are_refused(bad):
    with pytest.raises(InputError, match="expected"):
        select_tiles((0.0, 0.0), 4096.0, **bad)
