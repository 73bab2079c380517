"""Untrusted pictures: recognised by their bytes, bounded in size, refused in one line."""

from __future__ import annotations

import struct
import time
import zlib

import numpy as np
import pytest
from PIL import Image

from sketchterrain.errors import InputError
from sketchterrain.trace.picture import kind_of, picture_from, read_picture

VRT = (
    b'<VRTDataset rasterXSize="20" rasterYSize="20"><SourceFilename>/etc/passwd</SourceFilename></VRTDataset>'
)
EXPECTED = "expected a PNG, JPEG, TIFF or WebP picture"


def test_pictures_are_recognised_by_their_bytes(tmp_path) -> None:
    for form in ["PNG", "JPEG", "TIFF", "WEBP"]:
        pixels = np.zeros((30, 40, 3), np.uint8)
        pixels[:, :20] = (200, 60, 30)
        path = tmp_path / "map.bin"
        Image.fromarray(pixels).save(path, form, **({} if form == "PNG" else {"quality": 95}))
        assert kind_of(path) == "picture", form
        picture = read_picture(path)
        assert picture.rgba.shape == (30, 40, 4), form
        assert not picture.is_grey, form
        assert not picture.see_through, form
        assert np.abs(picture.rgba[:, :15, :3].astype(int) - (200, 60, 30)).max() < 12, form


def test_a_vrt_under_another_name_is_refused(tmp_path) -> None:
    for name in ["map.tif", "map.png", "map.gpkg", "map.geojson", "map.ora"]:
        (tmp_path / name).write_bytes(VRT)
        with pytest.raises(InputError, match="<VRTDataset"):
            kind_of(tmp_path / name)
        with pytest.raises(InputError, match=EXPECTED):
            read_picture(tmp_path / name)


def test_unsupported_missing_and_damaged_pictures_are_refused_in_one_line(tmp_path) -> None:
    for start, told in [
        (b"gimp xcf v011", "is a GIMP file: in GIMP, File"),
        (b"8BPS\0\1", "is a Photoshop file: save its layers as OpenRaster"),
        (b"GIF89a", EXPECTED),
        (b"%PDF-1.7", EXPECTED),
        (b"", EXPECTED),
        (b"\0" * 200, EXPECTED),
    ]:
        (tmp_path / "a.xcf").write_bytes(start)
        with pytest.raises(InputError, match=told) as error:
            kind_of(tmp_path / "a.xcf")
        assert "\n" not in str(error.value), start

    with pytest.raises(InputError, match="is not there"):
        kind_of(tmp_path / "none.png")
    with pytest.raises(InputError, match="cannot be read"):
        read_picture(tmp_path / "none.png")

    for form in ["PNG", "JPEG", "TIFF", "WEBP"]:
        noise = np.random.default_rng(1).integers(0, 256, (60, 60, 3), dtype=np.uint8)
        path = tmp_path / "map"
        Image.fromarray(noise).save(path, form)
        whole = path.read_bytes()
        for cut in (20, len(whole) // 3, len(whole) - 40):
            with pytest.raises(InputError, match="the map: expected a whole") as error:
                picture_from(whole[:cut], "the map")
            assert "\n" not in str(error.value), (form, cut)

    Image.fromarray(np.zeros((9, 9), np.float32)).save(tmp_path / "height.tif")
    with pytest.raises(InputError, match="its values are no colours"):
        read_picture(tmp_path / "height.tif")


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def test_bombs_are_refused_before_they_unpack() -> None:
    for side in [(100_000, 100_000), (40_000, 10), (30_000, 30_000), (0, 10)]:
        head = _chunk(b"IHDR", struct.pack(">IIBBBBB", *side, 8, 2, 0, 0, 0))
        body = _chunk(b"IDAT", zlib.compress(bytes(10_000_000), 9))
        start = time.perf_counter()
        with pytest.raises(InputError, match=r"expected (sides|at most|a whole PNG)"):
            picture_from(b"\x89PNG\r\n\x1a\n" + head + body + _chunk(b"IEND", b""), "bomb.png")
        assert time.perf_counter() - start < 1.0, side


def test_sixteen_bit_grey_becomes_eight_bit(tmp_path) -> None:
    deep = np.repeat(np.array([[0, 0x8000, 0xFFFF]], np.uint16), 3, axis=0)
    Image.fromarray(deep).save(tmp_path / "deep.png")
    picture = read_picture(tmp_path / "deep.png")
    assert picture.rgba[0, :, 0].tolist() == [0, 0x80, 0xFF]
    assert picture.is_grey
