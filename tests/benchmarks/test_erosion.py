"""Flow directions and catchments on ground whose answer is known."""

from __future__ import annotations

import numpy as np

from sketchterrain.benchmarks.erosion import catchments, receivers


def test_water_flows_down_the_steepest_slope_and_catchments_add_up() -> None:
    plane = np.repeat(np.arange(6.0)[:, None], 4, axis=1)
    area = catchments(receivers(plane)).reshape(6, 4)
    np.testing.assert_array_equal(area[:, 1], [6, 5, 4, 3, 2, 1])

    rows, columns = np.mgrid[-4:5, -4:5]
    down = receivers((rows**2 + columns**2).astype(float))
    assert down[40] == 40
    area = catchments(down)
    assert area[40] == area.max() == 81
    assert (down == np.arange(81)).sum() == 1

    # Down by 2 over one cell, or by 2.4 over the diagonal's 1.41.
    height = np.array([[9.0, 9.0, 9.0], [9.0, 5.0, 3.0], [9.0, 9.0, 2.6]])
    assert receivers(height)[4] == 5
