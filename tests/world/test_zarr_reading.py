"""Reading needs no terrain: what is written are numbers that walk at random."""

from __future__ import annotations

import json
import random
import shutil
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest
import zarr
from numcodecs import blosc
from zarr.codecs import BloscCodec, Crc32cCodec

import sketchterrain as st
from sketchterrain.errors import InputError
from sketchterrain.world.grid import World
from sketchterrain.world.ground import Ground
from sketchterrain.world.job import Job
from sketchterrain.world.opening import open_world
from sketchterrain.world.zarr_reading import StoredZarr
from sketchterrain.world.zarr_store import ZarrStore

if TYPE_CHECKING:
    from pathlib import Path

    from sketchterrain.terrain.recipe import TerrainRecipe

WORLD = World(-10.0, 0.0, 2090.0, 320.0, 1.0)
SHARD = "0/height/c/0/1"


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


def whole(world: StoredZarr, layer: str = "height", level: int = 0) -> np.ndarray:
    grid = world.levels[level]
    return world.read(layer, level, top=0, left=0, rows=grid.rows, columns=grid.columns)


def test_it_knows_what_it_holds(written: Path) -> None:
    world = open_world(written)
    assert (world.west, world.north) == (-10.0, 320.0)
    assert world.levels == WORLD.levels
    assert world.layers == ("height", "normal", "materials")
    assert world.material_names[:2] == ("grass", "soil")
    sketch = world.sketch()
    assert sketch is not None
    assert (sketch.name, sketch.seed) == ("Flat", 7)


def test_windows_are_what_zarr_reads(written: Path) -> None:
    world, group, rng = StoredZarr(written), zarr.open_group(written, mode="r"), random.Random(1)
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


def test_a_window_is_its_readers_to_change(written: Path) -> None:
    world = StoredZarr(written)
    first = world.read("height", 0, top=0, left=0, rows=5, columns=5)
    first[:] = 0
    again = world.read("height", 0, top=0, left=0, rows=5, columns=5)
    assert (again != 0).any()


def test_a_chunk_is_unpacked_once_for_windows_inside_it(
    written: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    unpacked, unpack = [], blosc.decompress
    monkeypatch.setattr(blosc, "decompress", lambda content: unpacked.append(1) or unpack(content))
    world = StoredZarr(written)
    for place in range(0, 191, 10):
        world.read("height", 0, top=place, left=place, rows=65, columns=65)
    assert len(unpacked) == 1


def test_what_is_kept_is_bounded(written: Path) -> None:
    world = StoredZarr(written, room=1 << 20)
    for layer in world.layers:
        whole(world, layer)
    assert world._chunks.taken <= 1 << 20


def test_threads_may_read_at_once(written: Path) -> None:
    world = StoredZarr(written, room=1 << 19)
    expected = whole(StoredZarr(written))

    def right(seed: int) -> bool:
        rng = random.Random(seed)
        top, left = rng.randrange(321 - 65), rng.randrange(2101 - 65)
        window = world.read("height", 0, top=top, left=left, rows=65, columns=65)
        return np.array_equal(window, expected[top : top + 65, left : left + 65])

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(right, range(100)))


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"top": -1}, "a window inside 321 rows and 2101 columns, got rows -1 to 4 and columns 0 to 5"),
        ({"left": 2097}, "columns 2097 to 2102"),
        ({"rows": 0}, "rows 0 to 0"),
    ],
)
def test_a_window_that_is_not_inside_is_refused(written: Path, asked: dict[str, int], message: str) -> None:
    with pytest.raises(InputError, match=message):
        StoredZarr(written).read("height", 0, **({"top": 0, "left": 0, "rows": 5, "columns": 5} | asked))


def test_a_layer_or_a_level_that_is_not_there_is_refused(written: Path) -> None:
    world = StoredZarr(written)
    with pytest.raises(InputError, match="a layer among height, normal, materials, got 'depth'"):
        whole(world, "depth")
    with pytest.raises(InputError, match="a level from 0 to 4, got 9"):
        world.read("height", 9, top=0, left=0, rows=1, columns=1)


def test_a_missing_shard_is_named_and_is_no_hole_of_nan(copy: Path) -> None:
    (copy / SHARD).unlink()
    world = StoredZarr(copy)
    world.read("height", 0, top=0, left=0, rows=321, columns=2048)  # the other shard
    with pytest.raises(InputError, match=rf"copy.zarr/{SHARD}: is not there: the world is not finished, or"):
        whole(world)


@pytest.mark.parametrize("where", ["chunk", "index"])
def test_a_broken_shard_is_named(copy: Path, where: str) -> None:
    content = bytearray((copy / SHARD).read_bytes())
    content[50 if where == "chunk" else -50] ^= 4
    (copy / SHARD).write_bytes(content)
    message = rf"copy.zarr/{SHARD}: broken: its checksum is wrong; .*--resume"
    with pytest.raises(InputError, match=message) as caught:
        whole(StoredZarr(copy))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("left", [0, 700, -1])
def test_a_shard_that_is_cut_off_is_named(copy: Path, left: int) -> None:
    content = (copy / SHARD).read_bytes()
    (copy / SHARD).write_bytes(content[:left])
    with pytest.raises(InputError, match=rf"copy.zarr/{SHARD}: broken: "):
        whole(StoredZarr(copy))


def test_a_shard_that_is_mended_meanwhile_is_read_again(written: Path, copy: Path) -> None:
    (copy / SHARD).write_bytes((copy / "0/height/c/0/0").read_bytes()[::-1])
    world = StoredZarr(copy)
    with pytest.raises(InputError):
        whole(world)
    (copy / SHARD).unlink()
    shutil.copyfile(written / SHARD, copy / SHARD)
    np.testing.assert_array_equal(whole(world), whole(StoredZarr(written)))


def test_a_folder_in_place_of_a_shard_is_one_line(copy: Path) -> None:
    (copy / SHARD).unlink()
    (copy / SHARD).mkdir()
    with pytest.raises(InputError, match=rf"{SHARD}: cannot be read \(Is a directory\)"):
        whole(StoredZarr(copy))


@pytest.mark.parametrize("name", ["2/normal/zarr.json", "0/height/zarr.json"])
def test_lost_or_broken_metadata_are_named(copy: Path, name: str) -> None:
    content = (copy / name).read_bytes()
    (copy / name).unlink()
    with pytest.raises(InputError, match=f"copy.zarr/{name}: is not there"):
        open_world(copy)
    (copy / name).write_bytes(content[:300])
    with pytest.raises(InputError, match=f"copy.zarr/{name}: broken: no JSON"):
        open_world(copy)
    (copy / name).write_bytes(b"[]")
    with pytest.raises(InputError, match=f"copy.zarr/{name}: broken: expected an object"):
        open_world(copy)


def test_an_array_that_another_program_wrote_anew_is_refused(copy: Path) -> None:
    group = zarr.open_group(copy, mode="a", use_consolidated=False)
    heights = group["1/height"][:]
    del group["1/height"]
    group["1"].create_array("height", data=heights, chunks=(64, 64))
    with pytest.raises(InputError, match=r"1/height/zarr.json: its chunk_grid is not that of this world"):
        open_world(copy)


def test_a_world_of_other_materials_and_packed_otherwise_is_read(written: Path, copy: Path) -> None:
    """As another version may write it."""
    root = json.loads((copy / "zarr.json").read_text())
    root["attributes"]["sketchterrain"]["materials"] = ["grass", "lava"]
    (copy / "zarr.json").write_text(json.dumps(root))
    world = StoredZarr(written)
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
    other = StoredZarr(copy)
    assert other.material_names == ("grass", "lava")
    np.testing.assert_array_equal(whole(other, "materials"), whole(world, "materials")[:2])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": 2}, "expected a world of format 1, got 2"),
        ({"world": {"west": 0}}, "does not say what the world holds"),
        ({"layers": ["depth"]}, "does not say what the world holds"),
        ({"world": {"west": 0, "south": 0, "east": -1, "north": 1, "cell": 1}}, "west < east"),
        ({"world": dict.fromkeys(("west", "south", "east", "north", "cell"), "?")}, "does not say"),
    ],
)
def test_a_root_that_tells_other_things_is_refused(copy: Path, change: dict, message: str) -> None:
    root = json.loads((copy / "zarr.json").read_text())
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
    with pytest.raises(InputError, match=r"copy.zarr/sketch/c/0: is not there"):
        world.sketch()


def test_the_smallest_world_is_one_shard_of_four_vertices(tmp_path: Path) -> None:
    sketch, world = st.Sketch(name="Small", extent=64.0), World(0.0, 0.0, 0.5, 0.5, 1.0)
    store = ZarrStore(
        Job(sketch, cast("TerrainRecipe", None), world, tmp_path / "a.zarr", "zarr", ("height",))
    )
    store.create()
    (shard,) = world.shards()
    height = np.array([[1, 2], [3, 4]], np.float32)
    none = np.empty((0, 2, 2), np.uint8)
    store.write(Ground(shard, height, none, none))
    read = StoredZarr(tmp_path / "a.zarr")
    np.testing.assert_array_equal(whole(read), height)
    np.testing.assert_array_equal(zarr.open_array(tmp_path / "a.zarr/0/height", mode="r")[:], height)


def test_another_zarr_store_is_no_world(tmp_path: Path) -> None:
    zarr.create_array(tmp_path / "a.zarr", shape=(3,), dtype="u1", zarr_format=3)
    with pytest.raises(InputError, match=r"a.zarr: a Zarr store, but no world of sketchterrain's"):
        open_world(tmp_path / "a.zarr")


def test_what_is_no_world_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a.zarr: no such file or folder, expected a world"):
        open_world(tmp_path / "a.zarr")
    with pytest.raises(InputError, match="no world"):
        open_world(tmp_path)
