"""Layers of a paint program: OpenRaster, folders of pictures, masks; and hostile archives."""

import io
import stat
import struct
import zipfile

import numpy as np
import pytest
from PIL import Image

from sketchterrain.errors import InputError
from sketchterrain.trace.layered import trace_folder, trace_mask, trace_open_raster
from sketchterrain.trace.sheet import Sheet

PLAIN = Sheet()


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
    stack = (
        "<stack>"
        + layer("Mountains", "data/m.png", x=10, y=5)
        + '<stack name="river">'
        + layer("upper", "data/r.png")
        + '<stack name="inner">'
        + layer("river 2", "data/r2.png")
        + "</stack></stack>"
        + layer("Paper", "data/m.png")
        + "</stack>"
    )
    files = {
        "data/m.png": dab(10, 20),
        "data/r.png": on_sheet(40, 60, (20, 0, 23, 60)),
        "data/r2.png": on_sheet(40, 60, (0, 30, 40, 33)),
    }
    traced = trace_open_raster(ora(stack, files), PLAIN)
    sketch = traced.sketch
    assert (sketch.width_px, sketch.height_px, sketch.name) == (60, 40, "painting")
    mountain = np.zeros((40, 60), np.uint8)
    mountain[5:15, 10:30] = 1
    assert np.array_equal(sketch.layers["mountain"], mountain)
    river = np.zeros((40, 60), np.uint8)
    river[:, 30:33] = 2
    river[20:23] = 1  # the upper one wins
    assert np.array_equal(sketch.layers["river"], river)
    assert any("left out: 'Paper'" in line for line in traced.notes)


def test_hidden_layers_are_left_out_and_dimmed_ones_are_not(ora) -> None:
    stack = (
        "<stack>"
        + layer("mountain", visibility="hidden")
        + layer("forest", opacity="0.0")
        + layer("hill", opacity="0.1")
        + '<stack visibility="hidden">'
        + layer("dune")
        + "</stack></stack>"
    )
    traced = trace_open_raster(ora(stack, {"data/a.png": dab(40, 60)}), PLAIN)
    painted = [name for name, image in traced.sketch.layers.items() if image.any()]
    assert painted == ["hill"]
    assert any(line == "hidden, left out: 'mountain', 'forest', 'dune'" for line in traced.notes)


def test_layers_beyond_the_picture_are_cut_and_half_opaque_paint_counts(ora) -> None:
    files = {"data/a.png": dab(30, 30)}
    sketch = trace_open_raster(ora(layer("lake", x=-10, y=25), files), PLAIN).sketch
    lake = np.zeros((40, 60), np.uint8)
    lake[25:, :20] = 1
    assert np.array_equal(sketch.layers["lake"], lake)
    traced = trace_open_raster(ora(layer("lake", x=100, y=0) + layer("hill"), files), PLAIN)
    assert not traced.sketch.layers["lake"].any()
    assert any("so it is empty" in line for line in traced.notes)

    pixels = np.concatenate([dab(40, 30, alpha=127), dab(40, 30, alpha=128)], axis=1)
    sketch = trace_open_raster(ora(layer("hill"), {"data/a.png": pixels}), PLAIN).sketch
    assert (sketch.layers["hill"] == np.repeat([[0, 1]], 30, axis=1)).all()


def test_layers_are_scaled_to_the_sheet(ora) -> None:
    files = {"data/a.png": on_sheet(400, 600, (100, 100, 300, 500))}
    path = ora(layer("mountain"), files, head='w="600" h="400"')
    sketch = trace_open_raster(path, Sheet(size_px=60, extent=1000.0)).sketch
    assert (sketch.width_px, sketch.height_px, sketch.extent) == (60, 40, 1000.0)
    assert sketch.layers["mountain"].sum() == 20 * 40


DOCTYPE = '<!DOCTYPE image [<!ENTITY a "aaaaaaaaaa">]>'


def test_malformed_open_rasters_are_refused_in_one_line(ora) -> None:
    for stack, options, told in [
        (layer("Background"), {}, "no layer of it is called mountain, .*: there is 'Background'"),
        ("<stack/>", {}, "no layer of it is called"),
        (layer("hill", "data/none.png"), {}, "layer 'hill': 'data/none.png' is not in it"),
        (layer("hill", "../../etc/passwd"), {}, "is not in it"),
        (layer("hill", x="1e99"), {}, "x='1e99': expected a number"),
        (layer("hill", opacity="nan"), {}, "opacity='nan': expected a number"),
        (layer("hill"), {"head": 'w="0" h="5"'}, "expected sides of 1 to"),
        (layer("hill"), {"head": 'w="99999" h="5"'}, "expected sides of 1 to"),
        (layer("hill"), {"head": 'w="32000" h="32000"'}, "expected at most 134 million pixels"),
        (layer("hill"), {"head": ""}, "expected sides of 1 to"),
        ("<stack>", {}, "expected XML"),
        ("<stack>" * 200 + "</stack>" * 200, {}, "nested too deeply"),
        (layer("hill"), {"mimetype": b"application/x-krita"}, "is a Krita file: in Krita, File"),
        (layer("hill"), {"mimetype": b"text/plain"}, "expected an OpenRaster file"),
        (layer("hill"), {"mimetype": None}, "expected an OpenRaster file"),
        (layer("hill") * 300, {}, "at most 256 layers"),
    ]:
        path = ora(stack, {"data/a.png": dab(4, 4)}, **options)
        with pytest.raises(InputError, match=told) as error:
            trace_open_raster(path, PLAIN)
        assert "\n" not in str(error.value), told

    path = ora(layer("hill"), {"data/a.png": on_sheet(200, 200, (0, 0, 90, 90))})
    whole = path.read_bytes()
    for cut in (10, len(whole) // 2, len(whole) - 5):
        path.write_bytes(whole[:cut])
        with pytest.raises(InputError, match="expected a whole OpenRaster file"):
            trace_open_raster(path, PLAIN)


def test_unsafe_archives_are_refused(tmp_path, ora) -> None:
    path = tmp_path / "bomb.ora"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("mimetype", b"image/openraster")
        archive.writestr("stack.xml", f'{DOCTYPE}<image w="4" h="4"><stack name="&a;"/></image>')
    with pytest.raises(InputError, match="DOCTYPE"):
        trace_open_raster(path, PLAIN)

    for entry, told in [
        ("../evil.png", "expected a path inside the archive"),
        ("/etc/evil.png", "expected a path inside the archive"),
        ("a/../../evil.png", "expected a path inside the archive"),
        ("C:evil.png", "expected a plain relative path"),
        (_link(), "not a link or a device"),
    ]:
        path = ora(layer("hill"), {"data/a.png": dab(4, 4)}, extra=[(entry, b"x")])
        with pytest.raises(InputError, match=told):
            trace_open_raster(path, PLAIN)

    path = ora(layer("hill"), {"data/a.png": dab(4, 4)})
    data = bytearray(path.read_bytes())
    at = data.rindex(b"PK\1\2")  # the last entry of the directory
    data[at + 8] |= 1
    path.write_bytes(bytes(data))
    with pytest.raises(InputError, match="it is encrypted"):
        trace_open_raster(path, PLAIN)


def _link() -> zipfile.ZipInfo:
    info = zipfile.ZipInfo("data/link.png")
    info.create_system = 3
    info.external_attr = (stat.S_IFLNK | 0o777) << 16
    return info


def test_archive_bombs_are_refused(ora) -> None:
    path = ora(layer("hill"), extra=[("data/a.png", bytes(300 << 20))])
    assert path.stat().st_size < 1 << 20
    with pytest.raises(InputError, match=r"data/a\.png: too large: expected at most 256 MiB"):
        trace_open_raster(path, PLAIN)
    many = [(f"data/{number}.png", b"") for number in range(1001)]
    with pytest.raises(InputError, match="entries: expected at most 1000"):
        trace_open_raster(ora(layer("hill"), extra=many), PLAIN)
    head = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sIIBBBBB", 13, b"IHDR", 60_000, 60_000, 8, 6, 0, 0, 0)
    with pytest.raises(InputError, match="layer 'hill'"):
        trace_open_raster(ora(layer("hill"), extra=[("data/a.png", head)]), PLAIN)


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
    traced = trace_folder(tmp_path, Sheet(size_px=60))
    layers = traced.sketch.layers
    assert (layers["mountain"][5:15, 5:15] == 1).all()
    assert layers["mountain"].sum() == 100
    assert (layers["river"][15:20] == 2).all()
    assert np.count_nonzero(layers["river"]) == 5 * 60
    assert np.count_nonzero(layers["forest"]) == pytest.approx(100, abs=12)
    assert np.array_equal(layers["hill"], np.arange(2400).reshape(40, 60) % 4)
    assert any(line == "no layer of a sketch, left out: 'notes.png'" for line in traced.notes)
    assert any(line == "no picture, left out: 'dune.png'" for line in traced.notes)


def test_unusable_folders_are_refused(tmp_path) -> None:
    with pytest.raises(InputError, match="no picture of it is called mountain"):
        trace_folder(tmp_path, PLAIN)
    Image.fromarray(dab(40, 60)).save(tmp_path / "mountain.png")
    Image.fromarray(dab(40, 50)).save(tmp_path / "river.png")
    with pytest.raises(InputError, match=r"50×40 px, but mountain.png is 60×40 px: expected pictures of one"):
        trace_folder(tmp_path, PLAIN)
    (tmp_path / "river.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    with pytest.raises(InputError, match=r"river\.png: expected a whole PNG"):
        trace_folder(tmp_path, PLAIN)
    (tmp_path / "sketch.toml").write_text("format = 1")
    with pytest.raises(InputError, match="it is a sketch already"):
        trace_folder(tmp_path, PLAIN)


def test_a_mask_is_what_differs_from_its_paper(saved) -> None:
    for ink in [0, 255]:
        pixels = np.full((50, 70), 255 - ink, np.uint8)
        pixels[10:20, 30:60] = ink
        traced = trace_mask(saved(pixels), "lake.4", PLAIN)
        assert np.array_equal(traced.sketch.layers["lake"] == 4, pixels == ink), ink

    path = saved(np.full((50, 70), 255, np.uint8))
    with pytest.raises(InputError, match="it is all #ffffff"):
        trace_mask(path, "lake", PLAIN)
    with pytest.raises(InputError, match="layer 'sea': expected mountain"):
        trace_mask(path, "sea", PLAIN)
