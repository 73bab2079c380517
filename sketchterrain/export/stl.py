"""STL, binary: a header of 80 bytes, the number of triangles, then 50 bytes each.

3D Systems' "StereoLithography Interface Specification": normal and three corners as little-endian float32,
two bytes that are 0; corners counter-clockwise from outside.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.whole_files import telling_failure, whole_file

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt

__all__ = ["write_stl"]

_FACET: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
_HEADER: Final = b"binary STL of sketchterrain; x east, y north, z up, metres"
_MOST: Final = (1 << 32) - 1
_AT_ONCE = 1 << 16  # triangles


def write_stl(path: Path, place: npt.NDArray[np.float32], triangles: npt.NDArray[np.uint32]) -> Path:
    """Write triangles.

    Parameters
    ----------
    path
    place
        (n, 3).
    triangles
        (k, 3).

    Raises
    ------
    InputError
        If there are more triangles than the format can count.
    SketchterrainError
        If the system cannot write the file.
    """
    if len(triangles) > _MOST:
        raise InputError(f"{path.name}: an STL holds {_MOST} triangles, this one needs {len(triangles)}")
    with whole_file(path) as stream, telling_failure(path):
        stream.write(_HEADER.ljust(80) + struct.pack("<I", len(triangles)))
        for first in range(0, len(triangles), _AT_ONCE):
            corners = place[triangles[first : first + _AT_ONCE]]
            sides = corners[:, 1:].astype(np.float64) - corners[:, :1]
            normal = np.cross(sides[:, 0], sides[:, 1])
            facets = np.zeros(len(corners), _FACET)
            facets["normal"] = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
            facets["corners"] = corners
            stream.write(facets.tobytes())
    return path
