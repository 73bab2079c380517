"""Coloured maps of known labels in many image formats, and label image operations."""

import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from sketchterrain.errors import InputError
from sketchterrain.importing.image_colours import mixtures
from sketchterrain.importing.images import read_map
from sketchterrain.importing.legend import Legend
from sketchterrain.importing.traced_layers import (
    UNASSIGNED,
    TraceOptions,
    scale_labels,
    scaled_size,
)

OPTIONS = TraceOptions(size_px=256)
SMOOTH, SHARP = Image.Resampling.LANCZOS, Image.Resampling.BICUBIC

# How the map is saved, and which share of its pixels is recovered.
SMALL = {
    "as it is": (lambda small: small, {}, 1.0),
    "blown up": (lambda small: small.resize((512, 512), SHARP), {}, 0.99),
    "JPEG 90": (lambda small: small, {"quality": 90}, 0.99),
    "JPEG 50": (lambda small: small, {"quality": 50}, 0.98),
    "JPEG 25": (lambda small: small, {"quality": 25}, 0.975),
    "WebP 60": (lambda small: small, {"quality": 60}, 0.97),
}
LARGE = {
    "antialiased": (lambda large: large.resize((256, 256), SMOOTH), {}, 0.99),
    "antialiased by area": (lambda large: large.resize((256, 256), Image.Resampling.BOX), {}, 0.99),
    "larger": (lambda large: large.resize((700, 700), SMOOTH), {}, 0.99),
    "much larger": (lambda large: large, {}, 0.998),
    "smaller": (lambda large: large.resize((160, 160), SMOOTH), {}, 0.97),
    "antialiased JPEG 75": (lambda large: large.resize((256, 256), SMOOTH), {"quality": 75}, 0.975),
    "larger JPEG 40": (lambda large: large.resize((700, 700), SMOOTH), {"quality": 40}, 0.985),
}
QUICK = ["as it is", "blown up", "JPEG 50", "WebP 60", "antialiased", "larger", "smaller"]
REST = [form for form in [*SMALL, *LARGE] if form not in QUICK]


def assert_spans(river, parts, case) -> None:
    """A river is one shape from edge to edge."""
    assert parts(river) == 1, case
    assert river[:, 0].any(), case
    assert river[:, -1].any(), case


@pytest.mark.parametrize("forms", [QUICK, pytest.param(REST, marks=pytest.mark.slow)], ids=["quick", "rest"])
def test_labels_are_recovered_from_any_image_format(known, labels_of, away, parts, saved, forms) -> None:
    for form in forms:
        change, options, least = (SMALL | LARGE)[form]
        ending = "webp" if "WebP" in form else "jpg" if options else "png"
        picture, truth = (known.picture, known.labels) if form in SMALL else (known.large, known.large_labels)
        path = saved(change(picture), f"map.{ending}", **options)
        traced = read_map(path).traced(OPTIONS)
        labels = labels_of(traced.sketch)
        assert (labels == truth).mean() >= least, form
        assert (labels == truth)[away(truth)].mean() >= 0.999, form
        assert set(np.unique(labels)) == set(np.unique(truth)), form
        assert_spans(traced.sketch.layers["river"] > 0, parts, form)
        assert traced.certain + traced.inferred + traced.unknown == pytest.approx(1.0), form
        if form == "as it is":
            assert traced.certain == 1.0, form


def test_thin_rivers_stay_connected_at_any_size(parts, saved) -> None:
    for size in [40, 100, 250, 600]:
        pixels = np.full((500, 500, 3), 255, np.uint8)
        pixels[100:400, 50:200] = (38, 104, 58)
        columns = np.arange(500)
        rows = np.rint(250 + 120 * np.sin(columns / 40.0)).astype(int)
        for column, (row, following) in enumerate(zip(rows, np.append(rows[1:], rows[-1]), strict=True)):
            low, high = sorted((row, following))
            pixels[low : high + 1, column] = (56, 116, 196)
        traced = read_map(saved(pixels)).traced(TraceOptions(size_px=size))
        assert_spans(traced.sketch.layers["river"] > 0, parts, size)
        assert traced.sketch.layers["forest"].any(), size


def test_lettering_is_filled_and_near_ends_of_rivers_are_joined(parts, saved) -> None:
    pixels = np.full((160, 160, 3), 255, np.uint8)
    pixels[20:120, 20:120] = (140, 92, 70)
    pixels[130:134] = (56, 116, 196)
    pixels[60:64, 30:110] = 0  # a bar of ink on the mountains
    pixels[125:140, 80:83] = 0  # and one across the river
    traced = read_map(saved(pixels)).traced(TraceOptions())
    assert traced.sketch.layers["mountain"][20:120, 20:120].all()
    assert parts(traced.sketch.layers["river"] > 0) == 1

    pixels = np.full((120, 120, 3), 255, np.uint8)
    pixels[20:23] = pixels[60:63] = (56, 116, 196)
    river = read_map(saved(pixels)).traced(TraceOptions()).sketch.layers["river"]
    assert parts(river > 0) == 2
    assert np.array_equal(np.flatnonzero(river.any(axis=1)), [20, 21, 22, 60, 61, 62])


def test_rivers_and_lakes_of_one_blue_are_separated_by_width(parts, saved) -> None:
    pixels = np.full((120, 160, 3), 255, np.uint8)
    rows, columns = np.ogrid[:120, :160]
    lake = (rows - 60) ** 2 + (columns - 70) ** 2 < 30**2
    pixels[lake] = pixels[58:62] = (170, 211, 223)
    pixels[20:26, 140:146] = (170, 211, 223)  # a pond: narrow, but not long
    read = read_map(saved(pixels))
    plain = read.traced(TraceOptions())
    assert not plain.sketch.layers["river"].any()
    assert any("--rivers-up-to 8" in line for line in plain.notes)
    layers = read.traced(TraceOptions(), narrow=8).sketch.layers
    assert parts(layers["river"] > 0) == 2
    assert (layers["river"][58:62, :36] == 1).all()
    assert (layers["river"][58:62, 105:] == 1).all()
    assert not (layers["river"] > 0)[lake].any()
    assert (layers["lake"][20:26, 140:146] == 1).all()
    water = (layers["river"] > 0) | (layers["lake"] > 0)
    assert np.array_equal(water, plain.sketch.layers["lake"] > 0)
    assert not read.traced(TraceOptions(), narrow=100).sketch.layers["river"][20:26, 140:146].any()


def test_specks_are_removed_and_transparent_pixels_are_empty(saved) -> None:
    pixels = np.full((64, 64, 3), 255, np.uint8)
    pixels[10:40, 10:40] = (140, 92, 70)
    pixels[20:22, 20:23] = (38, 104, 58)  # 6 px
    pixels[50:54, 50:54] = (38, 104, 58)  # 16 px
    read = read_map(saved(pixels))
    forest = read.traced(TraceOptions()).sketch.layers["forest"]
    assert np.count_nonzero(forest) == 16
    assert read.traced(TraceOptions()).sketch.layers["mountain"][10:40, 10:40].all()
    assert np.count_nonzero(read.traced(TraceOptions(), specks=0).sketch.layers["forest"]) == 22

    pixels = np.zeros((64, 64, 4), np.uint8)
    pixels[..., :3] = (140, 92, 70)  # also where it is transparent
    pixels[10:40, 10:40, 3] = 255
    pixels[50:60, 50:60] = (38, 104, 58, 255)
    sketch = read_map(saved(pixels)).traced(TraceOptions()).sketch
    assert np.count_nonzero(sketch.layers["mountain"]) == 900
    assert np.count_nonzero(sketch.layers["forest"]) == 100


def test_legend_of_the_user_replaces_the_default(saved) -> None:
    pixels = np.full((64, 64, 3), (200, 30, 200), np.uint8)
    pixels[:20] = (255, 120, 0)
    pixels[20:40] = (255, 160, 0)
    pixels[40:50] = (140, 92, 70)
    legend = Legend.parse(["mountain=#ff7800", "mountain.7=#ffa000", "nothing=#c81ec8"])
    traced = read_map(saved(pixels), legend).traced(TraceOptions(name="Mine", extent=777.0, seed=9))
    mountain = traced.sketch.layers["mountain"]
    assert (mountain[:20] == 1).all()
    assert (mountain[20:40] == 7).all()
    assert not mountain[40:].any()  # a colour of the program's own, but not of this legend
    assert (traced.sketch.name, traced.sketch.extent, traced.sketch.seed) == ("Mine", 777.0, 9)
    assert ("mountain", 7) in traced.sketch.labels
    assert any("left empty: #8c5c46" in line for line in traced.notes)

    pixels = np.full((64, 64, 3), 255, np.uint8)
    pixels[:30], pixels[30:50] = (140, 92, 70), (132, 88, 70)
    legend = Legend.parse(["hill=#8c5c46", "forest=#845846", "nothing=#ffffff"])
    sketch = read_map(saved(pixels), legend).traced(TraceOptions()).sketch
    assert np.count_nonzero(sketch.layers["hill"]) == 30 * 64
    assert np.count_nonzero(sketch.layers["forest"]) == 20 * 64


def test_palette_16_bit_cmyk_and_exif_rotation(known, labels_of, away, tmp_path) -> None:
    forms = {name: tmp_path / name for name in ("palette.png", "deep.png", "cmyk.tif", "turned.jpg")}
    exif = Image.Exif()
    exif[0x0112] = 6  # displayed turned by 90° clockwise
    turned = known.picture.transpose(Image.Transpose.ROTATE_90)
    known.picture.quantize(16).save(forms["palette.png"])
    forms["deep.png"].write_bytes(_deep_png(np.asarray(known.picture)))
    known.picture.convert("CMYK").save(forms["cmyk.tif"])
    turned.save(forms["turned.jpg"], exif=exif, quality=95, subsampling=0)
    for form, path in forms.items():
        labels = labels_of(read_map(path).traced(OPTIONS).sketch)
        assert (labels == known.labels)[away(known.labels)].mean() >= 0.999, form


def _deep_png(rgb: np.ndarray) -> bytes:
    """A PNG of 16 bits a channel, which Pillow cannot write."""
    rows = (rgb.astype(">u2") * 257).reshape(len(rgb), -1)
    lines = b"".join(b"\0" + row.astype(">u2").tobytes() for row in rows)
    head = struct.pack(">IIBBBBB", rgb.shape[1], rgb.shape[0], 16, 2, 0, 0, 0)
    chunks = ((b"IHDR", head), (b"IDAT", zlib.compress(lines)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )


def test_grey_maps_unknown_colours_and_invalid_options_are_refused(saved) -> None:
    grey = np.zeros((40, 40, 3), np.uint8)
    grey[10:30] = 200
    with pytest.raises(InputError, match="it is grey: expected a coloured map, or the layer"):
        read_map(saved(grey))
    red = np.zeros((40, 40, 3), np.uint8)
    red[..., 0] = 255
    with pytest.raises(InputError, match="no colour of the legend in it, but #ff0000"):
        read_map(saved(red)).traced(TraceOptions())

    for change in ({"size_px": 0}, {"size_px": 20_000}, {"extent": 0.0}, {"extent": np.nan}, {"seed": -1}):
        with pytest.raises(InputError):
            TraceOptions(**change)


def test_scaled_pixels_have_the_majority_of_their_area() -> None:
    small = np.random.default_rng(3).integers(0, 5, (17, 23), dtype=np.uint8)
    for factor in (1, 2, 7):
        large = np.kron(small, np.ones((factor, factor), np.uint8))
        assert np.array_equal(scale_labels(large, (23, 17)), small)
        assert np.array_equal(scale_labels(small, (23 * factor, 17 * factor)), large)
    for size in [(33, 17), (1, 1), (7, 300)]:
        assert (scale_labels(np.full((40, 80), 7, np.uint8), size, thin=(7,)) == 7).all(), size
    assert scaled_size(600, 800, 400) == (300, 400)
    assert scaled_size(10_000, 1, 100) == (100, 1)

    values = np.random.default_rng(4).integers(0, 3, (30, 50), dtype=np.uint8)
    scaled = scale_labels(values, (20, 12))  # 2.5 by 2.5 pixels each
    fine = np.kron(values, np.ones((2, 2), np.uint8))
    for row, column in np.ndindex(12, 20):
        block = fine[5 * row : 5 * row + 5, 5 * column : 5 * column + 5]
        counts = np.bincount(block.ravel(), minlength=3)
        assert counts[scaled[row, column]] == counts.max()

    values = np.full((4, 4), UNASSIGNED, np.uint8)
    values[0, 0] = 3
    assert scale_labels(values, (2, 2)).tolist() == [[3, UNASSIGNED], [UNASSIGNED, UNASSIGNED]]


def test_scaling_in_bands_is_bit_equal(monkeypatch) -> None:
    values = np.random.default_rng(5).integers(0, 4, (97, 61), dtype=np.uint8)
    whole = scale_labels(values, (40, 63), thin=(2,))
    monkeypatch.setattr("sketchterrain.importing.traced_layers._PIXELS_AT_ONCE", 1)
    assert np.array_equal(scale_labels(values, (40, 63), thin=(2,)), whole)


def test_blend_is_between_its_sides_and_a_line_is_not() -> None:
    pixels = np.zeros((9, 9, 3), np.uint8)
    pixels[:, :4], pixels[:, 4], pixels[:, 5:] = (255, 255, 255), (150, 180, 160), (38, 104, 58)
    assert np.array_equal(mixtures(pixels), np.arange(81).reshape(9, 9) % 9 == 4)
    pixels[:, 5:] = 255
    assert not mixtures(pixels).any()
    assert not mixtures(np.full((4, 4, 3), 90, np.uint8)).any()
