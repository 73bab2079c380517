from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.export.decimals import decimals, joined_rows, words


def texts(values: object, places: int) -> list[str]:
    column = decimals(np.asarray(values), places)
    return joined_rows([column]).decode("ascii").splitlines()


def test_columns_are_formatted_as_python_does() -> None:
    for places in [1, 3, 4, 7]:
        for size in [1e-6, 1.0, 12.0, 9999.0, 123456.0, 1e8]:
            values = np.random.default_rng(places).normal(0.0, size, 5000)
            rounded = np.rint(values * 10.0**places) / 10.0**places + 0.0  # halves to even, no negative zero
            assert texts(values, places) == [f"{value:.{places}f}" for value in rounded], (places, size)

    values = np.float32([0.1, 1e6 / 3, -7.25])
    assert texts(values, 3) == [f"{float(value):.3f}" for value in values]


def test_rounding_edges_are_formatted_and_non_finite_values_refused() -> None:
    assert texts([0.0, -0.0, -0.0004, 0.0006, 9.9996, 10.0, 99999.9996, -99999.9996], 3) == [
        *("0.000", "0.000", "0.000", "0.001", "10.000", "10.000", "100000.000", "-100000.000"),
    ]
    assert texts([9.007e12, -1.0], 3) == ["9007000000000.000", "-1.000"]
    assert texts([], 3) == []

    for broken in [np.nan, np.inf, -np.inf, 1e13]:
        with pytest.raises(InputError, match=r"expected finite numbers below 9e\+12, got"):
            decimals(np.array([1.0, broken, 2.0]), 3)


def test_rows_join_columns_of_any_width() -> None:
    names = words(("fir", "oak tree"))
    rows = joined_rows([decimals(np.array([1.0, -22.5]), 1), names[np.array([1, 0])]])
    assert rows == b"1.0,oak tree\n-22.5,fir\n"
