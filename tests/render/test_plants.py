"""Plants that are drawn: cells, levels of detail, density with distance."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sketchterrain.geometry.camera import Camera
from sketchterrain.look.tree_levels import DETAILS
from sketchterrain.render.forest import BAND, GROW, PIXELS, Forest, detail_shares
from sketchterrain.render.lit_ground import GroundLighting
from sketchterrain.render.plant_cells import (
    CELL,
    MAX_CELLS,
    SINK,
    PlantCells,
    cells_near,
    join_cells,
    plant_instances,
)
from sketchterrain.render.plant_cells import CELL as STAND_CELL
from sketchterrain.render.plant_meshes import (
    FILL,
    SOFT,
    WIDEST,
    PlantDensity,
    PlantMeshes,
    cull_distance,
    plant_importance,
    removal_rank,
    visible_share,
    width_scale,
)
from sketchterrain.render.plant_shade import PlantShadows
from sketchterrain.render.quality import Quality, TimeBudget
from sketchterrain.render.sky import Sun
from sketchterrain.render.textures import material_macros
from sketchterrain.schema.materials import BUILT_IN
from sketchterrain.vegetation.plants import PLANT

SUN = Sun(200.0, 35.0)
SIZE = (640, 360)
CAMERA = Camera((500.0, 60.0, 120.0), (500.0, 700.0, 60.0))


class Lattice:
    """Plants on a lattice of which every second row and column is a level up, on a slope, without an end."""

    sea_level = None
    context = None

    def __init__(self, *, extent=2000.0, spacing=16.0, slope=(0.02, -0.01), scale=0.8, species=5, levels=1):
        self.extent, self.spacing, self.slope = extent, spacing, slope
        self.scale, self.species, self.levels = scale, species, levels
        self.queries = []

    def heights(self, x, y, *, cell_size=0.0):
        x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        return (self.slope[0] * x + self.slope[1] * y).astype(np.float32)

    def foliage(self, west, south, east, north):
        self.queries.append((west, south, east, north))
        col, row = (
            np.arange(np.ceil(low / self.spacing), np.ceil(high / self.spacing)).astype(np.int64)
            for low, high in ((west, east), (south, north))
        )
        i, j = (each.ravel() for each in np.meshgrid(col, row))
        plants = np.zeros(i.size, PLANT)
        plants["x"], plants["y"] = self.spacing * i + 0.3, self.spacing * j + 0.3
        plants["z"] = self.heights(plants["x"], plants["y"])
        plants["scale"], plants["species"] = self.scale, (i + 2 * j) % self.species
        for level in range(1, self.levels):
            plants["level"] += ((i % 2**level == 0) & (j % 2**level == 0)).astype(np.uint8)
        return plants

    def foliage_steps(self, west, south, east, north):
        for _ in range(3):
            yield
        return self.foliage(west, south, east, north)


def taiga():
    return Lattice(extent=6000.0, spacing=SPACING, slope=(0.0, 0.0), scale=1.0, species=1, levels=5)


def in_order(instances):
    rows = np.column_stack(instances)
    return rows[np.lexsort((rows[:, 0], rows[:, 1]))]


def test_cells_contain_the_terrains_plants():
    meadow = Lattice()
    cells, whole = PlantCells(meadow), PlantCells(meadow)
    places = [(col, row) for col in range(-2, 2) for row in range(3)]
    cells.request(places)
    while not cells.complete:
        cells.advance(TimeBudget(1.0))
    whole.request(places)
    whole.advance(block=8)
    assert len(meadow.queries) == len(places) + 2  # blocks
    instances = []
    for each in (cells, whole):
        found = [each[place] for place in places]
        instances.append(in_order(join_cells(found, np.zeros(2))))
    assert (instances[0] == instances[1]).all()
    assert len(instances[0]) == len(places) * (CELL / 16) ** 2

    cells.request([(3, -2)])
    cells.advance()
    cell = cells[3, -2]
    place = cell.instances.position.astype(float)
    x, y = (place[:, :2] + cell.corner).T
    assert np.abs(place[:, 2] - (0.02 * x - 0.01 * y - SINK)).max() < 1e-4
    assert cell.low <= place[:, 2].min()
    assert cell.high >= (cell.instances.position[:, 2] + cell.instances.height).max()


def test_cells_near_are_complete_and_sorted():
    rng = np.random.default_rng(3)
    for x, y in rng.uniform(-5000, 5000, (20, 2)):
        near = cells_near(x, y, 1300.0)
        away = rng.uniform(-1.0, 1.0, (500, 2)) * 1300.0
        away = away[np.hypot(*away.T) < 1300.0]
        inside = {tuple(each) for each in np.floor((away + np.array([x, y])) / CELL).astype(int).tolist()}
        assert inside <= set(near)
        assert near[0] == (np.floor(x / CELL), np.floor(y / CELL))


def test_cells_are_generated_in_steps_and_evicted():
    meadow = Lattice()
    cells = PlantCells(meadow)
    cells.request([(0, 0)])
    now = [0.0]

    def timer():
        now[0] += 0.0012
        return now[0]

    frames = 0
    while not cells.complete:
        cells.advance(TimeBudget(0.008, timer=timer))
        frames += 1
    assert frames > 1
    for col in range(MAX_CELLS + 20):
        cells.request([(col, 5)])
        cells.advance()
    assert cells[0, 0] is None
    assert cells[MAX_CELLS + 19, 5] is not None


def test_details_cross_fade():
    steps = np.array(PIXELS)
    pixels = np.geomspace(1.0, 400.0, 4001)
    rank = np.full(len(pixels), 0.3)
    drawn = detail_shares(pixels, rank, steps)
    assert np.allclose(drawn.sum(axis=1), 1.0)
    assert ((drawn > 0).sum(axis=1) <= 2).all()
    assert (drawn[-1] == np.eye(DETAILS)[0]).all()
    assert (drawn[0] == np.eye(DETAILS)[-1]).all()
    step = np.log(pixels[1] / pixels[0])
    assert np.abs(np.diff(drawn, axis=0)).max() <= 1.2 * step / (2 * BAND)
    # Plants do not all change at once.
    finest = [detail_shares(pixels, np.full(len(pixels), w), steps)[:, 0] > 0.5 for w in (0.0, 1.0)]
    changes = [pixels[np.argmax(each)] for each in finest]
    assert changes[1] / changes[0] > 1.2


@pytest.mark.gl
@pytest.mark.parametrize("allowance", [pytest.param(0.002, marks=pytest.mark.slow), 1.0])
def test_sliced_shadow_maps_are_bit_equal(gl, allowance):
    meadow = Lattice()
    lit = GroundLighting(gl, meadow, SUN, texels=64)
    lit.converge(CAMERA)
    quality = Quality(shade_texels=256)
    drawn = []
    for sliced in (False, True):
        cells, meshes = PlantCells(meadow), PlantMeshes(gl)
        shade = PlantShadows(gl, meshes, cells, SUN, quality=quality, draw_distance=400.0)
        cells.request(shade.request(CAMERA, lit))
        cells.advance()
        if sliced:
            frames = 0
            while not shade.converged:
                shade.advance(CAMERA.eye, 0.05, TimeBudget(allowance))
                frames += 1
                assert frames < 3000
        else:
            shade.advance(CAMERA.eye, np.inf)
        drawn.append([shade.textures[name].read() for name in ("shade_near", "shade_far")])
        assert shade.fade_shares == (1.0, 1.0)
        assert np.frombuffer(drawn[-1][1], np.float32).min() < 1.0
    assert drawn[0] == drawn[1]


@pytest.mark.gl
def test_shadow_maps_stay_on_their_texel_grid(gl):
    meadow = Lattice()
    lit = GroundLighting(gl, meadow, SUN, texels=64)
    cells = PlantCells(meadow)
    shade = PlantShadows(
        gl, PlantMeshes(gl), cells, SUN, quality=Quality(shade_texels=256), draw_distance=400.0
    )
    point = np.array([510.0, 150.0, 8.0])
    places = []
    for dx in (0.0, 3.0, 60.0, 200.0):
        camera = Camera((500.0 + dx, 60.0, 120.0), (500.0 + dx, 700.0, 60.0))
        lit.converge(camera)
        cells.request(shade.request(camera, lit))
        cells.advance()
        shade.advance(camera.eye, np.inf)
        matrix = shade.matrices(camera.eye)[1]
        places.append((matrix @ [*(point - camera.eye), 1.0])[:2] * 128)
    steps = np.diff(places, axis=0)
    assert np.abs(steps - np.round(steps)).max() < 1e-3


@pytest.mark.gl
def test_plants_fade_in_and_the_forest_settles(gl):
    meadow = Lattice()
    lit = GroundLighting(gl, meadow, SUN, texels=64)
    lit.converge(CAMERA)
    quality = Quality.from_level(0.5)
    forest = Forest(gl, meadow, SUN, quality=quality, defines=material_macros(BUILT_IN))
    triangles, counts = [], []
    frames = 0
    while not forest.converged:
        forest.update(CAMERA, SIZE, lit, 0.05, TimeBudget(0.02))
        forest._select(CAMERA, SIZE)
        triangles.append(forest.triangles)
        counts.append(sum(batch.count for batch in forest._batches))
        frames += 1
        assert frames < 400
    assert triangles[0] == 0
    assert counts[-1] > 100
    converged = Forest(gl, meadow, SUN, quality=quality, defines=material_macros(BUILT_IN))
    assert converged.refine(CAMERA, SIZE, lit)
    assert sum(batch.count for batch in converged._batches) == counts[-1]
    assert converged.converged
    assert 0.05 * frames >= GROW


FRAME = (320, 180)
EYE = (3000.0, 300.0, 160.0)
THIN_CAMERA = Camera(EYE, (3000.0, 1700.0, -200.0), fov=60.0)
SPACING = 5.0


def drawn(forest):
    """Feet (m in the world), widths and shares of the last selection, each plant once."""
    rows = [
        np.frombuffer(batch._instances.read(), np.float32).reshape(-1, 8)[: batch.count]
        for batch in forest._batches
    ]
    rows = np.concatenate(rows).astype(float)
    place = np.round((rows[:, :2] + forest._origin) / SPACING).astype(np.int64)
    code, first, back = np.unique(place @ [1, 1 << 32], return_index=True, return_inverse=True)
    share = np.bincount(back.ravel(), rows[:, 7])
    return code, place[first] * SPACING, np.hypot(rows[first, 4], rows[first, 5]), share


def test_removal_ranks_are_uniform_and_cells_sorted_by_cull_distance():
    rng = np.random.default_rng(1)
    random = rng.uniform(0.0, 1.0, 400_000)
    level = np.floor(-np.log(rng.uniform(0.0, 1.0, random.size)) / np.log(4.0)).astype(np.uint8)
    rank = removal_rank(level, random)
    histogram = np.histogram(rank, bins=20, range=(0.0, 1.0))[0] / rank.size
    assert np.abs(histogram - 0.05).max() < 0.002
    for above in range(4):
        assert rank[level == above].max() <= rank[level > above].min()

    instances = plant_instances(taiga().foliage(0.0, 0.0, STAND_CELL, STAND_CELL), np.zeros(2))
    assert (np.diff(instances.cull) <= 0.0).all()
    assert (instances.rank[:4] > 0.98).all()
    # Solitary plants are more important.
    assert plant_importance(np.array([12.0]), np.array([1.0])) == pytest.approx(12.0)
    assert plant_importance(np.array([12.0]), np.array([0.0])) > plant_importance(
        np.array([12.0]), np.array([0.9])
    )


def test_density_falls_with_size_squared_and_plants_fade():
    rng = np.random.default_rng(2)
    rank = rng.uniform(0.0, 1.0, 200_000)
    hold = cull_distance(np.full(rank.size, 10.0), rank)
    for ratio in (0.5, 1.0, 2.0, 4.0):
        away = np.full(rank.size, 1000.0 * ratio)
        share = (visible_share(hold, away, 0.01) > 0.0).mean()
        assert share == pytest.approx(min(ratio**-2, 1.0), rel=0.05)
        width = width_scale(np.full(rank.size, 10.0), away, 0.01)
        assert width == pytest.approx(np.clip(ratio, 1.0, WIDEST))
        assert ratio > WIDEST or share * width[0] ** 2 == pytest.approx(1.0, rel=0.05)  # cover

    away = np.linspace(500.0, 2500.0, 4001)
    share = visible_share(np.full(away.size, 10.0), away, 0.01)
    width = width_scale(np.full(away.size, 10.0), away, 0.01)
    assert share[0] == 1.0
    assert share[-1] == 0.0
    step = np.abs(np.diff(away) / away[1:]).max()
    assert np.abs(np.diff(share)).max() < 2.0 * step / SOFT
    assert np.abs(np.diff(width)).max() < 2.0 * step


def test_density_never_exceeds_the_budget():
    rng = np.random.default_rng(3)
    held, copies = rng.pareto(2.0, 5000) + 0.001, rng.integers(1, 3, 5000)
    for most in (1, 40, 1000, 10_000):
        for elapsed in (None, 0.05):
            density = PlantDensity(most)
            for _ in range(3):
                density.update(held, copies, least=1e-3, elapsed=elapsed)
                assert copies[held > density.angle].sum() <= most
        if most < 5000:
            assert copies[held > density.angle].sum() > (FILL - 0.01) * most - 2
        else:
            assert density.angle == 1e-3


def test_density_converges_smoothly_to_that_of_a_still():
    rng = np.random.default_rng(4)
    held = rng.pareto(2.0, 20_000) + 0.001
    crowd, few = held, held[:1500]
    still, density = PlantDensity(1000), PlantDensity(1000)

    def follow():
        seen = few[few > density.floor(1e-3, still=False)]
        density.update(seen, np.ones(len(seen), int), least=1e-3, elapsed=0.05)

    density.update(few, np.ones(1500, int), least=1e-3, elapsed=0.05)
    for _ in range(200):
        follow()
    assert density.converged
    still.update(few, np.ones(1500, int), least=1e-3, elapsed=None)
    assert density.angle == pytest.approx(still.angle, rel=1e-6)
    density.update(crowd, np.ones(20_000, int), least=1e-3, elapsed=0.05)
    assert not density.converged
    steps = []
    for _ in range(400):  # out of the crowd again
        before = density.angle
        follow()
        steps.append(density.angle / before)
    assert min(steps) > 0.9
    assert density.angle == pytest.approx(still.angle, rel=1e-3)


@pytest.fixture(scope="module")
def forest_of(gl):
    terrain = taiga()
    lit = SimpleNamespace(converged=True, height_at=lambda x, y: 0.0)

    def create(**changes):
        quality = replace(Quality(shade_maps=0, map_texels=64), **changes)
        defines = {"SHADE_MAPS": 0, **material_macros(BUILT_IN)}
        return Forest(gl, terrain, Sun(200.0, 35.0), quality=quality, defines=defines), lit

    return create


@pytest.mark.gl
def test_small_motion_changes_few_plants(forest_of):
    forest, lit = forest_of(max_plants=20_000)
    assert forest.refine(THIN_CAMERA, FRAME, lit)
    before = drawn(forest)
    moved = replace(THIN_CAMERA, eye=(3000.6, 300.8, 160.0), target=(3000.6, 1700.8, -200.0))
    forest.update(moved, FRAME, lit, 0.05, TimeBudget(0.0))
    forest._select(moved, FRAME)
    after = drawn(forest)
    both, a, b = np.intersect1d(before[0], after[0], return_indices=True)
    assert len(both) > 0.98 * len(before[0])
    assert np.abs(before[2][a] - after[2][b]).max() < 0.02
    assert np.abs(before[3][a] - after[3][b]).mean() < 0.01
    gone = np.setdiff1d(before[0], both)
    aside = np.abs(before[1][np.isin(before[0], gone)] - EYE[:2])
    away = np.hypot(*aside.T)
    edge = np.abs(aside[:, 0] / aside[:, 1] - np.tan(np.radians(30.0)) * FRAME[0] / FRAME[1]) < 0.1
    assert before[3][np.isin(before[0], gone)][~edge & (away > 100.0)].max(initial=0.0) < 0.1


@pytest.mark.gl
def test_selection_is_skipped_at_rest(forest_of, monkeypatch):
    forest, lit = forest_of(max_plants=3000)
    assert forest.refine(THIN_CAMERA, FRAME, lit)
    selections = []
    monkeypatch.setattr("sketchterrain.render.forest.join_cells", lambda *_: selections.append(1))
    monkeypatch.setattr("sketchterrain.render.forest.cells_in_view", lambda *_: selections.append(1))
    for _ in range(3):
        forest.update(THIN_CAMERA, FRAME, lit, 0.05, TimeBudget(0.0))
        forest._select(THIN_CAMERA, FRAME)
    assert not selections
    assert forest.converged


@pytest.mark.slow
@pytest.mark.gl
def test_flight_at_rest_equals_a_still(forest_of):
    still, lit = forest_of(max_plants=3000)
    assert still.refine(THIN_CAMERA, FRAME, lit)
    flown, _ = forest_of(max_plants=3000)
    away = replace(THIN_CAMERA, eye=(3000.0, 300.0, 400.0), target=(3000.0, 1700.0, 600.0))
    assert flown.refine(away, FRAME, lit)
    for _ in range(400):
        flown.update(THIN_CAMERA, FRAME, lit, 0.05, TimeBudget(1.0))
        flown._select(THIN_CAMERA, FRAME)
        if flown.converged:
            break
    assert flown.converged
    (a, _, _, share), (b, _, _, other) = drawn(still), drawn(flown)
    assert (a == b).all()
    assert np.abs(share - other).max() < 1e-3
