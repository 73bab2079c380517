from __future__ import annotations

import resource
import shutil
import tracemalloc
from collections import namedtuple
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest

from sketchterrain.errors import InputError, SketchterrainError
from sketchterrain.export import FoliageFiles, check_room, write_foliage
from sketchterrain.export.foliage_files import VERTEX
from sketchterrain.terrain.plant import PLANT, SPECIES, STOREYS

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

AREA = (100.0, 200.0, 500.0, 1000.0)
KINDS = ("csv", "ply", "both", "none")


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


def test_only_the_requested_files_are_written(tmp_path: Path) -> None:
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


@pytest.fixture
def small_files() -> Iterator[None]:
    """Files of more than a megabyte are refused by the system, as by a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.usefixtures("small_files")
def test_a_full_disk_is_told_of_the_file_that_has_no_room(tmp_path: Path) -> None:
    for kind, name in [("csv", "csv"), ("both", "csv"), ("ply", "ply")]:
        with pytest.raises(
            SketchterrainError, match=rf"/foliage\.{name}: cannot be written \(File too large"
        ):
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


def test_contradictory_requests_are_refused() -> None:
    for kind, grass, line in [
        ("obj", False, "expected foliage as one of csv, ply, both, none, got 'obj'"),
        ("csv", True, "expected ply or both for grass, which only foliage.ply holds, got csv"),
        ("none", True, "expected ply or both for grass, which only foliage.ply holds, got none"),
    ]:
        with pytest.raises(InputError) as caught:
            FoliageFiles(kind, grass=grass)
        assert str(caught.value) == line, kind
