import io
import struct
import tracemalloc
import zlib
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from sketchterrain.errors import InputError
from sketchterrain.sketch import LAYERS
from sketchterrain.sketch.layer_images import decode_layer, encode_layer

_SMALL = np.array([[0, 1, 2], [255, 0, 7]], dtype=np.uint8)


def _refusal(data: bytes) -> str:
    with pytest.raises(InputError) as caught:
        decode_layer(data)
    assert str(caught.value).isprintable()
    return str(caught.value)


def _saved(image: Image.Image, **options: object) -> bytes:
    stream = io.BytesIO()
    image.save(stream, format="PNG", **options)  # type: ignore[arg-type]
    return stream.getvalue()


@given(
    st.integers(1, 40),
    st.integers(1, 40),
    st.lists(st.integers(0, 255), min_size=1, max_size=16),
    st.integers(0, 2**32 - 1),
)
def test_layers_round_trip(height: int, width: int, labels: list[int], seed: int) -> None:
    image = np.random.default_rng(seed).choice(np.array(labels, dtype=np.uint8), (height, width))
    again = decode_layer(encode_layer(image, (10, 200, 30)))
    np.testing.assert_array_equal(again, image)
    assert again.dtype == np.uint8
    assert not again.flags.writeable


def test_a_written_layer_is_an_8_bit_palette_image_in_the_layers_colour() -> None:
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


def test_indices_and_grey_values_are_labels(png: Callable[..., bytes], grey: Callable[..., bytes]) -> None:
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


def test_refused_images(png: Callable[..., bytes]) -> None:
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


def _resized(png: bytes, width: int, height: int) -> bytes:
    """Change the size in the header alone."""
    data = bytearray(png)
    data[16:24] = struct.pack(">II", width, height)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    return bytes(data)


def test_a_png_truncated_or_changed_at_any_byte_is_refused() -> None:
    data = encode_layer(_SMALL, (1, 2, 3))
    for position in range(len(data)):
        assert "expected a" in _refusal(data[:position])
        changed = bytearray(data)
        changed[position] ^= 0x41
        _refusal(bytes(changed))


def test_a_side_out_of_range_is_refused_by_the_header(png: Callable[..., bytes]) -> None:
    for width, height in ((16385, 1), (1, 16385), (2**31, 2**31 - 1), (0, 4), (4, 0)):
        data = _resized(png([b"\1"], 1), width, height)
        tracemalloc.start()
        assert f"{width}×{height} px: expected sides of 1 to 16384 px" in _refusal(data)
        assert tracemalloc.get_traced_memory()[1] < 1 << 20
        tracemalloc.stop()


def test_an_image_beyond_pillows_limit_is_read_without_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    image = np.zeros((120, 160), dtype=np.uint8)
    image[-1, -1] = 3
    for limit in (100, image.size - 1):  # Pillow raises beyond twice its limit and warns beyond it
        monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", limit)
        np.testing.assert_array_equal(decode_layer(encode_layer(image, (1, 2, 3))), image)


@given(st.binary(max_size=100))
def test_any_bytes_raise_an_input_error(data: bytes) -> None:
    for content in (data, b"\x89PNG\r\n\x1a\n" + data):
        with pytest.raises(InputError):
            decode_layer(content)
