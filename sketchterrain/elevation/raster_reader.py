"""Rasters read by GDAL in child processes, whose memory and time are limited.

Files that a user opens are not trusted: a crash of GDAL, a hang or a lack of memory ends the child, and is
one InputError. The child is started by the first file, and ends itself when idle; it sends numbers only.
"""

from __future__ import annotations

import atexit
import json
import math
import os
import re
import signal
import subprocess
import sys
import threading
import time
import warnings
import zipfile
from contextlib import suppress
from html import unescape
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple, TypeAlias

import numpy as np
import psutil

from sketchterrain.array_types import BoolArray
from sketchterrain.errors import InputError, one_line
from sketchterrain.io.gdal import OFFLINE, ONLINE_DRIVERS
from sketchterrain.io.system import module_command

Affine6: TypeAlias = tuple[float, float, float, float, float, float]
"""a, b, c, d, e, f of x = a·column + b·row + c, y = d·column + e·row + f."""

Window: TypeAlias = tuple[int, int, int, int]
"""First row, first column, rows and columns."""

ELLIPSOID: Final = "ellipsoid"
"""Vertical datum of heights above the ellipsoid."""

_MEMORY = 2 << 30  # bytes that the child may use beyond those of its libraries
_SECONDS, _RATE = 1.0, 2e6  # s of processor time a request; samples a second beyond
_WAITING = 10.0  # s a request may wait for the disk or other processes, beyond its processor time
_STARTING, _IDLE = 30.0, 60.0  # s
_OPEN_FILES = 4
_MAX_VRT, _VRT_HEAD, _MOST_FILES = 1 << 24, 4096, 1 << 16  # bytes; files that it refers to
_FORMATS = "GTiff .tif .tiff, SRTMHGT .hgt, AAIGrid .asc, VRT .vrt, PNG .png, HFA .img, EHdr .bil, XYZ .xyz, "
_FORMATS += "JP2OpenJPEG .jp2, netCDF .nc, GTX .gtx, DTED .dt0 .dt1 .dt2, USGSDEM .dem"
_DRIVERS = {name: each.split()[0] for each in _FORMATS.split(", ") for name in each.split()[1:]}
_PICTURES = sorted({*_DRIVERS.values(), "JPEG", "WEBP", "GIF", "BMP", "ENVI"} - {"netCDF", "XYZ"})
PLAIN: Final = (".r16", ".raw")
"""Names of files of 16-bit samples without a header end so."""
SUFFIXES: Final = (*_DRIVERS, ".npy", ".npz", *PLAIN, ".zip")
"""Names of files of elevation end so."""
_SIDECARS = (".hdr", ".prj", ".tfw", ".wld", ".pgw", ".jgw")  # in place of the suffix
_ENVIRONMENT = {
    # Sources of VRTs may be addresses, also in VRTs that they refer to.
    **OFFLINE,
    "GDAL_SKIP": ONLINE_DRIVERS,
    # libcurl of other libraries, as netCDF's, and hosts that need no proxy.
    **dict.fromkeys(("http_proxy", "https_proxy", "all_proxy", "ALL_PROXY", "HTTPS_PROXY"), "offline://"),
    **dict.fromkeys(("no_proxy", "NO_PROXY"), ""),
    "GDAL_CACHEMAX": "256",
    # Samples registered as points are moved by half a cell, whatever the environment says.
    "GTIFF_POINT_GEO_IGNORE": "NO",
    "OPENBLAS_NUM_THREADS": "1",
}
_DEATHS = {-9: "took too long or too much memory", -24: "took too long"}  # SIGKILL, SIGXCPU
_COMPOUND = re.compile(r'COMPD_CS\["[^"]*",(.*),(VERT_CS\[.*\])(?:,AUTHORITY\[[^]]*\])?\]', re.S)


class RasterHeader(NamedTuple):
    """Facts of a band of a raster file."""

    path: Path
    band: int
    shape: tuple[int, int]
    block: tuple[int, int]  # rows and columns that are stored together
    dtype: str
    place: Affine6 | None  # of samples as points, the centres of cells in any registration; None without one
    crs: str
    vertical: str  # datum: a code, WKT or `ELLIPSOID`; empty if the file declares none
    nodata: float | None
    scale: float
    offset: float
    unit: str
    bands: int  # in the file
    stamp: tuple[int, int]  # the file's size and time of modification


def read_header(path: Path, band: int = 1) -> RasterHeader:
    """Return facts of a raster that GDAL reads; raise InputError if it cannot be read.

    A path may name a file in a zip archive, ``N42E001.hgt.zip/N42E001.hgt``, or an archive of one file.
    """
    is_text = path.suffix.lower() in (".vrt", ".xyz") and path.is_file()
    facts, _ = _READER.ask(path, {"band": band}, path.stat().st_size // 8 if is_text else 0)
    values: list[Any] = [tuple(each) if isinstance(each, list) else each for each in facts]
    return RasterHeader(path, *values)


def read_window(header: RasterHeader, window: Window) -> tuple[Any, BoolArray]:
    """Return values (rows, columns) in the file's type, and which are data by its mask or tag.

    Raise InputError if they cannot be read, or the file has changed since its header was read.
    """
    height, width = window[2:]
    dtype, size = np.dtype(header.dtype), height * width
    stored = 1  # samples of all blocks that are decoded
    for first, count, side in zip(window[:2], window[2:], header.block, strict=True):
        stored *= side * (-(-(first + count) // side) - first // side)
    request = {"band": header.band, "stamp": header.stamp, "window": window}
    _, data = _READER.ask(header.path, request, stored, size * (dtype.itemsize + 1))
    values = np.frombuffer(data, dtype, size).reshape(height, width)
    return values, np.frombuffer(data, np.uint8, size, size * dtype.itemsize).reshape(height, width) != 0


def file_stamps(path: Path) -> list[tuple[str, int, int]]:
    """Return names, sizes and times of the sidecars of a file, and of all that a VRT refers to."""
    found: dict[str, tuple[str, int, int]] = {}
    waiting = [path]
    while waiting and len(found) < _MOST_FILES:
        file = waiting.pop()
        beside = [file.with_name(file.name + each) for each in (".aux.xml", ".msk")]
        beside += [file.with_suffix(each) for each in _SIDECARS]
        found |= {str(each): (str(each), *_stamp(each)) for each in beside if each.is_file()}
        if file.suffix.lower() != ".vrt" or not file.is_file():
            continue
        with suppress(OSError), file.open("rb") as stream:
            for name in _sources(stream.read(_MAX_VRT)):
                other = file.parent / name
                if str(other) not in found:
                    found[str(other)] = (str(other), *(_stamp(other) if other.is_file() else (0, 0)))
                    waiting.append(other)
    return sorted(found.values())


class RasterReader:
    """A child process, which answers one request at a time."""

    def __init__(self, kind: str) -> None:
        self._kind, self._lock = kind, threading.Lock()
        self._child: subprocess.Popen[bytes] | None = None
        atexit.register(self.close)

    def ask(self, path: Path, request: dict[str, Any], samples: int, size: int = 0) -> tuple[Any, bytearray]:
        """Return the answer to a request, and `size` bytes of data; raise InputError if there is none."""
        seconds = _SECONDS + samples / _RATE
        line = json.dumps({**request, "path": str(path.absolute()), "seconds": seconds}).encode() + b"\n"
        with self._lock:
            for _ in range(2):  # an idle child may just have ended
                starting = 0.0 if self._child else _STARTING
                child = self._child = self._child or _started()
                timer = threading.Timer(seconds + _WAITING + starting, child.kill)
                timer.start()
                try:
                    answer, data = _answer(child, line, size)
                    break
                except (EOFError, OSError, ValueError):  # it has ended
                    if code := self.close():
                        cause = _DEATHS.get(code, f"crashed, code {code}")
                        raise self._unreadable(path, f"its reader {cause}") from None
                except BaseException:
                    child.kill()  # the rest of its answer would be taken for the next one
                    self.close()
                    raise
                finally:
                    timer.cancel()
            else:
                raise self._unreadable(path, "its reader does not start")
        if isinstance(answer, str):
            raise self._unreadable(path, answer)
        return answer, data

    def _unreadable(self, path: Path, problem: str) -> InputError:
        return InputError(f"{one_line(path)}: cannot be read as {self._kind} ({one_line(problem)[:160]})")

    def close(self) -> int:
        """End the child; return its exit code."""
        child, self._child = self._child, None
        if child is None:
            return 0
        try:
            child.communicate(timeout=1.0)
        except subprocess.TimeoutExpired:
            child.kill()
            child.communicate()
        return child.returncode


_READER, PICTURES = RasterReader("elevation"), RasterReader("a raster")
"""The latter answers what `picture_warp.answer` does."""


def _started() -> subprocess.Popen[bytes]:
    environment, pipe, null = {**os.environ, **_ENVIRONMENT}, subprocess.PIPE, subprocess.DEVNULL
    command = module_command(__name__)
    return subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=null, env=environment)  # noqa: S603


def _answer(child: subprocess.Popen[bytes], line: bytes, size: int) -> tuple[Any, bytearray]:
    """Return a child's answer, a text if it complains; raise EOFError, OSError or ValueError at its end."""
    assert child.stdin is not None  # noqa: S101 # pipes
    assert child.stdout is not None  # noqa: S101
    child.stdin.write(line)
    child.stdin.flush()
    answer = json.loads(child.stdout.readline(1 << 20))  # ValueError at the end
    data = bytearray(size if isinstance(answer, dict) else 0)
    if data and child.stdout.readinto(data) != size:  # type: ignore[attr-defined] # buffered
        raise EOFError
    return answer, data


def _serve(requests: BinaryIO, answers: BinaryIO) -> None:
    """Answer requests until there are none for a while (child process)."""
    import sketchterrain.elevation.picture_warp  # noqa: F401 # GDAL, before time is limited

    files: dict[tuple[Any, ...], Any] = {}
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent's
    _limit(_SECONDS, _MEMORY)
    while True:
        idle = threading.Timer(_IDLE, os._exit, (0,))
        idle.daemon = True
        idle.start()
        line = requests.readline()
        idle.cancel()
        if not line:
            return
        request = json.loads(line)
        _limit(request["seconds"], writes=request.get("picture") == "overviews")
        try:
            answer, *data = _read(request, files)
        except Exception as error:  # noqa: BLE001 # whatever GDAL raises
            answer, data = one_line(error)[:400] or type(error).__name__, []
        answers.write(json.dumps(answer).encode() + b"\n")
        for each in data:
            answers.write(np.ascontiguousarray(each).data)
        answers.flush()


def _limit(seconds: float, memory: int = 0, *, writes: bool = False) -> None:
    """Limit the processor time, and once the memory, from now on (child process)."""
    if sys.platform != "win32":
        import resource

        limits = {resource.RLIMIT_CPU: math.ceil(time.process_time() + seconds)}
        limits[resource.RLIMIT_FSIZE] = resource.getrlimit(resource.RLIMIT_FSIZE)[1] if writes else 0
        if memory:
            limits[resource.RLIMIT_AS] = psutil.Process().memory_info().vms + memory
            limits[resource.RLIMIT_CORE] = 0
        for kind, most in limits.items():
            resource.setrlimit(kind, (most, resource.getrlimit(kind)[1]))


def _read(request: dict[str, Any], files: dict[tuple[Any, ...], Any]) -> tuple[Any, ...]:
    """Return facts, or an empty answer with the values and mask of a window (child process)."""
    from rasterio.windows import Window as RasterWindow

    path, band, task = Path(request["path"]), request["band"], request.get("picture")
    target, drivers, stamp = _target(path, is_picture=bool(task))
    if list(stamp) != request.get("stamp", list(stamp)):
        raise ValueError("it has changed while it was read")
    overview = request.get("overview")
    file = files.pop((path, stamp, overview), None)
    # Files that a VRT refers to may have changed.
    if file is not None and ("window" if task is None else "place") not in request:
        file = file.close()
    if file is None:
        _check_virtual(path, {path})
        file = _file(target, drivers, {} if overview is None else {"OVERVIEW_LEVEL": overview})
    if not 1 <= band <= file.count:
        raise ValueError(f"band = {band}: expected 1 to {file.count}")
    if task:
        from sketchterrain.elevation.picture_warp import answer

        found = answer(file, request)
    elif "window" in request:
        row, column, height, width = request["window"]
        part = RasterWindow(column, row, width, height)
        found = {}, file.read(band, window=part), file.read_masks(band, window=part)
    else:
        found = ((*_header(file, band), stamp),)
    # The last one used, unless it has failed: reading it again would give zeros.
    files[path, stamp, overview] = file
    while len(files) > _OPEN_FILES:
        files.pop(next(iter(files))).close()
    return found


def _file(target: Path | str, drivers: list[str], options: dict[str, Any]) -> Any:
    """Open a file by one of some drivers (child process)."""
    import rasterio

    with rasterio.Env() as environment:
        if not environment.drivers().keys() & set(drivers):
            raise ValueError(f"the installed GDAL has no driver {drivers[0]}")
        file = rasterio.DatasetReader(str(target), driver=drivers, **options)
    if not file.count and file.subdatasets:
        raise ValueError(f"expected one variable of heights, got {len(file.subdatasets)}")
    return file


def _header(file: Any, band: int) -> tuple[Any, ...]:
    """Return the values of a `RasterHeader` besides the stamp (child process)."""
    from sketchterrain.io.crs import crs_text, parse_crs

    n, at, wkt = band - 1, file.transform, file.crs.to_wkt() if file.crs else ""
    is_palette = file.driver == "PNG" and file.colorinterp[n].name == "palette"
    if np.dtype(file.dtypes[n]).kind not in "fiu" or is_palette:
        raise ValueError(f"expected heights, got {'a palette' if is_palette else file.dtypes[n]}")
    crs, vertical = crs_text(file.crs), ELLIPSOID if "CS[ellipsoidal,3]" in wkt else ""
    if parts := _COMPOUND.fullmatch(wkt):
        crs, vertical = (crs_text(parse_crs(each)) for each in parts.groups())
    column, row = at @ (0.5, 0.5)  # GDAL's transform refers to corners, also of files in points
    place = None if at.is_identity else (at.a, at.b, column, at.d, at.e, row)
    stored = file.block_shapes[n], file.dtypes[n]
    meaning = file.nodatavals[n], file.scales[n], file.offsets[n], file.units[n] or ""
    return band, file.shape, *stored, place, crs, vertical, *meaning, file.count


def _check_virtual(path: Path, known: set[Path]) -> None:
    """Raise ValueError for a VRT that refers to an address or nothing, itself or by others."""
    if not path.is_file():
        return
    with path.open("rb") as file:
        content = file.read(_VRT_HEAD)
        if b"<VRTDataset" not in content:
            return
        content += file.read(_MAX_VRT)
    if len(content) > _MAX_VRT or re.search(rb"/vsi\w+/|://|&#", content):
        raise ValueError("expected a VRT of files, of at most 16 MB, without addresses")
    for other in {path.parent / name for name in _sources(content)} - known:
        known.add(other)
        if not other.exists() and ":" not in other.name:  # that of a file with several rasters
            raise ValueError(f"it refers to a file that is missing: {other.name}")
        _check_virtual(other, known)


def _sources(content: bytes) -> list[str]:
    """Return names of the files that a VRT refers to."""
    names = re.findall(rb"<Source(?:Filename|Dataset)[^>]*>([^<]+)<", content)
    return [unescape(os.fsdecode(each)).strip() for each in names]


def _target(path: Path, *, is_picture: bool) -> tuple[Path | str, list[str], tuple[int, int]]:
    """Return what GDAL opens, by which drivers, and the file's size and time."""
    driver = _DRIVERS.get(path.suffix.lower(), "")
    for archive in () if is_picture else (path, *path.parents):
        if archive.suffix.lower() == ".zip" and archive.is_file():
            inside = path.relative_to(archive).as_posix()
            with zipfile.ZipFile(archive) as file:
                names = [each for each in file.namelist() if Path(each).suffix.lower() in _DRIVERS]
            if archive == path and len(names) == 1:
                inside = names[0]
            if inside not in names:
                raise ValueError(f"expected an archive of one file, or the name of one of its {len(names)}")
            driver = _DRIVERS[Path(inside).suffix.lower()]
            if driver == "VRT":
                raise ValueError("expected a file .tif, .hgt or .asc in an archive")
            return f"/vsizip/{{{archive}}}/{inside}", [driver], _stamp(archive)
    if not path.is_file():  # its name may be an address to GDAL
        raise ValueError("no such file")
    if not (driver or is_picture):
        raise ValueError(f"expected a file {', '.join(SUFFIXES)}")
    return path, _PICTURES if is_picture else [driver], _stamp(path)


def _stamp(path: Path) -> tuple[int, int]:
    facts = path.stat()
    return facts.st_size, facts.st_mtime_ns


if __name__ == "__main__":
    warnings.simplefilter("ignore")  # of files without a georeference
    # Libraries may write to stdout.
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    with suppress(BrokenPipeError):
        _serve(sys.stdin.buffer, output)
