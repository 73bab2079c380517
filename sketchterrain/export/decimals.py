"""Columns of numbers as text with fixed decimals, a whole column at a time: a table of millions of rows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    Text = npt.NDArray[np.uint8]

__all__ = ["decimals", "joined_rows", "words"]

_DIGITS = 4  # that one look-up gives
_TABLE = np.frombuffer("".join(f"{n:04d}" for n in range(10**_DIGITS)).encode("ascii"), np.uint32)
_MOST = 2.0**53  # up to which a float64 holds every whole number


def decimals(values: npt.NDArray[np.floating], places: int) -> Text:
    """Return numbers as ASCII text with so many decimals, as ``%.3f`` would, and never as "-0.000".

    Parameters
    ----------
    values
        (n,), finite, each below 2⁵³ in units of the last decimal.
    places
        Decimals, ≥ 1.

    Returns
    -------
    ndarray of uint8, shape (n, width)
        A text a row, among zero bytes, which :func:`joined_rows` leaves out.

    Raises
    ------
    InputError
        If a number is not finite, or too large.
    """
    units = np.rint(values.astype(np.float64) * 10.0**places)
    if not (np.abs(units) < _MOST).all():  # false for NaN too
        raise InputError(f"expected finite numbers below {_MOST / 10**places:.0g}, got {_worst(values):g}")
    rest = np.abs(units).astype(np.int64)
    count = max(len(str(rest.max(initial=0))), places + 1)
    groups = -(-count // _DIGITS)
    digits = np.empty((len(values), groups), np.uint32)
    for group in reversed(range(groups)):
        above = rest // 10**_DIGITS
        digits[:, group] = _TABLE[rest - above * 10**_DIGITS]
        rest = above
    plain = digits.view(np.uint8).reshape(len(values), groups * _DIGITS)[:, groups * _DIGITS - count :]
    text = np.empty((len(values), count + 2), np.uint8)
    point = count - places
    text[:, 0] = np.where(units < 0, ord("-"), 0)
    text[:, 1 : point + 1] = plain[:, :point]
    text[:, point + 1] = ord(".")
    text[:, point + 2 :] = plain[:, point:]
    size = np.abs(units)
    for column in range(point - 1):  # zeros before the first digit that counts; one stays before the point
        text[:, column + 1] *= size >= 10.0 ** (count - 1 - column)
    return text


def words(names: Sequence[str]) -> Text:
    """Return names as rows of ASCII text, filled up with zero bytes."""
    width = max(len(name) for name in names)
    text = "".join(name.ljust(width, "\0") for name in names).encode("ascii")
    return np.frombuffer(text, np.uint8).reshape(len(names), width)


def joined_rows(columns: Sequence[Text]) -> bytes:
    """Return lines of columns with commas between them; zero bytes in the columns are left out."""
    rows = len(columns[0])
    comma, end = (np.full((rows, 1), ord(sign), np.uint8) for sign in ",\n")
    parts = [part for column in columns for part in (column, comma)]
    return np.concatenate([*parts[:-1], end], axis=1).tobytes().translate(None, delete=b"\0")


def _worst(values: npt.NDArray[np.floating]) -> float:
    broken = values[~np.isfinite(values)]
    return float(broken[0] if broken.size else values[np.abs(values).argmax()])
