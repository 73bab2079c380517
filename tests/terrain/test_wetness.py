"""Wetness spreads over level ground, the same at each level; its oracle is in `tests/host`."""

import numpy as np

from sketchterrain.document.store import load_sketch
from sketchterrain.landforms.relief_fields import UnpaintedSettings
from sketchterrain.landforms.unpainted import unpainted_ground
from sketchterrain.landforms.wetness import wetness
from sketchterrain.terrain.layers.relief import ReliefLayer
from tests import terrains

CELL = 20.0


def channel(slope: float, *, side: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return heights and areas of a channel northward of 4,096 nodes, between sides of a slope."""
    row, column = np.mgrid[0:31, -15:16].astype(np.float64)
    area = np.where(column == 0, 4096.0, 1.0) * CELL * CELL
    return CELL * (slope * row + side * np.abs(column)), area


def test_steep_channels_and_valleys_are_drier() -> None:
    slopes = ((0.02, 0.0), (0.02, 0.1), (0.02, 0.5), (0.5, 0.5))
    across = [wetness(*channel(along, side=side), CELL, CELL)[15] for along, side in slopes]
    level, gentle, steep, torrent = across
    assert level[15] == 1.0
    for wide, narrow in ((level, gentle), (gentle, steep)):
        assert (narrow <= wide).all()
        assert narrow.sum() < 0.8 * wide.sum()
    assert torrent[15] < steep[15] == 1.0
    for each in across:
        assert (np.diff(each[15:]) <= 0).all()
        np.testing.assert_array_equal(each, each[::-1])
    assert steep[17] == 0.0
    assert level[20] > 0.5


def test_levels_of_unpainted_ground_are_as_wet() -> None:
    sketch = load_sketch("rolling_hills")
    level = sketch.replace(ground={**sketch.ground, "surroundings": 0.0})  # no ranges
    ground = unpainted_ground(UnpaintedSettings.from_sketch(level))
    means = [float(ground.window(k, *[1024 >> k] * 2, *[256 >> k] * 2).wetness.mean()) for k in range(6)]
    assert min(means) > 0.1
    assert max(means) < 1.8 * means[0]
    window = ground.window(0, 1024, 1024, 128, 128)
    channels = window.area > 500 * ground.settings.spacing**2
    assert np.median(window.wetness[channels]) > 0.7
    assert np.median(window.wetness) < 0.2


def test_painted_rivers_are_wet_and_mountains_dry() -> None:
    recipe = terrains.preset("valley_river").recipe
    nodes = recipe[ReliefLayer].painted.levels[0]
    spacing = recipe.extent / 256
    line = np.concatenate([river.centreline[:, :2] for river in recipe.rivers])
    column, row = (np.rint(line / spacing).astype(int) - (nodes.column, nodes.row)).T
    inside = (line > 0).all(axis=1) & (line < recipe.extent).all(axis=1)
    assert np.median(nodes.wetness[row[inside], column[inside]]) > 180
    assert nodes.wetness[nodes.rock > 200].mean() < 40
