"""Arrays in one file that is mapped into memory, and their writer, which appends to them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Int64Array

_ALIGNMENT: Final = 64  # bytes
_FACTS, _CONTENT = "facts.json", "arrays.bin"


class Texts:
    """Byte strings, one after the other."""

    def __init__(self, content: npt.NDArray[np.uint8], ends: Int64Array) -> None:
        self._content, self._ends = content, ends

    def __getitem__(self, number: int) -> bytes:
        start = self._ends[number - 1] if number else 0
        return self._content[start : self._ends[number]].tobytes()


class StoredArrays:
    """What an `ArrayWriter` wrote, read as far as it is asked for."""

    def __init__(self, folder: Path) -> None:
        self.facts, self._places = json.loads((folder / _FACTS).read_text(encoding="utf-8"))
        self._content = np.asarray(np.memmap(folder / _CONTENT, np.uint8, "r"))

    def array(self, name: str, dtype: npt.DTypeLike, columns: int = 0) -> npt.NDArray[Any]:
        """Return an array of values, or of rows of some columns."""
        start, size = self._places.get(name, (0, 0))
        found = self._content[start : start + size].view(dtype)
        return found.reshape(-1, columns) if columns else found

    def texts(self, name: str) -> Texts:
        """Return byte strings."""
        return Texts(self.array(name, np.uint8), self.array(f"{name}.ends", np.int64))


class ArrayWriter:
    """Appends to arrays in a folder; `finish` joins them in one file."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._streams = folder, dict[str, BinaryIO]()

    def add(self, name: str, array: npt.NDArray[Any]) -> None:
        """Append to an array."""
        if name not in self._streams:
            self._streams[name] = (self._folder / name).open("wb")
        self._streams[name].write(array.tobytes())

    def add_texts(self, name: str, texts: list[bytes]) -> None:
        """Append byte strings."""
        start = self._streams[name].tell() if name in self._streams else 0
        self.add(name, np.frombuffer(b"".join(texts), np.uint8))
        self.add(f"{name}.ends", start + np.cumsum([len(text) for text in texts], dtype=np.int64))

    def finish(self, facts: object = None) -> StoredArrays:
        """Join all arrays, and return them."""
        places = {}
        with (self._folder / _CONTENT).open("wb") as content:
            content.write(bytes(_ALIGNMENT))  # an empty file cannot be mapped
            for name, stream in self._streams.items():
                stream.close()
                content.write(bytes(-content.tell() % _ALIGNMENT))
                start, part = content.tell(), self._folder / name
                with part.open("rb") as opened:
                    shutil.copyfileobj(opened, content)
                places[name] = start, content.tell() - start
                part.unlink()
        (self._folder / _FACTS).write_text(json.dumps([facts, places]), encoding="utf-8")
        return StoredArrays(self._folder)
