"""Plants of a world: complete, unique, in files that GIS and data tools read."""

import json
from dataclasses import replace
from itertools import islice
from types import SimpleNamespace

import numpy as np
import pyarrow.dataset
import pyarrow.parquet
import pyogrio
import pytest
import shapely

import sketchterrain as st
from sketchterrain.errors import DeviceFailedError, SketchterrainError
from sketchterrain.vegetation.plants import PLANT
from sketchterrain.world import plants as written
from sketchterrain.world.grid import SHARD, World
from sketchterrain.world.job import Task, plant_tasks
from sketchterrain.world.plants import PlantStore, plant_square
from sketchterrain.world.task_runner import plant_store

EAST, NORTH = 512_000.0, 5_403_000.0
CELL = 1.0 / 32.0
# Three squares by two in the forest; the last column and row of them are narrow.
AREA = World(60.0, 100.0, 63.0 + 2 * SHARD * CELL, 101.0 + SHARD * CELL, CELL)


@pytest.fixture(scope="module")
def terrain(small_job):
    return st.build(small_job.sketch)


@pytest.fixture(scope="module")
def parquet(small_job, terrain, tmp_path_factory):
    """A job, and the file of each of its squares."""
    return write_plants(tmp_path_factory.mktemp("parquet") / "world.tif", "parquet", small_job, terrain)


@pytest.fixture(scope="module")
def flatgeobuf(small_job, terrain, tmp_path_factory):
    output = tmp_path_factory.mktemp("flatgeobuf") / "world.zarr"
    return write_plants(output, "flatgeobuf", small_job, terrain)


@pytest.fixture(scope="module", params=["parquet", "flatgeobuf"])
def planted(request):
    return request.getfixturevalue(request.param)


def write_plants(output, plants, small_job, terrain, *, count=None):
    changes = {"plants": plants, "grass": True, "crs": "EPSG:25832", "origin": (EAST, NORTH)}
    job = replace(small_job, world=AREA, output=output, **changes)
    store = PlantStore(job)
    files = {}
    for task in islice(plant_tasks(job), count):
        (name,) = store.write(task, terrain)
        files[task] = store.folder / name
    return job, files


@pytest.fixture(scope="module")
def expected(terrain):
    """All plants of the rectangle, found at once."""
    area = (AREA.west, AREA.south, AREA.east, AREA.north)
    return np.concatenate([terrain.foliage(*area, storey=storey) for storey in ("woody", "grass")])


def read_plants(path):
    """Read a file's plants, whichever form it has."""
    if path.suffix == ".parquet":
        table = pyarrow.parquet.ParquetFile(path).read()
        found = {name: table[name].to_numpy() for name in table.column_names}
        geometry = found.pop("geometry")
    else:
        meta, _, geometry, fields = pyogrio.raw.read(path)
        found = dict(zip(meta["fields"], fields, strict=True))
    places = shapely.get_coordinates(shapely.from_wkb(geometry), include_z=True)
    for axis, name in enumerate("xyz"):
        if name in found:  # what a column says, the point says too
            np.testing.assert_array_equal(found[name], places[:, axis])
    return found | dict(zip("xyz", places.T, strict=True))


def joined(files):
    parts = [read_plants(path) for path in files.values()]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def test_shard_of_one_column_has_no_plants(small_job) -> None:
    for across, squares in ((SHARD - 1, 1), (SHARD, 1), (SHARD + 1, 2)):
        job = replace(small_job, plants="parquet", world=World(0.0, 0.0, float(across), 1.0, 1.0))
        assert list(plant_tasks(job)) == [Task("plants", 0, 0, column) for column in range(squares)]


def test_plants_are_complete_and_unique(planted, expected) -> None:
    _, files = planted
    assert len(files) == 6
    found = joined(files)
    order = np.lexsort((found["x"], found["y"]))
    wanted = np.lexsort((expected["x"], expected["y"]))
    assert len(order) == len(wanted) > 1000
    plants = expected[wanted]
    np.testing.assert_array_equal(found["x"][order], plants["x"] + EAST)
    np.testing.assert_array_equal(found["y"][order], plants["y"] + NORTH)
    np.testing.assert_array_equal(found["z"][order], plants["z"])
    np.testing.assert_array_equal(found["species"][order], np.array(st.SPECIES)[plants["species"]])
    for name in ("scale", "tint", "level"):
        np.testing.assert_array_equal(found[name][order], plants[name])
    np.testing.assert_allclose(found["rotation"][order], np.degrees(plants["rotation"]), rtol=1e-6)
    for axis, name in enumerate(("nx", "ny", "nz")):
        np.testing.assert_array_equal(found[name][order], plants["normal"][:, axis])


def test_squares_contain_own_plants_with_reproducible_bytes(planted, small_job, terrain, tmp_path) -> None:
    job, files = planted
    _, again = write_plants(tmp_path / "world.zarr", job.plants, small_job, terrain, count=2)
    for task, path in files.items():
        west, south, east, north = plant_square(AREA, task.row, task.column)
        found = read_plants(path)
        assert np.all((found["x"] - EAST >= west) & (found["x"] - EAST < east))
        assert np.all((found["y"] - NORTH >= south) & (found["y"] - NORTH < north))
        assert task not in again or path.read_bytes() == again[task].read_bytes()


def test_parquet_is_partitioned_data_set(parquet, expected) -> None:
    job, files = parquet
    folder = job.output.with_name("world-plants")
    assert files[Task("plants", 0, 1, 2)] == folder / "tile_row=1/tile_column=2/plants.parquet"
    data = pyarrow.dataset.dataset(folder, partitioning="hive")
    assert data.count_rows() == len(expected)
    part = data.to_table(filter=pyarrow.dataset.field("tile_column") == 1)
    assert set(part["tile_row"].to_pylist()) == {0, 1}
    west, _, east, _ = plant_square(AREA, 0, 1)
    assert west <= min(part["x"].to_pylist()) - EAST < max(part["x"].to_pylist()) - EAST < east
    message = json.loads(pyarrow.parquet.read_metadata(files[Task("plants", 0, 0, 0)]).metadata[b"geo"])
    assert (message["version"], message["primary_column"]) == ("1.1.0", "geometry")
    column = message["columns"]["geometry"]
    assert (column["encoding"], column["geometry_types"]) == ("WKB", ["Point Z"])
    assert column["crs"]["id"] == {"authority": "EPSG", "code": 25832}
    found = read_plants(files[Task("plants", 0, 0, 0)])
    low, high = ([end(found[name]) for name in "xyz"] for end in (np.min, np.max))
    assert column["bbox"] == [*low, *high]
    assert job.origin == (EAST, NORTH)


def test_row_groups_are_bounded_with_statistics(small_job, terrain, expected, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(written, "_ROWS", 200)
    _, files = write_plants(tmp_path / "world.zarr", "parquet", small_job, terrain)
    counted = 0
    for path in files.values():
        file = pyarrow.parquet.ParquetFile(path)
        groups = [file.metadata.row_group(index) for index in range(file.metadata.num_row_groups)]
        assert all(group.num_rows == 200 for group in groups[:-1])
        for index, group in enumerate(groups):
            x = file.read_row_group(index)["x"].to_numpy()
            message = group.column(file.schema_arrow.get_field_index("x")).statistics
            assert (message.min, message.max) == (x.min(), x.max())
            counted += group.num_rows
    assert counted == len(expected)


def test_flatgeobuf_has_spatial_index(flatgeobuf) -> None:
    job, files = flatgeobuf
    path = files[Task("plants", 0, 0, 1)]
    assert path == job.output.with_name("world-plants") / "r0000_c0001.fgb"
    info = pyogrio.read_info(path)
    assert (info["layer_name"], info["geometry_type"], info["crs"]) == ("plants", "Point Z", "EPSG:25832")
    assert info["capabilities"]["fast_spatial_filter"]
    found = read_plants(path)
    west, south = np.median(found["x"]), np.median(found["y"])
    box = (west, south, west + 20.0, south + 20.0)
    inside = (found["x"] >= west) & (found["x"] <= box[2]) & (found["y"] >= south) & (found["y"] <= box[3])
    _, _, geometry, _ = pyogrio.raw.read(path, bbox=box)
    assert len(geometry) == inside.sum() > 0


def fake_terrain(*pieces, then=None):
    """Return a terrain with these plants."""

    def foliage_pieces(*_, storey):
        assert storey == "woody"
        yield from pieces
        if then is not None:
            raise then

    return SimpleNamespace(species_names=st.SPECIES, foliage_pieces=foliage_pieces)


@pytest.mark.parametrize("plants", ["parquet", "flatgeobuf"])
def test_empty_squares_failures_and_names(small_job, plants, tmp_path, file_size_limit, monkeypatch) -> None:
    task = Task("plants", 0, 0, 0)

    def files_in(folder):
        return [path.name for path in folder.rglob("*") if path.is_file()]

    store = PlantStore(replace(small_job, plants=plants, output=tmp_path / "world.zarr"))
    failed = DeviceFailedError("it gave up")
    with pytest.raises(DeviceFailedError) as caught:
        store.write(task, fake_terrain(np.zeros(5, PLANT), then=failed))
    assert caught.value is failed
    many = np.zeros(20_000, PLANT)
    many["x"], many["tint"] = np.random.default_rng(1).random((2, len(many)))
    with file_size_limit(50_000), pytest.raises(SketchterrainError, match=r"cannot be written \("):
        store.write(task, fake_terrain(many))
    assert not files_in(store.folder)

    for terrain in (fake_terrain(), fake_terrain(np.zeros(0, PLANT))):
        (name,) = store.write(task, terrain)
        found = read_plants(store.folder / name)
        assert {"x", "species", "tint"} <= set(found)
        assert all(len(values) == 0 for values in found.values())

    for name in ("wo!rld", "a world.zip", "größe 100%"):
        store = PlantStore(replace(small_job, plants=plants, output=tmp_path / name / f"{name}.zarr"))
        (file,) = store.write(task, fake_terrain(np.zeros(3, PLANT)))
        assert files_in(store.folder) == [file.split("/")[-1]]

    monkeypatch.setattr("sketchterrain.world.job.find_spec", lambda name: None)
    with pytest.raises(SketchterrainError, match=f"plants as {plants} needs pyarrow"):
        plant_store(replace(small_job, plants=plants, form="tiles"))
