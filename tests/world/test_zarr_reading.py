"""Reading needs no terrain: what is written are numbers that walk at random."""

import json
import random
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import cast

import numpy as np
import pytest
import zarr
from numcodecs import blosc
from zarr.codecs import BloscCodec, Crc32cCodec

import sketchterrain as st
from sketchterrain.errors import InputError
from sketchterrain.terrain.recipe import TerrainRecipe
from sketchterrain.world.grid import World
from sketchterrain.world.ground import Ground
from sketchterrain.world.job import Job
from sketchterrain.world.opening import StoredWorld, open_world
from sketchterrain.world.zarr_store import ZarrStore

WORLD = World(-10.0, 0.0, 2090.0, 320.0, 1.0)
SHARD = "0/height/c/0/1"
WINDOW = {"top": 0, "left": 0, "rows": 5, "columns": 5}


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("zarr") / "world.zarr"
    sketch = st.Sketch(name="Flat", extent=1024.0, seed=7)
    layers = ("height", "normal", "materials")
    store = ZarrStore(Job(sketch, cast("TerrainRecipe", None), WORLD, output, "zarr", layers))
    store.create()
    rng = np.random.default_rng(3)
    for shard in WORLD.shards():
        rows, columns = WORLD.levels[shard.level].size_of(shard)
        height = rng.normal(0, 1, (rows, columns)).cumsum(1).astype(np.float32)
        normal = rng.integers(100, 156, (3, rows, columns), dtype=np.uint8)
        materials = rng.integers(0, 32, (8, rows, columns), dtype=np.uint8)
        store.write(Ground(shard, height, normal, materials))
    store.close("{}\n")
    return output


@pytest.fixture
def copy(written: Path, tmp_path: Path) -> Path:
    """One that may be broken."""
    return shutil.copytree(written, tmp_path / "copy.zarr")


def whole(world: StoredWorld, layer: str = "height", level: int = 0) -> np.ndarray:
    grid = world.levels[level]
    return world.read(layer, level, top=0, left=0, rows=grid.rows, columns=grid.columns)


def test_windows_are_what_zarr_reads(written: Path) -> None:
    world, group, rng = open_world(written), zarr.open_group(written, mode="r"), random.Random(1)
    assert (world.west, world.north, world.levels) == (-10.0, 320.0, WORLD.levels)
    assert world.layers == ("height", "normal", "materials")
    assert world.material_names == st.MATERIALS
    sketch = world.sketch()
    assert sketch is not None
    assert (sketch.name, sketch.seed) == ("Flat", 7)
    for level in WORLD.levels:
        for layer in world.layers:
            array = group[f"{level.number}/{layer}"][:]
            for _ in range(8):
                top, left = rng.randrange(level.rows), rng.randrange(level.columns)
                rows = rng.randint(1, level.rows - top)
                columns = rng.randint(1, level.columns - left)
                window = world.read(layer, level.number, top=top, left=left, rows=rows, columns=columns)
                assert window.dtype == array.dtype
                np.testing.assert_array_equal(window, array[..., top : top + rows, left : left + columns])


def test_a_chunk_is_decompressed_once_and_a_window_may_be_changed(
    written: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    decoded, decode = [], blosc.decompress
    monkeypatch.setattr(blosc, "decompress", lambda *content: decoded.append(1) or decode(*content))
    world = open_world(written)
    for place in range(0, 191, 10):
        world.read("height", 0, top=place, left=place, rows=65, columns=65)[:] = 0
    assert len(decoded) == 1
    assert (world.read("height", 0, **WINDOW) != 0).any()


def test_threads_may_read_at_once(written: Path) -> None:
    world, expected = open_world(written), whole(open_world(written))

    def right(seed: int) -> bool:
        rng = random.Random(seed)
        top, left = rng.randrange(321 - 65), rng.randrange(2101 - 65)
        window = world.read("height", 0, top=top, left=left, rows=65, columns=65)
        return np.array_equal(window, expected[top : top + 65, left : left + 65])

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(right, range(100)))


def test_windows_that_are_not_there_are_refused(written: Path) -> None:
    world = open_world(written)
    for asked, message in (
        ({"top": -1}, "a window inside 321 rows and 2101 columns, got rows -1 to 4 and columns 0 to 5"),
        ({"left": 2097}, "columns 2097 to 2102"),
        ({"rows": 0}, "rows 0 to 0"),
        ({"layer": "depth"}, "a layer among height, normal, materials, got 'depth'"),
        ({"level": 9}, "a level from 0 to 4, got 9"),
    ):
        with pytest.raises(InputError, match=message):
            world.read(**{"layer": "height", "level": 0} | WINDOW | asked)


def test_a_missing_shard_is_named_and_not_read_as_fill_values(copy: Path) -> None:
    (copy / SHARD).unlink()
    world = open_world(copy)
    world.read("height", 0, top=0, left=0, rows=321, columns=2048)  # the other shard
    with pytest.raises(InputError, match=rf"copy.zarr/{SHARD}: is missing: the world is not finished, or"):
        whole(world)
    (copy / SHARD).mkdir()
    with pytest.raises(InputError, match=rf"copy.zarr/{SHARD}: broken"):
        whole(world)


def test_any_damaged_byte_of_a_shard_is_found(written: Path, copy: Path) -> None:
    content, world, rng = (written / SHARD).read_bytes(), open_world(copy), random.Random(5)
    index = range(len(content) - 1028, len(content))
    for place in [0, *rng.sample(range(len(content)), 40), *rng.sample(index, 20), len(content) - 1]:
        damaged = bytearray(content)
        damaged[place] ^= 1 << rng.randrange(8)
        (copy / SHARD).write_bytes(damaged)
        with pytest.raises(InputError, match=rf"copy.zarr/{SHARD}: broken .*--resume") as caught:
            whole(open_world(copy))
        assert "\n" not in str(caught.value)
    for size in (0, 1, 700, 1028, 3000, len(content) - 1):
        (copy / SHARD).write_bytes(content[:size])
        with pytest.raises(InputError, match=rf"copy.zarr/{SHARD}: broken"):
            whole(world)
    (copy / SHARD).write_bytes(content)  # mended while the world is open
    np.testing.assert_array_equal(whole(world), whole(open_world(written)))


def test_metadata_that_are_lost_or_broken_are_named(copy: Path) -> None:
    for name in ("zarr.json", "2/normal/zarr.json"):
        content = (copy / name).read_bytes()
        for damaged in (content[:300], b"[]", b""):
            (copy / name).write_bytes(damaged)
            with pytest.raises(InputError, match=f"copy.zarr/{name}: broken") as caught:
                open_world(copy)
            assert "\n" not in str(caught.value)
        root = json.loads((copy / "zarr.json").read_text() if name != "zarr.json" else content)
        root.pop("consolidated_metadata", None)  # as before the world is finished
        (copy / name).write_bytes(content)
        (copy / "zarr.json").write_text(json.dumps(root))
    (copy / "2/normal/zarr.json").unlink()
    with pytest.raises(InputError, match=r"copy.zarr/2/normal/zarr.json: is missing"):
        open_world(copy)


def test_an_array_that_another_program_wrote_anew_is_refused(copy: Path) -> None:
    group = zarr.open_group(copy, mode="a", use_consolidated=False)
    heights = group["1/height"][:]
    del group["1/height"]
    group["1"].create_array("height", data=heights, chunks=(64, 64))
    with pytest.warns(zarr.errors.ZarrUserWarning, match="not part in the Zarr format 3"):
        zarr.consolidate_metadata(copy)
    with pytest.raises(InputError, match=r"1/height/zarr.json: broken \(expected shape, shards and type"):
        open_world(copy)


def test_a_world_of_other_materials_and_another_compression_is_read(written: Path, copy: Path) -> None:
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


def test_a_root_that_describes_no_world_is_refused(copy: Path) -> None:
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
        with pytest.raises(InputError, match=message):
            open_world(copy)


def test_a_sketch_that_is_lost_or_broken_is_named(copy: Path) -> None:
    world = open_world(copy)
    chunk = copy / "sketch/c/0"
    chunk.write_bytes(chunk.read_bytes()[:-100])
    with pytest.raises(InputError, match=r"copy.zarr/sketch/c/0"):
        world.sketch()
    chunk.unlink()
    with pytest.raises(InputError, match=r"copy.zarr/sketch/c/0: is missing"):
        world.sketch()


def test_the_smallest_world_is_one_shard_of_four_vertices(tmp_path: Path) -> None:
    sketch, world = st.Sketch(name="Small", extent=64.0), World(0.0, 0.0, 0.5, 0.5, 1.0)
    recipe = cast("TerrainRecipe", None)
    store = ZarrStore(Job(sketch, recipe, world, tmp_path / "a.zarr", "zarr", ("height",)))
    store.create()
    (shard,) = world.shards()
    height = np.array([[1, 2], [3, 4]], np.float32)
    none = np.empty((0, 2, 2), np.uint8)
    store.write(Ground(shard, height, none, none))
    np.testing.assert_array_equal(whole(open_world(tmp_path / "a.zarr")), height)
    np.testing.assert_array_equal(zarr.open_array(tmp_path / "a.zarr/0/height", mode="r")[:], height)


def test_what_is_no_world_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a.zarr: no such file or folder, expected a world"):
        open_world(tmp_path / "a.zarr")
    with pytest.raises(InputError, match="no world"):
        open_world(tmp_path)
    zarr.create_group(tmp_path / "a.zarr", zarr_format=3)
    with pytest.raises(InputError, match=r"a.zarr: a Zarr store, but no world of sketchterrain's"):
        open_world(tmp_path / "a.zarr")
    zarr.create_array(tmp_path / "b.zarr", shape=(3,), dtype="u1", zarr_format=3)
    with pytest.raises(InputError, match=r"b.zarr/zarr.json: broken"):
        open_world(tmp_path / "b.zarr")
