"""Output folders, staging, and encodings shared by the writers: JSON, PNG, formatted rows of numbers."""

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

from sketchterrain.document.store import reject_sketch_folder
from sketchterrain.errors import InputError, SketchterrainError
from sketchterrain.io.files import atomic_file, atomic_path, wrap_os_errors, write_atomic
from sketchterrain.io.system import lock_folder, unlock_folder

_PREFIX: Final = ".sketchterrain-"  # of a staging folder
_PNG_LEVEL: Final = 3  # level 6 takes three times as long to save a tenth of the bytes
_Z_RLE: Final = 3  # zlib strategy: on filtered values as small as a search, and faster
_FIELD: Final = re.compile(r"%(?:\.(\d)f|[ds])")


def prepare_folder(folder: Path) -> None:
    """Create a folder, not a sketch's, and check now, before the work, that files can be written to it."""
    reject_sketch_folder(folder)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: expected a folder to write into, this is a file")
    with wrap_os_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass


@contextmanager
def staging(folder: Path) -> Iterator[Path]:
    """Yield a hidden subfolder for files that are moved into the folder together or not at all.

    It is deleted afterwards, and so are those of killed processes. Errors name the outer folder.
    """
    with wrap_os_errors(folder):
        # Locked while creating, so that no other process removes a subfolder that is not locked yet.
        outer = lock_folder(folder, wait=True)
        try:
            _remove_abandoned(folder)
            hidden = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=folder))
            lock = lock_folder(hidden, wait=True)  # released when its process ends, at the latest
        finally:
            unlock_folder(outer)
    try:
        yield hidden
    except SketchterrainError as error:
        if str(hidden) not in str(error):
            raise
        raise type(error)(str(error).replace(str(hidden), str(folder))) from error
    finally:
        shutil.rmtree(hidden, ignore_errors=True)
        unlock_folder(lock)


def _remove_abandoned(folder: Path) -> None:
    """Delete staging folders that no process has locked; none where the system cannot lock folders."""
    for hidden in folder.glob(f"{_PREFIX}*"):
        with suppress(OSError):
            lock = lock_folder(hidden)
            if lock is not None:
                shutil.rmtree(hidden, ignore_errors=True)
                unlock_folder(lock)


def stale_files(path: Path, report: dict[str, Any], same: Iterable[str]) -> list[Path]:
    """Return the files of a previous run beside its report that the new report does not list.

    There are none if there is no report at `path`, or one whose values of the keys `same` are different.
    """
    try:
        before = json.loads(path.read_bytes())
        if any(before.get(key) != report.get(key) for key in same):
            return []
        old, new = (
            {str(entry["file"] if isinstance(entry, dict) else entry) for entry in each["files"]}
            for each in (before, report)
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return []  # missing, or not ours
    names = (name for name in old - new if name not in ("", ".", "..") and not set(name) & set("/\\\0"))
    return [path.with_name(name) for name in sorted(names) if path.with_name(name).is_file()]


def move_files(folder: Path, files: Iterable[Path], *, stale: Iterable[Path] = ()) -> tuple[Path, ...]:
    """Move files into a folder of the same file system, replacing old ones; then delete the stale ones."""
    moved = []
    for file in files:
        with wrap_os_errors(folder / file.name):
            moved.append(file.replace(folder / file.name))
    for file in stale:
        with wrap_os_errors(file):
            file.unlink()
    return tuple(moved)


def write_json(path: Path, value: Any) -> Path:
    """Write indented JSON, keys in the order given; raise `ValueError` for NaN and Inf."""
    text = json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False)
    return write_atomic(path, f"{text}\n".encode(errors="backslashreplace"))  # JSON's escapes of surrogates


def write_png(path: Path, pixels: npt.NDArray[np.uint8]) -> Path:
    """Write an image, (rows, columns) or (rows, columns, 3 or 4), row 0 at the top."""
    with atomic_path(path) as temporary:
        Image.fromarray(pixels).save(temporary, format="PNG", compress_level=_PNG_LEVEL)
    return path


def write_values_png(path: Path, values: npt.NDArray[np.uint8] | npt.NDArray[np.uint16]) -> Path:
    """Write non-colour data, uint8 or grey uint16, as a PNG, row 0 at the top."""
    with atomic_path(path) as temporary:
        image = Image.fromarray(values)
        image.save(temporary, format="PNG", compress_level=_PNG_LEVEL, compress_type=_Z_RLE)
    return path


def format_rows(line: str, *columns: npt.NDArray[Any]) -> bytes:
    r"""Return a line of text for each row of columns in the %-format `line`, such as ``"%d,%.3f\n"``.

    Numbers are rounded in float64 to the decimals of their fields, halves to even; "-0.000" is avoided.
    """
    lists: list[Sequence[Any]] = []
    for decimals, column in zip(_FIELD.findall(line), columns, strict=True):
        if decimals:
            if not np.isfinite(column).all():
                invalid = column[~np.isfinite(column)][0]
                raise InputError(f"expected finite numbers to write as text, got {invalid:g}")
            column = np.round(column.astype(np.float64), int(decimals)) + 0.0  # no -0.0
        lists.append(column.tolist())
    return (line * len(lists[0]) % tuple(chain.from_iterable(zip(*lists, strict=True)))).encode()


def write_json_list(path: Path, head: dict[str, Any], name: str, chunks: Iterable[bytes]) -> Path:
    """Write a JSON object whose last member is a long list, one entry a line, from encoded chunks of it."""
    start = json.dumps(head | {name: []}, ensure_ascii=False, allow_nan=False).removesuffix("]}")
    separator = b""
    with atomic_file(path) as stream:
        stream.write(f"{start}\n".encode())
        for chunk in filter(None, chunks):
            with wrap_os_errors(path):
                stream.write(separator + chunk)
            separator = b",\n"
        stream.write(b"\n]}\n")
    return path
