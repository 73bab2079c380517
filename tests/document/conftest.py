"""Sketches and PNG files written byte by byte."""

import dataclasses
import struct
import zlib

import numpy as np
import pytest

from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch
from sketchterrain.errors import InputError


def _chunk(kind, content):
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def png(rows, width, *, depth=8, colour_type=0, palette=b""):
    header = struct.pack(">IIBBBBB", width, len(rows), depth, colour_type, 0, 0, 0)
    data = zlib.compress(b"".join(b"\0" + row for row in rows))
    chunks = [_chunk(b"IHDR", header)]
    if palette:
        chunks.append(_chunk(b"PLTE", palette))
    return b"\x89PNG\r\n\x1a\n" + b"".join([*chunks, _chunk(b"IDAT", data), _chunk(b"IEND", b"")])


def grey(image):
    """Return an 8-bit greyscale PNG of an array."""
    array = np.asarray(image, dtype=np.uint8)
    return png([row.tobytes() for row in array], array.shape[1])


@pytest.fixture
def folder(tmp_path):
    """A sketch folder with the given settings and files."""

    def make(settings="", files=(), version=2):
        place = tmp_path / "valley"
        place.mkdir(exist_ok=True)
        (place / "sketch.toml").write_text(f"format = {version}\n{settings}")
        for name, content in dict(files).items():
            (place / name).write_bytes(content)
        return place

    return make


def refusal(path):
    """Return the one line with which a sketch is refused."""
    with pytest.raises(InputError) as caught:
        load_sketch(path)
    assert caught.value.exit_code == 3
    assert str(caught.value).isprintable()
    return str(caught.value)


def same(a, b):
    """Assert that two sketches are the same in everything."""
    for field in dataclasses.fields(Sketch):
        if field.name not in ("layers", "vectors"):
            assert getattr(a, field.name) == getattr(b, field.name), field.name
    assert list(a.labels) == list(b.labels)
    assert list(a.layers) == list(b.layers)
    for name in a.layers:
        np.testing.assert_array_equal(a.layers[name], b.layers[name])
    for name in a.vectors:
        same_vectors(a.vectors[name], b.vectors[name])


def same_vectors(a, b):
    """Assert that two vector layers are the same in everything."""
    for key in ("layer", "vertices", "rings", "parts", "kinds", "ids", "labels"):
        np.testing.assert_array_equal(getattr(a, key), getattr(b, key), err_msg=key)
    assert list(a.columns) == list(b.columns)
    for name, column in a.columns.items():
        assert type(column) is type(b.columns[name])
        np.testing.assert_array_equal(np.asarray(column), np.asarray(b.columns[name]), err_msg=name)
