"""Cells of plants, their shadow maps and the forest that is drawn from them."""

from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.look.trees import DETAILS
from sketchterrain.render import Camera, Quality, Sun
from sketchterrain.render.allowance import Allowance
from sketchterrain.render.forest import BAND, GROW, PIXELS, Forest, shares
from sketchterrain.render.lit_ground import LitGround
from sketchterrain.render.plant_cells import CELL, KEPT, PlantCells, cells_near, joined
from sketchterrain.render.plant_meshes import KINDS, PlantMeshes
from sketchterrain.render.plant_shade import PlantShade, shade_matrix, sun_axes
from sketchterrain.render.plant_stand import SINK
from sketchterrain.terrain.plant import PLANT

SUN = Sun(200.0, 35.0)
SIZE = (640, 360)
CAMERA = Camera((500.0, 60.0, 120.0), (500.0, 700.0, 60.0))


class Meadow:
    """Hashed plants all over the world."""

    extent = 2000.0

    def __init__(self):
        self.asked = []

    def heights(self, x, y, *, cell_size=0.0):
        x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        return (0.02 * x - 0.01 * y).astype(np.float32)

    def foliage(self, west, south, east, north):
        self.asked.append((west, south, east, north))
        col = np.arange(np.ceil(west / 16), np.ceil(east / 16))
        row = np.arange(np.ceil(south / 16), np.ceil(north / 16))
        i, j = np.meshgrid(col, row)
        plants = np.zeros(i.size, PLANT)
        plants["x"], plants["y"] = 16.0 * i.ravel(), 16.0 * j.ravel()
        plants["z"] = self.heights(plants["x"], plants["y"])
        plants["scale"] = 0.8
        plants["species"] = (i + 2 * j).ravel().astype(np.int64) % 5
        return plants

    def foliage_steps(self, west, south, east, north):
        for _ in range(3):
            yield
        return self.foliage(west, south, east, north)


def in_order(stand):
    rows = np.column_stack(stand)
    return rows[np.lexsort((rows[:, 0], rows[:, 1]))]


def test_plants_of_cells_are_those_of_the_terrain():
    meadow = Meadow()
    cells, whole = PlantCells(meadow), PlantCells(meadow)
    places = [(col, row) for col in range(-2, 2) for row in range(3)]
    cells.want(places)
    while not cells.complete:
        cells.go_on(Allowance(1.0))
    whole.want(places)
    whole.finish()
    assert len(meadow.asked) == len(places) + 1
    stands = []
    for each in (cells, whole):
        found = [each[place] for place in places]
        stands.append(in_order(joined(found, np.zeros(2))))
    assert (stands[0] == stands[1]).all()
    assert len(stands[0]) == len(places) * (CELL / 16) ** 2

    cells = PlantCells(Meadow())
    cells.want([(3, -2)])
    cells.finish()
    cell = cells[3, -2]
    place = cell.stand.place.astype(float)
    x, y = (place[:, :2] + cell.corner).T
    assert np.abs(place[:, 2] - (0.02 * x - 0.01 * y - SINK)).max() < 1e-4
    assert cell.low <= place[:, 2].min()
    assert cell.high >= (cell.stand.place[:, 2] + cell.stand.tall).max()


def test_nearest_cells_come_first_and_none_is_left_out():
    rng = np.random.default_rng(3)
    for x, y in rng.uniform(-5000, 5000, (20, 2)):
        near = cells_near(x, y, 1300.0)
        away = rng.uniform(-1.0, 1.0, (500, 2)) * 1300.0
        away = away[np.hypot(*away.T) < 1300.0]
        inside = {tuple(each) for each in np.floor((away + np.array([x, y])) / CELL).astype(int).tolist()}
        assert inside <= set(near)
        assert near[0] == (np.floor(x / CELL), np.floor(y / CELL))


def test_cells_are_made_in_steps_and_dropped_when_long_unused():
    meadow = Meadow()
    cells = PlantCells(meadow)
    cells.want([(0, 0)])
    now = [0.0]

    def timer():
        now[0] += 0.0012
        return now[0]

    frames = 0
    while not cells.complete:
        cells.go_on(Allowance(0.008, timer=timer))
        frames += 1
    assert frames > 1
    for col in range(KEPT + 20):
        cells.want([(col, 5)])
        cells.finish()
    assert cells[0, 0] is None
    assert cells[KEPT + 19, 5] is not None


def test_levels_of_detail_of_a_plant_fade_into_each_other():
    steps = np.array(PIXELS)
    pixels = np.geomspace(1.0, 400.0, 4001)
    whim = np.full(len(pixels), 0.3)
    drawn = shares(pixels, whim, steps)
    assert np.allclose(drawn.sum(axis=1), 1.0)
    assert ((drawn > 0).sum(axis=1) <= 2).all()
    assert (drawn[-1] == np.eye(DETAILS)[0]).all()
    assert (drawn[0] == np.eye(DETAILS)[-1]).all()
    step = np.log(pixels[1] / pixels[0])
    assert np.abs(np.diff(drawn, axis=0)).max() <= 1.2 * step / (2 * BAND)
    # Plants do not all change at once.
    finest = [shares(pixels, np.full(len(pixels), w), steps)[:, 0] > 0.5 for w in (0.0, 1.0)]
    changes = [pixels[np.argmax(each)] for each in finest]
    assert changes[1] / changes[0] > 1.2


def test_commands_draw_each_instance_once(gl):
    meshes = PlantMeshes(gl)
    counts = np.random.default_rng(1).integers(0, 5, (KINDS, DETAILS))
    total = int(counts.sum())
    whole = meshes.commands(counts, 0, total)
    assert whole[:, 1].sum() == total
    parts = np.concatenate([meshes.commands(counts, k, min(k + 3, total)) for k in range(0, total, 3)])
    assert parts[:, 1].sum() == total
    assert (np.diff(parts[:, 3].astype(int)) > 0).all()
    ends = (meshes.first + meshes.vertices).ravel()
    assert (meshes.first.ravel()[1:] == ends[:-1]).all()


def test_sun_axes_are_a_right_handed_frame():
    axes = sun_axes(SUN)
    assert np.allclose(axes @ axes.T, np.eye(3))
    assert np.allclose(np.cross(axes[0], axes[1]), axes[2])
    corner = shade_matrix(SUN, np.zeros(3), 50.0, 400.0) @ [*(axes[0] * 50.0 + axes[1] * 50.0), 1.0]
    assert np.allclose(corner[:2], 1.0)


@pytest.mark.gl
@pytest.mark.parametrize("allowance", [pytest.param(0.002, marks=pytest.mark.slow), 1.0])
def test_shadows_drawn_in_slices_are_those_drawn_at_once(gl, allowance):
    meadow = Meadow()
    lit = LitGround(gl, meadow, SUN, texels=64)
    lit.settle(CAMERA)
    quality = Quality(shade_texels=256)
    drawn = []
    for sliced in (False, True):
        cells, meshes = PlantCells(meadow), PlantMeshes(gl)
        shade = PlantShade(gl, meshes, cells, SUN, quality=quality, reach=400.0)
        cells.want(shade.places(CAMERA, lit))
        cells.finish()
        if sliced:
            frames = 0
            while not shade.settled:
                shade.go_on(CAMERA.eye, 0.05, Allowance(allowance))
                frames += 1
                assert frames < 3000
        else:
            shade.finish(CAMERA.eye)
        drawn.append([shade.textures[name].read() for name in ("shade_near", "shade_far")])
        assert shade.shown_share == (1.0, 1.0)
        assert np.frombuffer(drawn[-1][1], np.float32).min() < 1.0
    assert drawn[0] == drawn[1]


@pytest.mark.gl
def test_shadow_maps_keep_their_grid_while_the_eye_moves(gl):
    meadow = Meadow()
    lit = LitGround(gl, meadow, SUN, texels=64)
    cells = PlantCells(meadow)
    shade = PlantShade(gl, PlantMeshes(gl), cells, SUN, quality=Quality(shade_texels=256), reach=400.0)
    point = np.array([510.0, 150.0, 8.0])
    places = []
    for dx in (0.0, 3.0, 60.0, 200.0):
        camera = Camera((500.0 + dx, 60.0, 120.0), (500.0 + dx, 700.0, 60.0))
        lit.settle(camera)
        cells.want(shade.places(camera, lit))
        cells.finish()
        shade.finish(camera.eye)
        matrix = shade.matrices(camera.eye)[1]
        places.append((matrix @ [*(point - camera.eye), 1.0])[:2] * 128)
    steps = np.diff(places, axis=0)
    assert np.abs(steps - np.round(steps)).max() < 1e-3


@pytest.mark.gl
def test_plants_grow_in_and_the_forest_settles(gl):
    meadow = Meadow()
    lit = LitGround(gl, meadow, SUN, texels=64)
    lit.settle(CAMERA)
    quality = Quality.of(0.5)
    forest = Forest(gl, meadow, SUN, quality=quality, defines={})
    triangles, shown = [], []
    frames = 0
    while not forest.settled:
        forest.update(CAMERA, SIZE, lit, 0.05, Allowance(0.02))
        forest._choose(CAMERA, SIZE)
        triangles.append(forest.triangles)
        shown.append(forest.count)
        frames += 1
        assert frames < 400
    assert triangles[0] == 0
    assert shown[-1] > 100
    settled = Forest(gl, meadow, SUN, quality=quality, defines={})
    settled.settle(CAMERA, SIZE, lit)
    assert settled.count == shown[-1]
    assert settled.settled
    assert 0.05 * frames >= GROW
