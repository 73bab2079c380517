"""How large an exported terrain can be, and the memory that it takes: known before anything is loaded."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sketchterrain.disk import gibibytes
from sketchterrain.errors import InputError
from sketchterrain.system import physical_memory

if TYPE_CHECKING:
    from sketchterrain.sketch import Sketch

MAX_SIZE = 16385
"""The most vertices along the longer side."""

# Measured at 4097²: heights, normals and weights, once in patches and once joined, take 86.
_BYTES_PER_VERTEX = 95
_BYTES_AT_LEAST = 450 << 20


def memory_needed(sketch: Sketch, size: int) -> float:
    """Return about how many bytes it takes to export a terrain."""
    east, north = sketch.size
    return _BYTES_AT_LEAST + _BYTES_PER_VERTEX * size * size * min(east, north) / max(east, north)


def check_size(sketch: Sketch, size: int) -> None:
    """Refuse a size that is out of range or needs more memory than this machine has."""
    if size < 2:
        raise InputError(f"size = {size}: expected 2 to {MAX_SIZE} vertices")
    needed = memory_needed(sketch, size)
    there = physical_memory()
    if size > MAX_SIZE:
        raise InputError(
            f"size = {size}: expected 2 to {MAX_SIZE} vertices; this needs about {gibibytes(needed)}"
        )
    if needed > there:
        raise InputError(
            f"size = {size} needs about {gibibytes(needed)} of memory, this machine has {gibibytes(there)}"
        )
