"""DEM grids: samples, their places in a sketch, and their accuracy, read from raster and NumPy files."""

from __future__ import annotations

import math
import zipfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import blake2b
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np

from sketchterrain.array_types import BoolArray, Float32Array, Float64Array
from sketchterrain.document.rasters import RasterSource
from sketchterrain.elevation.quirks import (
    CODES,
    MAX_FILLED,
    MAX_HEIGHT,
    CleanedSamples,
    Findings,
    ReadRows,
    StoredValues,
)
from sketchterrain.elevation.raster_reader import PLAIN, Affine6, read_header, read_window
from sketchterrain.errors import InputError, format_value, one_line

MIN_SIDE: Final = 4
"""Fewest samples along a side of a grid."""

MAX_SIDE: Final = 1 << 17
"""Most samples along a side of a file."""

MAX_HELD: Final = 1 << 24
"""Most samples of a file that are held in memory: rows of a larger one are read when they are needed."""

_LEAST_STEP, _MOST_STEP, _FAR = 1e-8, 1e7, 1e9  # degrees or m
_STRIP, _PIECE = 1 << 22, 1 << 21  # samples
_SAMPLED, _CODED = 64, 0.98  # rows that show what numbers mean; share of them that are heights
_MAX_ARCHIVE = 1 << 32  # bytes
_UNREADABLE = (
    *(OSError, ValueError, MemoryError, KeyError, EOFError, RuntimeError, TypeError),
    *(zipfile.BadZipFile, zlib.error),
)
_SPANS = ("xmin", "xmax", "ymin", "ymax")  # of .npz files: outer borders of the cells, as matplotlib's sample


class SketchFrame(NamedTuple):
    """The CRS of a sketch, and its south-west corner in it (m); local metres without a CRS."""

    crs: str = ""
    east: float = 0.0
    north: float = 0.0


LOCAL: Final = SketchFrame()

Rise: TypeAlias = Callable[[int, int], Float64Array | np.float32]
"""Returns metres to add to rows first … last - 1."""


@dataclass(frozen=True, eq=False)
class ElevationGrid:
    """Regularly spaced heights (Rocca et al. 2012, §3.1).

    Attributes
    ----------
    samples
        Heights (rows, columns), m; NaN where there is none. Those of large files can be sliced by rows only.
    place
        Place of the samples, as points, in `crs`, or in sketch metres without one.
    accuracy
        Largest error (m) of heights taken from the samples.
    findings
        What was found in the file, in words, with counts.
    vertical
        Vertical datum that the file declares (`raster_reader.ELLIPSOID`, a code or WKT); empty if none.
    """

    samples: Float32Array
    place: Affine6
    accuracy: float = 0.0
    crs: str = ""
    frame: SketchFrame = LOCAL
    name: str = "grid"
    findings: Findings = ()
    vertical: str = ""

    def __post_init__(self) -> None:
        rows, columns = self.shape
        if min(rows, columns) < MIN_SIDE:
            raise InputError(
                f"{self.name}: expected at least {MIN_SIDE} × {MIN_SIDE} samples, got {rows} × {columns}"
            )
        _check_place(self.name, self.place)
        if not (math.isfinite(self.accuracy) and self.accuracy >= 0.0):
            raise InputError(f"{self.name}: accuracy = {self.accuracy}: expected metres, 0 or more")
        if self.crs and not self.frame.crs:
            raise InputError(f"{self.name}: expected a sketch with a CRS, its frame has none")

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.samples.shape
        return rows, columns

    @cached_property
    def is_affine(self) -> bool:
        """Whether an affine map leads from samples to sketch metres."""
        from sketchterrain.io.crs import parse_crs

        return self.crs in ("", self.frame.crs) or parse_crs(self.crs) == parse_crs(self.frame.crs)

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
        head = (self.shape, self.place, self.accuracy, self.crs, self.frame)
        digest = blake2b(repr(head).encode(), digest_size=16)
        sums: list[float] = []
        count = 0
        for _, rows in self.strips():
            digest.update(np.ascontiguousarray(rows).data)
            sums += list(np.nansum(rows, axis=1, dtype=np.float64))
            count += int(np.count_nonzero(np.isfinite(rows)))
        if not count:
            raise InputError(f"{self.name}: {_no_heights(self)}")
        return digest.digest(), float(round(math.fsum(sums) / count))

    @property
    def found(self) -> Findings:
        """Findings, with those in samples that are read by rows, which are complete once all were read."""
        return (*self.findings, *getattr(self.samples, "findings", ()))

    def strips(self, rows: int | None = None) -> Iterator[tuple[int, Float32Array]]:
        """Yield first rows and samples of all strips of so many rows; by default of about 16 MB."""
        step = rows or min(max(_STRIP // self.shape[1], MAX_FILLED), 512)
        for first in range(0, self.shape[0], step):
            yield first, self.samples[first : first + step]

    def held(self) -> ElevationGrid:
        """Return the grid with all samples in memory."""
        return replace(self, samples=self.samples[:], findings=self.found)

    def without_samples(self) -> ElevationGrid:
        """Return the place of the grid."""
        return replace(self, samples=_NoSamples(self.shape), findings=())  # type: ignore[arg-type]

    def moved(self, east: float, north: float) -> ElevationGrid:
        """Return the grid in a sketch whose corner lies some metres further east and north."""
        if self.crs:
            frame = SketchFrame(self.frame.crs, self.frame.east + east, self.frame.north + north)
            return replace(self, frame=frame)
        a, b, c, d, e, f = self.place
        return replace(self, place=(a, b, c - east, d, e, f - north))

    def raised(self, rise: Rise, **changes: Any) -> ElevationGrid:
        """Return the grid with what `rise` returns of rows first … last - 1 added to its heights, m."""
        samples: Any = _RaisedSamples(self.samples, rise)
        return replace(
            self, samples=samples[:] if isinstance(self.samples, np.ndarray) else samples, **changes
        )

    def to_metres(self, column: Float64Array, row: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return x and y (m) in the sketch of places in the grid, in samples."""
        a, b, c, d, e, f = self.place
        x, y = a * column + b * row + c, d * column + e * row + f
        if not self.is_affine:
            from sketchterrain.io.crs import transform_points

            x, y = transform_points(self.crs, self.frame.crs, x, y)
            if not (np.isfinite(x).all() and np.isfinite(y).all()):
                raise InputError(f"{self.name}: lies outside of the CRS {one_line(self.frame.crs)[:60]}")
        if self.crs:
            x, y = x - self.frame.east, y - self.frame.north
        return x, y

    def to_samples(self, x: Float64Array, y: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return columns and rows in the grid of places in the sketch (m)."""
        a, b, c, d, e, f = self.place
        if self.crs:
            x, y = x + self.frame.east, y + self.frame.north
        if not self.is_affine:
            from sketchterrain.io.crs import transform_points

            x, y = transform_points(self.frame.crs, self.crs, x, y)
        x, y, area = x - c, y - f, a * e - b * d
        return (e * x - b * y) / area, (a * y - d * x) / area


class _NoSamples(NamedTuple):
    shape: tuple[int, int]


class _RaisedSamples:
    """Rows of samples, with metres added."""

    def __init__(self, samples: Any, rise: Rise) -> None:
        self.shape, self._samples, self._rise = samples.shape, samples, rise

    def __getitem__(self, rows: slice) -> Float32Array:
        first, last, _ = rows.indices(self.shape[0])
        return np.asarray(self._samples[first:last] + self._rise(first, last), np.float32)

    @property
    def findings(self) -> Findings:
        return tuple(self._samples.findings)


def _check_place(name: str, place: Affine6) -> None:
    """Raise InputError if the place of samples is degenerate, or out of any CRS."""
    a, b, c, d, e, f = place
    right, down = math.hypot(a, d), math.hypot(b, e)
    is_near = all(abs(each) <= _FAR for each in (c, f)) and max(right, down) <= _MOST_STEP
    if not (is_near and min(right, down) >= _LEAST_STEP and abs(a * e - b * d) > 1e-9 * right * down):
        raise InputError(f"{name}: the place of the samples is degenerate: {format_value(place)}")


class _File(NamedTuple):
    """A file of elevation."""

    shape: tuple[int, int]
    values: StoredValues
    place: Affine6 | None
    crs: str
    vertical: str
    findings: Findings
    read: ReadRows


def read_grid(
    path: Path,
    frame: SketchFrame = LOCAL,
    source: RasterSource | None = None,
    *,
    accuracy: float | None = None,
    crs: str | None = None,
    place: Affine6 | None = None,
) -> ElevationGrid:
    """Return a DEM grid of a raster of `SUFFIXES`: by GDAL, of NumPy, or of 16-bit samples.

    A path may name a file in a zip archive, ``N42E001.hgt.zip/N42E001.hgt``, or an archive of one file.
    Small voids are filled, values that mean "no data" become NaN; `ElevationGrid.found` counts them. More
    than `MAX_HELD` samples stay in the file, of which only the header is read.

    Parameters
    ----------
    frame
        Of the sketch.
    source
        States how values are heights, and the cells of a file without a place.
    accuracy
        Largest error (m); by default half the step of the file's values, 0 for floating point.
    crs, place
        CRS and place of the samples as points, in place of the file's.

    Raises
    ------
    InputError
        If the file cannot be read or is no grid of heights with a place in the sketch.
    """
    name, suffix, source = one_line(path), path.suffix.lower(), source or RasterSource("file")
    opened = _array_file if suffix in (".npy", ".npz") else _plain_file if suffix in PLAIN else _raster_file
    try:
        file = opened(path, source)
    except InputError as error:
        raise error if str(error).startswith(name) else InputError(f"{name}: {error}") from None
    (rows, columns), read = file.shape, file.read
    if max(rows, columns) > MAX_SIDE:
        raise InputError(f"{name}: {rows} × {columns} samples: expected at most {MAX_SIDE} along a side")
    declared = file.crs if crs is None else crs
    at = place or file.place
    if at is None and source.cell:
        at = (source.cell, 0.0, 0.5 * source.cell, 0.0, -source.cell, (rows - 0.5) * source.cell)
    if at is None:
        raise InputError(f"{name}: has no georeference: expected the side of a cell in m, cell (--cell 2)")
    if not declared and max(map(abs, (at[0], at[1], at[3], at[4]))) < 0.05 and abs(at[2]) <= 360:
        raise InputError(f"{name}: its coordinates look like degrees: expected a CRS, such as EPSG:4326")
    _check_place(name, at)
    step = math.sqrt(abs(at[0] * at[4] - at[1] * at[3])) * (111_320.0 if abs(at[0]) < 0.05 else 1.0)
    if rows * columns <= MAX_HELD:
        values, known = read(0, rows)

        def read(first: int, last: int) -> tuple[Float32Array, BoolArray]:
            return values[first:last].copy(), known[first:last]

    strip = max(_STRIP // columns, MAX_FILLED)
    by_rows: Any = CleanedSamples(read, file.shape, step, strip, file.values.sentinels)
    accuracy = 0.5 * file.values.step if accuracy is None else float(accuracy)
    findings = (*file.values.findings, *file.findings)
    grid = ElevationGrid(by_rows, at, accuracy, declared, frame, path.name, findings, file.vertical)
    if rows * columns > MAX_HELD:
        return grid
    grid = grid.held()
    if not np.isfinite(grid.samples).any():
        raise InputError("; ".join((f"{name}: {_no_heights(grid)}", *file.findings)))
    return grid


def _no_heights(grid: ElevationGrid) -> str:
    return f"has no heights, all {math.prod(grid.shape)} samples are voids"


def _array_file(path: Path, source: RasterSource) -> _File:
    """Return a NumPy file."""
    place: Affine6 | None = None
    crs = ""
    try:
        if path.suffix.lower() == ".npy":
            loaded: Any = np.load(path, allow_pickle=False, mmap_mode="r")
        else:
            with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
                if sum(each.file_size for each in archive.zip.infolist()) > _MAX_ARCHIVE:
                    raise ValueError(f"expected at most {_MAX_ARCHIVE >> 30} GiB")
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
    except _UNREADABLE as error:
        raise InputError(f"{one_line(path)}: cannot be read as elevation ({one_line(error)[:160]})") from None
    return _loaded_file(loaded, StoredValues(loaded.dtype, source), place, crs)


def _loaded_file(
    loaded: Any, values: StoredValues, place: Affine6 | None = None, crs: str = "", findings: Findings = ()
) -> _File:

    def read(first: int, last: int) -> tuple[Float32Array, BoolArray]:
        heights = values.heights(np.ascontiguousarray(loaded[first:last], values.dtype))
        return heights, np.ones(heights.shape, bool)

    sample = np.ascontiguousarray(loaded[:: max(len(loaded) // _SAMPLED, 1)], values.dtype)
    return _File(loaded.shape, values, place, crs, "", (*findings, *values.sign_finding(sample)), read)


def _plain_file(path: Path, source: RasterSource) -> _File:
    """Return a file of 16-bit samples without a header."""
    try:
        size = path.stat().st_size
        columns = source.columns or math.isqrt(size // 2)
        rows = size // 2 // max(columns, 1)
        if size != 2 * rows * columns or not size:
            raise InputError(f"{size} bytes: expected a square of 16-bit samples, or the columns (--columns)")
        values = StoredValues(np.uint16, source, None)
        either = [np.memmap(path, order, "r", shape=(rows, columns)) for order in ("<u2", ">u2")]
    except OSError as error:
        raise InputError(f"cannot be read as elevation ({one_line(error)[:160]})") from None
    step = max(rows // _SAMPLED, 1)
    rough = [np.abs(np.diff(each[::step].astype(np.float64), axis=1)).sum() for each in either]
    order = source.encoding or ("big-endian" if rough[1] < rough[0] else "little-endian")
    found = f"{rows} × {columns} samples of 16 bits, {order}{' (guessed)' * (not source.encoding)}"
    return _loaded_file(either[order == "big-endian"], values, findings=(found,))


def _raster_file(path: Path, source: RasterSource) -> _File:
    """Return a raster file, of which rows are read by pieces: in its type they need more memory."""
    header = read_header(path, source.band)
    rows, columns = header.shape
    is_picture = path.suffix.lower() == ".png"
    is_coded = header.dtype == "uint8" and header.bands >= 3 and (is_picture or source.encoding in CODES)
    is_coded &= not source.range  # grey in three bands
    bands = [header._replace(band=band) for band in (1, 2, 3)] if is_coded else [header]

    def stored(first: int, last: int) -> tuple[Any, BoolArray]:
        found = [read_window(each, (first, 0, last - first, columns)) for each in bands]
        if not is_coded:
            return found[0]
        red, green, blue = (each.astype(np.uint32) for each, _ in found)
        return (red << 16) + (green << 8) + blue, found[0][1]

    def sampled() -> Any:
        parts = [stored(row, row + 1) for row in range(0, rows, max(rows // _SAMPLED, 1))]
        return np.concatenate([raw[known] for raw, known in parts])

    if is_coded:
        numbers = sampled()
        heights = {each: abs(numbers * scale + least) <= MAX_HEIGHT for each, (scale, least) in CODES.items()}
        fits = (each for each, are in heights.items() if np.count_nonzero(are) > _CODED * len(numbers))
        code = source.encoding if source.encoding in CODES else next(fits, "")
        if not code:
            raise InputError("in colour: expected grey, or encoding (--encoding) mapbox or terrarium")
        values = StoredValues(np.uint32, source, "m", *CODES[code], voids=(0.0,))
        findings: Findings = (f"heights in the colours of {code.title()}",)
    else:
        unit = None if is_picture else header.unit
        values = StoredValues(header.dtype, source, unit, header.scale, header.offset)
        findings = values.sign_finding(sampled()) if values.may_be_signed else ()

    def read(first: int, last: int) -> tuple[Float32Array, BoolArray]:
        heights, known = (np.empty((last - first, columns), kind) for kind in (np.float32, bool))
        step = max(_PIECE // columns, 1)
        for start in range(first, last, step):
            end = min(start + step, last)
            raw, is_data = stored(start, end)
            part = slice(start - first, end - first)
            heights[part], known[part] = values.heights(raw), is_data
        return heights, known

    return _File(header.shape, values, header.place, header.crs, header.vertical, findings, read)
