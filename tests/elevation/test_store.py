"""Patches on disk: the same bits as in memory whatever the strips, lazily read, checked, and limited."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rasterio

from sketchterrain.caching import LRUCache
from sketchterrain.elevation.build import build_patches
from sketchterrain.elevation.grids import ElevationGrid, SketchFrame, open_grid, read_grid
from sketchterrain.elevation.patches import GridPatches
from sketchterrain.elevation.planes import DamagedStoreError
from sketchterrain.elevation.quirks import CleanedSamples, clean_samples
from sketchterrain.elevation.selection import Patchwork
from sketchterrain.elevation.store import PatchStore
from sketchterrain.errors import InputError

MakeGrid = Callable[..., ElevationGrid]
FRAME = SketchFrame("EPSG:32632", 500_000.0, 5_200_000.0)


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


def write(path: Path, heights: np.ndarray) -> Path:
    rows, columns = heights.shape
    profile = {"width": columns, "height": rows, "count": 1, "dtype": heights.dtype, "crs": FRAME.crs}
    at = rasterio.Affine(30.0, 0.0, 500_100.0, 0.0, -30.0, 5_201_000.0)
    with rasterio.open(path, "w", driver="GTiff", transform=at, **profile) as file:
        file.write(heights, 1)
    return path


@pytest.mark.parametrize("crs", ["", "EPSG:4326"])
def test_strips_make_no_difference(make_grid: MakeGrid, crs: str) -> None:
    heights = clean_samples(rough(330, 250), np.ones((330, 250), bool), 30.0)[0]
    place = (3e-4, 0.0, 9.0, 0.0, -3e-4, 47.0) if crs else (30.0, 4.0, 0.0, 4.0, -30.0, 0.0)
    grid = ElevationGrid(heights, place, 1.0, crs, FRAME)
    whole = build_patches(grid, strip=330)
    assert len(whole.table.cut) > 20
    assert len(whole.masks) > 50
    expected = bits(whole)
    for strip in (1, 7, 64):
        assert bits(build_patches(grid, strip=strip)) == expected, strip


def test_grid_of_scattered_samples_has_no_patches(tmp_path: Path) -> None:
    samples = np.full((70, 80), np.nan, np.float32)
    samples[::3, ::3] = 5.0
    part = PatchStore(tmp_path).patches(ElevationGrid(samples, (30.0, 0.0, 0.0, 0.0, -30.0, 0.0)))
    work = Patchwork({part.id: part})
    assert len(work) == len(work.cover(0.0)) == len(work.cover_for_cells(90.0)) == 0
    assert np.isnan(work.surface(work.cover(0.0)).evaluate(np.zeros(3), np.zeros(3)).height).all()


def test_cleaning_by_strips_equals_that_of_the_whole() -> None:
    heights = rough(400, 300)
    known = np.random.default_rng(6).random(heights.shape) > 1e-4
    expected, findings = clean_samples(heights, known, 30.0)
    assert len(findings) == 7, findings
    for strip in (16, 97, 400):
        cleaned = CleanedSamples(
            lambda first, last: (heights[first:last].copy(), known[first:last]), heights.shape, 30.0, strip
        )
        assert cleaned.count == np.count_nonzero(known & (np.abs(heights) < 9000.0)) - np.count_nonzero(
            np.isnan(expected) & known & (heights == 0.0)
        )
        for step in (400, 33, 5):
            parts = [cleaned[first : first + step] for first in range(0, 400, step)]
            assert np.concatenate(parts).tobytes() == expected.tobytes(), (strip, step)
            assert cleaned.findings == findings


def test_files_read_by_rows_give_the_same_grid(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif", rough(330, 250))
    np.save(tmp_path / "a.npy", rough(330, 250))
    for file, more in ((path, {}), (tmp_path / "a.npy", {"place": (5.0, 0.0, 1.0, 0.0, -5.0, 9.0)})):
        whole, rows = read_grid(file, FRAME, **more), open_grid(file, FRAME, **more)
        assert (rows.id, rows.base) == (whole.id, whole.base)
        assert rows.found == whole.findings
    write(tmp_path / "voids.tif", np.full((9, 9), np.nan, np.float32))
    with pytest.raises(InputError, match="no heights"):
        open_grid(tmp_path / "voids.tif", FRAME)
    with pytest.raises(InputError, match="cannot be read"):
        open_grid(tmp_path / "missing.tif", FRAME)


def test_stored_patches_have_the_bits_of_those_in_memory(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif", rough(330, 250))
    expected = build_patches(read_grid(path, FRAME))
    built = PatchStore(tmp_path / "store").load(path, FRAME)
    memory = LRUCache(max_bytes=1 << 18)
    opened = PatchStore(tmp_path / "store", memory=memory).load(path, FRAME)
    assert len(memory) == 0  # reads no coefficients
    for part in (built, opened):
        assert bits(part) == bits(expected)
        assert (part.id, part.findings, part.grid.place) == (
            expected.id,
            expected.findings,
            expected.grid.place,
        )
    assert 0 < sum(each.nbytes for _, each in memory.items()) <= 1 << 18
    # The same content by another name is not built again, and changed files are.
    folder = tmp_path / "store" / opened.id.hex()
    before = (folder / "coefficients").stat().st_mtime_ns
    shutil.copy(path, tmp_path / "b.tif")
    assert PatchStore(tmp_path / "store").load(tmp_path / "b.tif", FRAME).id == opened.id
    assert (folder / "coefficients").stat().st_mtime_ns == before
    assert PatchStore(tmp_path / "store").load(path, FRAME, accuracy=3.0).id != opened.id
    write(path, rough(330, 251))
    assert PatchStore(tmp_path / "store").load(path, FRAME).grid.shape == (330, 251)


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
        bits(PatchStore(tmp_path).patches(grid))
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


def test_cover_near_areas_is_that_of_the_cells(make_grid: MakeGrid) -> None:
    parts = [
        build_patches(each) for each in (make_grid(degrees=20.0), make_grid(90.0, 90, 100, accuracy=2.0))
    ]
    work = Patchwork({each.id: each for each in parts})
    areas = np.array([[3000.0, 3000.0, 3400.0, 3500.0], [6000.0, 6100.0, 6300.0, 6200.0]])
    for cell in (5.0, 60.0, 300.0):
        which = work.cover_for_cells(cell)
        near = [work.within(which, tuple(area)) for area in areas]
        assert work.cover_near(cell, areas).tolist() == sorted({*near[0].tolist(), *near[1].tolist()})


_MEMORY = """
import resource, sys
from pathlib import Path
import numpy as np, rasterio, scipy.ndimage, scipy.sparse.csgraph
from sketchterrain.elevation.grids import SketchFrame
from sketchterrain.elevation.selection import Patchwork
from sketchterrain.elevation.store import PatchStore
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
part = PatchStore(Path(sys.argv[2])).load(Path(sys.argv[1]), SketchFrame("EPSG:32632"))
work = Patchwork({part.id: part})
work.patch_data(work.cover(30.0))
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


@pytest.mark.slow
def test_memory_does_not_grow_with_the_grid(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif", np.tile(rough(330, 256), (16, 20)))
    done = subprocess.run(
        [sys.executable, "-c", _MEMORY, path, tmp_path / "store"], capture_output=True, text=True, check=True
    )
    assert int(done.stdout) < 320 << 10  # KB; whole planes of 27 million samples took more
