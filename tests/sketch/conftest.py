"""Sketches made by hand, byte by byte where the format matters."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sketchterrain.sketch import Sketch, load_sketch


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def _png(
    rows: list[bytes], width: int, *, depth: int = 8, colour_type: int = 0, palette: bytes = b""
) -> bytes:
    header = struct.pack(">IIBBBBB", width, len(rows), depth, colour_type, 0, 0, 0)
    data = zlib.compress(b"".join(b"\0" + row for row in rows))
    chunks = [_chunk(b"IHDR", header)]
    if palette:
        chunks.append(_chunk(b"PLTE", palette))
    return b"\x89PNG\r\n\x1a\n" + b"".join([*chunks, _chunk(b"IDAT", data), _chunk(b"IEND", b"")])


@pytest.fixture
def png() -> Callable[..., bytes]:
    """A PNG from raw rows, by the format's own words."""
    return _png


@pytest.fixture
def grey() -> Callable[..., bytes]:
    """An 8-bit greyscale PNG of an array."""

    def make(image: object) -> bytes:
        array = np.asarray(image, dtype=np.uint8)
        return _png([row.tobytes() for row in array], array.shape[1])

    return make


@pytest.fixture
def folder(tmp_path: Path) -> Callable[..., Path]:
    """A sketch folder with the given settings and files."""

    def make(settings: str | bytes | None = "", files: dict[str, bytes] | None = None) -> Path:
        place = tmp_path / "valley"
        place.mkdir(exist_ok=True)
        if isinstance(settings, str):
            settings = f"format = 1\n{settings}".encode()
        if settings is not None:
            (place / "sketch.toml").write_bytes(settings)
        for name, content in (files or {}).items():
            (place / name).write_bytes(content)
        return place

    return make


@pytest.fixture
def refusal() -> Callable[..., str]:
    """The one line with which a sketch is refused."""

    def read(path: object) -> str:
        with pytest.raises(Exception) as caught:
            load_sketch(path)  # type: ignore[arg-type]
        assert type(caught.value).__name__ == "InputError", repr(caught.value)
        assert caught.value.exit_code == 3  # type: ignore[attr-defined]
        message = str(caught.value)
        assert "\n" not in message
        assert message.isprintable()
        return message

    return read


@pytest.fixture
def same() -> Callable[[Sketch, Sketch], None]:
    """Assert that two sketches are the same in everything."""

    def compare(a: Sketch, b: Sketch) -> None:
        for key in (
            "name",
            "extent",
            "seed",
            "fidelity",
            "density",
            "ground",
            "climate",
            "weather",
            "labels",
            "edits",
            "material_rules",
        ):
            assert getattr(a, key) == getattr(b, key), key
        assert list(a.labels) == list(b.labels)
        assert list(a.layers) == list(b.layers)
        for name in a.layers:
            np.testing.assert_array_equal(a.layers[name], b.layers[name])

    return compare
