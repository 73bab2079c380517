"""Structures as arguments of host functions: named tuples, whose arrays are checked as others are."""

from typing import NamedTuple

import numpy as np
import pytest

from sketchterrain.benchmarks.host_mesh import SAMPLES
from sketchterrain.host.library import host_function


def bounds(**changes):
    table, box = SAMPLES["cell_bounds"](5)
    box[:] = np.nan
    host_function("cell_bounds")(table._replace(**changes), box)
    return box


def test_named_tuples_are_passed_as_structures():
    box = bounds()
    assert (box[0] == 0.0).all()
    assert (box[:, 0] == 0.0).all()
    centre = 0.5 * (box[1:, 1:, :2] + box[1:, 1:, 2:])
    row, column = np.indices((4, 4)) + 1
    np.testing.assert_allclose(centre[..., 0], column, rtol=0, atol=0.6)
    np.testing.assert_allclose(centre[..., 1], row, rtol=0, atol=0.6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"site_x": np.zeros((5, 6))},
            r"MeshTable: expected rows \+ 1 = 6 in the shape of site_x, got \(5, 6\)",
        ),
        (
            {"diagonal": np.zeros((5, 5))},
            r"expected diagonal as int64 \(rows, columns\), got float64 \(5, 5\)",
        ),
        ({"height": np.zeros((2, 5, 5)).T}, "expected height in C order"),
        ({"relief": None}, r"expected relief as float64 \(rows, columns, 2\), got NoneType"),
        ({"diagonal": np.zeros((4, 5), np.int64)}, r"expected rows \+ 1 = 5 in the shape of site_x"),
    ],
)
def test_arrays_of_structures_are_checked(changes, message):
    with pytest.raises(ValueError, match=message):
        bounds(**changes)


def test_sizes_of_arrays_may_be_numbers_of_structures():
    table, _ = SAMPLES["cell_bounds"](5)
    with pytest.raises(ValueError, match=r"expected table->rows = 5 in the shape of bounds, got \(4, 5, 4\)"):
        host_function("cell_bounds")(table, np.empty((4, 5, 4)))


def test_a_tuple_without_a_member_is_refused():
    class Other(NamedTuple):
        column: int = 0

    with pytest.raises(AttributeError, match="'Other' object has no attribute 'row'"):
        host_function("cell_bounds")(Other(), np.empty((4, 5, 4)))
