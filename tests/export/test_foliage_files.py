"""Plants as a table and as a cloud, read by independent readers; which files are written, in which pieces."""

import csv
import shutil
import time
import tracemalloc
from collections import namedtuple
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from itertools import pairwise
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import plyfile
import pytest
import trimesh

import sketchterrain as st
from sketchterrain.errors import InputError, SketchterrainError
from sketchterrain.export import FoliageFiles, check_room, write_foliage
from sketchterrain.export.foliage_files import ROW_BYTES, VERTEX, plant_cloud, plant_table
from sketchterrain.terrain.plant import PLANT, SPECIES, STOREYS

Plants = Callable[[int], np.ndarray]
AREA = (100.0, 200.0, 500.0, 1000.0)
KINDS = ("csv", "ply", "both", "none")
ROOT = Path(__file__).parents[2]
COLUMNS = ["x", "y", "z", "species", "scale", "rotation", "tint", "normal_x", "normal_y", "normal_z"]
PROPERTIES = ["x", "y", "z", "nx", "ny", "nz", "scale", "rotation", "tint", "level", "species"]
WRITERS: dict[str, Callable[..., AbstractContextManager[Callable[[np.ndarray], None]]]] = {
    "csv": plant_table,
    "ply": plant_cloud,
}


def written(folder: Path, kind: str, *pieces: np.ndarray, species: tuple[str, ...] = SPECIES) -> Path:
    path = folder / f"foliage.{kind}"
    with WRITERS[kind](path, species) as add:
        for piece in pieces:
            add(piece)
    return path


def read(path: Path) -> plyfile.PlyData:
    return plyfile.PlyData.read(path, mmap=False)


def assert_same(vertices: np.ndarray, plants: np.ndarray) -> None:
    for name in ("x", "y", "z", "scale", "rotation", "tint", "level", "species"):
        np.testing.assert_array_equal(vertices[name], plants[name])
    for axis, name in enumerate(("nx", "ny", "nz")):
        np.testing.assert_array_equal(vertices[name], plants["normal"][:, axis])


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="ascii") as stream:
        return list(csv.DictReader(stream))


def test_each_plant_is_a_line_in_order_on_the_ground(tmp_path: Path, terrain: st.Terrain) -> None:
    plants = terrain.foliage(0.0, 0.0, *terrain.size)
    assert len(plants) > 100
    rows = rows_of(written(tmp_path, "csv", plants))
    assert list(rows[0]) == COLUMNS
    assert [row["species"] for row in rows] == [terrain.species_names[i] for i in plants["species"]]
    fields = {name: plants[name] for name in ("x", "y", "z", "scale", "rotation", "tint")}
    fields |= {name: plants["normal"][:, axis] for axis, name in enumerate(COLUMNS[-3:])}
    for name, field in fields.items():
        half = 0.00005 if name == "rotation" or name.startswith("normal") else 0.0005
        read = np.array([float(row[name]) for row in rows])
        np.testing.assert_allclose(read, field, rtol=1e-7, atol=1.001 * half)

    x, y, z = (np.array([float(row[name]) for row in rows]) for name in "xyz")
    east, north = terrain.size
    assert ((x >= 0) & (x <= east) & (y >= 0) & (y <= north)).all()
    # The positions are rounded to the millimetre; the ground is nowhere steeper than 20 to 1.
    np.testing.assert_allclose(z, terrain.heights(x, y), rtol=0, atol=0.02)


def test_numbers_have_fixed_decimals_and_bounded_length(tmp_path: Path) -> None:
    plant = (1e6 + 1 / 3, 2.0, -1e-5, (0.6, -0.0, 0.8), 1, 3, 1.25, 6.28318, 0.5)
    path = written(tmp_path, "csv", np.array([plant], PLANT), species=("fir", "oak"))
    line = "1000000.333,2.000,0.000,oak,1.250,6.2832,0.500,0.6000,0.0000,0.8000"
    assert path.read_text(encoding="ascii").splitlines()[1] == line

    plant = (-999999.999, -999999.999, -9999.9999, (-1, -1, 1), 0, 0, 1.25, 6.28318, 1.0)
    path = written(tmp_path, "csv", np.array([plant], PLANT))
    assert len(path.read_bytes().splitlines(keepends=True)[1]) <= ROW_BYTES

    path = written(tmp_path, "csv", species=("fir",))
    assert path.read_text(encoding="ascii") == ",".join(COLUMNS) + "\n"


def test_every_bit_of_a_plant_is_in_the_cloud_for_independent_readers(tmp_path: Path, plants: Plants) -> None:
    some = plants(100_003)
    path = written(tmp_path, "ply", some)
    cloud = read(path)
    assert (cloud.text, cloud.byte_order) == (False, "<")
    vertices = cloud["vertex"].data
    assert list(vertices.dtype.names) == PROPERTIES
    assert VERTEX.itemsize == 46
    assert_same(vertices, some)
    assert [line for line in cloud.comments if line.startswith("species")] == [
        f"species {code} {name}" for code, name in enumerate(SPECIES)
    ]
    places = np.stack([some["x"], some["y"], some["z"]], axis=-1)
    np.testing.assert_array_equal(trimesh.load(path).vertices, places)
    np.testing.assert_array_equal(meshio.read(path).points, places)

    page = (ROOT / "docs/foliage_files.md").read_text(encoding="utf-8")
    names: dict[str, Any] = {}
    exec(page.split("```python\n")[1].split("```")[0], names)  # noqa: S102
    vertices, species = names["read_plants"](path)
    assert_same(vertices, some)
    assert tuple(species) == SPECIES


def test_plants_in_pieces_are_the_same_file(tmp_path: Path, plants: Plants) -> None:
    lengths = set()
    for count in [0, 1, 9, 10, 4096, 4097, 70_001]:
        some = plants(count)
        pieces = np.split(some, sorted(np.random.default_rng(count).integers(0, count + 1, 4)))
        for kind in WRITERS:
            whole = written(tmp_path, kind, some).read_bytes()
            assert written(tmp_path, kind, *pieces).read_bytes() == whole, (kind, count)
            if kind == "csv":
                assert whole.count(b"\n") == count + 1
            else:
                assert len(read(tmp_path / "foliage.ply")["vertex"].data) == count
                lengths.add(len(whole) - 46 * count)
    assert len(lengths) == 1  # the header is equally long for any count
    assert "species 5 grass" in read(written(tmp_path, "ply")).comments


def test_an_interrupt_a_missing_folder_and_non_finite_numbers_leave_no_partial_file(
    tmp_path: Path, plants: Plants
) -> None:
    for kind, write in WRITERS.items():
        old = written(tmp_path, kind, plants(3)).read_bytes()
        for after in [0, 1, 20_000]:

            def interrupted(after: int = after, kind: str = kind, write: Any = write) -> None:
                with write(tmp_path / f"foliage.{kind}", SPECIES) as add:
                    add(plants(after))
                    raise KeyboardInterrupt

            with pytest.raises(KeyboardInterrupt):
                interrupted()
            assert (tmp_path / f"foliage.{kind}").read_bytes() == old, (kind, after)
        with pytest.raises(SketchterrainError, match=rf"foliage\.{kind}: cannot be written \(No such file"):
            written(tmp_path / "no", kind)
    some = plants(10)
    some["tint"][3] = np.nan
    with pytest.raises(InputError, match=r"finite numbers .* got nan"):
        written(tmp_path, "csv", some)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["foliage.csv", "foliage.ply"]


@pytest.mark.slow
def test_a_million_lines_take_seconds(tmp_path: Path, plants: Plants) -> None:
    some = plants(1_000_000)
    start = time.perf_counter()
    written(tmp_path, "csv", some)
    assert time.perf_counter() - start < 5


@pytest.mark.slow
def test_ten_million_plants_take_seconds_and_a_few_megabytes(tmp_path: Path, plants: Plants) -> None:
    some = plants(200_000)
    first, count = some.copy(), 0
    tracemalloc.start()
    start = time.perf_counter()
    with plant_cloud(tmp_path / "foliage.ply", SPECIES) as add:
        for turn in range(50):
            some["x"] = first["x"] + 4096.0 * turn
            add(some)
            count += len(some)
    seconds, (_, most) = time.perf_counter() - start, tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert count == 10_000_000
    assert seconds < 30
    assert most < 32 << 20
    header = (tmp_path / "foliage.ply").stat().st_size - 46 * count
    vertices = np.memmap(tmp_path / "foliage.ply", VERTEX, "r", header, (count,))
    assert_same(vertices[-len(some) :], some)
    with (tmp_path / "foliage.ply").open("rb") as file:
        assert b"\nelement vertex 10000000\n" in file.read(header)


class Plantation:
    """So many plants of each storey in so many pieces, from south to north; some pieces are empty."""

    species_names = SPECIES

    def __init__(self, woody: int = 0, grass: int = 0, pieces: int = 5) -> None:
        self._count = {"woody": woody, "grass": grass}
        self._pieces = pieces
        self.asked: list[str] = []

    def foliage_estimate(
        self, west: float, south: float, east: float, north: float, *, storey: str
    ) -> tuple[int, int]:
        assert (west, south, east, north) == AREA
        return 2 * self._count[storey], 2 * self._count[storey] * PLANT.itemsize

    def foliage_pieces(
        self, west: float, south: float, east: float, north: float, *, storey: str
    ) -> Iterator[np.ndarray]:
        self.asked.append(storey)
        ends = np.linspace(0, self._count[storey], self._pieces + 1).astype(int)
        for number, (first, end) in enumerate(pairwise(ends)):
            yield np.zeros(0, PLANT)
            random = np.random.default_rng(number)
            plants = np.zeros(end - first, PLANT)
            plants["x"] = random.uniform(west, east, len(plants))
            plants["y"] = south + (north - south) * (np.arange(first, end) + 0.5) / self._count[storey]
            plants["normal"][:, 2] = 1.0
            codes = [SPECIES.index(name) for name in STOREYS[storey]]
            plants["species"] = random.choice(codes, len(plants))
            yield plants


def vertices(folder: Path) -> np.ndarray:
    content = (folder / "foliage.ply").read_bytes()
    return np.frombuffer(content.split(b"end_header\n", 1)[1], VERTEX)


def lines(folder: Path) -> list[str]:
    return (folder / "foliage.csv").read_text(encoding="ascii").splitlines()[1:]


def test_only_the_requested_files_are_written_and_contradictions_refused(tmp_path: Path) -> None:
    for kind in KINDS:
        terrain = Plantation(woody=1000, grass=3000)
        folder = tmp_path / kind
        folder.mkdir()
        done = write_foliage(folder, terrain, AREA, FoliageFiles(kind))
        names = {"csv": ["foliage.csv"], "ply": ["foliage.ply"], "none": []}
        expected = names.get(kind, ["foliage.csv", "foliage.ply"])
        assert [path.name for path in done.files] == expected, kind
        assert sorted(path.name for path in folder.iterdir()) == expected, kind
        assert sum(done.counts.values()) == (1000 if expected else 0), kind
        assert tuple(done.counts) == (STOREYS["woody"] if expected else ()), kind
        assert done.seconds > 0.0, kind
        assert terrain.asked == (["woody"] if expected else []), kind

    for kind, grass, line in [
        ("obj", False, "expected foliage as one of csv, ply, both, none, got 'obj'"),
        ("csv", True, "expected ply or both for grass, which only foliage.ply holds, got csv"),
        ("none", True, "expected ply or both for grass, which only foliage.ply holds, got none"),
    ]:
        with pytest.raises(InputError) as caught:
            FoliageFiles(kind, grass=grass)
        assert str(caught.value) == line, kind


def test_grass_comes_after_the_trees_and_into_the_cloud_alone(tmp_path: Path) -> None:
    for kind in ["ply", "both"]:
        done = write_foliage(
            tmp_path, Plantation(woody=1000, grass=3000), AREA, FoliageFiles(kind, grass=True)
        )
        found = vertices(tmp_path)
        grass = np.isin(found["species"], [SPECIES.index(name) for name in STOREYS["grass"]])
        assert not grass[:1000].any(), kind
        assert grass[1000:].all(), kind
        assert len(grass) == 4000, kind
        counts = np.bincount(found["species"], minlength=len(SPECIES))
        assert done.counts == dict(zip(SPECIES, counts.tolist(), strict=True)), kind
        if kind == "both":
            assert len(lines(tmp_path)) == 1000, kind
            assert {line.split(",")[3] for line in lines(tmp_path)} == set(STOREYS["woody"]), kind

    done = write_foliage(tmp_path, Plantation(), AREA, FoliageFiles("both", grass=True))
    assert len(vertices(tmp_path)) == 0
    assert lines(tmp_path) == []
    assert done.counts == dict.fromkeys(SPECIES, 0)


def test_progress_goes_from_nothing_to_all(tmp_path: Path) -> None:
    told: list[float] = []
    wanted = FoliageFiles("ply", grass=True)
    write_foliage(tmp_path, Plantation(400, 1600), AREA, wanted, progress=told.append)
    assert told == sorted(told)
    assert 0.0 < told[0] < 0.2 == pytest.approx(told[4], abs=1e-3)
    assert told[-1] == pytest.approx(1.0, abs=1e-3)


def test_many_plants_take_no_more_memory_than_few(tmp_path: Path) -> None:
    most = []
    for count in (10_000, 40_000):
        tracemalloc.start()
        write_foliage(tmp_path, Plantation(woody=count, pieces=count // 5000), AREA, FoliageFiles("both"))
        most.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert len(vertices(tmp_path)) == count
    assert most[1] < most[0] + (1 << 18)  # both files of the second have 3.6 MB more


def test_a_stop_between_pieces_leaves_nothing(tmp_path: Path) -> None:
    for stop in [KeyboardInterrupt, SketchterrainError("the device gave up")]:

        class Broken(Plantation):
            reason = stop

            def foliage_pieces(self, *area: float, storey: str) -> Iterator[np.ndarray]:
                yield from super().foliage_pieces(*area, storey=storey)
                raise self.reason

        with pytest.raises((KeyboardInterrupt, SketchterrainError)):
            write_foliage(tmp_path, Broken(50_000), AREA, FoliageFiles("both"))
        assert list(tmp_path.iterdir()) == [], stop


def test_a_full_disk_is_told_of_the_file_that_has_no_room(
    tmp_path: Path, files_no_larger_than: Callable[[int], AbstractContextManager[None]]
) -> None:
    for kind, name in [("csv", "csv"), ("both", "csv"), ("ply", "ply")]:
        told = rf"/foliage\.{name}: cannot be written \(File too large"
        with files_no_larger_than(1 << 20), pytest.raises(SketchterrainError, match=told):
            write_foliage(tmp_path, Plantation(50_000), AREA, FoliageFiles(kind))
        assert list(tmp_path.iterdir()) == [], kind


Usage = namedtuple("Usage", "total used free")


def test_foliage_beyond_the_free_space_is_refused_with_the_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for wanted, line in [
        (FoliageFiles("csv"), r"foliage\.csv: up to 2e\+08 plants need up to 15\.6 GiB, .* 9\.3 GiB left"),
        (FoliageFiles("both"), r"foliage\.csv and foliage\.ply: up to 2e\+08 plants need up to 24\.2 GiB,"),
        (FoliageFiles("ply", grass=True), r"foliage\.ply: up to 2\.2e\+09 plants need up to 94\.2 GiB,"),
    ]:
        monkeypatch.setattr(shutil, "disk_usage", lambda _: Usage(10**11, 10**10, 10**10))
        terrain = Plantation(10**8, 10**9)
        with pytest.raises(InputError, match=line) as caught:
            check_room(tmp_path, terrain, AREA, wanted)
        assert "\n" not in str(caught.value), line
        assert terrain.asked == [], line

    monkeypatch.setattr(shutil, "disk_usage", lambda _: Usage(10**11, 10**10, 10**10))
    check_room(tmp_path, Plantation(10**8, 10**12), AREA, FoliageFiles("ply"))
    check_room(tmp_path, Plantation(10**12, 10**12), AREA, FoliageFiles("none"))
