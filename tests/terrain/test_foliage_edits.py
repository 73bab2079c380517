"""An edit changes the plants near it; farther away each keeps its bits."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.spatial import cKDTree

from sketchterrain.sketch import Edit, Sketch
from sketchterrain.terrain import build, rebuild
from sketchterrain.terrain.changes import touches
from sketchterrain.terrain.lattice import metres_per_unit

if TYPE_CHECKING:
    from collections.abc import Callable

    import sketchterrain as st
    from sketchterrain.compute import ComputeContext

    Area = tuple[float, float, float, float]

PIXELS, EXTENT = 64, 4096.0


@pytest.fixture(scope="module")
def before(context: ComputeContext) -> st.Terrain:
    """Three forests, and a river between them."""
    forest, river = np.zeros((2, PIXELS, PIXELS), np.uint8)
    forest[6:24, 6:26] = forest[10:24, 36:56] = forest[42:58, 12:52] = 1
    for column in range(8, 56):
        row = round(32 + 2 * np.sin(column / 6))
        river[row, column] = river[row + 1, column] = 1
    layers = {"forest": forest, "river": river}
    return build(Sketch(extent=EXTENT, seed=9, layers=layers, density={"forest": 0.0}), device=context)


def _repainted(terrain: st.Terrain) -> Sketch:
    """The forest in the north-east has lost its east."""
    layers = {name: layer.copy() for name, layer in terrain.sketch.layers.items()}
    layers["forest"][10:24, 48:56] = 0
    return replace(terrain.sketch, layers=layers)


def _moved(terrain: st.Terrain) -> Sketch:
    """The river takes another way, half a kilometre aside."""
    river = terrain.features.rivers[0]
    x, y = (float(each) for each in river.points[3, :2])
    return replace(terrain.sketch, edits=(Edit("move_point", river.id, index=3, x=x + 60.0, y=y - 500.0),))


def _away(terrains: tuple[st.Terrain, st.Terrain], storey: str, area: Area, plants: np.ndarray) -> np.ndarray:
    """Metres from plants to the nearest vertex at which the spacing or the ground is another one."""
    unit = metres_per_unit(EXTENT)
    wider = (area[0] - MARGIN, area[1] - MARGIN, area[2] + MARGIN, area[3] + MARGIN)
    blocks = [each._foliage._storeys[storey]._spacing for each in terrains]
    one, two = (each.raster(*(round(side / unit) for side in wider)) for each in blocks)
    rows, columns = one.spacing.shape
    x = (one.west + np.arange(columns) * one.step) * unit
    y = (one.south + np.arange(rows) * one.step) * unit
    heights = [each.heights(x[None, :], y[:, None]) for each in terrains]
    row, column = np.nonzero((one.spacing != two.spacing) | (heights[0] != heights[1]))
    assert 0 < row.size < 0.6 * one.spacing.size
    changed = cKDTree(np.stack([x[column], y[row]], axis=-1))
    return np.asarray(changed.query(np.stack([plants["x"], plants["y"]], axis=-1))[0])


AREAS = {
    _repainted: {"woody": (2000.0, 1800.0, 4096.0, 3800.0), "grass": (2900.0, 2400.0, 3200.0, 2700.0)},
    _moved: {"woody": (0.0, 800.0, 2400.0, 3000.0), "grass": (800.0, 1900.0, 1100.0, 2200.0)},
}
"""m: where plants are compared."""
NEAR = {"woody": (300.0, 30.0, 100.0), "grass": (40.0, 4.0, 10.0)}
"""m from the change: none beyond the first is another one, few beyond the others are."""
MARGIN = 400.0  # m around those, in which changes are looked for


def _others(own: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Which plants are not among the others, bit for bit."""
    there = {row.tobytes() for row in others}
    return np.array([row.tobytes() not in there for row in own], dtype=bool)


@pytest.mark.parametrize(
    ("edit", "storey"),
    [
        (_repainted, "woody"),
        pytest.param(_repainted, "grass", marks=pytest.mark.slow),
        pytest.param(_moved, "woody", marks=pytest.mark.slow),
        pytest.param(_moved, "grass", marks=pytest.mark.slow),
    ],
)
def test_an_edit_changes_plants_near_it_alone(
    before: st.Terrain, edit: Callable[[st.Terrain], Sketch], storey: str
) -> None:
    after, areas = rebuild(before, edit(before))
    area = AREAS[edit][storey]
    plants = [each.foliage(*area, storey=storey) for each in (before, after)]
    changed = np.concatenate([_others(*plants), _others(*plants[::-1])])
    both = np.concatenate(plants)
    away = _away((before, after), storey, area, both)
    assert changed.sum() > 100
    near, half, tenth = NEAR[storey]
    assert not changed[away > near].any()
    assert (away > near).sum() > 1000
    assert changed[(away > half) & (away <= near)].mean() < 0.1
    assert changed[(away > tenth) & (away <= near)].mean() < 0.02
    # What may be another one at all, heights and masks included, is known beforehand: nothing else is, here.
    outside = [
        not touches(areas, (x, y, x, y), margin=near) for x, y in zip(both["x"], both["y"], strict=True)
    ]
    assert not changed[np.array(outside)].any()
