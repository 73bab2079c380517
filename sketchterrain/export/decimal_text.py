"""Numbers as decimal text, compiled."""

import numpy as np
import numpy.typing as npt
from numba import njit

_compiled = njit(cache=True, nogil=True)

_ZERO, _MINUS, _POINT = ord("0"), ord("-"), ord(".")


@_compiled  # type: ignore[untyped-decorator] # numba has no types
def write_decimals(text: npt.NDArray[np.uint8], steps: npt.NDArray[np.int64], decimals: int) -> None:
    """Write integers in steps of 10^-decimals, right-aligned, into zeroed rows of characters (n, width)."""
    for row in range(len(steps)):
        left, at, written = abs(steps[row]), text.shape[1], 0
        while left > 0 or written <= decimals:
            if written == decimals and written > 0:
                at -= 1
                text[row, at] = _POINT
            at -= 1
            text[row, at] = _ZERO + left % 10
            left //= 10
            written += 1
        if steps[row] < 0:
            text[row, at - 1] = _MINUS


@_compiled  # type: ignore[untyped-decorator] # numba has no types
def remove_zeros(text: npt.NDArray[np.uint8]) -> int:
    """Move the characters (n,) that are not 0 to the front; return their number."""
    count = 0
    for character in text:
        text[count] = character
        count += character != 0
    return count
