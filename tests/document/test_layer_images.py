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

from sketchterrain.document.label_layers import decode_layer, encode_layer, label_rgb
from sketchterrain.document.store import load_sketch
from sketchterrain.errors import InputError
from sketchterrain.jobs.generate import sketch_notes
from sketchterrain.schema.layers import LAYERS, PAINTED_LAYERS

from .conftest import grey, png, refusal

_SMALL = np.array([[0, 1, 2], [255, 0, 7]], dtype=np.uint8)


def _refusal(data):
    with pytest.raises(InputError) as caught:
        decode_layer(data, "mountain")
    assert str(caught.value).isprintable()
    return str(caught.value)


def _decoded(data, layer="mountain"):
    image, notes = decode_layer(data, layer)
    assert notes == []
    return image


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
    again = _decoded(encode_layer(image, (10, 200, 30)))
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
        image = _decoded(png([packed], len(bits), depth=depth, colour_type=3, palette=palette))
        assert image.tolist() == [bits], depth

    np.testing.assert_array_equal(_decoded(grey(_SMALL)), _SMALL)
    np.testing.assert_array_equal(_decoded(_saved(Image.fromarray(_SMALL), transparency=1)), _SMALL)
    assert _decoded(png([b"\x81", b"\xff"], 8, depth=1)).tolist() == [[1, 0, 0, 0, 0, 0, 0, 1], [1] * 8]

    assert _decoded(grey([list(range(17))])).shape == (1, 17)  # 0 is no label
    assert _decoded(grey([list(range(1, 17))])).shape == (1, 16)
    assert "it has 17 labels, expected at most 16" in _refusal(grey([list(range(18))]))


@pytest.mark.parametrize("layer", PAINTED_LAYERS)
def test_colours_decide_where_the_palette_is_the_layers(layer):
    labels = np.array([[0, 0, 1, 2], [0, 3, 4, 2]], np.uint8)
    written = [*Image.open(io.BytesIO(encode_layer(labels, LAYERS[layer].colour))).getpalette()[: 17 * 3]]
    drawn = [0, 0, 0, *(channel for label in range(1, 17) for channel in label_rgb(layer, label))]
    for palette in (written, drawn):
        for order in ([1, 0, *range(2, 17)], [*range(16, -1, -1)]):
            place = np.argsort(order).astype(np.uint8)
            moved = np.array(palette, np.uint8).reshape(-1, 3)[order]
            picture = Image.fromarray(place[labels])
            picture.putpalette(moved.ravel().tolist())
            image, (note,) = decode_layer(_saved(picture), layer)
            np.testing.assert_array_equal(image, labels)
            assert f"{place[0]} is empty" in note
            assert f"{place[1]} is 1" in note


def test_palettes_of_others_and_of_files_by_the_program_have_indices_as_labels():
    for labels in ([0, 1, 75, 200], [1, 2, 75], [0], [77]):  # some shades of high labels are those of others
        image = np.array([labels] * 2, np.uint8)
        np.testing.assert_array_equal(_decoded(encode_layer(image, LAYERS["mountain"].colour)), image)
        np.testing.assert_array_equal(_decoded(encode_layer(image, (1, 200, 7))), image)
    image = np.array([[1, 0, 2]], np.uint8)
    for palette in ((255, 255, 255, 0, 0, 0, 200, 0, 0), (0, 0, 0, *LAYERS["hill"].colour, 200, 0, 0)):
        picture = Image.fromarray(image)
        picture.putpalette(palette)
        np.testing.assert_array_equal(_decoded(_saved(picture), "hill"), image)
    # A layer without paint, whose palette begins with a colour; a transparent entry of any colour
    picture = Image.fromarray(np.ones((2, 2), np.uint8))
    picture.putpalette((*LAYERS["hill"].colour, 0, 0, 0))
    assert not decode_layer(_saved(picture), "hill")[0].any()
    picture = Image.fromarray(np.array([[0, 1, 2]], np.uint8))
    picture.putpalette((*LAYERS["hill"].colour, 0, 0, 0, 9, 9, 9))
    assert decode_layer(_saved(picture, transparency=bytes([255, 255, 0])), "hill")[0].tolist() == [[1, 0, 0]]
    picture.putpalette((*LAYERS["hill"].colour, 0, 0, 0, 255, 255, 255))  # of a copied layer
    assert decode_layer(_saved(picture), "mountain")[0].tolist() == [[1, 0, 0]]


def _in_colour(labels, layer="mountain", *, canvas=(0, 0, 0), alpha=255):
    """Return a picture of labels in the palette's colours, (rows, columns, 4)."""
    table = [(*canvas, alpha), *((*label_rgb(layer, label), 255) for label in range(1, 4))]
    return np.array(table, np.uint8)[labels]


def test_pictures_in_exactly_the_layers_colours_are_labels():
    labels = np.zeros((20, 30), np.uint8)
    labels[4:16, 3:14], labels[5:9, 20:28], labels[18, 2:] = 1, 2, 3
    for canvas, alpha in (((0, 0, 0), 255), ((255, 255, 255), 255), ((9, 9, 9), 0)):
        picture = Image.fromarray(_in_colour(labels, canvas=canvas, alpha=alpha))
        np.testing.assert_array_equal(_decoded(_saved(picture)), labels)
        if alpha:
            np.testing.assert_array_equal(_decoded(_saved(picture.convert("RGB"))), labels)
    wide = (_in_colour(labels).astype(">u2") * 257)[..., :3]
    np.testing.assert_array_equal(
        _decoded(png([row.tobytes() for row in wide], 30, depth=16, colour_type=2)), labels
    )
    for mode in ("RGB", "RGBA", "LA"):
        np.testing.assert_array_equal(_decoded(_saved(Image.fromarray(labels).convert(mode))), labels)
    for factor in (1, 257):
        np.testing.assert_array_equal(
            _decoded(_saved(Image.fromarray(labels.astype(np.uint16) * factor))), labels
        )
    for blank in ("white", (0, 0, 0, 0), "black"):
        assert not _decoded(_saved(Image.new("RGBA", (8, 8), blank))).any()


@pytest.mark.parametrize("layer", ["mountain", "river"])
@pytest.mark.parametrize(("canvas", "alpha"), [((0, 0, 0), 255), ((255, 255, 255), 255), ((0, 0, 0), 0)])
def test_antialiased_edges_get_the_nearer_label(layer, canvas, alpha):
    y, x = np.mgrid[:480, :640]
    fine = np.where(np.hypot(x - 220, y - 240) < 150, 1, 0)
    fine = np.where(np.hypot(x - 450, y - 200) < 97, 2, fine).astype(np.uint8)
    rgba = _in_colour(fine, layer, canvas=canvas, alpha=alpha).astype(float).reshape(120, 4, 160, 4, 4)
    weight = rgba[..., 3:] / 255.0
    colour = (rgba[..., :3] * weight).sum(axis=(1, 3)) / np.maximum(weight.sum(axis=(1, 3)), 1e-9)
    smooth = np.concatenate([colour, 255.0 * weight.mean(axis=(1, 3))], axis=-1).round().astype(np.uint8)
    image, (note,) = decode_layer(_saved(Image.fromarray(smooth)), layer)
    assert "of it, edges between its colours, is read as the nearer label" in note
    assert set(np.unique(image)) == {0, 1, 2}
    inner = fine.reshape(120, 4, 160, 4).transpose(0, 2, 1, 3).reshape(120, 160, 16)
    pure = (inner == inner[..., :1]).all(axis=-1)
    np.testing.assert_array_equal(image[pure], inner[..., 0][pure])
    counted = np.array([(inner == label).sum() for label in (1, 2)]) / 16.0
    np.testing.assert_allclose([(image == label).sum() for label in (1, 2)], counted, rtol=0.03)


def test_refused_images():
    noise = np.random.default_rng(0).integers(0, 256, (60, 60, 3), dtype=np.uint8)
    blurred = np.linspace(_in_colour(0), _in_colour(1), 200).round().astype(np.uint8)[:, None].repeat(4, 1)
    mask = np.where(np.eye(9, dtype=bool), 255, 0).astype(np.uint8)
    other = _in_colour(np.eye(9, dtype=np.uint8).repeat(2, 0).repeat(2, 1))
    other[:4, 10:14, :3] = (10, 20, 200)
    for picture, part in (
        (Image.fromarray(noise), "expected the colours of layer mountain alone, got #"),
        (Image.fromarray(blurred), "expected the colours of layer mountain alone, got "),
        (Image.fromarray(other), "got #0a14c8"),
        (Image.fromarray(mask).convert("RGB"), "grey in several channels"),
        (Image.fromarray(mask).convert("LA"), "grey in several channels"),
        (Image.fromarray(np.arange(64, dtype=np.uint8).reshape(8, 8)), "looks antialiased: it has 63 labels"),
    ):
        message = _refusal(_saved(picture))
        assert part in message
        assert "`sketchterrain trace FILE --layer mountain -o DIR`" in message
    message = _refusal(_saved(Image.fromarray(np.full((4, 4), 300, dtype=np.uint16))))
    assert message == "16 bits with values up to 300: expected labels from 0 to 255"
    small = np.array([[1, 65535] * 3] * 2, ">u2")  # of which 8 bits would be empty
    assert "grey in" in _refusal(png([row.tobytes() for row in small], 3, depth=16, colour_type=4))
    for depth in (2, 4):  # values of shallow grey would be stretched
        assert f"{depth} bits a pixel: expected labels" in _refusal(png([b"\x1b"], 8 // depth, depth=depth))
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
        np.testing.assert_array_equal(_decoded(encode_layer(image, (1, 2, 3))), image)


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


def test_changes_of_images_are_notes_of_the_sketch(folder):
    image = Image.fromarray(np.array([[1, 0]], np.uint8))
    image.putpalette((*LAYERS["hill"].colour, 0, 0, 0))
    sketch = load_sketch(folder(files={"hill.png": _saved(image), "mountain.png": grey([[1, 0]])}))
    assert sketch.layers["hill"].tolist() == [[0, 1]]
    (note,) = sketch.notes
    assert note.startswith("hill.png: colours decide")
    assert sketch_notes(sketch)[0] == note


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
