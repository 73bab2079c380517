"""Zarr worlds: content, other readers, reading, damage."""

import json
import random
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import rasterio
import xarray
import zarr
from numcodecs import blosc
from zarr.codecs import BloscCodec, Crc32cCodec

import sketchterrain as st
from sketchterrain.compute.context import ComputeContext
from sketchterrain.errors import InputError
from sketchterrain.schema.materials import MATERIALS
from sketchterrain.world.grid import ShardData, World
from sketchterrain.world.job import Job
from sketchterrain.world.stored_world import open_world
from sketchterrain.world.task_runner import TaskRunner
from sketchterrain.world.zarr_store import ZarrStore
from tests.refusals import refused

ORIGIN = (500_000.0, 5_500_000.0)
WEST, SOUTH, EAST, NORTH, CELL = -40.0, 400.0, 2120.0, 700.0, 1.0  # two shards wide, two chunks high
SECOND = "0/height/c/0/1"
WINDOW = {"top": 0, "left": 0, "rows": 5, "columns": 5}
LEDGER = '{"file": "…"}\n'


@pytest.fixture(scope="module")
def terrain():
    mountain, river, forest = (np.zeros((48, 64), np.uint8) for _ in range(3))
    mountain[4:16, 48:60] = 1
    river[24:27, :40] = 1
    forest[34:46, 6:30] = 1
    return st.build(
        st.Sketch(
            name="North-east",
            extent=1024.0,
            seed=5,
            density={"hill": 4.0},
            layers={"mountain": mountain, "river": river, "forest": forest},
        )
    )


@pytest.fixture(scope="module")
def job(terrain, tmp_path_factory):
    output = tmp_path_factory.mktemp("zarr") / "world.zarr"
    world = World(WEST, SOUTH, EAST, NORTH, CELL)
    layers = ("height", "normal", "materials")
    return Job(terrain.sketch, terrain.recipe, world, output, "zarr", layers, crs="EPSG:25832", origin=ORIGIN)


@pytest.fixture(scope="module")
def shards(job):
    maker = TaskRunner(job, ComputeContext())
    return [maker.compute_shard(shard) for shard in job.world.shards()]


@pytest.fixture(scope="module")
def written(job, shards):
    """The whole world."""
    store = ZarrStore(job)
    store.create()
    for ground in shards:
        store.write(ground)
    assert store.join(progress=lambda _: None) == ()
    job.layout.journal.write_text("…")
    store.close(LEDGER)
    return job.output


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_heights_are_bit_equal_to_terrain_at_coordinates(written, job, terrain):
    group = zarr.open_group(written, mode="r")
    for level in job.world.levels:
        held = group[str(level.number)]
        x, y = held["x"][:] - ORIGIN[0], held["y"][:] - ORIGIN[1]
        assert (x[0], y[0]) == (WEST, NORTH)
        assert x[-1] >= EAST
        assert y[-1] <= SOUTH
        height = held["height"][:]
        expected = terrain.heights(*np.meshgrid(x, y), cell_size=level.cell)
        np.testing.assert_array_equal(height.view(np.int32), expected.view(np.int32))


def test_layers_of_shards_round_trip(written, shards):
    group = zarr.open_group(written, mode="r")
    assert {ground.shard.column for ground in shards} == {0, 1}
    for ground in shards:
        rows, columns = ground.height.shape
        top, left = ground.shard.row * 2048, ground.shard.column * 2048
        for layer in ("height", "normal", "materials"):
            array = group[f"{ground.shard.level}/{layer}"]
            part = array[..., top : top + rows, left : left + columns]
            np.testing.assert_array_equal(part, getattr(ground, layer))
    assert (group["0/materials"][:].sum(0, dtype=np.int64) == 255).all()
    for layer, first in (("height", ()), ("normal", (3,)), ("materials", (len(MATERIALS),))):
        array = group[f"0/{layer}"]
        assert array.metadata.zarr_format == 3
        assert (array.shards, array.chunks) == ((*first, 2048, 2048), (*first, 256, 256))
    assert np.isnan(group["0/height"].fill_value)  # missing data is not sea level


def test_xarray_opens_levels_and_the_whole_tree(written, shards):
    fine = shards[-2]  # the last level's first shard
    with xarray.open_zarr(written, group="0") as level:
        assert set(level.coords) == {"x", "y", "spatial_ref"}
        assert dict(level.sizes) == {"y": 301, "x": 2161, "axis": 3, "material": len(MATERIALS)}
        assert level["height"].sel(x=ORIGIN[0] + 3, y=ORIGIN[1] + 690).values == fine.height[10, 43]
        normal = level["normal"].isel(y=10, x=43).values
        assert np.linalg.norm(normal) == pytest.approx(1, abs=0.01)  # decoded to −1 … 1
        shares = level["materials"].isel(y=10).sum("material").values
        np.testing.assert_allclose(shares, 1, rtol=1e-12)
    with xarray.open_datatree(written, engine="zarr") as tree:
        assert set(tree.groups) == {"/", "/0", "/1", "/2", "/3", "/4"}
        assert tree["4/height"].dims == ("y", "x")


def test_root_attributes_describe_world(written, job):
    group = zarr.open_group(written, mode="r")
    ours = group.attrs["sketchterrain"]
    bounds = {"west": WEST, "south": SOUTH, "east": EAST, "north": NORTH, "cell": CELL}
    assert (ours["format"], ours["seed"], ours["world"]) == (1, 5, bounds)
    assert ours["layers"] == ["height", "normal", "materials"]
    layout = group.attrs["multiscales"]["layout"]
    assert [entry["asset"] for entry in layout] == [str(level.number) for level in job.world.levels]
    for entry in layout:
        assert entry["spatial:shape"] == list(group[entry["asset"]]["height"].shape)
        assert entry["spatial:transform"] == group[entry["asset"]].attrs["spatial:transform"]
    assert group.attrs["proj:code"] == "EPSG:25832"
    named = {convention["name"] for convention in group.attrs["zarr_conventions"]}
    assert named == {"multiscales", "proj", "spatial"}


@pytest.mark.parametrize("number", [0, 3])
def test_georeferences_agree(written, number):
    group = zarr.open_group(written, mode="r")[str(number)]
    pixels = rasterio.Affine(*group.attrs["spatial:transform"])
    mapping = group[group["height"].attrs["grid_mapping"]].attrs
    gdal = [float(each) for each in mapping["GeoTransform"].split()]
    assert rasterio.Affine.from_gdal(*gdal) == pixels
    rows, columns = group["height"].shape
    for row, column in ((0, 0), (rows - 1, columns - 1)):  # the middle of a pixel is its vertex
        x, y = pixels @ (column + 0.5, row + 0.5)
        assert (x, y) == (group["x"][column], group["y"][row])
    west, south, east, north = group.attrs["spatial:bbox"]
    assert (west, north) == pixels @ (0, 0)
    assert (east, south) == pixels @ (columns, rows)
    for wkt in (mapping["crs_wkt"], mapping["spatial_ref"]):
        assert rasterio.CRS.from_wkt(wkt).to_epsg() == 25832
    assert group.attrs["proj:code"] == "EPSG:25832"


def test_sketch_and_ledger_are_stored(written, job, tmp_path):
    group = zarr.open_group(written, mode="r")
    assert bytes(group["ledger"][:]).decode() == LEDGER == job.layout.ledger.read_text()
    (tmp_path / "a.sketch").write_bytes(bytes(group["sketch"][:]))
    sketch = st.load_sketch(tmp_path / "a.sketch")
    assert (sketch.name, sketch.seed) == ("North-east", 5)
    np.testing.assert_array_equal(sketch.layers["mountain"], job.sketch.layers["mountain"])
    assert not job.layout.journal.exists()


def test_store_contains_only_zarr_files(written, job):
    before = contents(written)
    named = {name for name in before if name.endswith("zarr.json") or "/c" in name}
    assert set(before) == named
    names = set(ZarrStore(job).create())
    shards = {name for name in before if name.split("/")[1:2] in [[layer] for layer in job.layers]}
    shards = {name for name in shards if "/c/" in name}
    assert names | shards | {"zarr.json", "ledger/zarr.json", "ledger/c/0"} == set(before)
    group = zarr.open_group(written, mode="r", use_consolidated=False)  # warns of what is no group or array
    assert {name for name, _ in group.members()} == {*"01234", "sketch", "ledger"}


def test_unfinished_store_opens(job, shards, tmp_path):
    job = replace(job, output=tmp_path / "a.zarr")
    store = ZarrStore(job)
    names = store.create()
    assert not job.layout.ledger.exists()
    assert all((store.folder / name).is_file() for name in names)
    job.layout.journal.write_text("…")
    store.write(shards[0])
    group = zarr.open_group(store.folder, mode="r")
    assert group["ledger"].shape == (0,)
    assert {name for name, _ in group.members()} == {*"01234", "sketch", "ledger"}
    np.testing.assert_array_equal(group["4/height"][:], shards[0].height)


def test_repeated_concurrent_writes_give_equal_bytes(written, job, shards, tmp_path):
    store = ZarrStore(replace(job, output=tmp_path / "a.zarr"))
    store.create()
    (name, *_) = store.write(shards[0])
    (store.folder / name).write_bytes(b"a broken one")
    with ThreadPoolExecutor(3) as pool:  # each shard twice at once, from its end to its beginning
        list(pool.map(ZarrStore(store._job).write, [*shards[::-1], *shards]))
    store.close(LEDGER)
    assert contents(store.folder) == contents(written)


def test_unrequested_layers_are_not_written(job, shards, tmp_path):
    store = ZarrStore(replace(job, output=tmp_path / "a.zarr", layers=("height",), crs=None, origin=(0, 0)))
    store.create()
    assert store.write(shards[0]) == ("4/height/c/0/0",)
    store.close(LEDGER)
    with xarray.open_zarr(store.folder, group="4") as level:
        assert list(level) == ["height"]
        words = (level["spatial_ref"].attrs["crs_wkt"], level.attrs["proj:wkt2"])
    for crs in map(rasterio.CRS.from_wkt, words):  # metres that lie nowhere on Earth
        assert not crs.is_projected
        assert not crs.is_geographic


@pytest.fixture
def copy(written, tmp_path):
    """A copy to break."""
    return shutil.copytree(written, tmp_path / "copy.zarr")


def whole(world, layer="height", level=0):
    grid = world.levels[level]
    return world.read(layer, level, top=0, left=0, rows=grid.rows, columns=grid.columns)


def test_windows_equal_zarr(written, job):
    world, group, rng = open_world(written), zarr.open_group(written, mode="r"), random.Random(1)
    assert (world.west, world.north, world.levels) == (WEST, NORTH, job.world.levels)
    assert world.layers == ("height", "normal", "materials")
    assert world.material_names == st.MATERIALS
    sketch = world.sketch()
    assert (sketch.name, sketch.seed) == ("North-east", 5)
    for level in world.levels:
        for layer in world.layers:
            array = group[f"{level.number}/{layer}"][:]
            for _ in range(8):
                top, left = rng.randrange(level.rows), rng.randrange(level.columns)
                rows = rng.randint(1, level.rows - top)
                columns = rng.randint(1, level.columns - left)
                window = world.read(layer, level.number, top=top, left=left, rows=rows, columns=columns)
                assert window.dtype == array.dtype
                np.testing.assert_array_equal(window, array[..., top : top + rows, left : left + columns])


def test_chunks_are_cached_and_windows_are_copies(written, monkeypatch):
    decoded, decode = [], blosc.decompress
    monkeypatch.setattr(blosc, "decompress", lambda *content: decoded.append(1) or decode(*content))
    world = open_world(written)
    for place in range(0, 191, 10):
        world.read("height", 0, top=place, left=place, rows=65, columns=65)[:] = 0
    assert len(decoded) == 1
    assert (world.read("height", 0, **WINDOW) != 0).any()


def test_windows_outside_level_are_refused(written):
    world = open_world(written)
    for asked, message in (
        ({"top": -1}, "a window inside 301 rows and 2161 columns, got rows -1 to 4 and columns 0 to 5"),
        ({"left": 2157}, "columns 2157 to 2162"),
        ({"rows": 0}, "rows 0 to 0"),
        ({"layer": "depth"}, "a layer among height, normal, materials, got 'depth'"),
        ({"level": 9}, "a level from 0 to 4, got 9"),
    ):
        refused(message, world.read, **{"layer": "height", "level": 0} | WINDOW | asked)


def test_missing_shard_is_reported(copy):
    (copy / SECOND).unlink()
    world = open_world(copy)
    world.read("height", 0, top=0, left=0, rows=301, columns=2048)  # the other shard
    refused(rf"copy.zarr/{SECOND}: is missing: the world is not finished or damaged", whole, world)
    (copy / SECOND).mkdir()
    refused(rf"copy.zarr/{SECOND}: broken", whole, world)


def test_any_damaged_byte_is_detected(written, copy):
    content, world, rng = (written / SECOND).read_bytes(), open_world(copy), random.Random(5)
    index = range(len(content) - 1028, len(content))
    for place in [0, *rng.sample(range(len(content)), 12), *rng.sample(index, 8), len(content) - 1]:
        damaged = bytearray(content)
        damaged[place] ^= 1 << rng.randrange(8)
        (copy / SECOND).write_bytes(damaged)
        refused(rf"copy.zarr/{SECOND}: broken .*--resume", whole, open_world(copy))
    for size in (0, 1, 700, 1028, 3000, len(content) - 1):
        (copy / SECOND).write_bytes(content[:size])
        refused(rf"copy.zarr/{SECOND}: broken", whole, world)
    (copy / SECOND).write_bytes(content)  # mended while the world is open
    np.testing.assert_array_equal(whole(world), whole(open_world(written)))


def test_missing_or_broken_metadata_are_reported(copy):
    for name in ("zarr.json", "2/normal/zarr.json"):
        content = (copy / name).read_bytes()
        for damaged in (content[:300], b"[]", b""):
            (copy / name).write_bytes(damaged)
            refused(f"copy.zarr/{name}: broken", open_world, copy)
        root = json.loads((copy / "zarr.json").read_text() if name != "zarr.json" else content)
        root.pop("consolidated_metadata", None)  # as before the world is finished
        (copy / name).write_bytes(content)
        (copy / "zarr.json").write_text(json.dumps(root))
    (copy / "2/normal/zarr.json").unlink()
    refused(r"copy.zarr/2/normal/zarr.json: is missing", open_world, copy)


def test_rewritten_array_is_refused(copy):
    group = zarr.open_group(copy, mode="a", use_consolidated=False)
    heights = group["1/height"][:]
    del group["1/height"]
    group["1"].create_array("height", data=heights, chunks=(64, 64))
    with pytest.warns(zarr.errors.ZarrUserWarning, match="not part in the Zarr format 3"):
        zarr.consolidate_metadata(copy)
    refused(r"1/height/zarr.json: broken \(expected shape, shards and type", open_world, copy)


def test_other_materials_and_compression_are_read(written, copy):
    """As another version may write it."""
    root = json.loads((copy / "zarr.json").read_text())
    root["attributes"]["sketchterrain"]["materials"] = ["grass", "lava"]
    del root["consolidated_metadata"]
    (copy / "zarr.json").write_text(json.dumps(root))
    world = open_world(written)
    group = zarr.open_group(copy, mode="a", use_consolidated=False)
    for level in world.levels:
        few = whole(world, "materials", level.number)[:2]
        del group[f"{level.number}/materials"]
        group[str(level.number)].create_array(
            "materials",
            data=few,
            chunks=(2, 256, 256),
            shards=(2, 2048, 2048),
            compressors=[BloscCodec(cname="lz4", clevel=9, shuffle="shuffle"), Crc32cCodec()],
            config={"write_empty_chunks": True},
        )
    other = open_world(copy)
    assert other.material_names == ("grass", "lava")
    np.testing.assert_array_equal(whole(other, "materials"), whole(world, "materials")[:2])


def test_invalid_root_attributes_are_refused(copy):
    text = (copy / "zarr.json").read_text()
    bounds = ("west", "south", "east", "north", "cell")
    for change, message in (
        ({"format": 2}, "expected a world of format 1, got 2"),
        ({"world": {"west": 0}}, r"zarr.json: broken \("),
        ({"layers": ["depth"]}, r"zarr.json: broken \(layers depth\)"),
        ({"world": dict(zip(bounds, (0, 0, -1, 1, 1), strict=True))}, "west < east"),
        ({"world": dict.fromkeys(bounds, "?")}, r"zarr.json: broken \("),
    ):
        root = json.loads(text)
        root["attributes"]["sketchterrain"] |= change
        (copy / "zarr.json").write_text(json.dumps(root))
        refused(message, open_world, copy)


def test_missing_or_broken_sketch_is_reported(copy):
    world = open_world(copy)
    chunk = copy / "sketch/c/0"
    chunk.write_bytes(chunk.read_bytes()[:-100])
    refused(r"copy.zarr/sketch/c/0", world.sketch)
    chunk.unlink()
    refused(r"copy.zarr/sketch/c/0: is missing", world.sketch)


def test_smallest_world_has_four_vertices(job, tmp_path):
    world = World(0.0, 0.0, 0.5, 0.5, 1.0)
    store = ZarrStore(replace(job, world=world, output=tmp_path / "a.zarr", layers=("height",)))
    store.create()
    (shard,) = world.shards()
    height = np.array([[1, 2], [3, 4]], np.float32)
    store.write(ShardData(shard, height, *[np.empty((0, 2, 2), np.uint8)] * 2))
    np.testing.assert_array_equal(whole(open_world(store.folder)), height)
    np.testing.assert_array_equal(zarr.open_array(store.folder / "0/height", mode="r")[:], height)


def test_invalid_zarr_worlds_are_refused(tmp_path):
    refused(r"a.zarr: no such file or folder, expected a world", open_world, tmp_path / "a.zarr")
    refused("expected a world, with", open_world, tmp_path)
    zarr.create_group(tmp_path / "a.zarr", zarr_format=3)
    with pytest.raises(
        InputError, match=r"a.zarr: expected a world of sketchterrain, got another Zarr store"
    ):
        open_world(tmp_path / "a.zarr")
    zarr.create_array(tmp_path / "b.zarr", shape=(3,), dtype="u1", zarr_format=3)
    refused(r"b.zarr/zarr.json: broken", open_world, tmp_path / "b.zarr")
