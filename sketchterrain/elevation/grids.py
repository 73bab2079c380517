"""DEM grids: samples, their places in a sketch, and their accuracy, read from raster and NumPy files."""

from __future__ import annotations

import math
import warnings
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import blake2b
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np

from sketchterrain.array_types import Float32Array, Float64Array
from sketchterrain.elevation.quirks import CleanedSamples, Findings, clean_samples
from sketchterrain.errors import InputError, format_value, one_line

Affine6: TypeAlias = tuple[float, float, float, float, float, float]
"""a, b, c, d, e, f of x = a·column + b·row + c, y = d·column + e·row + f."""

Window: TypeAlias = tuple[int, int, int, int]
"""First row, first column, rows and columns."""

MIN_SIDE: Final = 4
"""Fewest samples along a side of a grid."""

MAX_SAMPLES: Final = 1 << 29
"""Most samples that are read at once."""

_FEET = {"ft": 0.3048, "foot": 0.3048, "feet": 0.3048, "us-ft": 1200 / 3937, "us survey foot": 1200 / 3937}
_DRIVERS = {".tif": "GTiff", ".tiff": "GTiff", ".hgt": "SRTMHGT", ".asc": "AAIGrid", ".vrt": "VRT"}
_STRIP, _PIECE = 1 << 22, 1 << 21  # samples
_UNREADABLE = (
    OSError,
    ValueError,
    MemoryError,
    KeyError,
    EOFError,
    RuntimeError,
    TypeError,
    zipfile.BadZipFile,
    zlib.error,
)
_MAX_VRT = 1 << 24  # bytes
_SPANS = ("xmin", "xmax", "ymin", "ymax")  # of .npz files: outer borders of the cells, as matplotlib's sample


class SketchFrame(NamedTuple):
    """The CRS of a sketch, and its south-west corner in it (m); local metres without a CRS."""

    crs: str = ""
    east: float = 0.0
    north: float = 0.0


LOCAL: Final = SketchFrame()


@dataclass(frozen=True, eq=False)
class ElevationGrid:
    """Regularly spaced heights (Rocca et al. 2012, §3.1).

    Attributes
    ----------
    samples
        Heights (rows, columns), m; NaN where there is none. Those of `open_grid` are read by rows.
    place
        Place of the samples, as points, in `crs`, or in sketch metres without one.
    accuracy
        Largest error (m) of heights taken from the samples.
    findings
        What was found in the file, in words, with counts.
    """

    samples: Float32Array
    place: Affine6
    accuracy: float = 0.0
    crs: str = ""
    frame: SketchFrame = LOCAL
    name: str = "grid"
    findings: Findings = ()

    def __post_init__(self) -> None:
        rows, columns = self.samples.shape
        if min(rows, columns) < MIN_SIDE:
            raise InputError(
                f"{self.name}: expected at least {MIN_SIDE} × {MIN_SIDE} samples, got {rows} × {columns}"
            )
        a, b, _, d, e, _ = self.place
        if not np.isfinite(self.place).all() or abs(a * e - b * d) <= 1e-9 * math.hypot(a, d) * math.hypot(
            b, e
        ):
            raise InputError(
                f"{self.name}: the place of the samples is degenerate: {format_value(self.place)}"
            )
        if not (math.isfinite(self.accuracy) and self.accuracy >= 0.0):
            raise InputError(f"{self.name}: accuracy = {self.accuracy}: expected metres, 0 or more")
        if self.crs and not self.frame.crs:
            raise InputError(f"{self.name}: expected a sketch with a CRS, its frame has none")

    @cached_property
    def is_affine(self) -> bool:
        """Whether an affine map leads from samples to sketch metres."""
        from sketchterrain.io.crs import parse_crs

        return self.crs in ("", self.frame.crs) or parse_crs(self.crs) == parse_crs(self.frame.crs)

    def to_metres(self, column: Float64Array, row: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return x and y (m) in the sketch of places in the grid, in samples."""
        a, b, c, d, e, f = self.place
        x, y = a * column + b * row + c, d * column + e * row + f
        if not self.is_affine:
            x, y = _transformed(self.crs, self.frame.crs, x, y)
            if not (np.isfinite(x).all() and np.isfinite(y).all()):
                raise InputError(f"{self.name}: lies outside of the CRS {one_line(self.frame.crs)[:60]}")
        if self.crs:
            x, y = x - self.frame.east, y - self.frame.north
        return x, y

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.samples.shape
        return rows, columns

    def without_samples(self) -> ElevationGrid:
        """Return the place of the grid: its samples are NaN and take no memory."""
        return replace(self, samples=np.broadcast_to(np.float32(np.nan), self.shape))

    @property
    def found(self) -> Findings:
        """Findings, with those in samples that are read by rows."""
        return (*self.findings, *getattr(self.samples, "findings", ()))

    @property
    def id(self) -> bytes:
        """Hash of samples, place and accuracy: the same grid has the same id wherever it is from."""
        return self._content[0]

    @property
    def base(self) -> float:
        """Mean height in whole metres."""
        return self._content[1]

    @cached_property
    def _content(self) -> tuple[bytes, float]:
        head = (self.samples.shape, self.place, self.accuracy, self.crs, self.frame)
        digest = blake2b(repr(head).encode(), digest_size=16)
        sums: list[float] = []
        count = 0
        for _, rows in self.strips():
            digest.update(np.ascontiguousarray(rows).data)
            sums += list(np.nansum(rows, axis=1, dtype=np.float64))
            count += int(np.count_nonzero(np.isfinite(rows)))
        return digest.digest(), float(round(math.fsum(sums) / max(count, 1)))

    def strips(self, rows: int | None = None) -> Iterator[tuple[int, Float32Array]]:
        """Yield first rows and samples of all strips of so many rows; by default of about 16 MB."""
        step = rows or min(max(_STRIP // self.samples.shape[1], 64), 512)
        for first in range(0, len(self.samples), step):
            yield first, self.samples[first : first + step]


def _transformed(source: str, target: str, x: Any, y: Any) -> tuple[Float64Array, Float64Array]:
    """Return coordinates in another CRS, inf outside of it."""
    from rasterio import Env
    from rasterio._err import CPLE_BaseError
    from rasterio.warp import transform

    shape = np.shape(x)
    try:
        with Env():
            found = transform(source, target, np.ravel(x), np.ravel(y))
    except CPLE_BaseError:
        return np.full(shape, np.inf), np.full(shape, np.inf)
    east, north = (np.reshape(np.asarray(each, np.float64), shape) for each in found)
    return east, north


def read_grid(
    path: Path,
    frame: SketchFrame = LOCAL,
    *,
    band: int = 1,
    window: Window | None = None,
    accuracy: float | None = None,
    crs: str | None = None,
    place: Affine6 | None = None,
) -> ElevationGrid:
    """Return a DEM grid of a GeoTIFF, COG, VRT, HGT, ASCII grid, or a ``.npy`` or ``.npz`` file.

    A path may name a file in a zip archive, ``N42E001.hgt.zip/N42E001.hgt``, or an archive of one file.
    Small voids are filled, values that mean "no data" become NaN; `ElevationGrid.findings` counts them.

    Parameters
    ----------
    frame
        Of the sketch.
    window
        Part of the grid to read; all of it by default.
    accuracy
        Largest error (m); by default half the step of the file's values, 0 for floating point.
    crs, place
        CRS and place of the samples as points, in place of the file's.

    Raises
    ------
    InputError
        If the file cannot be read or is no grid of heights with a place in the sketch.
    """
    with _named(path):
        raw, known, place_in_file, crs_in_file, findings = _read(path, band, window)
    kind = raw.dtype.kind
    at, source, step = _checked_place(path, place or place_in_file, crs_in_file if crs is None else crs)
    samples, more = clean_samples(raw, known, step)
    if not np.isfinite(samples).any():
        raise InputError(f"{one_line(path)}: has no heights, all {samples.size} samples are voids")
    accuracy = _accuracy(kind) if accuracy is None else float(accuracy)
    return ElevationGrid(samples, at, accuracy, source, frame, name=path.name, findings=(*findings, *more))


def open_grid(
    path: Path,
    frame: SketchFrame = LOCAL,
    *,
    band: int = 1,
    accuracy: float | None = None,
    crs: str | None = None,
    place: Affine6 | None = None,
) -> ElevationGrid:
    """Return the grid that `read_grid` returns, of any size: its samples are read by rows when needed.

    The file is read once for values that mean "no data", and once more by `ElevationGrid.id`; then `found` is
    complete.
    """
    if path.suffix.lower() == ".npz":
        return read_grid(path, frame, accuracy=accuracy, crs=crs, place=place)
    with _named(path):
        rows, columns = _shape(path)
        raw, _, place_in_file, crs_in_file, findings = _read(path, band, (0, 0, 1, columns))
    at, source, step = _checked_place(path, place or place_in_file, crs_in_file if crs is None else crs)

    def read(first: int, last: int) -> tuple[Any, Any]:
        values, known = np.empty((last - first, columns), np.float32), np.empty((last - first, columns), bool)
        step = max(_PIECE // columns, 1)  # in a file's type they need more memory
        with _named(path):
            for start in range(0, last - first, step):
                rows = min(step, last - first - start)
                part = _read(path, band, (first + start, 0, rows, columns))
                values[start : start + rows], known[start : start + rows] = part[:2]
        return values, known

    strip = max(_STRIP // columns, 64)
    samples = CleanedSamples(read, (rows, columns), step, strip)
    if not samples.count:
        raise InputError(f"{one_line(path)}: has no heights, all {rows * columns} samples are voids")
    accuracy = _accuracy(raw.dtype.kind) if accuracy is None else float(accuracy)
    by_rows: Any = samples
    return ElevationGrid(by_rows, at, accuracy, source, frame, path.name, findings)


def _accuracy(kind: str) -> float:
    return 0.5 if kind in "iu" else 0.0


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Raise what reading a file raises as one line."""
    try:
        yield
    except _UNREADABLE as error:
        raise InputError(f"{one_line(path)}: cannot be read as elevation ({one_line(error)[:160]})") from None


def _checked_place(path: Path, at: Affine6 | None, crs: str) -> tuple[Affine6, str, float]:
    """Return place, CRS and about the distance (m) of samples."""
    name = one_line(path)
    if at is None:
        raise InputError(f"{name}: has no georeference: expected the place of its samples")
    if not crs and max(map(abs, (at[0], at[1], at[3], at[4]))) < 0.05 and abs(at[2]) <= 360:
        raise InputError(f"{name}: its coordinates look like degrees: expected a CRS, such as EPSG:4326")
    step = math.sqrt(abs(at[0] * at[4] - at[1] * at[3])) * (111_320.0 if abs(at[0]) < 0.05 else 1.0)
    return at, crs, step


def _read(path: Path, band: int, window: Window | None) -> tuple[Any, Any, Affine6 | None, str, Findings]:
    """Return heights, which are known, their place, CRS and findings."""
    if path.suffix.lower() in (".npy", ".npz"):
        return *_read_array(path, window), ()
    return _read_raster(path, band, window)


def _shape(path: Path) -> tuple[int, int]:
    """Return rows and columns of a file."""
    if path.suffix.lower() == ".npy":
        rows, columns = np.load(path, allow_pickle=False, mmap_mode="r").shape
    else:
        with _open(path) as file:
            rows, columns = file.shape
    return rows, columns


def _checked_window(shape: tuple[int, int], window: Window | None) -> Window:
    """Return the window to read; raise ValueError if it is not inside or too large."""
    rows, columns = shape
    row, column, height, width = window or (0, 0, rows, columns)
    if min(row, column) < 0 or min(height, width) < 1 or row + height > rows or column + width > columns:
        raise ValueError(f"window {window}: expected one inside of {rows} × {columns} samples")
    if height * width > MAX_SAMPLES:
        raise ValueError(f"{height} × {width} samples: expected at most {MAX_SAMPLES}, or a window")
    return row, column, height, width


def _read_array(path: Path, window: Window | None) -> tuple[Any, Any, Affine6 | None, str]:
    """Return heights, which are known, their place and CRS from a NumPy file."""
    place: Affine6 | None = None
    crs = ""
    if path.suffix.lower() == ".npy":
        loaded: Any = np.load(path, allow_pickle=False, mmap_mode="r")
    else:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            if sum(each.file_size for each in archive.zip.infolist()) > 8 * MAX_SAMPLES:
                raise ValueError(f"expected at most {MAX_SAMPLES} samples")
            arrays = {key: archive[key] for key in archive.files}
        planes = [each for each in arrays.values() if each.ndim == 2]
        if len(planes) != 1:
            raise ValueError(f"expected one array of rows and columns, got {len(planes)}")
        loaded = planes[0]
        if all(key in arrays for key in _SPANS):
            west, east, south, north = (float(arrays[key]) for key in _SPANS)
            south, north = min(south, north), max(south, north)  # exchanged in matplotlib's sample
            width, height = (east - west) / loaded.shape[1], (north - south) / loaded.shape[0]
            place = width, 0.0, west + 0.5 * width, 0.0, -height, north - 0.5 * height
        crs = str(arrays["crs"]) if "crs" in arrays else ""
    if loaded.ndim != 2 or loaded.dtype.kind not in "fiu":
        raise ValueError(f"expected numbers (rows, columns), got {loaded.dtype} {loaded.shape}")
    row, column, height, width = _checked_window(loaded.shape, window)
    raw = np.array(loaded[row : row + height, column : column + width])
    return raw, np.ones(raw.shape, bool), _moved(place, row, column) if place else None, crs


def _moved(place: Affine6, row: float, column: float) -> Affine6:
    """Return the place of samples that are counted from another one."""
    a, b, c, d, e, f = place
    return a, b, c + a * column + b * row, d, e, f + d * column + e * row


def _read_raster(
    path: Path, band: int, window: Window | None
) -> tuple[Any, Any, Affine6 | None, str, Findings]:
    """Return heights, which are known, their place, CRS and findings of a raster that GDAL reads."""
    from rasterio.windows import Window as RasterWindow

    from sketchterrain.io.crs import crs_text

    findings: list[str] = []
    with _open(path) as file:
        if not 1 <= band <= file.count:
            raise InputError(f"{one_line(path)}: band = {band}: expected 1 to {file.count}")
        row, column, height, width = _checked_window(file.shape, window)
        part = RasterWindow(column, row, width, height)
        raw = file.read(band, window=part)
        if raw.dtype.kind not in "fiu":
            raise ValueError(f"expected heights, got {raw.dtype}")
        known = file.read_masks(band, window=part) != 0
        scale, offset, unit = file.scales[band - 1], file.offsets[band - 1], file.units[band - 1]
        metres = _FEET.get((unit or "m").strip().lower(), 1.0)
        if metres != 1.0:
            findings.append(f"heights in feet, converted by {metres:.8g}")
        if (scale * metres, offset) != (1.0, 0.0):
            known &= np.abs(raw.astype(np.float64)) < 32767.0
            raw = (raw.astype(np.float64) * scale + offset) * metres
        at = file.transform
        # Samples are the centres of cells: GDAL's transform refers to corners, also of files in points.
        georeferenced = not at.is_identity
        place = _moved((at.a, at.b, at.c, at.d, at.e, at.f), row + 0.5, column + 0.5)
        crs = crs_text(file.crs)
    return raw, known, place if georeferenced else None, crs, tuple(findings)


@contextmanager
def _open(path: Path) -> Iterator[Any]:
    """Open a raster file, which may lie in a zip archive; raise InputError or ValueError if GDAL can't."""
    import rasterio
    from rasterio._err import CPLE_BaseError
    from rasterio.errors import RasterioError

    target, driver = _gdal_path(path)
    try:
        with (
            warnings.catch_warnings(),
            # Samples registered as points are moved by half a cell, whatever the environment says.
            rasterio.Env(GTIFF_POINT_GEO_IGNORE=False, GDAL_DISABLE_READDIR_ON_OPEN="EMPTY_DIR"),
        ):
            warnings.simplefilter("ignore")  # of a file without a georeference
            with rasterio.open(target, driver=driver) as file:
                yield file
    except (RasterioError, CPLE_BaseError) as error:
        raise ValueError(one_line(error)) from None


def _gdal_path(path: Path) -> tuple[Path | str, str]:
    """Return what GDAL opens, and by which driver; names of missing files and VRTs may be addresses to it."""
    driver = _DRIVERS.get(path.suffix.lower(), "")
    for archive in (path, *path.parents):
        if archive.suffix.lower() == ".zip" and archive.is_file():
            inside = path.relative_to(archive).as_posix()
            with zipfile.ZipFile(archive) as file:
                names = [each for each in file.namelist() if not each.endswith("/")]
            if archive == path and len(names) == 1:
                inside = names[0]
            if inside not in names:
                raise ValueError(f"expected an archive of one file, or the name of one of its {len(names)}")
            driver = _DRIVERS.get(Path(inside).suffix.lower(), "")
            if driver in ("", "VRT"):
                raise ValueError("expected a file .tif, .hgt or .asc in an archive")
            return f"/vsizip/{{{archive.absolute()}}}/{inside}", driver
    if not path.is_file():
        raise ValueError("no such file")
    if not driver:
        raise ValueError(f"expected a file {', '.join(_DRIVERS)}, .npy, .npz or .zip")
    if driver == "VRT":
        with path.open("rb") as file:
            content = file.read(_MAX_VRT + 1)
        if len(content) > _MAX_VRT or any(each in content for each in (b"/vsi", b"://", b"&#")):
            raise ValueError("expected a VRT of files, of at most 16 MB, without addresses")
    return path.absolute(), driver
