"""Stored worlds that are viewed: tiles, heights and colours are the store's own, and those of a terrain."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
import shapely
from PIL import Image

from sketchterrain.app.cli import main
from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.sketch import Sketch
from sketchterrain.features.table import FeatureTable
from sketchterrain.generation.building import build, make_recipe
from sketchterrain.generation.terrain import Terrain
from sketchterrain.look.objects import terrain_objects
from sketchterrain.render.scene import surface_heights
from sketchterrain.schema.materials import BEDROCK, MATERIALS
from sketchterrain.world.grid import CHUNK, World
from sketchterrain.world.run import run_world
from sketchterrain.world.stored_world import open_world
from sketchterrain.world.viewed import StoredPyramid, StoredTerrain
from tests.refusals import refused

from .grown import InMemoryWorld

EXTENT = 2048.0
CELL = 4.0
QUADS = 32


@pytest.fixture(scope="module")
def terrain():
    mountain, forest, lake, river = (np.zeros((64, 64), np.uint8) for _ in range(4))
    mountain[8:24, 30:50] = 1
    forest[36:56, 6:26] = 1
    lake[40:50, 30:52] = 1
    river[30:64, 24:26] = 1
    layers = {"mountain": mountain, "forest": forest, "lake": lake, "river": river}
    return build(Sketch(extent=EXTENT, layers=layers), device=ComputeContext())


@pytest.fixture(scope="module")
def whole(terrain):
    """The sketch, whose tiles are the terrain's own."""
    return InMemoryWorld(terrain, (0.0, 0.0, EXTENT, EXTENT), CELL)


@pytest.fixture(scope="module")
def odd(terrain):
    """A piece whose ends lie on no tile's border, nor on its coarser levels' vertices."""
    return InMemoryWorld(terrain, (100.0, 200.0, 100.0 + 301 * CELL, 200.0 + 213 * CELL), CELL)


def written(view, keys, *, roots=(), quads=QUADS):
    """Tiles that a view writes: {key: vertices}, {key: facts}; parents are among the keys or are roots."""
    place = {key: slot for slot, key in enumerate(keys)}
    parents = [-1 if key in roots else place[key[0] - 1, key[1] >> 1, key[2] >> 1] for key in keys]
    store = view.vertex_store(len(keys), quads=quads)
    facts = view.write_tiles(keys, np.arange(len(keys)), parents, store)
    return dict(zip(keys, store.download(), strict=True)), dict(zip(keys, facts, strict=True))


def chain(key, up):
    """A key after all above it, `up` levels."""
    return [(key[0] - n, key[1] >> n, key[2] >> n) for n in range(up, -1, -1)]


def test_vertices_equal_terrain_tiles(terrain, whole):
    view = StoredTerrain(whole, terrain.context)
    assert view.extent == terrain.extent
    for level, column, row in ((4, 7, 10), (4, 0, 15), (3, 5, 2), (2, 3, 0)):
        live = chain((level, column, row), level - 2)  # coarser ones are not stored
        viewed = [(z, x, y - (1 << z)) for z, x, y in live]
        ours, known = written(view, viewed, roots=viewed[:1])
        theirs, facts = written(terrain, live, roots=live[:1])
        for mine, other in zip(viewed, live, strict=True):
            one, two = ours[mine], theirs[other]
            for name in ("height", "parent_height"):
                assert np.array_equal(one[name], two[name])
            rim = np.zeros(one.shape, bool)
            ends = [0, 1, -2, -1]  # at the world's end there is one neighbour alone, for the parent too
            rim[ends] = rim[:, ends] = True
            for name in ("slope", "parent_slope"):
                apart = np.abs(one[name].astype(int) - two[name].astype(int)).max(axis=-1)
                assert apart[~rim].max() <= 2, "heights tell slopes to 16 bits"
                assert apart.max() <= 2 * 32767 / 255 + 2, "stored normals do to 8"
            for name in ("weights", "parent_weights"):
                # A byte that is rounded, and one more where weights must sum to 255.
                assert np.abs(one[name].astype(int) - two[name].astype(int)).max() <= 2
            assert known[mine]["low"] == facts[other]["low"]
            assert known[mine]["high"] == facts[other]["high"]


def test_tile_vertices_are_stored_samples_bit_for_bit(terrain, odd):
    view = StoredTerrain(odd, terrain.context)
    bits = int(np.log2(view.extent / CELL))
    checked = 0
    for level, column, row in ((4, 3, -5), (4, 8, -4), (3, 0, -1), (3, 3, -3)):
        tiles, _ = written(view, [(level, column, row)], roots=[(level, column, row)])
        (tile,) = tiles.values()
        number = bits - int(np.log2(QUADS)) - level
        height = odd.data["height", number]
        top, left = -(row + 1) * QUADS, column * QUADS
        inside = tile[: height.shape[0] - top, : height.shape[1] - left]
        rows, columns = inside.shape
        part = np.s_[..., top : top + rows, left : left + columns]
        assert np.array_equal(inside["height"], height[part])
        weights = odd.data["materials", number][part].transpose(1, 2, 0)
        assert np.array_equal(inside["weights"][..., : weights.shape[-1]], weights)
        stored = odd.data["normal", number][part][:2] / 127.5 - 1
        assert np.abs(inside["slope"].transpose(2, 0, 1) / 32767 - stored).max() < 1 / 255 + 1 / 32767
        checked += rows * columns
    assert checked > 3000


def test_neighbours_and_parents_are_bit_equal_at_shared_vertices(terrain, odd):
    view = StoredTerrain(odd, terrain.context)
    level = 4
    keys = [(level, x, y) for x in (3, 4) for y in (-4, -3)]
    above = sorted({(level - 1, x >> 1, y >> 1) for _, x, y in keys})
    tiles, _ = written(view, above + keys, roots=above)
    for x, y in ((3, -4), (3, -3)):
        assert np.array_equal(tiles[level, x, y][:, -1], tiles[level, x + 1, y][:, 0])
    for x in (3, 4):
        assert np.array_equal(tiles[level, x, -3][-1], tiles[level, x, -4][0])
    for z, x, y in keys:
        own, parent = tiles[z, x, y], tiles[z - 1, x >> 1, y >> 1]
        half = QUADS // 2
        part = parent[half * (1 - (y & 1)) :, half * (x & 1) :][: half + 1, : half + 1]
        for name in ("height", "slope", "weights"):
            assert np.array_equal(own[f"parent_{name}"][::2, ::2], part[name])
        expected = 0.5 * (part["height"][:-1, :-1] + part["height"][1:, 1:])
        assert np.array_equal(own["parent_height"][1::2, 1::2], expected.astype(np.float32))


def test_geometric_error_bounds_distance_to_finest_level(terrain, whole):
    view = StoredTerrain(whole, terrain.context)
    finest = whole.data["height", 0]
    shares = []
    for level in (1, 2, 3):
        keys = [(level, x, -1 - y) for x in range(1 << level) for y in range(1 << level)]
        tiles, facts = written(view, keys, roots=keys)
        step = (len(finest) - 1) >> level
        for (_, x, y), tile in tiles.items():
            error = facts[level, x, y]["error"]
            part = finest[-(y + 1) * step :, x * step :][: step + 1, : step + 1]
            cut = step // QUADS
            middle = part[cut // 2 :: cut, cut // 2 :: cut]
            apart = np.abs(0.5 * (tile["height"][:-1, :-1] + tile["height"][1:, 1:]) - middle)
            shares.append(np.mean(apart <= error))
            assert apart.max() <= 3 * error
    assert np.min(shares) > 0.9
    assert np.mean(shares) > 0.98
    tiles, facts = written(view, [(4, 3, -3)], roots=[(4, 3, -3)])
    assert facts[4, 3, -3]["error"] == 0.0


def test_heights_interpolate_samples(terrain, odd):
    view = StoredTerrain(odd, terrain.context)
    height = odd.data["height", 0]
    rng = np.random.default_rng(1)
    row, column = rng.integers(0, height.shape[0], 50), rng.integers(0, height.shape[1], 50)
    assert np.array_equal(view.heights(column * CELL, -row * CELL), height[row, column])
    x, y = (column[:-1] % 200 + 0.25) * CELL, -(row[:-1] % 200 + 0.5) * CELL
    i, j = column[:-1] % 200, row[:-1] % 200
    expected = 0.5 * (
        0.75 * (height[j, i] + height[j + 1, i]) + 0.25 * (height[j, i + 1] + height[j + 1, i + 1])
    )
    assert np.allclose(view.heights(x, y), expected, atol=1e-4)
    coarse = odd.data["height", 1]
    assert view.heights(48.0, -32.0, cell_size=2.5 * CELL) == coarse[4, 6]
    # Far apart or side by side: the same.
    x, y = rng.uniform(0, view.size[0], 300), -rng.uniform(0, view.size[1], 300)
    singly = [float(view.heights(a, b)) for a, b in zip(x, y, strict=True)]
    assert np.array_equal(view.heights(x, y), np.array(singly, np.float32))


def test_heights_beyond_edges_are_low(terrain, odd):
    view = StoredTerrain(odd, terrain.context)
    height = odd.data["height", 0]
    far = view.heights([-5000.0, view.size[0] + 10.0], [-100.0, -100.0])
    assert (far <= np.percentile(odd.data["height", len(odd.levels) - 1], 5) + 1e-3).all()
    assert view.heights(0.0, 0.0) == height[0, 0], "the border itself is ground"


def test_missing_normals_and_materials_have_defaults(terrain):
    bare = InMemoryWorld(terrain, (0.0, 0.0, 1024.0, 1024.0), CELL, layers=("height",))
    view = StoredTerrain(bare, terrain.context)
    key = (3, 3, -4)
    tiles, _ = written(view, [key], roots=[key])
    tile = tiles[key][:-1, :-1]
    exact = bare.data["exact normal", 0][:, 96 : 96 + QUADS, 96 : 96 + QUADS]
    assert np.abs(tile["slope"] / 32767 - exact[:2].transpose(1, 2, 0)).max() < 1e-4
    assert (tile["weights"][..., MATERIALS.index(BEDROCK)] == 255).all()
    assert tile["weights"].sum() == 255 * tile.size
    assert len(view.missing_parts) == 3


def test_tiles_outside_bounds_are_skipped(terrain, odd):
    view = StoredTerrain(odd, terrain.context)
    before = odd.reads
    keys = [(4, 3, 0), (4, -1, -1), (4, 15, -1)]
    _, facts = written(view, keys, roots=keys)
    assert odd.reads == before
    assert all(fact["error"] == 0 for fact in facts.values())


def test_broken_chunk_is_reported(terrain, odd):
    odd.broken.add(("height", 0, 0, 1))
    try:
        view = StoredTerrain(odd, terrain.context)
        refused("0/height/0/1", view.heights, CELL * (CHUNK + 3), -CELL)
        refused("0/height/0/1", written, view, [(4, 8, -1)], roots=[(4, 8, -1)])
    finally:
        odd.broken.clear()


def test_broken_chunk_is_replaced_by_coarser_level(terrain, odd):
    keys = [(4, column, -1) for column in range(6, 9)]
    sound, _ = written(StoredTerrain(odd, terrain.context), keys, roots=keys)
    message = []
    odd.broken |= {(layer, 0, 0, 1) for layer in odd.layers}
    try:
        view = StoredTerrain(odd, terrain.context, on_error=message.append)
        tiles, _ = written(view, keys, roots=keys)
    finally:
        odd.broken.clear()
    assert sorted(message) == [f"0/{layer}/0/1: broken" for layer in sorted(odd.layers)]
    assert np.array_equal(tiles[4, 6, -1]["height"], sound[4, 6, -1]["height"])
    # Without a gap, even where the chunk begins, in the first column of the last tile.
    assert np.array_equal(tiles[4, 7, -1][:, -1], tiles[4, 8, -1][:, 0])
    height, coarse = tiles[4, 8, -1]["height"], odd.data["height", 1]
    assert np.array_equal(height[::2, ::2], coarse[: QUADS // 2 + 1, CHUNK // 2 :][:, : QUADS // 2 + 1])
    assert not np.array_equal(height, sound[4, 8, -1]["height"])
    apart = np.abs(height[:, : 301 - CHUNK] - sound[4, 8, -1]["height"][:, : 301 - CHUNK])
    assert apart.max() < 20.0


def test_plants_and_water_are_clipped_to_world(terrain, odd):
    view = StoredTerrain(odd, terrain.context, terrain)
    west, south, east, north = view.bounds
    plants = view.foliage(west - 50, south - 50, west + 150, south + 100)
    live = terrain.foliage(100.0, 200.0, 250.0, 300.0)
    assert len(plants) == pytest.approx(len(live), abs=2)
    assert len(plants) > 10
    assert np.array_equal(np.sort(plants["x"] + view.corner[0])[:5], np.sort(live["x"])[:5])
    assert np.array_equal(plants["z"], view.heights(plants["x"], plants["y"]))
    assert (plants["x"].min(), plants["y"].min()) >= (west, south)
    assert view.features.lakes
    assert view.features.rivers
    for lake in view.features.lakes:
        _, columns = np.nonzero(lake.shape.inside > 0)
        x = lake.shape.west + columns * lake.shape.spacing
        assert west <= x.min() < x.max() <= east
    for river in view.features.rivers:
        line = river.centreline
        assert west <= line[:, 0].min() <= line[:, 0].max() <= east
        assert south <= line[:, 1].min() <= line[:, 1].max() <= north


def test_the_sea_has_its_level_in_a_world(terrain, odd, monkeypatch):
    assert StoredTerrain(odd, terrain.context, terrain).sea_level is None
    level = float(np.median(odd.data["height", 0]))
    monkeypatch.setattr(type(terrain), "features", replace(terrain.features, sea_level=level))
    monkeypatch.setattr(type(terrain), "sea_level", level)
    view = StoredTerrain(odd, terrain.context, terrain)
    assert (view.sea_level, view.features.sea_level) == (level, level)
    assert [each.kind for each in terrain_objects(view.features)][-1] == "sea"
    low = np.argwhere(odd.data["height", 0] < level)[0]
    assert surface_heights(view, low[1] * CELL, -low[0] * CELL) == level


def test_foreign_materials_are_refused(terrain, odd):
    class Foreign:
        levels, layers, material_names = odd.levels, odd.layers, ("grass", "lava")

    refused("lava", StoredPyramid, Foreign())


SMALL = ["--size", "160x90", "--quality", "0", "--without", "trees"]


def picture(path):
    with Image.open(path) as image:
        assert image.format == "PNG"
        return np.asarray(image.convert("RGB"))


def error_lines(capsys):
    lines = capsys.readouterr().err.strip().splitlines()
    return [line for line in lines if line.startswith("sketchterrain: ")]


@pytest.mark.gl
@pytest.mark.slow
def test_picture_of_world(finished_world, tmp_path, capsys):
    file = tmp_path / "new" / "view.png"
    eye = ["--eye", "200,252,90", "--look-at", "330,252,10"]
    assert main(["view", str(finished_world), "-o", str(file), *SMALL, *eye]) == 0
    assert capsys.readouterr().out.strip() == str(file)
    seen = picture(file)
    assert seen.shape == (90, 160, 3)
    # A strip of ground 4 m wide before the air: only in the middle it is seen.
    ground = np.abs(seen[70].astype(int) - seen[70, 0]).max(axis=-1) > 12
    assert ground.any()
    assert not ground[:30].any()
    assert not ground[-30:].any()


@pytest.mark.gl
def test_picture_of_broken_world_reports_file(finished_world, tmp_path, capsys):
    broken = tmp_path / "broken.zarr"
    shutil.copytree(finished_world, broken)
    for shard in (broken / "0" / "height" / "c").rglob("*"):
        if shard.is_file():
            data = bytearray(shard.read_bytes())
            for place in range(0, len(data) * 3 // 4, 500):  # in every chunk of it
                data[place] ^= 1
            shard.write_bytes(data)
    file = tmp_path / "view.png"
    arguments = ["view", str(broken), "-o", str(file), *SMALL, "--eye", "200,252,9", "--look-at", "330,252,0"]
    code = main(arguments)
    (line,) = error_lines(capsys)
    assert code == 3
    assert "height/c/" in line
    assert "broken" in line
    assert not file.exists()


@pytest.mark.gl
@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["-o", "view.svg"], "expected the name of a .png file, got 'view.svg'"),
        (["--eye", "0,0,9"], "--eye needs -o: it is for pictures"),
        (["-o", "v.png", "--look-at", "0,0,0"], "--look-at needs an --eye at another place"),
        (["-o", "v.png", "--eye", "0,0,9", "--view", "air"], "--view with --eye"),
    ],
)
def test_inconsistent_view_options_are_refused(options, message, capsys):
    assert main(["view", "world.zarr", *options]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("form", ["zarr", pytest.param("tiles", marks=pytest.mark.slow)])
def test_appearance_is_stored_as_evaluated(form, small_job, tmp_path, reporter) -> None:
    """Of two shards at two levels, bit for bit."""
    fields = shapely.box([-5.0, 101.0], [20.0, 35.0], [101.0, 300.0], [140.0, 240.0])
    layer = FeatureTable.from_shapes("landuse", fields)
    sketch = small_job.sketch.replace(vectors={"landuse": layer})
    world = World(-20.0, 60.0, 400.0, 64.0, 0.125)
    job = replace(
        small_job,
        sketch=sketch,
        recipe=make_recipe(sketch),
        world=world,
        form=form,
        layers=("height", "appearance"),
        output=tmp_path / ("world.zarr" if form == "zarr" else "world"),
    )
    run_world(job, reporter=reporter)
    terrain = Terrain(sketch, job.recipe, ComputeContext())
    stored = open_world(job.output)
    assert stored.layers == ("height", "appearance")
    for number in (0, 2):
        level = stored.levels[number]
        found = stored.read("appearance", number, top=0, left=0, rows=level.rows, columns=level.columns)
        cell = level.cell, level.cell
        size = {"columns": level.columns, "rows": level.rows}
        expected = terrain.appearance.window(world.west, world.north, cell=cell, **size)
        assert expected[..., 3].any()
        off = np.abs(found.astype(int) - expected.transpose(2, 0, 1))
        # Shards begin at other texels: rounding moves few of them over the edges of patterns.
        assert (off > 1).mean() < 1e-3
