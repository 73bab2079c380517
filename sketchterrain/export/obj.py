"""Wavefront OBJ: triangles as text, written in pieces, with a library of materials beside them.

Wavefront's "Object Files (.obj)" and "MTL material format": vertices are counted from 1 through the whole
file; texture coordinates grow from the picture's lower left corner.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sketchterrain.export.decimals import decimals
from sketchterrain.whole_files import telling_failure, whole_file, write_whole

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path
    from typing import BinaryIO

    import numpy.typing as npt

__all__ = ["HEIGHT_DECIMALS", "ObjPart", "write_mtl", "write_obj"]

HEIGHT_DECIMALS: Final = 4
"""Of a metre."""

_PLACE_DECIMALS: Final = 6  # grids are seldom whole metres apart
_AT_ONCE = 1 << 16  # rows


class ObjPart(NamedTuple):
    """An object of a file: its vertices along the file's axes, y up.

    Attributes
    ----------
    name, material : str
    place : (n, 3) float64
    normal : (n, 3) float32
    texel : (n, 2) float32 or None
        From the picture's upper left corner.
    triangles : (k, 3) uint32
        Counter-clockwise from outside.
    """

    name: str
    material: str
    place: npt.NDArray[np.float64]
    normal: npt.NDArray[np.float32]
    texel: npt.NDArray[np.float32] | None
    triangles: npt.NDArray[np.uint32]


@contextmanager
def write_obj(path: Path, library: str) -> Iterator[Callable[[ObjPart], None]]:
    """Yield a function that adds an object to a file, which is there, whole, once the context has ended well.

    Parameters
    ----------
    path
    library
        Name of the file with the materials.

    Raises
    ------
    SketchterrainError
        If the system cannot write the file.
    """
    with whole_file(path) as stream:
        stream.write(f"# x east, y up, z south, metres\nmtllib {library}\n".encode())
        counted = {"v": 1, "vt": 1, "vn": 1}

        def add(part: ObjPart) -> None:
            with telling_failure(path):
                _write(stream, part, counted)

        yield add


def write_mtl(path: Path, materials: Mapping[str, Mapping[str, str]]) -> Path:
    """Write materials: the statements of each, by its name."""
    lines = [
        line
        for name, statements in materials.items()
        for line in (f"newmtl {name}", *(f"{key} {value}" for key, value in statements.items()), "")
    ]
    return write_whole(path, "\n".join(lines).encode())


def _write(stream: BinaryIO, part: ObjPart, counted: dict[str, int]) -> None:
    stream.write(f"o {part.name.replace(' ', '_')}\nusemtl {part.material}\n".encode())
    columns: dict[str, npt.NDArray[np.floating]] = {"v": part.place, "vn": part.normal}
    if part.texel is not None:
        columns["vt"] = np.stack([part.texel[:, 0], np.float32(1.0) - part.texel[:, 1]], axis=-1)
    places = {"v": [_PLACE_DECIMALS, HEIGHT_DECIMALS, _PLACE_DECIMALS], "vt": [6, 6], "vn": [4, 4, 4]}
    for word, values in columns.items():
        for first in range(0, len(values), _AT_ONCE):
            rows = values[first : first + _AT_ONCE]
            texts = [decimals(rows[:, axis], count) for axis, count in enumerate(places[word])]
            stream.write(_lines(word, [[text] for text in texts]))
    order = [word for word in ("v", "vt", "vn") if word in columns]
    for first in range(0, len(part.triangles), _AT_ONCE):
        some = part.triangles[first : first + _AT_ONCE].astype(np.float64)
        corners = [
            # A whole number is the text of one decimal without its point and that decimal.
            [decimals(some[:, corner] + counted[word], 1)[:, :-2] for word in order]
            for corner in range(3)
        ]
        stream.write(_lines("f", corners, "//" if len(order) == 2 else "/"))
    for word, values in columns.items():
        counted[word] += len(values)


def _lines(word: str, columns: list[list[npt.NDArray[np.uint8]]], between: str = "/") -> bytes:
    """Return lines of a word and columns, in each of which texts are joined."""
    rows = len(columns[0][0])

    def same(text: str) -> npt.NDArray[np.uint8]:
        return np.broadcast_to(np.frombuffer(text.encode(), np.uint8), (rows, len(text)))

    parts = [same(word)]
    for column in columns:
        parts.append(same(" "))
        for number, text in enumerate(column):
            parts += [same(between), text] if number else [text]
    return np.concatenate([*parts, same("\n")], axis=1).tobytes().translate(None, delete=b"\0")
