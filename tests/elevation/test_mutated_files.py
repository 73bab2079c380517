"""Mutated elevation files of every format: each is a grid or one line, and none hangs."""

import re
import zipfile
from pathlib import Path

import numpy as np
import pytest
import rasterio
import rasterio.shutil
from PIL import Image

from sketchterrain.document.rasters import RasterSource
from sketchterrain.document.sketch import Sketch
from sketchterrain.elevation.build import build_patches
from sketchterrain.elevation.grids import read_grid
from sketchterrain.elevation.pictures import read_picture
from sketchterrain.errors import InputError

from .conftest import FRAME, HEIGHTS, write

STATED = RasterSource("file", cell=30.0, range="0,1300")
SOURCES = {"code.png": RasterSource("file", cell=30.0), "grey.png": STATED, "square.r16": STATED}
SKETCH = Sketch(extent=1000.0, frame={"crs": "EPSG:32632", "east": 5e5, "north": 5.2e6, "vertical": ""})
NUMBERS = (b"0", b"-1", b"1e400", b"nan", b"99999999", b"4294967297", b"-2147483649", b"0.0001", b"", b"x")
WORDS = (b"\0" * 4, b"\xff" * 4, b"\x7f\xff\xff\xff", b"\xff\xff\xff\x7f", b"\x01\0\0\0", b"\0\0\0\x01")


def originals(folder: Path) -> dict[str, bytes]:
    """Write small files of each format; return their contents by suffix."""
    for name, options in (
        ("plain.tif", {}),
        ("tiled.tif", {"compress": "deflate", "tiled": True, "blockxsize": 16, "blockysize": 16}),
        ("lzw.tif", {"compress": "lzw", "nodata": -1.0, "bigtiff": "yes"}),
    ):
        write(folder / name, tags={"AREA_OR_POINT": "Point"}, **options)
    rows = "\n".join(" ".join(f"{each:g}" for each in row) for row in HEIGHTS)
    head = "ncols 25\nnrows 20\nxllcorner 500100\nyllcorner 5200400\ncellsize 30\nNODATA_value -9999\n"
    (folder / "text.asc").write_text(head + rows)
    source = (
        '<ComplexSource><SourceFilename relativeToVRT="1">tiled.tif</SourceFilename><SourceBand>1'
        '</SourceBand><SrcRect xOff="0" yOff="0" xSize="25" ySize="20"/>'
        '<DstRect xOff="{}" yOff="0" xSize="25" '
        'ySize="20"/><ScaleOffset>1</ScaleOffset><ScaleRatio>2</ScaleRatio></ComplexSource>'
    )
    (folder / "mosaic.vrt").write_text(
        '<VRTDataset rasterXSize="50" rasterYSize="20"><SRS>EPSG:32632</SRS><GeoTransform>500100, 30, 0,'
        ' 5201000, 0, -30</GeoTransform><VRTRasterBand dataType="Float32" band="1"><NoDataValue>-1'
        f"</NoDataValue>{source.format(0)}{source.format(25)}</VRTRasterBand></VRTDataset>"
    )
    spans = {"xmin": 500_100.0, "xmax": 500_850.0, "ymin": 5_200_400.0, "ymax": 5_201_000.0}
    np.savez_compressed(folder / "packed.npz", z=HEIGHTS, crs="EPSG:32632", **spans)
    np.savez(folder / "stored.npz", z=HEIGHTS.astype(np.int16), crs="EPSG:32632", **spans)
    for name, driver in (("a.img", "HFA"), ("a.bil", "EHdr"), ("a.xyz", "XYZ"), ("a.jp2", "JP2OpenJPEG")):
        write(folder / "whole.tif", HEIGHTS.astype(np.int16))
        rasterio.shutil.copy(folder / "whole.tif", folder / name, driver=driver)
    rasterio.shutil.copy(folder / "plain.tif", folder / "a.nc", driver="netCDF")
    codes = ((HEIGHTS + 10000.0) * 10.0).astype(np.uint32)
    Image.fromarray(np.stack([codes >> 16, codes >> 8 & 255, codes & 255], -1).astype(np.uint8)).save(
        folder / "code.png"
    )
    Image.fromarray((HEIGHTS * 50.0).astype(np.uint16)).save(folder / "grey.png")
    (folder / "square.r16").write_bytes((HEIGHTS[:20, :20] * 50.0).astype("<u2").tobytes())
    # 16-bit heights of 1201 × 1201 samples, which compress well.
    tile = np.tile(HEIGHTS.astype(">i2"), (61, 49))[:1201, :1201]
    with zipfile.ZipFile(folder / "N46E009.hgt.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("N46E009.hgt", tile.tobytes())
    (folder / "N46E009.hgt").write_bytes(tile.tobytes())
    with zipfile.ZipFile(folder / "plain.zip", "w") as archive:
        archive.write(folder / "plain.tif", "plain.tif")
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """Return content with a few bytes, words or numbers changed, moved, repeated or cut off."""
    data = bytearray(content)
    for _ in range(rng.integers(1, 5)):
        head = rng.random() < 0.5  # most of a format is in its head or tail
        at = int(rng.integers(min(len(data), 600) if head else len(data))) if data else 0
        way = rng.integers(7)
        if way == 0:
            data[at : at + 1] = rng.bytes(1)
        elif way == 1:
            data[at : at + 4] = WORDS[rng.integers(len(WORDS))]
        elif way == 2:
            numbers = list(re.finditer(rb"-?\d+(\.\d+)?", data[: 1 << 12]))
            if numbers:
                hit = numbers[rng.integers(len(numbers))]
                data[hit.start() : hit.end()] = NUMBERS[rng.integers(len(NUMBERS))]
        elif way == 3:
            length = int(rng.integers(1, 64))
            data[at:at] = data[at : at + length]
        elif way == 4:
            del data[at : at + int(rng.integers(1, 64))]
        elif way == 5:
            other = int(rng.integers(len(data))) if data else 0
            data[at : at + 16] = data[other : other + 16]
        elif rng.random() < 0.2:
            del data[at:]
    return bytes(data)


@pytest.mark.parametrize(
    ("first", "count"),
    [
        (0, 30),
        pytest.param(30, 300, marks=pytest.mark.slow),
        pytest.param(330, 100_000, marks=pytest.mark.soak),
    ],
)
def test_mutated_files_are_grids_or_one_line(tmp_path: Path, first: int, count: int) -> None:
    files = originals(tmp_path)
    large = [name for name in files if "hgt" in name]  # a tenth of the cases
    beside = {name: files.pop(name) for name in list(files) if name.endswith((".hdr", ".prj", ".xml"))}
    names = 6 * [name for name in files if name not in large] + large
    for name in files:
        build_patches(read_grid(tmp_path / name, FRAME, SOURCES.get(name)))
    folder = tmp_path / "mutated"
    folder.mkdir()
    for name, content in {**beside, "tiled.tif": files["tiled.tif"]}.items():  # the mosaic's
        (folder / name).write_bytes(content)
    grids, lines = 0, []
    for seed in range(first, first + count):
        name = names[seed % len(names)]
        path = folder / (f"a{name}" if name == "tiled.tif" else name)
        path.write_bytes(mutated(files[name], np.random.default_rng(seed)))
        try:
            grid = read_grid(path, FRAME, SOURCES.get(name))
            if grid.samples.size < 100_000:
                build_patches(grid)
            grids += 1
        except InputError as error:
            lines.append(str(error))
        except Exception as error:
            raise AssertionError(f"case {seed}, {name}") from error
        try:
            read_picture(RasterSource(str(path)), SKETCH, side=32)
        except InputError as error:
            lines.append(str(error))
        except Exception as error:
            raise AssertionError(f"case {seed}, {name}") from error
    assert [line for line in lines if not line.isprintable() or len(line) >= 400] == []
    assert 0.05 * count < grids < 0.95 * count
