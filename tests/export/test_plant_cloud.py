"""Clouds of plants, read by a parser of our own, written from the format's description, and by others'."""

from __future__ import annotations

import time
import tracemalloc
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from sketchterrain.errors import SketchterrainError
from sketchterrain.export.foliage_files import VERTEX, plant_cloud
from sketchterrain.terrain.plant import SPECIES

if TYPE_CHECKING:
    from collections.abc import Callable

    Plants = Callable[[int], np.ndarray]

ROOT = Path(__file__).parents[2]
SIZES = {"double": "<f8", "float": "<f4", "uchar": "u1"}
PROPERTIES = ["x", "y", "z", "nx", "ny", "nz", "scale", "rotation", "tint", "level", "species"]


def written(folder: Path, *pieces: np.ndarray) -> Path:
    with plant_cloud(folder / "foliage.ply", SPECIES) as add:
        for piece in pieces:
            add(piece)
    return folder / "foliage.ply"


def read(path: Path) -> tuple[np.ndarray, list[str]]:
    """Return the vertices and the comments of a binary PLY."""
    with path.open("rb") as file:
        assert file.readline() == b"ply\n"
        assert file.readline() == b"format binary_little_endian 1.0\n"
        comments, properties, count = [], [], -1
        while (line := file.readline().decode("ascii").rstrip("\n")) != "end_header":
            match line.split(" "):
                case ["comment", *_]:
                    comments.append(line.removeprefix("comment "))
                case ["element", "vertex", number]:
                    assert count == -1
                    assert str(int(number)) == number
                    count = int(number)
                case ["property", kind, name]:
                    assert count >= 0
                    properties.append((name, SIZES[kind]))
                case _:
                    pytest.fail(f"unexpected line: {line}")
        vertices = np.frombuffer(file.read(), np.dtype(properties))
    assert len(vertices) == count
    return vertices, comments


def assert_same(vertices: np.ndarray, plants: np.ndarray) -> None:
    for name in ("x", "y", "z", "scale", "rotation", "tint", "level", "species"):
        np.testing.assert_array_equal(vertices[name], plants[name])
    for axis, name in enumerate(("nx", "ny", "nz")):
        np.testing.assert_array_equal(vertices[name], plants["normal"][:, axis])


def test_every_bit_of_a_plant_is_there_in_order(tmp_path: Path, plants: Plants) -> None:
    some = plants(100_003)
    vertices, comments = read(written(tmp_path, some))
    assert list(vertices.dtype.names) == PROPERTIES
    assert vertices.dtype.itemsize == VERTEX.itemsize == 46
    assert_same(vertices, some)
    assert [line for line in comments if line.startswith("species")] == [
        f"species {code} {name}" for code, name in enumerate(SPECIES)
    ]


def test_clouds_of_any_size_and_pieces_are_the_same_file(tmp_path: Path, plants: Plants) -> None:
    for count in [0, 1, 9, 10, 65_536, 65_537, 200_001]:
        some = plants(count)
        whole = written(tmp_path, some).read_bytes()
        pieces = np.split(some, sorted(np.random.default_rng(count).integers(0, count + 1, 4)))
        assert written(tmp_path, *pieces).read_bytes() == whole, count
        assert len(read(tmp_path / "foliage.ply")[0]) == count, count

    vertices, comments = read(written(tmp_path))
    assert len(vertices) == 0
    assert "species 5 grass" in comments


def test_the_header_is_as_long_for_any_count(tmp_path: Path, plants: Plants) -> None:
    lengths = {len(written(tmp_path, plants(n)).read_bytes()) - 46 * n for n in (0, 7, 12_345, 1_000_000)}
    assert len(lengths) == 1


def test_an_interrupt_or_a_missing_folder_leaves_no_partial_cloud(tmp_path: Path, plants: Plants) -> None:
    for after in [0, 1, 70_000]:
        old = written(tmp_path, plants(3)).read_bytes()

        def interrupted(after: int = after) -> None:
            with plant_cloud(tmp_path / "foliage.ply", SPECIES) as add:
                add(plants(after))
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            interrupted()
        assert [entry.name for entry in tmp_path.iterdir()] == ["foliage.ply"], after
        assert (tmp_path / "foliage.ply").read_bytes() == old, after

    with pytest.raises(SketchterrainError, match=r"foliage\.ply: cannot be written \(No such file"):
        written(tmp_path / "no")


def test_the_reader_in_the_docs_reads_them(tmp_path: Path, plants: Plants) -> None:
    page = (ROOT / "docs/foliage_files.md").read_text(encoding="utf-8")
    names: dict[str, Any] = {}
    exec(page.split("```python\n")[1].split("```")[0], names)  # noqa: S102
    some = plants(1000)
    vertices, species = names["read_plants"](written(tmp_path, some))
    assert_same(vertices, some)
    assert tuple(species) == SPECIES


@pytest.mark.parametrize("library", ["plyfile", "trimesh", "meshio"])
def test_others_read_the_same(tmp_path: Path, plants: Plants, library: str) -> None:
    other = pytest.importorskip(library)
    some = plants(1000)
    path = written(tmp_path, some)
    if library == "plyfile":
        assert_same(other.PlyData.read(path)["vertex"].data, some)
        return
    places = other.load(path).vertices if library == "trimesh" else other.read(path).points
    np.testing.assert_array_equal(places, np.stack([some["x"], some["y"], some["z"]], axis=-1))


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
