"""Patches on disk: the same bits as in memory whatever the strips, lazily read, checked, and limited."""

import copy
import os
import pickle
import shutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

import numpy as np
import pytest

from sketchterrain.caching import LRUCache
from sketchterrain.elevation.base import PatchStore
from sketchterrain.elevation.build import build_patches
from sketchterrain.elevation.grids import ElevationGrid, SketchFrame, read_grid
from sketchterrain.elevation.patches import GridPatches
from sketchterrain.elevation.planes import DamagedStoreError
from sketchterrain.elevation.quirks import CleanedSamples
from sketchterrain.elevation.selection import Patchwork
from sketchterrain.errors import SketchterrainError

from .conftest import FRAME, write

MakeGrid = Callable[..., ElevationGrid]


def bits(part: GridPatches) -> list[bytes]:
    """Return all that patches consist of; masks are numbered in the order in which strips find them."""
    table, work = part.table, Patchwork({part.id: part})
    coefficients, mask_of, masks = work.patch_data(np.arange(len(part)))
    values = [*table._replace(mask=table.mask >= 0), coefficients, mask_of, masks, part.base]
    return [np.asarray(each).tobytes() for each in values]


def rough(rows: int, columns: int) -> np.ndarray:
    """Return relief with voids of every size, collars and a spike."""
    rng = np.random.default_rng(5)
    heights = 900.0 + np.cumsum(rng.normal(size=(rows, columns)), axis=0).astype(np.float32)
    heights[120:190, 40:60] = -9999.0
    heights[230:290, 100:164] = np.nan
    heights[200:203, :] = -32768.0
    heights[rng.random(heights.shape) < 1e-3] = -9999.0
    heights[60, 70] += 3000.0
    heights[:, -9:] = 0.0
    heights[20:25, -60:] = 0.0
    heights[30:60, 80:90] = 0.0  # a lake
    heights[-90:, :50] = np.nan
    return heights


def cleaned(heights: np.ndarray, known: np.ndarray, strip: int | None = None) -> CleanedSamples:
    def read(first: int, last: int) -> tuple[np.ndarray, np.ndarray]:
        return heights[first:last].copy(), known[first:last]

    return CleanedSamples(read, heights.shape, 30.0, strip)


@pytest.mark.parametrize("crs", ["", "EPSG:4326"])
def test_strips_make_no_difference(make_grid: MakeGrid, crs: str) -> None:
    heights = cleaned(rough(330, 250), np.ones((330, 250), bool))[:]
    place = (3e-4, 0.0, 9.0, 0.0, -3e-4, 47.0) if crs else (30.0, 4.0, 0.0, 4.0, -30.0, 0.0)
    grid = ElevationGrid(heights, place, 1.0, crs, FRAME)
    whole = build_patches(grid, strip=330)
    assert len(whole.table.cut) > 20
    assert len(whole.masks) > 50
    expected = bits(whole)
    for strip in (7, 64) if crs else (1, 64):
        assert bits(build_patches(grid, strip=strip)) == expected, strip


def test_cleaning_by_strips_equals_that_of_the_whole() -> None:
    heights = rough(400, 300)
    known = np.random.default_rng(6).random(heights.shape) > 1e-4
    whole = cleaned(heights, known)
    expected, findings = whole[:], whole.findings
    assert len(findings) == 7, findings
    for strip in (16, 97, 400):
        found = cleaned(heights, known, strip)
        for step in (400, 33):
            parts = [found[first : first + step] for first in range(0, 400, step)]
            assert np.concatenate(parts).tobytes() == expected.tobytes(), (strip, step)
            assert found.findings == findings


def test_stored_patches_have_the_bits_of_those_in_memory(tmp_path: Path) -> None:
    path, folder = write(tmp_path / "a.tif", rough(330, 250)), tmp_path / "store"
    expected, read = build_patches(read_grid(path, FRAME)), []

    def opened(path: Path = path, **more: float) -> AbstractContextManager[ElevationGrid]:
        read.append(path)
        return nullcontext(read_grid(path, FRAME, **more))

    built, findings = PatchStore(folder).load("key", opened)
    memory = LRUCache(max_bytes=1 << 18)
    again, same = PatchStore(folder, memory=memory).load("key", opened)
    assert len(read) == 1
    assert len(memory) == 0  # reads no coefficients
    assert findings == same == read_grid(path, FRAME).findings
    for part in (built, again):
        assert bits(part) == bits(expected)
        assert (part.id, part.law, part.box) == (expected.id, expected.law, expected.box)
        assert part.grid.place == expected.grid.place
    assert 0 < sum(each.nbytes for _, each in memory.items()) <= 1 << 18
    # The same content by another key is not built again.
    before = (folder / built.id.hex() / "coefficients").stat().st_mtime_ns
    assert PatchStore(folder).load("other", opened)[0].id == built.id
    assert (folder / built.id.hex() / "coefficients").stat().st_mtime_ns == before
    assert PatchStore(folder).load("accurate", lambda: opened(accuracy=3.0))[0].id != built.id


def test_moved_patches_are_those_built_there(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif", rough(330, 250))
    home = PatchStore(tmp_path).patches(read_grid(path, SketchFrame(FRAME.crs)))
    moved, built = home.moved(FRAME.east, FRAME.north), build_patches(read_grid(path, FRAME))
    assert np.allclose(moved.box, built.box)
    assert (moved.table.reach[:, :2] <= built.table.reach[:, :2]).all()
    assert (moved.table.reach[:, 2:] >= built.table.reach[:, 2:]).all()
    assert np.abs(moved.table.reach - built.table.reach).max() < 2.0
    x, y = np.random.default_rng(1).uniform([[0.0], [-8500.0]], [[9000.0], [500.0]], (2, 500))
    for part in (moved, copy.deepcopy(moved)):
        one, two = (Patchwork({each.id: each}) for each in (part, built))
        found, expected = (each.surface(each.cover(3.0)).evaluate(x, y) for each in (one, two))
        assert np.isfinite(expected.height).any()
        assert np.allclose(found.height, expected.height, rtol=0.0, atol=1e-6, equal_nan=True)
    assert part.id == moved.id != home.id


def test_other_processes_open_stores_again(tmp_path: Path, make_grid: MakeGrid) -> None:
    part = PatchStore(tmp_path).patches(make_grid())
    work = Patchwork({part.id: part})
    assert len(pickle.dumps(work)) < 1000
    assert bits(copy.deepcopy(work).grids[part.id]) == bits(part)  # as pickles are made
    shutil.rmtree(tmp_path / part.id.hex())
    with pytest.raises(SketchterrainError, match="has been deleted"):
        copy.deepcopy(work)
    held = build_patches(make_grid())
    assert bits(copy.deepcopy(held)) == bits(held)


def test_small_grids_are_held_in_memory_if_nothing_can_be_written(make_grid: MakeGrid) -> None:
    grid = make_grid()
    part, _ = PatchStore(Path("/dev/null")).load("key", lambda: nullcontext(grid))
    assert bits(part) == bits(build_patches(grid))


def test_damaged_and_unfinished_stores_are_built_again(tmp_path: Path, make_grid: MakeGrid) -> None:
    grid = make_grid()
    part = PatchStore(tmp_path).patches(grid)
    expected, folder = bits(part), tmp_path / part.id.hex()
    for name, damage in (
        ("table.npz", lambda content: content[: len(content) // 2]),
        ("table.npz", lambda content: content[:3000] + bytes([content[3000] ^ 1]) + content[3001:]),
        ("coefficients", lambda content: content[:-4]),
        ("masks", lambda content: content[:100]),
        ("table.npz", lambda content: b""),
    ):
        content = (folder / name).read_bytes()
        (folder / name).write_bytes(damage(content))
        assert bits(PatchStore(tmp_path).patches(grid)) == expected, name
    flipped = bytearray((folder / "coefficients").read_bytes())
    flipped[40_000] ^= 1
    (folder / "coefficients").write_bytes(flipped)
    with pytest.raises(DamagedStoreError, match="built again"):
        bits(PatchStore(tmp_path, memory=LRUCache()).patches(grid))
    assert bits(PatchStore(tmp_path).patches(grid)) == expected
    assert [each.name for each in tmp_path.iterdir()] == [folder.name]


def test_stores_opened_longest_ago_are_deleted(tmp_path: Path, make_grid: MakeGrid) -> None:
    grids = [make_grid(offset=float(n)) for n in range(3)]
    size = 0
    for n, grid in enumerate(grids[:2]):
        folder = tmp_path / PatchStore(tmp_path).patches(grid).id.hex()
        size = sum(each.stat().st_size for each in folder.iterdir())
        os.utime(folder, (n, n))
    abandoned = tmp_path / ".building"
    abandoned.mkdir()
    os.utime(abandoned, (5, 5))
    PatchStore(tmp_path, max_bytes=size * 5 // 2).patches(grids[0])  # now the newest
    PatchStore(tmp_path, max_bytes=size * 5 // 2).patches(grids[2])
    left = {each.name for each in tmp_path.iterdir()}
    assert left == {grids[0].id.hex(), grids[2].id.hex()}


_MEMORY = """
import resource, sys
from pathlib import Path
import numpy as np, rasterio, scipy.ndimage, scipy.sparse.csgraph
from sketchterrain.elevation.grids import SketchFrame, read_grid
from sketchterrain.elevation.selection import Patchwork
from sketchterrain.elevation.base import PatchStore
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
grid = read_grid(Path(sys.argv[1]), SketchFrame("EPSG:32632"))
part = PatchStore(Path(sys.argv[2])).patches(grid)
work = Patchwork({part.id: part})
work.patch_data(work.cover(30.0))
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


@pytest.mark.soak
def test_memory_does_not_grow_with_the_grid(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif", np.tile(rough(330, 256), (16, 20)))
    done = subprocess.run(
        [sys.executable, "-c", _MEMORY, path, tmp_path / "store"], capture_output=True, text=True, check=True
    )
    assert int(done.stdout) < 320 << 10  # KB; whole planes of 27 million samples took more
