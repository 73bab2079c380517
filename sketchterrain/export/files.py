"""Folders to write into, and encodings that several writers share: JSON, PNG, rows of numbers as text."""

from __future__ import annotations

import json
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from sketchterrain.errors import InputError, SketchterrainError
from sketchterrain.system import lock_folder, unlock_folder
from sketchterrain.whole_files import atomic_file, atomic_path, wrap_os_errors, write_atomic

_PREFIX: Final = ".sketchterrain-"  # of a staging folder
# Level 6 takes three times as long to save a tenth of the bytes.
_PNG_LEVEL: Final = 3
_RUN_LENGTHS: Final = (
    3  # zlib's Z_RLE: of filtered values it leaves no more bytes than a search, in less time
)
_FIELD: Final = re.compile(r"%(?:\.(\d)f|[ds])")


def prepare_folder(folder: Path) -> None:
    """Make a folder, and find out now, not after the work, whether files can be written there.

    Raises
    ------
    InputError
        If there is something else in its place.
    SketchterrainError
        If the system cannot write there.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: expected a folder to write into, this is a file")
    with wrap_os_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass


@contextmanager
def staging(folder: Path) -> Iterator[Path]:
    """Yield a hidden folder inside another, for files that shall come into it together or not at all.

    What is still there afterwards is deleted, and so is what was left by a process that was killed. Failures
    to write name the outer folder.

    Raises
    ------
    SketchterrainError
        If the system cannot write there.
    """
    with wrap_os_errors(folder):
        hidden, lock = _made(folder)
    try:
        yield hidden
    except SketchterrainError as error:
        if str(hidden) not in str(error):
            raise
        raise type(error)(str(error).replace(str(hidden), str(folder))) from error
    finally:
        shutil.rmtree(hidden, ignore_errors=True)
        unlock_folder(lock)


def _made(folder: Path) -> tuple[Path, int | None]:
    """Return a new hidden folder and its lock, which lasts as long as its process at most."""
    outer = lock_folder(folder, wait=True)  # so that no other process sweeps a folder that is not locked yet
    try:
        _sweep(folder)
        hidden = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=folder))
        return hidden, lock_folder(hidden, wait=True)
    finally:
        unlock_folder(outer)


def _sweep(folder: Path) -> None:
    """Delete hidden folders that no process has locked; none where folders have no locks."""
    for hidden in folder.glob(f"{_PREFIX}*"):
        with suppress(OSError):
            lock = lock_folder(hidden)
            if lock is not None:
                shutil.rmtree(hidden, ignore_errors=True)
                unlock_folder(lock)


def files_without_successor(folder: Path, before: Iterable[str], now: Iterable[str]) -> list[Path]:
    """Return the files of a folder that were written the last time and are not this time."""
    plain = sorted(name for name in {*before} - {*now} if _is_plain(name))
    return [folder / name for name in plain if (folder / name).is_file()]


def move_into(folder: Path, files: Iterable[Path], *, outdated: Iterable[Path] = ()) -> tuple[Path, ...]:
    """Move finished files into a folder of the same file system, over old ones, and return their new paths.

    Parameters
    ----------
    folder
    files
    outdated
        Files that go, once all others are there.

    Raises
    ------
    SketchterrainError
        If the system cannot.
    """
    moved = []
    for file in files:
        with wrap_os_errors(folder / file.name):
            moved.append(file.replace(folder / file.name))
    for file in outdated:
        with wrap_os_errors(file):
            file.unlink()
    return tuple(moved)


def _is_plain(name: str) -> bool:
    return name not in ("", ".", "..") and not set(name) & set("/\\\0")


def write_json(path: Path, value: Any) -> Path:
    """Write a value as JSON, indented, keys in the order given; NaN and infinities are refused."""
    text = json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False)
    return write_atomic(path, f"{text}\n".encode())


def write_png(path: Path, pixels: npt.NDArray[np.uint8]) -> Path:
    """Write a picture, (rows, columns) or (rows, columns, 3 or 4); row 0 is its upper edge."""
    with atomic_path(path) as temporary:
        Image.fromarray(pixels).save(temporary, format="PNG", compress_level=_PNG_LEVEL)
    return path


def write_values_png(path: Path, values: npt.NDArray[np.uint8] | npt.NDArray[np.uint16]) -> Path:
    """Write values that are no colours, uint8 or grey uint16, as a PNG; row 0 is its upper edge."""
    with atomic_path(path) as temporary:
        image = Image.fromarray(values)
        image.save(temporary, format="PNG", compress_level=_PNG_LEVEL, compress_type=_RUN_LENGTHS)
    return path


def text_rows(line: str, *columns: npt.NDArray[Any]) -> bytes:
    r"""Return a line of text for each row of columns, as the %-format `line` has it: ``"%d,%.3f\n"``.

    Numbers are rounded in float64 to the decimals of their fields, halves to even, and never are "-0.000".

    Raises
    ------
    InputError
        If a number is not finite.
    """
    lists: list[Sequence[Any]] = []
    for places, column in zip(_FIELD.findall(line), columns, strict=True):
        if places:
            if not np.isfinite(column).all():
                broken = column[~np.isfinite(column)][0]
                raise InputError(f"expected finite numbers to write as text, got {broken:g}")
            column = np.round(column.astype(np.float64), int(places)) + 0.0  # no -0.0
        lists.append(column.tolist())
    return (line * len(lists[0]) % tuple(chain.from_iterable(zip(*lists, strict=True)))).encode()


def write_listing(path: Path, head: dict[str, Any], name: str, pieces: Iterable[bytes]) -> Path:
    """Write a JSON object whose last member is a long list, one entry a line."""
    start = json.dumps(head | {name: []}, ensure_ascii=False, allow_nan=False).removesuffix("]}")
    with atomic_file(path) as stream:
        stream.write(f"{start}\n".encode())
        begun = False
        for piece in pieces:
            if piece:
                with wrap_os_errors(path):
                    stream.write(b",\n" + piece if begun else piece)
                begun = True
        stream.write(b"\n]}\n")
    return path
