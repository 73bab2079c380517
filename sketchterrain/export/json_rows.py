"""Long lists as JSON: rows of numbers from columns, written piece by piece."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.export.decimals import words
from sketchterrain.whole_files import telling_failure, whole_file

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    import numpy.typing as npt

    Text = npt.NDArray[np.uint8]

__all__ = ["json_rows", "small_numbers", "write_listing"]

_NUMBERS = words([str(number) for number in range(256)])


def json_rows(parts: Sequence[bytes | Text]) -> bytes:
    """Return lines with a comma and a line's end between them, none after the last.

    Parameters
    ----------
    parts
        What a line is put together from: bytes, the same in each, or columns of text as
        :func:`sketchterrain.export.decimals.decimals` makes them; one column at least.
    """
    rows = next(len(part) for part in parts if not isinstance(part, bytes))
    columns = [_column(part, rows) for part in (*parts, b",\n")]
    return np.concatenate(columns, axis=1).tobytes().translate(None, delete=b"\0")[:-2]


def small_numbers(values: npt.NDArray[np.uint8]) -> Text:
    """Return bytes as text, a number a row: a column of :func:`json_rows`."""
    return _NUMBERS[values]


def write_listing(path: Path, head: dict[str, Any], name: str, pieces: Iterable[bytes]) -> Path:
    """Write a JSON object whose last member is a long list, one entry a line.

    Parameters
    ----------
    path
    head
        The members before it.
    name
        Of the list.
    pieces
        Its entries as :func:`json_rows` gives them; empty pieces are passed over.

    Raises
    ------
    SketchterrainError
        If the system cannot write the file.
    """
    start = json.dumps(head | {name: []}, ensure_ascii=False, allow_nan=False).removesuffix("]}")
    with whole_file(path) as stream:
        stream.write(f"{start}\n".encode())
        begun = False
        for piece in pieces:
            if piece:
                with telling_failure(path):
                    stream.write(b",\n" + piece if begun else piece)
                begun = True
        stream.write(b"\n]}\n")
    return path


def _column(part: bytes | Text, rows: int) -> Text:
    if not isinstance(part, bytes):
        return part
    return np.broadcast_to(np.frombuffer(part, np.uint8), (rows, len(part)))
