"""GeoTIFF worlds: seamless tiles, one file per layer, both read back as evaluated."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio
from numpy.typing import NDArray

import sketchterrain as st
from sketchterrain.errors import SketchterrainError
from sketchterrain.schema.materials import MATERIALS
from sketchterrain.world.geotiff_store import TiffStore, TileStore
from sketchterrain.world.grid import GridLevel, ShardData, World
from sketchterrain.world.job import Job
from sketchterrain.world.journal import check_world
from sketchterrain.world.run import run_world
from sketchterrain.world.stored_world import open_world
from tests.refusals import refused

EAST, NORTH = 512_000.0, 5_403_000.0
# Two shards each way, whose southern and eastern ones are a few vertices wide.
AREA = World(-30.0, 10.0, 2023.0, 2061.0, 1.0)


def height_at(x: NDArray, y: NDArray) -> NDArray[np.float32]:
    return (80.0 * np.sin(x[None, :] / 90.0) + 0.01 * y[:, None]).astype(np.float32)


def level_coordinates(level: GridLevel, world: World) -> tuple[NDArray, NDArray]:
    """Return x and y of a level's vertices."""
    x = world.west + np.arange(level.columns) * level.cell
    return x, world.north - np.arange(level.rows) * level.cell


def shards(world: World) -> Iterator[ShardData]:
    """Yield the shards of a synthetic terrain, the finest first."""
    for shard in sorted(world.shards()):
        level = world.levels[shard.level]
        rows, columns = level.size_of(shard)
        x, y = level_coordinates(level, world)
        left, top = 2048 * shard.column, 2048 * shard.row
        height = height_at(x[left : left + columns], y[top : top + rows])
        normal = np.stack([np.full(height.shape, value, np.uint8) for value in (1, 2, shard.level)])
        weights = np.zeros((len(MATERIALS), *height.shape), np.uint8)
        weights[0], weights[7] = 200, 55
        yield ShardData(shard, height, normal, weights)


@pytest.fixture(scope="module", params=["tiles", pytest.param("tif", marks=pytest.mark.slow)])
def synthetic_world(request, small_job: Job, tmp_path_factory) -> Job:
    """A world of a synthetic terrain in either form."""
    folder = tmp_path_factory.mktemp(request.param)
    output = folder / ("world" if request.param == "tiles" else "world.tif")
    job = replace(
        small_job, world=AREA, output=output, form=request.param, crs="EPSG:25832", origin=(EAST, NORTH)
    )
    store = (TileStore if request.param == "tiles" else TiffStore)(job)
    store.create()
    assert not job.layout.ledger.exists()
    for ground in shards(AREA):
        store.write(ground)
    shares: list[float] = []
    names = store.join(progress=shares.append)
    assert all((store.folder / name).is_file() for name in names)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    store.close("a ledger\n")
    assert job.layout.ledger.read_text() == "a ledger\n"
    assert not job.layout.journal.exists()
    return job


def joined(job: Job, layer: str) -> Path:
    """Return the file that has all of a layer."""
    if job.form == "tiles":
        return job.output / f"{layer}.vrt"
    return job.output if layer == "height" else job.output.with_name(f"world_{layer}.tif")


def test_gdal_reads_one_grid_across_all_borders(synthetic_world) -> None:
    x, y = level_coordinates(AREA.levels[0], AREA)
    with rasterio.open(joined(synthetic_world, "height")) as file:
        np.testing.assert_array_equal(file.read(1), height_at(x, y))
        assert file.xy(0, 0) == (EAST - 30.0, NORTH + 2061.0)
        assert file.xy(2051, 2053) == (EAST + 2023.0, NORTH + 10.0)
        assert (file.crs.to_epsg(), file.tags()["AREA_OR_POINT"]) == (25832, "Point")
        assert (file.descriptions, file.units) == (("height",), ("m",))
        across = file.read(1, window=((2040, 2052), (2040, 2054)))
    np.testing.assert_array_equal(across, height_at(x[2040:], y[2040:]))
    with rasterio.open(joined(synthetic_world, "normal")) as file:
        assert file.descriptions == ("east", "north", "up")
        assert [int(each.value) for each in file.colorinterp] == [3, 4, 5]  # red, green, blue
    with rasterio.open(joined(synthetic_world, "materials")) as file:
        assert file.descriptions == st.MATERIALS
        sums = file.read(window=((1900, 2052), (1900, 2054))).sum(axis=0, dtype=int)
        assert np.all(sums == 255)


def test_overviews_are_evaluated_levels(synthetic_world) -> None:
    for level in AREA.levels[1:]:
        x, y = level_coordinates(level, AREA)
        with rasterio.open(joined(synthetic_world, "height"), overview_level=level.number - 1) as file:
            shown = file.read(1)
            np.testing.assert_array_equal(shown, height_at(x, y))
        with rasterio.open(joined(synthetic_world, "normal"), overview_level=level.number - 1) as file:
            assert np.all(file.read(3) == level.number)
    with rasterio.open(joined(synthetic_world, "height")) as file:
        assert len(file.overviews(1)) == len(AREA.levels) - 1
    with rasterio.open(joined(synthetic_world, "normal")) as file:  # as a GIS zoomed out
        assert np.all(file.read(3, out_shape=(257, 257)) == 3)  # level 3 has that size


def test_every_level_is_read_back(synthetic_world) -> None:
    world = open_world(synthetic_world.output)
    assert (world.west, world.north, world.levels) == (AREA.west, AREA.north, AREA.levels)
    assert (world.layers, world.material_names) == (synthetic_world.layers, st.MATERIALS)
    sketch = world.sketch()
    assert sketch is not None
    assert sketch.extent == synthetic_world.sketch.extent
    for level in world.levels:
        x, y = level_coordinates(level, AREA)
        read = world.read("height", level.number, top=0, left=0, rows=level.rows, columns=level.columns)
        np.testing.assert_array_equal(read, height_at(x, y))
    part = world.read("materials", 0, top=2046, left=2045, rows=6, columns=9)
    assert part.shape == (len(MATERIALS), 6, 9)
    assert np.all(part.sum(axis=0, dtype=int) == 255)
    assert np.all(world.read("normal", 1, top=1000, left=1000, rows=20, columns=20)[2] == 1)


def test_threads_read_at_once(synthetic_world) -> None:
    world = open_world(synthetic_world.output)
    x, y = level_coordinates(AREA.levels[0], AREA)
    places = [(top, left) for top in range(0, 2000, 300) for left in range(0, 2000, 300)]

    def read(place: tuple[int, int]) -> NDArray:
        return world.read("height", 0, top=place[0], left=place[1], rows=50, columns=50)

    with ThreadPoolExecutor(4) as threads:
        for (top, left), found in zip(places, threads.map(read, places), strict=True):
            np.testing.assert_array_equal(found, height_at(x[left : left + 50], y[top : top + 50]))


def test_single_tile_is_cog_with_overviews(small_job, tmp_path) -> None:
    world = World(0.0, 0.0, 1023.0, 699.0, 1.0)
    store = TileStore(replace(small_job, world=world, output=tmp_path / "world", form="tiles"))
    store.create()
    for ground in shards(world):
        names = store.write(ground)
        if ground.shard.level == 0:
            height = ground.height
            break
    assert names == tuple(f"{layer}/level0/r0000_c0000.tif" for layer in ("height", "normal", "materials"))
    with rasterio.open(store.folder / names[0]) as file:
        assert file.overviews(1) == [4, 8]
        assert file.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
        np.testing.assert_array_equal(file.read(1), height)
        coarse = file.read(1, out_shape=(175, 256))
    np.testing.assert_allclose(coarse, height.reshape(175, 4, 256, 4).mean(axis=(1, 3)), atol=1e-4)


@pytest.mark.parametrize("form", ["tiles", pytest.param("tif", marks=pytest.mark.slow)])
def test_world_is_bit_equal_to_terrain(small_job, form: str, tmp_path, reporter, tree) -> None:
    output = tmp_path / ("world" if form == "tiles" else "world.tif")
    job = replace(small_job, output=output, form=form)
    run_world(job, reporter=reporter)
    terrain = st.build(job.sketch)
    for level in job.world.levels:
        x, y = level_coordinates(level, job.world)
        with rasterio.open(joined(job, "height"), **_overview(level)) as file:
            height = file.read(1)
        rows, columns = height.shape
        expected = terrain.heights(x[None, :columns], y[:rows, None], cell_size=level.cell)
        np.testing.assert_array_equal(height, expected)
    assert list(check_world(output, progress=lambda _: None)) == []
    written = tree(tmp_path)
    assert not [name for name in written if name.startswith(".")]
    # Missing or damaged files are rewritten to the same bytes.
    for name in [each for each in written if "normal" in each][:2]:
        path = tmp_path / name
        content = bytearray(path.read_bytes())
        content[len(content) // 2] ^= 1
        path.write_bytes(content)
    joined(job, "height").unlink()
    run_world(job, resume=True, reporter=reporter)
    assert reporter.found
    assert tree(tmp_path) == written


@pytest.mark.slow
def test_run_interrupted_while_joining_is_resumed(small_job, tmp_path, reporter, tree) -> None:
    class _StoppedError(Exception):
        pass

    def stop(share: float) -> None:
        if share > 0.3:  # the heights are whole, the normals are not
            raise _StoppedError

    job = replace(small_job, output=tmp_path / "a" / "world.tif", form="tif")
    other = replace(job, output=tmp_path / "b" / "world.tif")
    for each in (job, other):
        each.output.parent.mkdir()
    reporter.joined, calm = stop, reporter.joined
    with pytest.raises(_StoppedError):
        run_world(job, reporter=reporter)
    assert joined(job, "height").is_file()
    assert not joined(job, "normal").exists()
    reporter.joined = calm
    done = run_world(job, resume=True, reporter=reporter)
    assert done.computed == 0
    run_world(other, reporter=reporter)
    assert tree(tmp_path / "a") == tree(tmp_path / "b")


def _overview(level: GridLevel) -> dict[str, int]:
    return {"overview_level": level.number - 1} if level.number else {}


def test_missing_or_broken_tile_is_reported(small_job, tmp_path) -> None:
    world = World(0.0, 0.0, 699.0, 699.0, 1.0)
    store = TileStore(replace(small_job, world=world, output=tmp_path / "world", form="tiles"))
    store.create()
    refused("world: is not finished; world --resume completes it", open_world, store.folder)
    for ground in shards(world):
        store.write(ground)
    store.join(progress=lambda _: None)
    whole = {"top": 0, "left": 0, "rows": 700, "columns": 700}
    tile = store.folder / "height/level0/r0000_c0000.tif"
    content = bytearray(tile.read_bytes())
    content[-2000] ^= 0xFF
    tile.write_bytes(content)
    refused(r"height/level0/r0000_c0000.tif: broken", open_world(store.folder).read, "height", 0, **whole)
    tile.write_bytes(content[:3000])
    refused(r"height/level0/r0000_c0000.tif: broken", open_world(store.folder).read, "height", 0, **whole)
    tile.unlink()
    refused(r"height/level0/r0000_c0000.tif: is missing", open_world(store.folder).read, "height", 0, **whole)
    assert open_world(store.folder).read("normal", 0, **whole).shape == (3, 700, 700)


@pytest.mark.parametrize("form", ["tiles", "tif"])
def test_special_characters_in_world_names(small_job, form: str, tmp_path) -> None:
    world, name = World(0.0, 0.0, 299.0, 99.0, 1.0), "wo!rld & <größe> 100%.zip"
    (tmp_path / name).mkdir()
    output = tmp_path / name / (name if form == "tiles" else f"{name}.tif")
    job = replace(small_job, world=world, output=output, form=form, layers=("height",))
    store = (TileStore if form == "tiles" else TiffStore)(job)
    store.create()
    for ground in shards(world):
        store.write(ground)
    (*_, top) = store.join(progress=lambda _: None)
    store.close("")
    expected = height_at(*level_coordinates(world.levels[0], world))
    with rasterio.open(store.folder / top) as file:
        np.testing.assert_array_equal(file.read(1), expected)
        assert len(file.overviews(1)) == 1
    with rasterio.open(store.folder / top, overview_level=0) as file:
        coarse = height_at(*level_coordinates(world.levels[1], world))
        np.testing.assert_array_equal(file.read(1), coarse[: file.height, : file.width])
    read = open_world(output).read("height", 0, top=0, left=0, rows=100, columns=300)
    np.testing.assert_array_equal(read, expected)


def test_invalid_worlds_are_refused(tmp_path) -> None:
    (tmp_path / "empty").mkdir()
    refused(r"empty: expected a world, with zarr.json or height.vrt", open_world, tmp_path / "empty")
    (tmp_path / "text.tif").write_text("no picture")
    refused(r"text.tif: broken \(", open_world, tmp_path / "text.tif")
    profile = {"driver": "GTiff", "width": 2, "height": 2, "count": 1, "dtype": "uint8"}
    with rasterio.open(tmp_path / "other.tif", "w", **profile, transform=rasterio.Affine.scale(2.0, -2.0)):
        pass
    refused(r"other.tif: expected the heights of a world", open_world, tmp_path / "other.tif")


def test_failed_join_leaves_no_file(small_job, tmp_path, file_size_limit) -> None:
    world = World(0.0, 0.0, 299.0, 299.0, 1.0)
    job = replace(small_job, world=world, output=tmp_path / "world.tif", form="tif", layers=("height",))
    store = TiffStore(job)
    store.create()
    noise = np.random.default_rng(1)
    made = [
        replace(each, height=noise.normal(size=each.height.shape).astype(np.float32))
        for each in shards(world)
    ]
    with (
        file_size_limit(4000),
        pytest.raises(SketchterrainError, match=r"r0000_c0000.tif: cannot be written"),
    ):
        store.write(made[0])
    for ground in made:
        names = store.write(ground)
    with file_size_limit(200_000), pytest.raises(SketchterrainError, match=r"world.tif: cannot be written"):
        store.join(progress=lambda _: None)
    assert [path.name for path in tmp_path.iterdir()] == [".world.tif.parts"]
    (tmp_path / names[0]).write_bytes(b"II*\0")
    with pytest.raises(SketchterrainError, match=r"world.tif: cannot be written \(.*r0000_c0000.tif"):
        store.join(progress=lambda _: None)
    (tmp_path / names[0]).unlink()
    with pytest.raises(SketchterrainError, match=r"world.tif: cannot be written \(.*_c0000.tif: No such"):
        store.join(progress=lambda _: None)
    assert not list(tmp_path.rglob("*.tmp"))
    assert not job.output.exists()
