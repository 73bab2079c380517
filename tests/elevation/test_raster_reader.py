"""Rasters read in a child process: its death, hangs and lack of memory are one line."""

import os
import signal
import socket
import threading
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from rasterio.transform import Affine

from sketchterrain.document.drapes import DrapedLayer
from sketchterrain.document.rasters import RasterSource, embedded
from sketchterrain.document.sketch import Sketch
from sketchterrain.drape.drapes import Drapes
from sketchterrain.elevation import grids, raster_reader
from sketchterrain.elevation.grids import read_grid
from sketchterrain.elevation.pictures import read_picture
from sketchterrain.elevation.raster_reader import ELLIPSOID, read_header, read_window
from sketchterrain.errors import InputError
from sketchterrain.importing.elevation import read_heights

from .conftest import FRAME, HEIGHTS, PLACE, write


def one_line_of(path: Path) -> str:
    with pytest.raises(InputError, match="cannot be read as elevation") as raised:
        read_grid(path, FRAME)
    assert "\n" not in str(raised.value)
    assert len(str(raised.value)) < 400
    return str(raised.value)


def child_id() -> int:
    child = raster_reader._READER._child
    assert child is not None
    return child.pid


def test_header_and_windows(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif", nodata=-1.0, crs="EPSG:32632+5773")
    header = read_header(path)
    assert (header.shape, header.dtype, header.nodata) == ((20, 25), "float32", -1.0)
    assert (header.crs, header.vertical) == ("EPSG:32632", "EPSG:5773")
    assert header.place == (30.0, 0.0, 500_115.0, 0.0, -30.0, 5_200_985.0)
    values, known = read_window(header, (5, 7, 10, 12))
    assert np.array_equal(values, HEIGHTS[5:15, 7:19])
    assert known.all()
    degrees = Affine(1e-3, 0.0, 9.0, 0.0, -1e-3, 47.0)
    assert read_header(write(tmp_path / "b.tif", crs="EPSG:4979", transform=degrees)).vertical == ELLIPSOID
    assert read_header(write(tmp_path / "c.tif")).vertical == ""


@pytest.mark.parametrize("profile", [{}, {"tiled": True, "blockxsize": 16, "blockysize": 16}])
def test_rows_equal_the_whole(tmp_path: Path, profile: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    heights = np.arange(7000, dtype=np.float32).reshape(100, 70)
    heights[40, 50] = -1.0
    path = write(tmp_path / "a.tif", heights, nodata=-1.0, **profile)
    whole = read_grid(path, FRAME)
    monkeypatch.setattr(grids, "MAX_HELD", 0)
    monkeypatch.setattr(grids, "_PIECE", 500)
    rows = read_grid(path, FRAME)
    assert not isinstance(rows.samples, np.ndarray)
    assert rows.samples[3:93].tobytes() == whole.samples[3:93].tobytes()
    assert (rows.id, rows.base, rows.found) == (whole.id, whole.base, whole.findings)
    assert "1 samples in 1 small voids, filled" in rows.found


def test_death_of_the_child_is_one_line_and_the_next_file_is_read(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif")
    header = read_header(path)
    for death in (signal.SIGSEGV, signal.SIGKILL):
        before = child_id()
        os.kill(before, death)
        with pytest.raises(InputError, match="its reader"):
            read_window(header, (0, 0, 20, 25))
        assert np.array_equal(read_window(header, (0, 0, 20, 25))[0], HEIGHTS)
        assert child_id() != before
    assert raster_reader._READER.close() == 0  # as an idle one: no error
    assert np.array_equal(read_window(header, (0, 0, 20, 25))[0], HEIGHTS)


def test_a_changed_file_is_one_line(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif")
    header = read_header(path)
    read_window(header, (0, 0, 4, 4))
    write(path, HEIGHTS[:10])
    with pytest.raises(InputError, match="has changed"):
        read_window(header, (0, 0, 4, 4))
    path.unlink()
    with pytest.raises(InputError, match="no such file"):
        read_window(header, (0, 0, 4, 4))


def vrt(path: Path, source: str, size: tuple[int, int] = (9, 9), kind: str = "SimpleSource") -> Path:
    path.write_text(
        f'<VRTDataset rasterXSize="{size[0]}" rasterYSize="{size[1]}"><GeoTransform>5, 30, 0, 9, 0, -30'
        f'</GeoTransform><VRTRasterBand dataType="Float32" band="1"><{kind}>'
        f'<SourceFilename relativeToVRT="1">{source}</SourceFilename><SourceBand>1</SourceBand>'
        f'<SrcRect xOff="0" yOff="0" xSize="{size[0]}" ySize="{size[1]}"/>'
        f'<DstRect xOff="0" yOff="0" xSize="{size[0]}" ySize="{size[1]}"/>'
        f"{KERNEL if kind == 'KernelFilteredSource' else ''}</{kind}></VRTRasterBand></VRTDataset>"
    )
    return path


WMS = (
    '<GDAL_WMS><Service name="TMS"><ServerUrl>{host}/${{z}}/${{x}}/${{y}}.png</ServerUrl></Service>'
    "<DataWindow><UpperLeftX>0</UpperLeftX><UpperLeftY>100</UpperLeftY><LowerRightX>100</LowerRightX><LowerRightY>0"
    "</LowerRightY><TileLevel>2</TileLevel><TileCountX>1</TileCountX><TileCountY>1</TileCountY></DataWindow>"
    "<Projection>EPSG:3857</Projection><BandsCount>1</BandsCount></GDAL_WMS>"
)
KERNEL = f"<Kernel><Size>401</Size><Coefs>{'1 ' * 401**2}</Coefs></Kernel>"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="POSIX")
def test_a_hang_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path / "a.tif")
    read_grid(tmp_path / "a.tif", FRAME)
    monkeypatch.setattr(raster_reader, "_WAITING", -0.5)
    os.mkfifo(tmp_path / "pipe.tif")  # opening it waits for a writer
    assert "no such file" in one_line_of(tmp_path / "pipe.tif")
    assert "too long" in one_line_of(vrt(tmp_path / "a.vrt", "pipe.tif"))


def test_endless_work_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(raster_reader, "_SECONDS", 0.1)
    write(tmp_path / "a.tif", np.zeros((500, 500), np.float32))
    assert "too long" in one_line_of(vrt(tmp_path / "a.vrt", "a.tif", (500, 500), "KernelFilteredSource"))


def test_too_much_memory_is_one_line(tmp_path: Path) -> None:
    side = 1 << 16
    with rasterio.open(
        *(tmp_path / "a.tif", "w"),
        driver="GTiff",
        width=side,
        height=side,
        count=1,
        dtype="float64",
        sparse_ok=True,
        crs="EPSG:32632",
        tiled=True,
        blockxsize=side,
        blockysize=side,
        bigtiff="yes",
        transform=PLACE,
    ):
        pass
    header = read_header(tmp_path / "a.tif")
    with pytest.raises(InputError, match="cannot be read"):
        read_window(header, (0, 0, 64, 64))
    assert np.array_equal(read_grid(write(tmp_path / "b.tif"), FRAME).samples, HEIGHTS)


def drape_error(path: Path) -> None:
    drapes = Drapes.open([DrapedLayer(str(path))], SKETCH.frame, SKETCH.size, SKETCH.extent)
    if drapes.problems:
        raise InputError(drapes.problems[0])
    drapes.rasters(1.0)[0][1].pixels(0.0, 270.0, 30.0, 9, 9)
    raise InputError(drapes.rasters(1.0)[0][1].problem(drapes.layers[0]))


SKETCH = Sketch(extent=1000.0, frame={"crs": "", "east": 0.0, "north": -300.0, "vertical": ""})
READERS: dict[str, Any] = {
    "elevation": read_grid,
    "picture": lambda path: read_picture(RasterSource(str(path)), SKETCH),
    "stored": lambda path: read_picture(embedded(RasterSource(str(path))), SKETCH),
    "drape": drape_error,
    "realism": read_heights,
}


@pytest.mark.parametrize("reader", READERS)
def test_addresses_are_not_opened(tmp_path: Path, reader: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    for each in (raster_reader._READER, raster_reader.PICTURES):
        each.close()
    nested = tmp_path / "nested.tif"
    outer = tmp_path / "outer.vrt"
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.setblocking(False)
        host = f"http://127.0.0.1:{server.getsockname()[1]}"
        for address in (f"/vsicurl/{host}/a.tif", f"{host}/a.tif", f"/vsicurl_streaming/{host}/a.tif", WMS):
            vrt(nested, address) if address != WMS else nested.write_text(WMS.format(host=host))
            for path in (nested, vrt(outer, "nested.tif")):
                with pytest.raises(InputError, match=r"cannot be read"):
                    READERS[reader](path)
        with pytest.raises(BlockingIOError):
            server.accept()  # nobody has connected


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="POSIX")
@pytest.mark.parametrize("reader", ["picture", "drape"])
def test_a_picture_that_ends_its_reader_is_one_line(
    tmp_path: Path, reader: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path / "a.tif", crs=None, transform=Affine(30.0, 0.0, 5.0, 0.0, -30.0, 9.0))
    READERS["picture"](tmp_path / "a.tif")
    os.mkfifo(tmp_path / "pipe.tif")
    with monkeypatch.context() as patch:
        patch.setattr(raster_reader, "_WAITING", -0.5)
        with pytest.raises(InputError, match="took too long") as raised:
            READERS[reader](vrt(tmp_path / "a.vrt", "pipe.tif"))  # opening it waits for a writer
    assert "\n" not in str(raised.value)
    assert READERS["picture"](tmp_path / "a.tif").pixels.shape[2] == 4


def test_files_that_refer_to_themselves_or_nothing_are_one_line(tmp_path: Path) -> None:
    one_line_of(vrt(tmp_path / "own.vrt", "own.vrt"))
    one_line_of(vrt(tmp_path / "missing.vrt", "missing.tif"))


def test_several_threads_read_at_once(tmp_path: Path) -> None:
    paths = [write(tmp_path / f"{k}.tif", HEIGHTS + k) for k in range(6)]
    found: dict[int, bool] = {}

    def read(k: int) -> None:
        found[k] = all(np.array_equal(read_grid(paths[k], FRAME).samples, HEIGHTS + k) for _ in range(5))

    threads = [threading.Thread(target=read, args=(k,)) for k in range(6)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    assert found == dict.fromkeys(range(6), True)


def test_archives_name_their_files(tmp_path: Path) -> None:
    write(tmp_path / "a.tif")
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.write(tmp_path / "a.tif", "../a.tif")
        archive.writestr("b.vrt", "<VRTDataset/>")
    for name in ("a.zip", "a.zip/b.vrt", "a.zip/c.tif"):
        one_line_of(tmp_path / name)
