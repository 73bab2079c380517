import json
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio
import xarray
import zarr

import sketchterrain as st
from sketchterrain.compute import ComputeContext
from sketchterrain.errors import SketchterrainError
from sketchterrain.world.grid import World
from sketchterrain.world.ground import Ground
from sketchterrain.world.job import Job
from sketchterrain.world.task_runner import TaskRunner
from sketchterrain.world.zarr_store import ZarrStore

ORIGIN = (500_000.0, 5_500_000.0)
WEST, SOUTH, EAST, NORTH, CELL = -40.0, 400.0, 2120.0, 700.0, 1.0  # two shards wide, two chunks high
LEDGER = '{"file": "…"}\n'


@pytest.fixture(scope="module")
def terrain() -> st.Terrain:
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
def job(terrain: st.Terrain, tmp_path_factory: pytest.TempPathFactory) -> Job:
    output = tmp_path_factory.mktemp("zarr") / "world.zarr"
    world = World(WEST, SOUTH, EAST, NORTH, CELL)
    layers = ("height", "normal", "materials")
    return Job(terrain.sketch, terrain.recipe, world, output, "zarr", layers, crs="EPSG:25832", origin=ORIGIN)


@pytest.fixture(scope="module")
def grounds(job: Job) -> list[Ground]:
    maker = TaskRunner(job, ComputeContext())
    return [maker.ground(shard) for shard in job.world.shards()]


@pytest.fixture(scope="module")
def written(job: Job, grounds: list[Ground]) -> Path:
    """The whole world."""
    store = ZarrStore(job)
    store.create()
    for ground in grounds:
        store.write(ground)
    assert store.join(progress=lambda _: None) == ()
    store.journal.write_text("…")
    store.close(LEDGER)
    return job.output


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_heights_are_the_terrains_to_the_bit_at_the_places_that_coordinates_tell(
    written: Path, job: Job, terrain: st.Terrain
) -> None:
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


def test_every_layer_of_every_shard_is_what_was_given(written: Path, grounds: list[Ground]) -> None:
    group = zarr.open_group(written, mode="r")
    assert {ground.shard.column for ground in grounds} == {0, 1}
    for ground in grounds:
        rows, columns = ground.height.shape
        top, left = ground.shard.row * 2048, ground.shard.column * 2048
        for layer in ("height", "normal", "materials"):
            array = group[f"{ground.shard.level}/{layer}"]
            part = array[..., top : top + rows, left : left + columns]
            np.testing.assert_array_equal(part, getattr(ground, layer))
    assert (group["0/materials"][:].sum(0, dtype=np.int64) == 255).all()


def test_arrays_are_sharded_in_chunks_of_256(written: Path) -> None:
    group = zarr.open_group(written, mode="r")
    for layer, first in (("height", ()), ("normal", (3,)), ("materials", (8,))):
        array = group[f"0/{layer}"]
        assert array.metadata.zarr_format == 3
        assert array.shards == (*first, 2048, 2048)
        assert array.chunks == (*first, 256, 256)
    assert np.isnan(group["0/height"].fill_value)  # what is lost is no sea level


def test_xarray_opens_levels_and_the_whole_tree(written: Path, grounds: list[Ground]) -> None:
    fine = grounds[-2]  # the last level's first shard
    with xarray.open_zarr(written, group="0") as level:
        assert set(level.coords) == {"x", "y", "spatial_ref"}
        assert dict(level.sizes) == {"y": 301, "x": 2161, "axis": 3, "material": 8}
        assert level["height"].sel(x=ORIGIN[0] + 3, y=ORIGIN[1] + 690).values == fine.height[10, 43]
        normal = level["normal"].isel(y=10, x=43).values
        assert np.linalg.norm(normal) == pytest.approx(1, abs=0.01)  # decoded to −1 … 1
        shares = level["materials"].isel(y=10).sum("material").values
        np.testing.assert_allclose(shares, 1, rtol=1e-12)
    with xarray.open_datatree(written, engine="zarr") as tree:
        assert set(tree.groups) == {"/", "/0", "/1", "/2", "/3", "/4"}
        assert tree["4/height"].dims == ("y", "x")


def test_the_root_tells_all_readers_what_it_is(written: Path, job: Job) -> None:
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
def test_every_way_of_georeferencing_says_the_same(written: Path, number: int) -> None:
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


def test_gdal_reads_it_from_3_13_on_and_says_what_it_lacks_before(written: Path) -> None:
    name = f'ZARR:"{written}":/0/height'
    version = tuple(int(part) for part in rasterio.__gdal_version__.split(".")[:2])
    if version < (3, 13):
        with pytest.raises(rasterio.RasterioIOError, match="sharding_indexed"):
            rasterio.open(name)
        return
    with rasterio.open(name) as file:
        assert file.crs.to_epsg() == 25832
        assert file.xy(0, 0) == (ORIGIN[0] + WEST, ORIGIN[1] + NORTH)


def test_consolidated_metadata_are_those_of_each_group_and_array(written: Path) -> None:
    root = json.loads((written / "zarr.json").read_text())
    members = root["consolidated_metadata"]["metadata"]
    paths = {str(path.parent.relative_to(written)) for path in written.rglob("zarr.json")} - {"."}
    assert set(members) == paths
    for name, member in members.items():
        own = json.loads((written / name / "zarr.json").read_text())
        if own["node_type"] == "group":
            inner = own["consolidated_metadata"].pop("metadata")
            assert member["consolidated_metadata"].pop("metadata") == {}
            assert {f"{name}/{each}": value for each, value in inner.items()}.items() <= members.items()
        assert member == own


def test_it_carries_its_sketch_and_its_ledger(written: Path, job: Job, tmp_path: Path) -> None:
    group = zarr.open_group(written, mode="r")
    assert bytes(group["ledger"][:]).decode() == LEDGER == ZarrStore(job).ledger_text()
    (tmp_path / "a.sketch").write_bytes(bytes(group["sketch"][:]))
    sketch = st.load_sketch(tmp_path / "a.sketch")
    assert (sketch.name, sketch.seed) == ("North-east", 5)
    np.testing.assert_array_equal(sketch.layers["mountain"], job.sketch.layers["mountain"])
    assert not ZarrStore(job).journal.exists()


def test_nothing_is_left_over_and_nothing_is_unknown_to_zarr(written: Path, job: Job) -> None:
    before = contents(written)
    named = {name for name in before if name.endswith("zarr.json") or "/c" in name}
    assert set(before) == named
    names = set(ZarrStore(job).create())
    shards = {name for name in before if name.split("/")[1:2] in [[layer] for layer in job.layers]}
    shards = {name for name in shards if "/c/" in name}
    assert names | shards | {"zarr.json", "ledger/zarr.json", "ledger/c/0"} == set(before)
    group = zarr.open_group(written, mode="r", use_consolidated=False)  # warns of what is no group or array
    assert {name for name, _ in group.members()} == {*"01234", "sketch", "ledger"}


def test_creating_it_again_writes_nothing_but_what_is_lost_or_other(written: Path, job: Job) -> None:
    whole = contents(written)
    changed = {"zarr.json", "0/height/zarr.json", "0/x/c/0", "sketch/c/0", "3/spatial_ref/c"}
    lost = {"1/zarr.json", "2/y/c/0", "ledger/zarr.json"}
    times = {name: (written / name).stat().st_mtime_ns for name in whole}
    for name in changed:
        (written / name).write_bytes(whole[name][:-1] + b"?")
    for name in lost:
        (written / name).unlink()
    ZarrStore(job).create()
    assert contents(written) == whole
    after = {name: (written / name).stat().st_mtime_ns for name in whole}
    assert {name for name in whole if after[name] != times[name]} == changed | lost


def test_before_it_is_closed_it_opens_too(job: Job, grounds: list[Ground], tmp_path: Path) -> None:
    store = ZarrStore(replace(job, output=tmp_path / "a.zarr"))
    names = store.create()
    assert store.mark.is_file()
    assert store.journal.parent.is_dir()
    assert store.ledger_text() is None
    assert all((store.folder / name).is_file() for name in names)
    store.journal.write_text("…")
    store.write(grounds[0])
    group = zarr.open_group(store.folder, mode="r")
    assert group["ledger"].shape == (0,)
    assert {name for name, _ in group.members()} == {*"01234", "sketch", "ledger"}
    np.testing.assert_array_equal(group["4/height"][:], grounds[0].height)


def test_whoever_writes_and_however_often_the_bytes_are_the_same(
    written: Path, job: Job, grounds: list[Ground], tmp_path: Path
) -> None:
    store = ZarrStore(replace(job, output=tmp_path / "a.zarr"))
    store.create()
    with ThreadPoolExecutor(3) as pool:  # each shard twice at once, from its end to its beginning
        list(pool.map(ZarrStore(store._job).write, [*grounds[::-1], *grounds]))
    store.close(LEDGER)
    assert contents(store.folder) == contents(written)


def test_a_broken_shard_is_replaced_by_a_whole_one(job: Job, grounds: list[Ground], tmp_path: Path) -> None:
    store = ZarrStore(replace(job, output=tmp_path / "a.zarr"))
    store.create()
    (name, *_) = store.write(grounds[0])
    whole = (store.folder / name).read_bytes()
    (store.folder / name).write_bytes(whole[:100] + b"?" * 300)
    store.write(grounds[0])
    assert (store.folder / name).read_bytes() == whole


def test_layers_that_nobody_asked_for_are_not_written(
    job: Job, grounds: list[Ground], tmp_path: Path
) -> None:
    store = ZarrStore(replace(job, output=tmp_path / "a.zarr", layers=("height",), crs=None, origin=(0, 0)))
    store.create()
    assert store.write(grounds[0]) == ("4/height/c/0/0",)
    store.close(LEDGER)
    with xarray.open_zarr(store.folder, group="4") as level:
        assert list(level) == ["height"]
        words = (level["spatial_ref"].attrs["crs_wkt"], level.attrs["proj:wkt2"])
    for crs in map(rasterio.CRS.from_wkt, words):  # metres that lie nowhere on Earth
        assert not crs.is_projected
        assert not crs.is_geographic


def test_what_the_system_refuses_is_one_line_and_leaves_no_file(
    job: Job, grounds: list[Ground], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = ZarrStore(replace(job, output=tmp_path / "a.zarr"))
    store.create()
    before = contents(store.folder)

    def full(_: int) -> None:
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(SketchterrainError, match=r"4/height/c/0/0: cannot be written \(No space left"):
        store.write(grounds[0])
    assert contents(store.folder) == before


def test_long_axes_are_chunks_of_coordinates(tmp_path: Path, job: Job) -> None:
    world = World(0.0, 0.0, 100_000.0, 10.0, 1.0)
    store = ZarrStore(replace(job, output=tmp_path / "a.zarr", world=world, origin=(0.0, 0.0)))
    names = store.create()
    assert {name for name in names if name.startswith("0/x/c")} == {"0/x/c/0", "0/x/c/1"}
    x = zarr.open_array(store.folder / "0/x", mode="r")[:]
    np.testing.assert_array_equal(x, np.arange(100_001))
