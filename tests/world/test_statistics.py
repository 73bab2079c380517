"""Relief, slopes and hypsometry: analytic surfaces, NumPy on the whole, levels that agree."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from sketchterrain.errors import InputError
from sketchterrain.world import statistics as measured
from sketchterrain.world.grid import World
from sketchterrain.world.statistics import compute_statistics


class ArrayWorld:
    """A world in memory with subsampled levels; records the largest window."""

    west, north = 0.0, 0.0

    def __init__(self, height: npt.NDArray, cell: float = 1.0, materials: npt.NDArray | None = None) -> None:
        rows, columns = height.shape
        self.levels = World(0.0, 0.0, (columns - 1) * cell, (rows - 1) * cell, cell).levels
        assert (self.levels[0].rows, self.levels[0].columns) == height.shape
        self._data = {"height": height}
        if materials is not None:
            self._data["materials"] = materials
        self.layers = tuple(self._data)
        self.material_names = () if materials is None else tuple("abcdefgh"[: len(materials)])
        self.largest = 0

    def read(
        self, layer: str, level: int, *, top: int, left: int, rows: int, columns: int
    ) -> npt.NDArray[Any]:
        assert min(top, left) >= 0
        whole, step = self._data[layer], 1 << level
        down = np.arange(top, top + rows) * step
        across = np.arange(left, left + columns) * step
        assert max(down[-1] - whole.shape[-2], across[-1] - whole.shape[-1]) < step
        down, across = (
            np.minimum(at, size - 1) for at, size in zip((down, across), whole.shape[-2:], strict=True)
        )
        window = whole[..., down[:, None], across]
        self.largest = max(self.largest, window.nbytes)
        return window


def places(rows: int, columns: int, cell: float) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return x, and y that runs north, of a grid around (0, 0)."""
    across = (np.arange(columns) - (columns - 1) / 2) * cell
    down = ((rows - 1) / 2 - np.arange(rows)) * cell
    return np.meshgrid(across, down)


@pytest.mark.parametrize("cell", [0.5, 8.0])
def test_plane_has_constant_slope(cell: float) -> None:
    x, y = places(300, 517, cell)
    found = compute_statistics(ArrayWorld((0.25 * x - 0.5 * y).astype(np.float32), cell))
    assert found.slopes is not None
    steep = math.degrees(math.atan(math.hypot(0.25, 0.5)))
    assert found.slopes.mean == pytest.approx(steep, abs=1e-4)
    assert found.slopes.maximum == pytest.approx(steep, abs=1e-2)
    assert found.slopes.surface_ratio == pytest.approx(math.sqrt(1 + 0.25**2 + 0.5**2), abs=1e-5)
    assert all(value == pytest.approx(steep, abs=0.01) for value in found.slopes.quantiles.values())
    assert found.slopes.shares[int(steep // 5)] == 1.0
    assert found.area == 299 * 516 * cell**2
    assert found.hypsometry.integral == pytest.approx(0.5, abs=1e-6)


def test_cone_hypsometry_is_analytic() -> None:
    x, y = places(1001, 1001, 1.0)
    radius = np.hypot(x, y)
    height = np.maximum(100.0 * (1.0 - radius / 500.0), 0.0).astype(np.float32)
    found = compute_statistics(ArrayWorld(height))
    heights, above = (np.array(each) for each in (found.hypsometry.heights, found.hypsometry.share_above))
    assert np.allclose(heights, np.linspace(0.0, 100.0, 21))
    expected = math.pi * (500.0 * (1.0 - heights / 100.0)) ** 2 / 1000.0**2
    assert above[1:] == pytest.approx(expected[1:], abs=2e-3)
    assert above[0] == 1.0  # all of it, where it is flat, too
    assert found.sea_share is None
    for level in (-5.0, 20.0, 60.0, 200.0):
        drowned = compute_statistics(ArrayWorld(height), sea_level=level).sea_share
        dry = math.pi * (500.0 * (1.0 - min(max(level, 1e-9), 100.0) / 100.0)) ** 2 / 1000.0**2
        assert drowned == pytest.approx(0.0 if level < 0.0 else 1.0 - dry, abs=2e-3), level
    # A cone's volume is a third of its base and height.
    assert found.hypsometry.integral == pytest.approx(math.pi * 500.0**2 / 3.0 / 1000.0**2, abs=1e-3)
    assert found.slopes is not None
    assert found.slopes.quantiles["0.5"] == pytest.approx(math.degrees(math.atan(0.2)), abs=0.01)


@pytest.mark.parametrize("shape", [(300, 4500), (3, 3), (260, 4097), (2, 40), (2, 2)])
def test_statistics_equal_numpy(shape: tuple[int, int]) -> None:
    chance = np.random.default_rng(3)
    height = np.cumsum(chance.normal(size=shape), axis=1).astype(np.float32) + np.float32(-40.0)
    weights = chance.integers(0, 128, size=(1, *shape)).astype(np.uint8)
    held = ArrayWorld(height, 2.0, np.concatenate([weights, 255 - weights]))
    found = compute_statistics(held)
    exact = height.astype(np.float64)
    assert (found.relief.minimum, found.relief.maximum) == (exact.min(), exact.max())
    assert found.relief.mean == pytest.approx(exact.mean(), rel=1e-12)
    assert found.relief.standard_deviation == pytest.approx(exact.std(), rel=1e-12)
    bin_ = 2.0 ** np.ceil(np.log2(max(np.ptp(exact) / 65536, 2.0**-12)))
    ordered = np.sort(exact.ravel())
    for share, value in found.relief.quantiles.items():
        place = int(float(share) * (ordered.size - 1))
        assert ordered[max(place - 1, 0)] - bin_ <= value <= ordered[min(place + 2, ordered.size - 1)] + bin_
    for level, above in zip(found.hypsometry.heights[1:-1], found.hypsometry.share_above[1:-1], strict=True):
        between = np.mean(exact > level + bin_), np.mean(exact > level - bin_)
        assert between[0] - 1e-12 <= above <= between[1] + 1e-12
    assert found.materials["a"] == pytest.approx(weights.mean() / 255.0, rel=1e-12)
    assert sum(found.materials.values()) == pytest.approx(1.0)
    if min(shape) < 3:
        assert found.slopes is None
        return
    degrees = np.degrees(np.arctan(horn(exact, 2.0)))
    assert found.slopes is not None
    assert found.slopes.mean == pytest.approx(degrees.mean(), rel=1e-9)
    assert found.slopes.maximum == pytest.approx(degrees.max(), rel=1e-9)
    expected = np.histogram(degrees, bins=18, range=(0, 90))[0] / degrees.size
    assert found.slopes.shares == pytest.approx(expected, abs=1e-12)
    assert held.largest <= 4500 * 256 * 4


def horn(z: npt.NDArray[np.float64], cell: float) -> npt.NDArray[np.float64]:
    """Return the tangents of slopes, term by term as gdaldem's documentation of Horn's formula has them."""
    a, b, c = z[:-2, :-2], z[:-2, 1:-1], z[:-2, 2:]
    d, f = z[1:-1, :-2], z[1:-1, 2:]
    g, h, i = z[2:, :-2], z[2:, 1:-1], z[2:, 2:]
    east = ((c + 2 * f + i) - (a + 2 * d + g)) / (8 * cell)
    north = ((g + 2 * h + i) - (a + 2 * b + c)) / (8 * cell)
    return np.asarray(np.hypot(east, north))


def test_statistics_are_independent_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    height = np.cumsum(np.random.default_rng(5).normal(size=(40, 9000)), axis=1).astype(np.float32)
    several = compute_statistics(ArrayWorld(height)).as_dict()
    monkeypatch.setattr(measured, "_THREADS", 1)
    assert compute_statistics(ArrayWorld(height)).as_dict() == several


def test_missing_level_is_refused() -> None:
    with pytest.raises(InputError, match="no level 3: expected 0 to 0"):
        compute_statistics(ArrayWorld(np.zeros((5, 5), np.float32)), level=3)
