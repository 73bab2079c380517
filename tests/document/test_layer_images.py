"""PNG layers and zip archives, byte by byte."""

import io
import stat
import struct
import tracemalloc
import zipfile
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from sketchterrain.document.label_layers import decode_layer, encode_layer
from sketchterrain.document.layers import LAYERS
from sketchterrain.document.store import load_sketch, pack_zip
from sketchterrain.errors import InputError

from .conftest import grey, png, refusal

_SMALL = np.array([[0, 1, 2], [255, 0, 7]], dtype=np.uint8)


def _refusal(data):
    with pytest.raises(InputError) as caught:
        decode_layer(data)
    assert str(caught.value).isprintable()
    return str(caught.value)


def _saved(image, **options):
    stream = io.BytesIO()
    image.save(stream, format="PNG", **options)
    return stream.getvalue()


@settings(max_examples=30)
@given(
    st.integers(1, 40),
    st.integers(1, 40),
    st.lists(st.integers(0, 255), min_size=1, max_size=16),
    st.integers(0, 2**32 - 1),
)
def test_layers_round_trip(height, width, labels, seed):
    image = np.random.default_rng(seed).choice(np.array(labels, dtype=np.uint8), (height, width))
    again = decode_layer(encode_layer(image, (10, 200, 30)))
    np.testing.assert_array_equal(again, image)
    assert again.dtype == np.uint8
    assert not again.flags.writeable


def test_layers_are_8_bit_palette_images_in_their_colour():
    labels = np.arange(17, dtype=np.uint8)[None]
    for layer in LAYERS.values():
        data = encode_layer(_SMALL, layer.colour)
        assert data[24:26] == bytes([8, 3])
        with Image.open(io.BytesIO(data)) as picture:
            colours = np.asarray(picture.convert("RGB"))
        assert tuple(colours[0, 1]) == layer.colour
        assert tuple(colours[0, 0]) == (0, 0, 0)
        with Image.open(io.BytesIO(encode_layer(labels, layer.colour))) as picture:
            assert len(np.unique(np.asarray(picture.convert("RGB")).reshape(-1, 3), axis=0)) == 17


def test_indices_and_grey_values_are_labels():
    for depth in (1, 2, 4, 8):
        bits = [0, 1] * 4 if depth == 1 else [0, 1, 2, 3]
        packed = int("".join(f"{bit:0{depth}b}" for bit in bits), 2).to_bytes(len(bits) * depth // 8, "big")
        palette = bytes(range(255, 255 - 3 * 2 ** min(depth, 3), -1))
        image = decode_layer(png([packed], len(bits), depth=depth, colour_type=3, palette=palette))
        assert image.tolist() == [bits], depth

    np.testing.assert_array_equal(decode_layer(grey(_SMALL)), _SMALL)
    np.testing.assert_array_equal(decode_layer(_saved(Image.fromarray(_SMALL), transparency=1)), _SMALL)
    assert decode_layer(png([b"\x81", b"\xff"], 8, depth=1)).tolist() == [[1, 0, 0, 0, 0, 0, 0, 1], [1] * 8]

    assert decode_layer(grey([list(range(17))])).shape == (1, 17)  # 0 is no label
    assert decode_layer(grey([list(range(1, 17))])).shape == (1, 16)
    assert "it has 17 labels, expected at most 16" in _refusal(grey([list(range(18))]))


def test_refused_images():
    for mode in ("RGB", "RGBA", "LA"):
        message = _refusal(_saved(Image.fromarray(_SMALL).convert(mode)))
        assert "single-channel" in message
        assert {"LA": "grey with alpha"}.get(mode, mode) in message
    message = _refusal(_saved(Image.fromarray(np.full((4, 4), 300, dtype=np.uint16))))
    assert message == "16 bits a pixel: expected an 8-bit single-channel PNG"
    for depth in (2, 4):  # values of shallow grey would be stretched
        assert f"{depth} bits a pixel: expected an 8-bit" in _refusal(png([b"\x1b"], 8 // depth, depth=depth))
    with Image.new("L", (64, 64)) as picture:
        picture.paste(255, (16, 16, 48, 48))
        smooth = picture.rotate(30, resample=Image.Resampling.BICUBIC).resize((100, 100))
    assert "looks antialiased" in _refusal(_saved(smooth))
    for data in (b"", b"\x89PNG\r\n\x1a\n", b"GIF89a", b"\x89PNG\r\n\x1a\n" + b"\0" * 100, b"\0" * 99):
        assert "PNG" in _refusal(data)
    data = png([b"\1"], 1)
    assert "no header" in _refusal(data[:8] + data[-12:] + data[8:])  # chunks in a wrong order
    cut = _resized(png([b"\1" * 8] * 4, 8), 20, 4)
    assert "damaged" in _refusal(cut)  # the stream ends within a row


def _resized(png, width, height):
    """Change the size in the header alone."""
    data = bytearray(png)
    data[16:24] = struct.pack(">II", width, height)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    return bytes(data)


def test_damaged_png_is_refused():
    data = encode_layer(_SMALL, (1, 2, 3))
    for position in range(len(data)):
        assert "expected a" in _refusal(data[:position])
        changed = bytearray(data)
        changed[position] ^= 0x41
        _refusal(bytes(changed))


def test_image_size_is_checked_before_decoding():
    for width, height in ((16385, 1), (1, 16385), (2**31, 2**31 - 1), (0, 4), (4, 0)):
        data = _resized(png([b"\1"], 1), width, height)
        tracemalloc.start()
        assert f"{width}×{height} px: expected sides of 1 to 16384 px" in _refusal(data)
        assert tracemalloc.get_traced_memory()[1] < 1 << 20
        tracemalloc.stop()


def test_images_beyond_pillows_limit_are_read(monkeypatch):
    image = np.zeros((120, 160), dtype=np.uint8)
    image[-1, -1] = 3
    for limit in (100, image.size - 1):  # Pillow raises beyond twice its limit and warns beyond it
        monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", limit)
        np.testing.assert_array_equal(decode_layer(encode_layer(image, (1, 2, 3))), image)


_SETTINGS = b"format = 1\n"
_TEN_GB = 10 * 10**9


@pytest.fixture
def packed(tmp_path):
    """Write a zip with the given entries: names or ZipInfo, and contents."""

    def make(*entries, method=zipfile.ZIP_DEFLATED):
        path = tmp_path / "valley.sketch"
        with zipfile.ZipFile(path, "w", method, compresslevel=1) as archive:
            for name, content in entries:
                archive.writestr(name, content)
        return path

    return make


def _zeros(count):
    """Return a raw deflate stream of `count` zeros, of repeated pieces."""
    piece = 10**7
    compressor = zlib.compressobj(9, zlib.DEFLATED, -15)
    first = compressor.compress(bytes(piece)) + compressor.flush(zlib.Z_FULL_FLUSH)
    return first * (count // piece) + compressor.flush()


def _bomb(name, count, *, declared, start=b""):
    """Return a zip whose entry `name` has `count` zeros after `start` but declares another size."""
    head = zlib.compressobj(9, zlib.DEFLATED, -15)
    content = head.compress(start) + head.flush(zlib.Z_FULL_FLUSH) + _zeros(count)
    entries, directory = b"", b""
    for entry, size, data, method in (("sketch.toml", 11, _SETTINGS, 0), (name, declared, content, 8)):
        wide = struct.pack("<HHQQ", 1, 16, size, len(data)) if size >= 2**32 else b""
        sizes = (2**32 - 1, 2**32 - 1) if wide else (len(data), size)
        fields = (45, 0, method, 0, 33, zlib.crc32(data) if not method else 0, *sizes, len(entry), len(wide))
        at = len(entries)
        entries += struct.pack("<4sHHHHHIIIHH", b"PK\3\4", *fields) + entry.encode() + wide + data
        directory += struct.pack("<4sHHHHHHIIIHHHHHII", b"PK\1\2", 45, *fields, 0, 0, 0, 0, at)
        directory += entry.encode() + wide
    tail = struct.pack("<4sHHHHIIH", b"PK\5\6", 0, 0, 2, 2, len(directory), len(entries), 0)
    return entries + directory + tail


def test_sketch_at_the_top_or_in_one_folder_of_a_zip(packed):
    hill = grey([[1, 0, 0]])
    for top in ("", "My valley/"):
        sketch = load_sketch(
            packed((f"{top}sketch.toml", b"format = 1\nseed = 5\n"), (f"{top}hill.png", hill))
        )
        assert sketch.seed == 5
        assert sketch.layers["hill"].tolist() == [[1, 0, 0]]

    path = packed(
        ("valley/", b""),
        ("valley/sketch.toml", _SETTINGS),
        ("__MACOSX/valley/._hill.png", b"?"),
        (".DS_Store", b"?"),
        ("valley/._hill.png", b"?"),
        ("valley/source.xcf", b"?"),
        ("valley/notes/readme.txt", b"?"),
    )
    assert load_sketch(path).width_px == 512


def _special(kind):
    """Return an entry that is not a file."""
    info = zipfile.ZipInfo("hill.png")
    info.external_attr = (kind | 0o777) << 16
    return info


_LEAVING = (
    *("../evil.toml", "a/../../evil", "/etc/evil", "a\\..\\evil", "C:/evil"),
    *("./sketch.toml", "a//b", "..", "a/.."),
)
# Entries beside the settings, and the expected message.
_REFUSED: list[tuple[list[tuple[str | zipfile.ZipInfo, bytes]], str]] = [
    *(([(name, b"evil")], "refused: expected a") for name in _LEAVING),
    *(
        ([(_special(kind), b"/etc/passwd")], "not a link or a device")
        for kind in (stat.S_IFLNK, stat.S_IFIFO, stat.S_IFCHR)
    ),
    ([("sketch.toml", _SETTINGS)], "duplicate entry"),
    ([(f"{i}.txt", b"") for i in range(1001)], "expected at most 1000"),
    ([(f"{i}.xcf", bytes(60 << 20)) for i in range(5)], "unpacked: too large: expected at most 256 MiB"),
]


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_refused_entries(packed, tmp_path):
    for entries, expected in _REFUSED:
        path = packed(("sketch.toml", _SETTINGS), *entries)
        message = refusal(path)
        assert expected in message, entries[0]
        assert str(path) in message, entries[0]
        assert [entry.name for entry in tmp_path.iterdir()] == ["valley.sketch"]
        assert not (tmp_path.parent / "evil").exists()
    for method in (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
        message = refusal(packed(("sketch.toml", _SETTINGS), method=method))
        assert "expected stored or deflated data" in message
    path = packed(("sketch.toml", _SETTINGS + bytes(16 << 20)))
    assert "sketch.toml: too large: expected at most 16 MiB" in refusal(path)


def test_refused_bytes(packed, tmp_path):
    path = packed(("sketch.toml", _SETTINGS), ("hill.pngXevil", b""))
    path.write_bytes(path.read_bytes().replace(b"hill.pngX", b"hill.png\0"))
    assert "refused: expected a plain relative path" in refusal(path)

    path = packed(("sketch.toml", _SETTINGS))
    data = bytearray(path.read_bytes())
    data[6] |= 1
    data[data.index(b"PK\1\2") + 8] |= 1
    path.write_bytes(data)
    assert "encrypted" in refusal(path)

    path = tmp_path / "x.sketch"
    for content in (b"", b"PK", b"not a zip", b"PK\5\6" + bytes(18)):
        path.write_bytes(content)
        assert str(path) in refusal(path), content
    with path.open("wb") as stream:
        stream.truncate(1 << 40)  # sparse
    assert "too large: expected at most 256 MiB" in refusal(path)


_BOMBS = [("hill.png", 1000, b""), ("hill.png", 60 << 20, b"\x89PNG\r\n\x1a\n"), ("notes.txt", _TEN_GB, b"")]


def test_zip_bombs_are_not_unpacked(tmp_path, monkeypatch):
    unpacked, read = [], zipfile.ZipExtFile.read

    def counted(entry, *size):
        unpacked.append(len(content := read(entry, *size)))
        return content

    monkeypatch.setattr(zipfile.ZipExtFile, "read", counted)
    path = tmp_path / "bomb.sketch"
    for name, declared, start in _BOMBS:
        path.write_bytes(_bomb(name, _TEN_GB, declared=declared, start=start))
        tracemalloc.start()
        assert "bomb.sketch" in refusal(path), (name, declared, start)
        assert sum(unpacked) < 200 << 20
        assert tracemalloc.get_traced_memory()[1] < 200 << 20
        tracemalloc.stop()


def test_damaged_zips_and_invalid_sketches_are_refused(packed):
    path = packed(("sketch.toml", _SETTINGS), ("hill.png", grey([[0, 1], [2, 3]])))
    whole = path.read_bytes()
    for length in range(0, len(whole), 3):
        path.write_bytes(whole[:length])
        assert "valley.sketch" in refusal(path)

    path = packed(("v/sketch.toml", b"format = 1\nextent = 0\n"))
    assert refusal(path) == f"{path}/sketch.toml: extent = 0: expected a number from 1 to 1000000 m"
    path = packed(("v/sketch.toml", _SETTINGS), ("v/mountains.png", grey([[0]])))
    assert "unknown layer image 'mountains.png'" in refusal(path)
    path = packed(("v/w/sketch.toml", _SETTINGS))
    assert "no sketch.toml" in refusal(path)


def test_zip_bytes_are_reproducible():
    files = {"sketch.toml": b"format = 1", "hill.png": b"2"}
    data = pack_zip(files)
    assert data == pack_zip(dict(reversed(files.items())))
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        assert archive.testzip() is None
        assert {info.filename: archive.read(info) for info in archive.infolist()} == files
