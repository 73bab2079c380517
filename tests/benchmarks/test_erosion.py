"""Where water runs, and how much of it, on ground whose answer is known."""

from __future__ import annotations

import numpy as np

from sketchterrain.benchmarks.erosion import catchments, receivers


def test_a_plane_drains_along_its_slope() -> None:
    height = np.repeat(np.arange(6.0)[:, None], 4, axis=1)
    area = catchments(receivers(height)).reshape(6, 4)
    np.testing.assert_array_equal(area[:, 1], [6, 5, 4, 3, 2, 1])


def test_a_bowl_drains_into_its_middle() -> None:
    rows, columns = np.mgrid[-4:5, -4:5]
    down = receivers((rows**2 + columns**2).astype(float))
    assert down[40] == 40
    area = catchments(down)
    assert area[40] == area.max() == 81
    assert (down == np.arange(81)).sum() == 1


def test_diagonals_count_by_their_length() -> None:
    height = np.array([[9.0, 9.0, 9.0], [9.0, 5.0, 3.0], [9.0, 9.0, 2.6]])
    # Down by 2 over one cell, or by 2.4 over the diagonal's 1.41.
    assert receivers(height)[4] == 5
