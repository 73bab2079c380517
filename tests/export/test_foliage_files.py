"""Plants as CSV and PLY in independent readers, in chunks, and failures of writing."""

import csv
import shutil
import tracemalloc
from collections import namedtuple
from itertools import pairwise
from pathlib import Path

import meshio
import numpy as np
import plyfile
import pytest
import trimesh

from sketchterrain.errors import SketchterrainError
from sketchterrain.export.foliage_files import (
    ROW_BYTES,
    VERTEX,
    FoliageOptions,
    check_disk_space,
    plant_cloud,
    plant_table,
    write_foliage,
)
from sketchterrain.vegetation.plants import PLANT, SPECIES, STOREYS
from tests.refusals import refused

AREA = (100.0, 200.0, 500.0, 1000.0)
ROOT = Path(__file__).parents[2]
PROPERTIES = ["x", "y", "z", "nx", "ny", "nz", "scale", "rotation", "tint", "level", "species"]
WRITERS = {"csv": plant_table, "ply": plant_cloud}


def written(folder, kind, *pieces, species=SPECIES):
    path = folder / f"foliage.{kind}"
    with WRITERS[kind](path, species) as add:
        for piece in pieces:
            add(piece)
    return path


def read(path):
    return plyfile.PlyData.read(path, mmap=False)


def plants(count):
    """Return plants of all species on rough ground, from south to north, the same every time."""
    random = np.random.default_rng(count)
    some = np.zeros(count, PLANT)
    some["x"], some["y"] = 4096.0 * random.random(count), np.sort(4096.0 * random.random(count))
    some["z"] = random.normal(100.0, 300.0, count)
    upward = np.stack([*random.normal(0.0, 0.3, (2, count)), np.ones(count)], axis=-1)
    some["normal"] = upward / np.linalg.norm(upward, axis=-1, keepdims=True)
    some["species"], some["level"] = random.integers(0, [[len(SPECIES)], [6]], (2, count))
    some["scale"] = random.uniform(0.2, 1.3, count)
    some["rotation"] = random.uniform(0.0, 2 * np.pi, count)
    some["tint"] = random.random(count)
    return some


def test_csv_rows_have_fixed_decimals_and_bounded_length(tmp_path):
    some = plants(300)
    with written(tmp_path, "csv", some).open(newline="", encoding="ascii") as stream:
        rows = list(csv.DictReader(stream))
    normal = ["normal_x", "normal_y", "normal_z"]
    assert list(rows[0]) == ["x", "y", "z", "species", "scale", "rotation", "tint", *normal]
    assert [row["species"] for row in rows] == [SPECIES[code] for code in some["species"]]
    fields = {name: some[name] for name in ("x", "y", "z", "scale", "rotation", "tint")}
    fields |= {name: some["normal"][:, axis] for axis, name in enumerate(normal)}
    for name, field in fields.items():
        half = 0.00005 if name == "rotation" or name in normal else 0.0005
        found = np.array([float(row[name]) for row in rows])
        np.testing.assert_allclose(found, field, rtol=1e-7, atol=1.001 * half)

    plant = (1e6 + 1 / 3, 2.0, -1e-5, (0.6, -0.0, 0.8), 1, 3, 1.25, 6.28318, 0.5)
    path = written(tmp_path, "csv", np.array([plant], PLANT), species=("fir", "oak"))
    line = "1000000.333,2.000,0.000,oak,1.250,6.2832,0.500,0.6000,0.0000,0.8000"
    assert path.read_text(encoding="ascii").splitlines()[1] == line
    plant = (-999999.999, -999999.999, -9999.9999, (-1, -1, 1), 0, 0, 1.25, 6.28318, 1.0)
    path = written(tmp_path, "csv", np.array([plant], PLANT))
    assert len(path.read_bytes().splitlines(keepends=True)[1]) <= ROW_BYTES


def assert_same(vertices, plants):
    for name in ("x", "y", "z", "scale", "rotation", "tint", "level", "species"):
        np.testing.assert_array_equal(vertices[name], plants[name])
    for axis, name in enumerate(("nx", "ny", "nz")):
        np.testing.assert_array_equal(vertices[name], plants["normal"][:, axis])


def test_ply_is_bit_equal_in_independent_readers(tmp_path):
    some = plants(10_003)
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
    names = {}
    exec(page.split("```python\n")[1].split("```")[0], names)  # noqa: S102
    vertices, species = names["read_plants"](path)
    assert_same(vertices, some)
    assert tuple(species) == SPECIES


def test_plants_in_chunks_give_the_same_file(tmp_path):
    lengths = set()
    for count in [0, 1, 9, 10, 4096, 4097, 9_001]:
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


def test_failures_leave_no_partial_foliage_file(tmp_path):
    for kind, write in WRITERS.items():
        old = written(tmp_path, kind, plants(3)).read_bytes()
        for after in [0, 1, 20_000]:

            def interrupted(after=after, kind=kind, write=write):
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
    refused(r"finite numbers .* got nan", written, tmp_path, "csv", some)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["foliage.csv", "foliage.ply"]


class Plantation:
    """So many plants of each storey in so many pieces, from south to north; some pieces are empty."""

    species_names = SPECIES

    def __init__(self, woody=0, grass=0, pieces=5):
        self._count = {"woody": woody, "grass": grass}
        self._pieces = pieces
        self.requested_storeys: list[str] = []

    def foliage_estimate(self, west, south, east, north, *, storey):
        assert (west, south, east, north) == AREA
        return 2 * self._count[storey], 2 * self._count[storey] * PLANT.itemsize

    def foliage_pieces(self, west, south, east, north, *, storey):
        self.requested_storeys.append(storey)
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


def vertices(folder):
    content = (folder / "foliage.ply").read_bytes()
    return np.frombuffer(content.split(b"end_header\n", 1)[1], VERTEX)


def lines(folder):
    return (folder / "foliage.csv").read_text(encoding="ascii").splitlines()[1:]


def test_only_the_requested_files_are_written_and_contradictions_refused(tmp_path):
    for kind, forms in {"csv": ["csv"], "ply": ["ply"], "both": ["csv", "ply"], "none": []}.items():
        terrain = Plantation(woody=1000, grass=3000)
        folder = tmp_path / kind
        folder.mkdir()
        result = write_foliage(folder, terrain, AREA, FoliageOptions(kind))
        expected = [f"foliage.{form}" for form in forms]
        assert [path.name for path in result.files] == expected, kind
        assert sorted(path.name for path in folder.iterdir()) == expected, kind
        assert sum(result.counts.values()) == (1000 if forms else 0), kind
        assert terrain.requested_storeys == (["woody"] if forms else []), kind

    for kind, grass, line in [
        ("obj", False, "expected foliage as one of csv, ply, both, none, got 'obj'"),
        ("csv", True, "expected ply or both for grass, which only foliage.ply holds, got csv"),
    ]:
        refused(line, FoliageOptions, kind, grass=grass)


def test_grass_follows_the_trees_in_the_ply_only(tmp_path):
    progress = []
    terrain, options = Plantation(woody=1000, grass=3000), FoliageOptions("both", grass=True)
    done = write_foliage(tmp_path, terrain, AREA, options, progress=progress.append)
    assert progress == sorted(progress)
    assert 0.0 < progress[0] < 0.25 == pytest.approx(progress[4], abs=1e-3)
    assert progress[-1] == pytest.approx(1.0, abs=1e-3)
    found = vertices(tmp_path)
    grass = np.isin(found["species"], [SPECIES.index(name) for name in STOREYS["grass"]])
    assert grass.tolist() == [False] * 1000 + [True] * 3000
    counts = np.bincount(found["species"], minlength=len(SPECIES))
    assert done.counts == dict(zip(SPECIES, counts.tolist(), strict=True))
    assert len(lines(tmp_path)) == 1000
    assert {line.split(",")[3] for line in lines(tmp_path)} == set(STOREYS["woody"])

    done = write_foliage(tmp_path, Plantation(), AREA, FoliageOptions("both", grass=True))
    assert len(vertices(tmp_path)) == 0
    assert lines(tmp_path) == []
    assert done.counts == dict.fromkeys(SPECIES, 0)


def test_memory_is_independent_of_the_number_of_plants(tmp_path):
    most = []
    for count in (5_000, 20_000):
        tracemalloc.start()
        write_foliage(tmp_path, Plantation(woody=count, pieces=count // 5000), AREA, FoliageOptions("both"))
        most.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert len(vertices(tmp_path)) == count
    assert most[1] < most[0] + (1 << 18)  # both files of the second have 1.8 MB more


def test_full_disk_is_reported_with_the_file_name(tmp_path, files_no_larger_than):
    for kind, name in [("csv", "csv"), ("both", "csv"), ("ply", "ply")]:
        progress = rf"/foliage\.{name}: cannot be written \(File too large"
        with files_no_larger_than(1 << 20), pytest.raises(SketchterrainError, match=progress):
            write_foliage(tmp_path, Plantation(50_000), AREA, FoliageOptions(kind))
        assert list(tmp_path.iterdir()) == [], kind


Usage = namedtuple("Usage", "total used free")


def test_foliage_beyond_the_free_disk_space_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda _: Usage(10**11, 10**10, 10**10))
    for options, line in [
        (FoliageOptions("csv"), r"foliage\.csv: up to 2e\+08 plants need up to 15\.6 GiB, .* 9\.3 GiB free"),
        (FoliageOptions("both"), r"foliage\.csv and foliage\.ply: up to 2e\+08 plants need up to 24\.2 GiB,"),
        (FoliageOptions("ply", grass=True), r"foliage\.ply: up to 2\.2e\+09 plants need up to 94\.2 GiB,"),
    ]:
        terrain = Plantation(10**8, 10**9)
        refused(line, check_disk_space, tmp_path, terrain, AREA, options)
        assert terrain.requested_storeys == [], line

    check_disk_space(tmp_path, Plantation(10**8, 10**12), AREA, FoliageOptions("ply"))
    check_disk_space(tmp_path, Plantation(10**12, 10**12), AREA, FoliageOptions("none"))
