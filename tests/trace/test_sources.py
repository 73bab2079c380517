"""Legends, layer names and untrusted pictures: their meaning, their kinds, and refusals in one line."""

import struct
import time
import zlib

import numpy as np
import pytest
from PIL import Image

from sketchterrain.errors import InputError
from sketchterrain.sketch import LAYERS
from sketchterrain.trace.legend import INK, NOTHING, OWN_LEGEND, Legend, Meaning, meant_by, read_legend
from sketchterrain.trace.picture import kind_of, picture_from, read_picture


def test_colours_stand_for_layers_within_the_tolerance() -> None:
    for layer in LAYERS:
        assert OWN_LEGEND.meaning(LAYERS[layer].colour) == Meaning(layer, 1), layer

    assert OWN_LEGEND.meaning((255, 255, 255)) == NOTHING
    assert OWN_LEGEND.meaning((9, 1, 1)) == INK
    assert OWN_LEGEND.meaning((0xAA, 0xD3, 0xDF)) == Meaning("lake", 1)
    assert OWN_LEGEND.meaning((255, 0, 0)) is None

    for tolerance, meaning in ((0.0, None), (0.2, Meaning("river", 3))):
        legend = Legend.given(["river.3=#00f"], tolerance=tolerance)
        assert legend.meaning((0, 0, 255)) == Meaning("river", 3)
        assert legend.meaning((20, 40, 235)) == meaning


def test_a_legend_file_is_read(tmp_path) -> None:
    path = tmp_path / "legend.toml"
    path.write_text(
        '[[colour]]\nrgb = "#8b5a2b"\nlayer = "mountain"\n'
        '[[colour]]\nrgb = "0000ff"\nlayer = "river"\nlabel = 2\n'
        '[[colour]]\nrgb = "#000"\nlayer = "ink"\n'
    )
    legend = read_legend(path)
    assert list(legend.colours.items()) == [
        ((139, 90, 43), Meaning("mountain", 1)),
        ((0, 0, 255), Meaning("river", 2)),
        ((0, 0, 0), INK),
    ]


def test_malformed_legends_are_refused_in_one_line(tmp_path) -> None:
    for text, told in [
        ("", r"expected tables \[\[colour\]\]"),
        ("colour = 3", r"expected tables \[\[colour\]\]"),
        ("x = 3", "unknown key 'x'"),
        ("colour = []", "at least one colour"),
        ("[[colour]]\nrgb='#1'\nlayer='hill'", r'1: expected a colour as "#rrggbb", got \'#1\''),
        ("[[colour]]\nrgb='#123456'", r"1: expected layer, a layer's name, got None"),
        ("[[colour]]\nrgb='#123456'\nlayer='hils'", "unknown layer 'hils'.*did you mean 'hill'"),
        ("[[colour]]\nrgb='#123456'\nlayer='hill'\nlabel=0", "label from 1 to 255, got 0"),
        ("[[colour]]\nrgb='#123456'\nlayer='hill'\nlabel=true", "expected label, 1 to 255, got true"),
        ("[[colour]]\nrgb='#123456'\nlayer='ink'\nlabel=2", "ink has no labels"),
        ("[[colour]]\nrgb='#123456'\nlayer='hill'\nlable=2", "unknown key 'lable'.*did you mean 'label'"),
        ("[[colour]]\nrgb='#1', x", "not TOML"),
        ("[[colour]]\nrgb='#123456'\nlayer='hill'\n" * 1001, "1001 colours: expected at most 1000"),
        (
            "[[colour]]\nrgb='#123'\nlayer='hill'\n[[colour]]\nrgb='#112233'\nlayer='lake'",
            "#112233 stands for hill 1 and for lake 1",
        ),
    ]:
        path = tmp_path / "legend.toml"
        path.write_text(text)
        with pytest.raises(InputError, match=f"legend.toml: .*{told}") as error:
            read_legend(path)
        assert "\n" not in str(error.value), text[:80]

    with pytest.raises(InputError, match="cannot be read"):
        read_legend(tmp_path / "none.toml")
    with pytest.raises(InputError, match="cannot be read"):
        read_legend(tmp_path)
    (tmp_path / "large.toml").write_bytes(b"#" * (1 << 21))
    with pytest.raises(InputError, match="too large for a legend"):
        read_legend(tmp_path / "large.toml")

    for text in ["", "mountain", "=#123456", "mountain.=#123456", "mountain=red", "no.1=#123456"]:
        with pytest.raises(InputError, match="colour "):
            Legend.given([text])


def test_layer_names_mean_layers_and_labels() -> None:
    for name, meant in [
        ("mountain", Meaning("mountain", 1)),
        ("Mountains", Meaning("mountain", 1)),
        (" river 2 ", Meaning("river", 2)),
        ("forest.1", Meaning("forest", 1)),
        ("LAKE_3.png", Meaning("lake", 3)),
        ("dune (12)", Meaning("dune", 12)),
        ("hill#4", Meaning("hill", 4)),
        ("Materials", Meaning("material", 1)),
        ("mountain 0", None),
        ("river 256", None),
        ("Background", None),
        ("mountain copy", None),
        ("", None),
        ("rivers of gold", None),
    ]:
        assert meant_by(name) == meant, name


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
