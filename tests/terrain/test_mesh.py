"""The mesh of drainage cells and unpainted ground: partition, bit equality of windows, valleys that fall."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from sketchterrain.document.sketch import Sketch
from sketchterrain.host.library import host_function
from sketchterrain.landforms import mesh as meshes
from sketchterrain.landforms import mesh_nodes
from sketchterrain.landforms.relief_fields import UnpaintedSettings
from sketchterrain.landforms.unpainted import UnpaintedGround, unpainted_ground

SETTINGS = UnpaintedSettings(7680.0, 3, mountain_density=0.04, hill_density=0.2)
CORNERS = [[[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]]
"""Corners of quads in each triangle, by diagonal and half."""
SIDES = [[(0, 1, 4), (2, 3, 4)], [(0, 3, 4), (2, 1, 4)]]
"""Sides of triangles, by diagonal and half: south, east, north and west of the quad, and its diagonal."""


@pytest.fixture(scope="module")
def ground():
    return UnpaintedGround(SETTINGS)


def test_cells_tile_the_plane_and_are_as_large_as_a_lattice_square(ground):
    table = ground.table(-8, 40, 20, 20)
    place, third, _ = mesh_nodes.owners(ground.mesh, table, 1, -4 * 32, 44 * 32, 320, 320)
    assert (place[..., 0] >= 0).all()  # in some triangle
    assert (place[..., 3] != place[..., 4]).all()
    assert 0.0 <= third.min() <= third.max() <= 1.0 / 3.0 + 1e-12
    count = np.bincount(mesh_nodes.owner_index(place, 21).ravel(), minlength=21 * 21).reshape(21, 21)
    inner = count[7:13, 7:13]
    assert (inner > 0).all()
    assert np.mean(inner) == pytest.approx(32**2, rel=0.1)


def _neighbour(table, row, column, half, side):
    """Return row, column and half of the triangle beyond a side."""
    q, p = row + (side == 2) - (side == 0), column + (side == 1) - (side == 3)
    half = {0: 1, 1: 1 - table.diagonal[q, p], 2: 0, 3: table.diagonal[q, p], 4: 1 - half}[side]
    return q, p, int(half)


def _ends(table, row, column, side):
    """Return the corners of a quad at the ends of a side."""
    if side == 4:
        return (0, 2) if table.diagonal[row, column] == 0 else (1, 3)
    return side, (side + 1) % 4


def test_valleys_fall_and_hardly_any_vertex_is_a_sink(ground):
    table = ground.table(100, -60, 90, 90)
    sinks = 0
    for j in range(1, 89):
        for i in range(1, 89):
            for half in range(2):
                side = table.receiver[j, i, half]
                if side < 0:
                    sinks += 1
                    continue
                q, p, other = _neighbour(table, j, i, half, side)
                assert table.height[q, p, other] < table.height[j, i, half]
    assert sinks <= 0.002 * 88 * 88 * 2


def test_edges_are_monotone_in_valleys_and_rise_to_one_pass_elsewhere(ground):
    table = ground.table(20, 20, 30, 30)
    rule = meshes.PassRule(0.8, 1.5, 0.01, 1920.0)
    valleys, edge_height = 0, host_function("edge_height")
    for j in range(2, 16):
        for i in range(2, 16):
            for half in range(2):
                for side in SIDES[table.diagonal[j, i]][half]:
                    q, p, other = _neighbour(table, j, i, half, side)
                    back = 4 if side == 4 else (side + 2) % 4
                    ends, far_ends = _ends(table, j, i, side), _ends(table, q, p, back)
                    thirds = np.linspace(1 / 3, 0, 20)
                    here = [edge_height(table, rule, j, i, half, *ends, t) for t in thirds]
                    there = [edge_height(table, rule, q, p, other, *far_ends, t) for t in thirds]
                    assert here[0] == pytest.approx(table.height[j, i, half])
                    assert here[-1] == pytest.approx(there[-1])  # both triangles agree on the middle
                    profile = np.diff(here + there[-2::-1])
                    valley = table.receiver[j, i, half] == side or table.receiver[q, p, other] == back
                    valleys += valley
                    if valley:
                        assert (profile >= 0).all() or (profile <= 0).all()
                    else:
                        assert (np.diff(np.sign(profile)) > 0).sum() == 0  # no second rise
    assert valleys > 250


def test_threads_and_evicted_cells_change_no_bit(ground):
    expected = ground.window(1, 500, 500, 96, 96)
    with ThreadPoolExecutor(2) as pool:
        threaded = UnpaintedGround(SETTINGS, max_bytes=200_000, executor=pool).window(1, 500, 500, 96, 96)
    for a, b in zip(expected, threaded, strict=True):
        assert np.array_equal(a, b)
    assert np.array_equal(unpainted_ground(SETTINGS).window(1, 500, 500, 96, 96).height, expected.height)


@pytest.mark.parametrize("densities", [(0.0, 0.0, 0.0), (0.04, 0.2, 0.0), (0.0, 0.0, 800.0)])
def test_hardly_any_ground_lies_in_closed_hollows(densities):
    from skimage.morphology import reconstruction

    mountains, hills, surroundings = densities
    settings = UnpaintedSettings(
        7680.0, 5, mountain_density=mountains, hill_density=hills, surroundings=surroundings
    )
    height = UnpaintedGround(settings).window(0, 700, -600, 192, 192).height
    seed = np.full_like(height, height.max())
    seed[[0, -1]], seed[:, [0, -1]] = height[[0, -1]], height[:, [0, -1]]
    filled = reconstruction(seed, height, method="erosion")
    assert (filled - height > 0.05 * settings.spacing).mean() <= 0.01


def test_the_painted_region_covers_the_sketch_and_no_more_than_its_cells():
    bare = [
        UnpaintedGround(UnpaintedSettings(e, 4, mountain_density=d)) for e, d in ((7680.0, 0.0), (960.0, 3.0))
    ]
    assert bare[0].painted_sites == bare[1].painted_sites  # of the seed alone
    ground = bare[0]
    for level in range(4):
        region = ground.painted_region(level)
        side = 256 >> level
        south, west = -region.row, -region.column
        assert region.inside[south : south + side + 1, west : west + side + 1].all()
        assert region.inside.size < (side + 256 * 0.9 / 2**level + 4) ** 2
        inner = region.inside[1:-1, 1:-1] & np.isnan(region.border[1:-1, 1:-1])
        for b, a in ((0, 1), (1, 0), (1, 2), (2, 1)):  # an inner node has all its neighbours
            assert region.inside[b : b + inner.shape[0], a : a + inner.shape[1]][inner].all()
        outside = ground.window(level, region.column, region.row, *region.inside.shape, painted=False)
        assert np.array_equal(np.isnan(outside.height), region.inside)


def test_valleys_lead_away_from_the_painted_region():
    """What leads into it, in numbers of vertices upstream, is little beside what leads out of it."""
    entering = leaving = 0
    for seed in range(6):
        ground = UnpaintedGround(UnpaintedSettings(7680.0, seed))
        painted, table = set(ground.painted_sites), ground.table(-4, -4, 12, 12)

        def inside(row, column, half, painted=painted, table=table):
            corners = CORNERS[table.diagonal[row, column]][half]
            at = zip(meshes.CORNER_X[corners].tolist(), meshes.CORNER_Y[corners].tolist(), strict=True)
            return sum((table.column + column + x, table.row + row + y) in painted for x, y in at)

        for row, column, half in np.add(np.argwhere(table.receiver[1:-1, 1:-1] >= 0), [1, 1, 0]).tolist():
            side = table.receiver[row, column, half]
            beyond = _neighbour(table, row, column, half, side)
            sites = inside(row, column, half), inside(*beyond)
            upstream = table.upstream[row, column, half]
            entering += upstream * (0 < sites[0] < 3 and sites[1] == 3)
            leaving += upstream * (sites[0] == 3 and sites[1] < 3)
    assert entering < 0.25 * leaving


def test_border_of_the_painted_region_meets_the_cells_outside():
    ground = UnpaintedGround(SETTINGS)
    region = ground.painted_region(0)
    whole = ground.window(0, region.column, region.row, *region.inside.shape)
    border = np.isfinite(region.border)
    assert np.array_equal(whole.height[border], region.border[border])


def test_surroundings_change_nothing_of_the_painted_region():
    settings = replace(SETTINGS, surroundings=900.0, rocky_surroundings=True)
    plain, surrounded = UnpaintedGround(SETTINGS), UnpaintedGround(settings)
    for level in (1, 3):
        before, after = plain.painted_region(level), surrounded.painted_region(level)
        assert np.array_equal(before.border, after.border, equal_nan=True)
        at = (level, after.column, after.row, *after.inside.shape)
        for one, other in zip(plain.window(*at), surrounded.window(*at), strict=True):
            assert np.array_equal(one[after.inside], other[after.inside])


@pytest.mark.parametrize("level", [2, 5])
def test_surroundings_are_as_high_as_asked_at_every_level(level):
    settings = UnpaintedSettings(7680.0, 3, relief=30.0)
    ranges = replace(settings, surroundings=600.0, rocky_surroundings=True)
    side = 768 >> level
    at = (level, 640 >> level, -(384 >> level), side, side)  # 1.5 to 4.5 extents east of the sketch
    plain, surrounded = (UnpaintedGround(each).window(*at) for each in (settings, ranges))
    rise = surrounded.height - plain.height
    assert 0.6 * 600.0 < np.percentile(rise, 99) < 1.4 * 600.0
    assert np.percentile(rise, 10) < 0.2 * 600.0  # there are plains between them
    assert plain.rock.max() == 0.0 < 0.1 < surrounded.rock.mean() < 0.7


def test_levels_agree(ground):
    finest = ground.window(0, 2048, 1024, 512, 512).height
    relief = np.ptp(np.percentile(finest, (1, 99)))
    for level, share in ((1, 0.04), (2, 0.08), (3, 0.12), (4, 0.14), (5, 0.15)):
        coarse = ground.window(level, 2048 >> level, 1024 >> level, 512 >> level, 512 >> level).height
        difference = coarse - finest[:: 1 << level, :: 1 << level]
        assert np.sqrt((difference**2).mean()) <= share * relief
        assert abs(difference.mean()) <= 0.08 * relief


def test_settings_are_those_of_a_sketch():
    sketch = Sketch(extent=5000.0, seed=6, labels={("mountain", 1): {"height": 777.0}})
    settings = UnpaintedSettings.from_sketch(sketch)
    assert (settings.extent, settings.seed) == (5000.0, 6)
    assert settings.relief == sketch.ground["relief"]
    assert (settings.mountain_height, settings.hill_height) == (777.0, 80.0)  # automatic hills
    assert (settings.surroundings, settings.rocky_surroundings) == (150.0, False)  # nothing is painted
    image = np.zeros_like(sketch.layers["mountain"])
    image[200:300, 200:300] = 1
    painted = sketch.replace(layers={**sketch.layers, "mountain": image}, extent=7000.0)
    settings = UnpaintedSettings.from_sketch(painted)
    assert (settings.surroundings, settings.rocky_surroundings) == (777.0, True)
    level = UnpaintedSettings.from_sketch(painted.replace(ground={**painted.ground, "surroundings": 0.0}))
    assert level.surroundings == 0.0
