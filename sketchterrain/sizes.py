"""Size limits and memory needs of an exported terrain, checked before anything is computed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sketchterrain.disk import format_bytes
from sketchterrain.errors import InputError
from sketchterrain.system import physical_memory

if TYPE_CHECKING:
    from sketchterrain.sketch import Sketch

MAX_SIZE = 16385
"""The most vertices along the longer side."""

# Measured at 4097²: heights, normals and weights, once in patches and once joined, take 86.
_BYTES_PER_VERTEX = 95
_BASE_BYTES = 450 << 20


def memory_needed(sketch: Sketch, size: int) -> float:
    """Return the approximate bytes that an export takes, `size` vertices along the longer side."""
    east, north = sketch.size
    return _BASE_BYTES + _BYTES_PER_VERTEX * size * size * min(east, north) / max(east, north)


def check_size(sketch: Sketch, size: int) -> None:
    """Raise InputError if `size` vertices are out of range or need more memory than this machine has."""
    if size < 2:
        raise InputError(f"size = {size}: expected 2 to {MAX_SIZE} vertices")
    needed, physical = memory_needed(sketch, size), physical_memory()
    about = f"about {format_bytes(needed)}"
    if size > MAX_SIZE:
        raise InputError(f"size = {size}: expected 2 to {MAX_SIZE} vertices; this needs {about}")
    if needed > physical:
        raise InputError(f"size = {size} needs {about} of memory, this machine has {format_bytes(physical)}")
