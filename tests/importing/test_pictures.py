"""Legends, layer names, pictures and layered files, and their refusals."""

import io
import struct
import zipfile
import zlib

import numpy as np
import pytest
from PIL import Image, ImageFile

from sketchterrain.errors import InputError
from sketchterrain.importing.images import decode_picture, detect_kind, read_picture
from sketchterrain.importing.layered import trace_folder, trace_mask, trace_open_raster
from sketchterrain.importing.legend import (
    INK,
    NOTHING,
    OWN_LEGEND,
    Legend,
    Meaning,
    read_legend,
)
from sketchterrain.importing.traced_layers import TraceOptions
from sketchterrain.schema.layers import LAYERS, PAINTED_LAYERS
from tests.refusals import refused


def test_legend_matches_colours_within_the_tolerance() -> None:
    for layer in PAINTED_LAYERS:
        assert OWN_LEGEND.meaning(LAYERS[layer].colour) == Meaning(layer, 1), layer

    assert OWN_LEGEND.meaning((255, 255, 255)) == NOTHING
    assert OWN_LEGEND.meaning((9, 1, 1)) == INK
    assert OWN_LEGEND.meaning((0xAA, 0xD3, 0xDF)) == Meaning("lake", 1)
    assert OWN_LEGEND.meaning((255, 0, 0)) is None

    for tolerance, meaning in ((0.0, None), (0.2, Meaning("river", 3))):
        legend = Legend.parse(["river.3=#00f"], tolerance=tolerance)
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


def test_malformed_legends_are_refused(tmp_path) -> None:
    path = tmp_path / "legend.toml"
    for text, message in [
        ("", "missing required field `colour`"),
        ("colour = 3", "Expected `array`"),
        ("colour = []", "at least one colour"),
        ("[[colour]]\nrgb='#1'\nlayer='hill'", r'1: expected a colour as "#rrggbb", got \'#1\''),
        ("[[colour]]\nrgb='#123456'", "missing required field `layer`"),
        ("[[colour]]\nrgb='#123456'\nlayer='hils'", "unknown layer 'hils'.*did you mean 'hill'"),
        ("[[colour]]\nrgb='#123456'\nlayer='hill'\nlabel=0", "label from 1 to 255, got 0"),
        ("[[colour]]\nrgb='#123456'\nlayer='hill'\nlabel=true", r"Expected `int \| null`, got `bool`"),
        ("[[colour]]\nrgb='#123456'\nlayer='ink'\nlabel=2", "ink has no labels"),
        ("[[colour]]\nrgb='#123456'\nlayer='hill'\nlable=2", "unknown field `lable`"),
        ("[[colour]]\nrgb='#1', x", "not TOML"),
        ("[[colour]]\nrgb='#123456'\nlayer='hill'\n" * 1001, "length <= 1000"),
        ("#" * (1 << 21), "too large for a legend"),
        (
            "[[colour]]\nrgb='#123'\nlayer='hill'\n[[colour]]\nrgb='#112233'\nlayer='lake'",
            "#112233 means both hill 1 and lake 1",
        ),
    ]:
        path.write_text(text)
        refused(f"legend.toml: .*{message}", read_legend, path)

    refused("cannot be read", read_legend, tmp_path)
    for text in ["", "mountain", "=#123456", "mountain.=#123456", "mountain=red", "no.1=#123456"]:
        refused("colour ", Legend.parse, [text])


VRT = b'<VRTDataset rasterXSize="9" rasterYSize="9"><SourceFilename>/etc/passwd</SourceFilename></VRTDataset>'
EXPECTED = "expected a PNG, JPEG, TIFF or WebP picture"


def test_pictures_are_recognised_by_their_bytes(tmp_path) -> None:
    pixels = np.zeros((30, 40, 3), np.uint8)
    pixels[:, :20] = (200, 60, 30)
    path = tmp_path / "map.bin"
    for form in ["PNG", "JPEG", "TIFF", "WEBP"]:
        Image.fromarray(pixels).save(path, form, **({} if form == "PNG" else {"quality": 95}))
        assert detect_kind(path) == "picture", form
        picture = read_picture(path)
        assert picture.rgba.shape == (30, 40, 4), form
        assert not picture.is_grey | picture.has_transparency, form
        assert np.abs(picture.rgba[:, :15, :3].astype(int) - (200, 60, 30)).max() < 12, form


def test_vrt_files_are_refused_whatever_their_name(tmp_path) -> None:
    for name in ["map.tif", "map.png", "map.gpkg", "map.geojson", "map.ora"]:
        (tmp_path / name).write_bytes(VRT)
        refused("<VRTDataset", detect_kind, tmp_path / name)
        refused(EXPECTED, read_picture, tmp_path / name)


def test_unsupported_missing_and_damaged_pictures_are_refused(tmp_path) -> None:
    for start, message in [
        (b"gimp xcf v011", "is a GIMP file: in GIMP, File"),
        (b"8BPS\0\1", "is a Photoshop file: save its layers as OpenRaster"),
        *((start, EXPECTED) for start in (b"GIF89a", b"", b"\0" * 200)),
    ]:
        (tmp_path / "a.xcf").write_bytes(start)
        refused(message, detect_kind, tmp_path / "a.xcf")

    refused("does not exist", detect_kind, tmp_path / "none.png")
    refused("cannot be read", read_picture, tmp_path / "none.png")

    for form in ["PNG", "JPEG", "TIFF", "WEBP"]:
        noise = np.random.default_rng(1).integers(0, 256, (60, 60, 3), dtype=np.uint8)
        path = tmp_path / "map"
        Image.fromarray(noise).save(path, form)
        whole = path.read_bytes()
        for cut in (20, len(whole) // 3, len(whole) - 40):
            refused("the map: expected a whole", decode_picture, whole[:cut], "the map")

    Image.fromarray(np.zeros((9, 9), np.float32)).save(tmp_path / "height.tif")
    refused("its values are not colours", read_picture, tmp_path / "height.tif")


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def test_bombs_are_refused_before_they_unpack(monkeypatch) -> None:
    monkeypatch.setattr(ImageFile.ImageFile, "load", lambda _: pytest.fail("unpacked"))
    for side in [(100_000, 100_000), (40_000, 10), (30_000, 30_000), (0, 10)]:
        head = _chunk(b"IHDR", struct.pack(">IIBBBBB", *side, 8, 2, 0, 0, 0))
        body = _chunk(b"IDAT", zlib.compress(bytes(10_000_000), 9))
        with pytest.raises(InputError, match=r"expected (sides|at most|a whole PNG)"):
            decode_picture(b"\x89PNG\r\n\x1a\n" + head + body + _chunk(b"IEND", b""), "bomb.png")


DEFAULTS = TraceOptions()


def png(pixels: np.ndarray) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "PNG")
    return stream.getvalue()


def dab(height: int, width: int, colour=(200, 30, 30), alpha: int = 255) -> np.ndarray:
    pixels = np.zeros((height, width, 4), np.uint8)
    pixels[...] = (*colour, alpha)
    return pixels


def on_sheet(height: int, width: int, box, **look) -> np.ndarray:
    pixels = np.zeros((height, width, 4), np.uint8)
    top, left, bottom, right = box
    pixels[top:bottom, left:right] = dab(bottom - top, right - left, **look)
    return pixels


@pytest.fixture
def ora(tmp_path):
    """Write an OpenRaster file: its stack's XML, and its PNGs by path."""

    def write(stack: str, files=None, *, mimetype=b"image/openraster", extra=(), head='w="60" h="40"'):
        path = tmp_path / "painting.ora"
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            if mimetype is not None:
                archive.writestr("mimetype", mimetype, zipfile.ZIP_STORED)
            xml = f'<?xml version="1.0" encoding="UTF-8"?><image version="0.0.3" {head}>{stack}</image>'
            archive.writestr("stack.xml", xml)
            for name, pixels in (files or {}).items():
                archive.writestr(name, png(pixels))
            for entry, content in extra:
                archive.writestr(entry, content)
        return path

    return write


def layer(name: str, source: str = "data/a.png", **more: object) -> str:
    attributes = "".join(f' {key.replace("_", "-")}="{value}"' for key, value in more.items())
    return f'<layer name="{name}" src="{source}"{attributes}/>'


def test_layers_are_read_by_name_with_offsets_labels_and_groups(ora) -> None:
    upper, lower = layer("upper", "data/r.png"), layer("river 2", "data/r2.png")
    river = f'<stack name="river">{upper}<stack name="inner">{lower}</stack></stack>'
    mountains, paper = layer("Mountains", "data/m.png", x=10, y=5), layer("Paper", "data/m.png")
    stack = f"<stack>{mountains}{river}{paper}</stack>"
    files = {
        "data/m.png": dab(10, 20),
        "data/r.png": on_sheet(40, 60, (20, 0, 23, 60)),
        "data/r2.png": on_sheet(40, 60, (0, 30, 40, 33)),
    }
    traced = trace_open_raster(ora(stack, files), DEFAULTS)
    sketch = traced.sketch
    assert (sketch.width_px, sketch.height_px, sketch.name) == (60, 40, "painting")
    mountain = np.zeros((40, 60), np.uint8)
    mountain[5:15, 10:30] = 1
    assert np.array_equal(sketch.layers["mountain"], mountain)
    river = np.zeros((40, 60), np.uint8)
    river[:, 30:33] = 2
    river[20:23] = 1  # the upper one wins
    assert np.array_equal(sketch.layers["river"], river)
    assert any("skipped: 'Paper'" in line for line in traced.notes)


def test_hidden_layers_are_skipped_and_dimmed_ones_are_not(ora) -> None:
    layers = layer("mountain", visibility="hidden") + layer("forest", opacity="0.0")
    layers += layer("hill", opacity="0.1") + f'<stack visibility="hidden">{layer("dune")}</stack>'
    stack = f"<stack>{layers}</stack>"
    traced = trace_open_raster(ora(stack, {"data/a.png": dab(40, 60)}), DEFAULTS)
    painted = [name for name, image in traced.sketch.layers.items() if image.any()]
    assert painted == ["hill"]
    assert any(line == "hidden, skipped: 'mountain', 'forest', 'dune'" for line in traced.notes)


def test_layers_are_clipped_to_the_picture_and_half_opaque_paint_counts(ora) -> None:
    files = {"data/a.png": dab(30, 30)}
    sketch = trace_open_raster(ora(layer("lake", x=-10, y=25), files), DEFAULTS).sketch
    lake = np.zeros((40, 60), np.uint8)
    lake[25:, :20] = 1
    assert np.array_equal(sketch.layers["lake"], lake)
    for x, y in ((100, 0), (0, 100), (100, 100)):
        traced = trace_open_raster(ora(layer("lake", x=x, y=y) + layer("hill"), files), DEFAULTS)
        assert not traced.sketch.layers["lake"].any()
        assert any("so it is empty" in line for line in traced.notes)

    pixels = np.concatenate([dab(40, 30, alpha=127), dab(40, 30, alpha=128)], axis=1)
    sketch = trace_open_raster(ora(layer("hill"), {"data/a.png": pixels}), DEFAULTS).sketch
    assert (sketch.layers["hill"] == np.repeat([[0, 1]], 30, axis=1)).all()


def test_layers_are_scaled_to_the_sketch(ora) -> None:
    files = {"data/a.png": on_sheet(400, 600, (100, 100, 300, 500))}
    path = ora(layer("mountain"), files, head='w="600" h="400"')
    sketch = trace_open_raster(path, TraceOptions(size_px=60, extent=1000.0)).sketch
    assert (sketch.width_px, sketch.height_px, sketch.extent) == (60, 40, 1000.0)
    assert sketch.layers["mountain"].sum() == 20 * 40


DOCTYPE = '<!DOCTYPE image [<!ENTITY a "aaaaaaaaaa">]>'


def test_malformed_open_rasters_are_refused(ora) -> None:
    for stack, options, message in [
        (layer("Background"), {}, "none of its layers is named mountain, .*: found 'Background'"),
        (layer("hill", "data/none.png"), {}, "layer 'hill': 'data/none.png' is not in it"),
        (layer("hill", "../../etc/passwd"), {}, "is not in it"),
        (layer("hill", x="1e99"), {}, "x='1e99': expected a number"),
        (layer("hill", opacity="nan"), {}, "opacity='nan': expected a number"),
        (layer("hill"), {"head": 'w="0" h="5"'}, "expected sides of 1 to"),
        (layer("hill"), {"head": 'w="32000" h="32000"'}, "expected at most 134 million pixels"),
        ("<stack>", {}, "expected XML"),
        ("<stack>" * 200 + "</stack>" * 200, {}, "nested too deeply"),
        (layer("hill"), {"mimetype": b"application/x-krita"}, "is a Krita file: in Krita, File"),
        (layer("hill"), {"mimetype": None}, "expected an OpenRaster file"),
        (layer("hill") * 300, {}, "at most 256 layers"),
    ]:
        path = ora(stack, {"data/a.png": dab(4, 4)}, **options)
        refused(message, trace_open_raster, path, DEFAULTS)

    path = ora(layer("hill"), {"data/a.png": on_sheet(200, 200, (0, 0, 90, 90))})
    whole = path.read_bytes()
    for cut in (10, len(whole) // 2, len(whole) - 5):
        path.write_bytes(whole[:cut])
        refused("expected a whole OpenRaster file", trace_open_raster, path, DEFAULTS)


def test_unsafe_archives_and_bombs_are_refused(tmp_path, ora, monkeypatch) -> None:
    path = tmp_path / "bomb.ora"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("mimetype", b"image/openraster")
        archive.writestr("stack.xml", f'{DOCTYPE}<image w="4" h="4"><stack name="&a;"/></image>')
    refused("DOCTYPE", trace_open_raster, path, DEFAULTS)

    path = ora(layer("hill"), {"data/a.png": dab(4, 4)}, extra=[("a/../../evil.png", b"x")])
    refused("expected a path inside the archive", trace_open_raster, path, DEFAULTS)

    monkeypatch.setattr("sketchterrain.importing.layered._MAX_PNG", 16 << 20)
    path = ora(layer("hill"), extra=[("data/a.png", bytes(20 << 20))])
    assert path.stat().st_size < 1 << 17
    refused(r"data/a\.png: too large: expected at most 16 MiB", trace_open_raster, path, DEFAULTS)


def test_a_folder_of_pictures_is_read_by_file_names(tmp_path) -> None:
    Image.fromarray(on_sheet(40, 60, (5, 5, 15, 15))).save(tmp_path / "mountain.png")
    strokes = np.zeros((80, 120), np.uint8)
    strokes[30:40] = 255
    Image.fromarray(strokes).save(tmp_path / "River 2.png")
    paper = np.full((40, 60, 3), 255, np.uint8)
    paper[20:30, 40:50] = (30, 30, 30)
    Image.fromarray(paper).save(tmp_path / "forests.jpg", quality=90)
    Image.fromarray(np.arange(2400, dtype=np.uint16).reshape(40, 60).astype(np.uint8) % 4).save(
        tmp_path / "hill.png"
    )
    Image.fromarray(paper).save(tmp_path / "notes.png")
    (tmp_path / "readme.txt").write_text("mine")
    (tmp_path / "dune.png").write_text("no picture")
    traced = trace_folder(tmp_path, TraceOptions(size_px=60))
    layers = traced.sketch.layers
    assert (layers["mountain"][5:15, 5:15] == 1).all()
    assert layers["mountain"].sum() == 100
    assert (layers["river"][15:20] == 2).all()
    assert np.count_nonzero(layers["river"]) == 5 * 60
    assert np.count_nonzero(layers["forest"]) == pytest.approx(100, abs=12)
    assert np.array_equal(layers["hill"], np.arange(2400).reshape(40, 60) % 4)
    assert any(line == "not a layer of a sketch, skipped: 'notes.png'" for line in traced.notes)
    assert any(line == "not a picture, skipped: 'dune.png'" for line in traced.notes)


def test_unusable_folders_are_refused(tmp_path) -> None:
    refused("none of its pictures is named mountain", trace_folder, tmp_path, DEFAULTS)
    Image.fromarray(dab(40, 60)).save(tmp_path / "mountain.png")
    Image.fromarray(dab(40, 50)).save(tmp_path / "river.png")
    with pytest.raises(InputError, match=r"50×40 px, but mountain.png is 60×40 px: expected the same aspect"):
        trace_folder(tmp_path, DEFAULTS)
    (tmp_path / "river.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    refused(r"river\.png: expected a whole PNG", trace_folder, tmp_path, DEFAULTS)
    (tmp_path / "sketch.toml").write_text("format = 1")
    refused("it is a sketch already", trace_folder, tmp_path, DEFAULTS)


def test_mask_is_what_differs_from_the_background(saved) -> None:
    for ink in [0, 255]:
        pixels = np.full((50, 70), 255 - ink, np.uint8)
        pixels[10:20, 30:60] = ink
        traced = trace_mask(saved(pixels), "lake.4", DEFAULTS)
        assert np.array_equal(traced.sketch.layers["lake"] == 4, pixels == ink), ink

    path = saved(np.full((50, 70), 255, np.uint8))
    with pytest.raises(InputError, match="it is all #ffffff"):
        trace_mask(path, "lake", DEFAULTS)
    refused("layer 'ocean': expected mountain", trace_mask, path, "ocean", DEFAULTS)
