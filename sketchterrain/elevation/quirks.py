"""Defects of DEM samples: values that mean "no data", collars, voids, spikes and terraces."""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sketchterrain.array_types import BoolArray, Float32Array, Int64Array
from sketchterrain.document.rasters import RasterSource
from sketchterrain.errors import InputError, format_value, one_line
from sketchterrain.host.library import host_function

Findings: TypeAlias = tuple[str, ...]
"""What was found, in words, with counts."""

MAX_FILLED: Final = 64
"""Largest side (samples) of a void that is filled."""

SENTINELS: Final = (-9999.0, 9999.0, -999.0)
"""Values that mean "no data" where no height is near them."""

MAX_HEIGHT: Final = 12_000.0
"""Deeper and higher (m) is no place on Earth."""

_SENTINEL_GAP = 100.0  # m
_COLLAR_HEIGHT = 20.0  # m: zeros along a rim are not the sea where the ground beside them is so high
_EIGHT = np.ones((3, 3), np.uint8)
_SPIKE_SLOPE, _SPIKE_TIMES = 1.5, 12.0
_TERRACED = 0.3  # share of samples equal to their neighbour
_SAMPLED = 8  # groups of as many rows, for the usual rise and for terraces


ReadRows: TypeAlias = Callable[[int, int], tuple[Float32Array, BoolArray]]
"""Returns a copy of a file's values (m) of rows first … last - 1, and which are known."""


class CleanedSamples:
    """Rows of a DEM, cleaned as they are read: the same whichever strips they are read by.

    First, the file is read once for what depends on all of it: which values mean "no data", and collars.
    """

    def __init__(
        self,
        read: ReadRows,
        shape: tuple[int, int],
        step: float,
        strip: int | None = None,
        sentinels: tuple[float, ...] = SENTINELS,
    ) -> None:
        self.shape, self._read, self._step, self._strip = shape, read, step, strip or shape[0]
        self._candidates, self._sentinels = sentinels, list[float]()
        self._collars: dict[int, bytes] = {}  # by strip
        self._voids = np.zeros(3, np.int64)  # samples filled, voids filled, samples left out
        self._counted = 0  # rows whose voids are

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, rows: slice) -> Float32Array:
        """Return the heights of some rows."""
        first, last, _ = rows.indices(len(self))
        self._survey  # noqa: B018 - finds sentinels and collars
        low, high = max(first - MAX_FILLED - 1, 0), min(last + MAX_FILLED + 1, len(self))
        samples = np.ascontiguousarray(self._without_bad_values(low, high))
        counts = np.zeros(3, np.int64)
        if np.isnan(samples[first - low : last - low]).any():
            counts = _fill_small_voids(samples, low, (first, last), self.shape)
        if first == self._counted < last:
            self._voids, self._counted = self._voids + counts, last
        return samples[first - low : last - low].copy()

    @property
    def findings(self) -> Findings:
        """What was found, in the rows that were read one after another; of all rows at the end."""
        filled, voids, left = self._voids
        report = [f"{filled} samples in {voids} small voids, filled"] if voids else []
        report += [f"{left} samples in large voids or at the rim, left out"] if left else []
        return (*self._survey, *report)

    def _without_bad_values(self, first: int, last: int) -> Float32Array:
        values, known = self._read(first, last)
        bad = ~(known & _are_heights(values))
        for sentinel in self._sentinels:
            bad |= values == sentinel
        for strip in range(first // self._strip, -(-last // self._strip)) if self._collars else ():
            if strip in self._collars:
                start = strip * self._strip
                mask = self._unpacked(strip)[max(first - start, 0) : last - start]
                bad[max(start - first, 0) :][: len(mask)] |= mask
        values[bad] = np.nan
        return values

    def _unpacked(self, strip: int) -> BoolArray:
        rows = min(self._strip, len(self) - strip * self._strip)
        bits = np.frombuffer(zlib.decompress(self._collars[strip]), np.uint8)
        return np.unpackbits(bits, count=rows * self.shape[1]).reshape(rows, -1).astype(bool)

    @cached_property
    def _survey(self) -> Findings:
        """Find sentinels and collars; return what was found."""
        return tuple(self._find_quirks())

    def _find_quirks(self) -> Iterator[str]:
        rows = len(self)
        slope, terraces = self._slopes()
        steepest = max(_SPIKE_SLOPE * self._step, _SPIKE_TIMES * (slope + 1e-6))
        collars, odd = _Collars(self.shape), np.zeros(0, np.float32)
        hits, near = (np.zeros(len(self._candidates), kind) for kind in (np.int64, bool))
        unknown = strange = spikes = 0
        for start in range(0, rows, self._strip):
            low, high = max(start - 1, 0), min(start + self._strip + 1, rows)
            mine = slice(start - low, start - low + self._strip)  # the others are beside it
            values, known = self._read(low, high)
            far = known & ~_are_heights(values)
            unknown += _count(~known[mine])
            if far[mine].any():
                strange += _count(far[mine])
                odd = np.unique(np.append(odd, values[mine][far[mine]]))[:4]
            known = known & ~far
            values[~known] = np.nan  # which is quiet
            for n, sentinel in enumerate(self._candidates):
                hit = known & (values == sentinel)
                close = known & ~hit & (np.abs(values - sentinel) < _SENTINEL_GAP)
                hits[n] += _count(hit[mine])
                near[n] |= close.any()
                known &= ~hit
            collars.add(start // self._strip, values, known, mine)
            values[~known] = np.nan
            spikes += _spikes(values, steepest, mine)
        self._sentinels = [
            each for each, count, kept in zip(self._candidates, hits, near, strict=True) if count and not kept
        ]
        self._collars, zeros = collars.found()
        if unknown:
            yield f"{unknown} samples of no data (the file's mask or tag)"
        if strange:
            yield f"{strange} samples of no data ({', '.join(sorted(f'{each:.6g}' for each in odd))})"
        for sentinel, count in zip(self._candidates, hits, strict=True):
            if sentinel in self._sentinels:
                yield f"{count} samples of no data ({sentinel:g})"
        if zeros:
            yield f"{zeros} zeros in collars along the rim, taken for no data"
        if spikes:
            yield f"{spikes} spikes, higher or lower than all their neighbours (kept)"
        yield from terraces

    def _slopes(self) -> tuple[float, list[str]]:
        """Return the usual rise of neighbours (m) of some rows, and a report of heights in steps."""
        parts, groups = [], min(-(-len(self) // _SAMPLED), _SAMPLED)
        for row in np.linspace(0, max(len(self) - _SAMPLED, 0), groups).astype(int).tolist():
            values, known = self._read(row, min(row + _SAMPLED, len(self)))
            values[~(known & _are_heights(values))] = np.nan
            parts.append(np.abs(np.diff(values)).ravel())
        rise = np.concatenate(parts)
        rise = rise[np.isfinite(rise)]
        return float(np.median(rise)) if len(rise) else 0.0, _terraces(rise)


def _are_heights(values: Float32Array) -> BoolArray:
    return (values >= -MAX_HEIGHT) & (values <= MAX_HEIGHT)


def _count(mask: BoolArray) -> int:
    return int(np.count_nonzero(mask))


class _Collars:
    """Regions of zeros along the rim at the foot of a cliff, found strip by strip."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self._shape = shape
        self._strips: list[tuple[int, int, bytes]] = []  # number, first label, labels
        self._facts = [np.zeros((3, 1), np.int64)]  # by label: at the rim, borders, borders to high ground
        self._pairs = [np.zeros((2, 0), np.int64)]  # labels that touch across strips
        self._labels = 0
        self._above: Any = np.zeros(shape[1], np.int64)

    def add(self, strip: int, values: Float32Array, known: BoolArray, mine: slice) -> None:
        """Label the zeros of a strip, given with a row on each side."""
        zero = known & (values == 0.0)
        above, self._above = self._above, np.zeros(self._shape[1], np.int64)
        if not zero[mine].any():
            return
        local, count = ndimage.label(zero[mine], _EIGHT)
        labels = np.zeros(zero.shape, np.int32)
        labels[mine] = local
        edges = [local[:, 0], local[:, -1]]
        edges += [local[0]] if strip == 0 else []
        edges += [local[-1]] if mine.stop >= len(values) else []
        facts = np.zeros((3, count + 1), np.int64)
        facts[0, np.unique(np.concatenate(edges))] = 1
        # Borders are pairs of samples, so that those of parts add up.
        ground = np.pad(known & ~zero, 1)
        cliff = ground & np.pad(np.abs(values) > _COLLAR_HEIGHT, 1)
        for row in range(3):
            for column in range(3):
                part = np.s_[row : row + len(zero), column : column + zero.shape[1]]
                for n, beside in ((1, ground), (2, cliff)):
                    facts[n] += np.bincount(labels[beside[part]], minlength=count + 1)
        self._facts.append(facts[:, 1:])
        here = np.where(local[0] > 0, local[0] + self._labels, 0)
        for shift in (-1, 0, 1):
            there = np.roll(above, shift)
            there[: max(shift, 0)] = 0
            there[len(there) + min(shift, 0) :] = 0
            self._pairs.append(np.stack([here, there])[:, (here > 0) & (there > 0)])
        self._strips.append((strip, self._labels, zlib.compress(local.astype(np.int32).data, 1)))
        self._above = np.where(local[-1] > 0, local[-1] + self._labels, 0)
        self._labels += count

    def found(self) -> tuple[dict[int, bytes], int]:
        """Return bits of each strip that has collars, compressed, and how many zeros these are."""
        size = self._labels + 1
        one, other = np.concatenate(self._pairs, axis=1)
        graph = coo_array((np.ones(len(one), bool), (one, other)), shape=(size, size))
        count, region = connected_components(graph, directed=False)
        facts = np.concatenate(self._facts, axis=1)
        rim, borders, high = (np.bincount(region, each, count) for each in facts)
        collar = ((rim > 0) & (2 * high > borders))[region]
        collar[0] = False
        strips, zeros = {}, 0
        for strip, first, packed in self._strips:
            labels = np.frombuffer(zlib.decompress(packed), np.int32)
            mask = collar[np.where(labels > 0, labels + first, 0)]
            if mask.any():
                strips[strip] = zlib.compress(np.packbits(mask).data, 1)
                zeros += _count(mask)
        return strips, zeros


def _spikes(samples: Float32Array, steepest: float, mine: slice) -> int:
    """Return how many samples stand out from all their neighbours, by steep slopes and unlike others."""
    first, last = max(mine.start, 1), min(mine.stop, len(samples) - 1)
    if last <= first or samples.shape[1] < 3:
        return 0
    inner = samples[first:last, 1:-1]
    above, below = np.full(inner.shape, np.inf, np.float32), np.full(inner.shape, np.inf, np.float32)
    for row in (-1, 0, 1):
        for column in range(3):
            if (row, column) != (0, 1):
                rise = inner - samples[first + row : last + row, column : column + inner.shape[1]]
                np.fmin(above, rise, out=above)
                np.fmin(below, -rise, out=below)
    stands_out = np.maximum(above, below)
    return _count((stands_out > steepest) & np.isfinite(stands_out))


def _terraces(rise: Float32Array) -> list[str]:
    """Report heights in steps, where many neighbours are equal."""
    moved = rise[rise > 1e-4]
    if not len(moved) or len(moved) > (1.0 - _TERRACED) * len(rise):
        return []
    quantum = float(moved.min())
    multiples = moved / quantum
    if np.mean(np.abs(multiples - np.round(multiples)) < 0.02) < 0.99:
        return []
    share = 100.0 * (1.0 - len(moved) / len(rise))
    return [
        f"terraces: {share:.0f} % of neighbours are equal, heights are in steps of {quantum:.3g} m (kept)"
    ]


def _fill_small_voids(
    samples: Float32Array, low: int, mine: tuple[int, int], shape: tuple[int, int]
) -> Int64Array:
    """Fill voids that don't touch the rim and are at most `MAX_FILLED` across, in place, by a membrane.

    `samples` are rows from `low` on. Return the samples filled, voids that begin, and samples left out in the
    rows `mine`.
    """
    labels = np.empty(samples.shape, np.int32)
    ndimage.label(np.isnan(samples), _EIGHT, output=labels)
    boxes = np.array([(r.start, r.stop, c.start, c.stop) for r, c in ndimage.find_objects(labels)])
    top, bottom, left, right = boxes.T
    # One that reaches the strip's end is larger, as strips reach so far beyond these rows.
    side = np.maximum(bottom - top, right - left)
    small = side <= MAX_FILLED
    small &= (top > 0) & (left > 0) & (bottom < len(samples)) & (right < shape[1])
    first, last = (row - low for row in mine)
    chosen = np.flatnonzero(small & (top < last) & (bottom > first))
    # The same sine on every processor, unlike NumPy's.
    relaxation = np.array([2.0 / (1.0 + math.sin(math.pi / (n + 2))) for n in side[chosen].tolist()])
    window, inner = (np.empty((MAX_FILLED + 2) ** 2, kind) for kind in (np.float64, np.int64))
    host_function("fill_voids")(samples, labels, boxes, chosen, relaxation, window, inner)
    counts = np.bincount(labels[first:last].ravel(), minlength=len(boxes) + 1)[1:]
    starting = np.count_nonzero(small & (top >= first) & (top < last))
    return np.array([counts[small].sum(), starting, counts[~small].sum()])


CODES: Final = {"mapbox": (0.1, -10000.0), "terrarium": (1.0 / 256.0, -32768.0)}
"""Step and least height (m) of heights as numbers of 24 bits in red, green and blue."""

# Those of PROJ and GDAL in metres, without "US survey", "international" and the last s.
_NAMES = "1000 km kilometre kilometer, 1 m metre meter, 0.1 dm decimetre decimeter, 0.0254 in inch inche, "
_NAMES += "0.01 cm centimetre centimeter, 0.001 mm millimetre millimeter, 0.3048 ft foot feet, "
_NAMES += "0.9144 yd yard, 1.8288 fath fathom, 0.201168 link, 20.1168 ch chain, 1609.344 mi mile, "
_NAMES += "1852 kmi nmi nauticalmile, "
_NAMES += "0.30479951 indft indianfoot indianfeet, 0.91439523 indyd indianyard, 20.11669506 indch indianchain"
_UNITS = {name: float(each.split()[0]) for each in _NAMES.split(", ") for name in each.split()[1:]}
_SURVEY: Final = 1200.0 / 3937.0 / 0.3048  # of the lengths of the United States until 2022
_INT16_VOIDS: Final = (-32768.0, -32767.0, 32767.0)


def unit_metres(unit: str) -> float | None:
    """Return the metres of a unit of length by a name of PROJ or GDAL; None for other names."""
    name = re.sub(r"[\s_().'\[\]-]|international|intl", "", unit.lower())
    plain = re.sub(r"^us(?=.)|survey|(?<=.)us$", "", name)
    metres = _UNITS.get(plain, _UNITS.get(plain[:-1]) if plain[2:].endswith("s") else None)
    return metres and metres * (_SURVEY if plain != name else 1.0)


class StoredValues:
    """How the values of a file are heights: by what a source states, else by the file.

    Raise InputError for an unknown unit, for none (None) without a range, and for a sign of signed values.
    """

    def __init__(
        self,
        dtype: npt.DTypeLike,
        source: RasterSource,
        unit: str | None = "",
        scale: float = 1.0,
        offset: float = 0.0,
        voids: tuple[float, ...] = (),
    ) -> None:
        self.dtype = stored = np.dtype(dtype).newbyteorder("=")
        self._signed = np.dtype(f"i{stored.itemsize}") if stored.kind == "u" else None
        if source.signed and self._signed is None:
            raise InputError(f"signed = 1: expected whole numbers without a sign, got {stored.name}")
        self._dtype = (source.signed and self._signed) or stored
        if unit is None and not source.range:
            raise InputError(
                "no heights in m: expected range (--range 0,900), and a place or cell (--cell 2)"
            )
        unit = source.units or unit or "m"
        if (metres := unit_metres(unit)) is None:
            raise InputError(f"heights in {format_value(unit)}: expected a unit of length, units (--units)")
        if not (scale and math.isfinite(scale) and math.isfinite(offset)):
            raise InputError(
                f"heights with scale {scale} and offset {offset}: expected finite ones, no scale of 0"
            )
        told = f"heights in {one_line(unit)[:40]}, converted by {metres:.8g}"
        self.findings: Findings = (told,) if metres != 1.0 else ()
        kind, is_wide = self._dtype.kind, self._dtype.itemsize > 1
        least, most = (0, 1) if kind == "f" else (np.iinfo(self._dtype).min, np.iinfo(self._dtype).max)
        if source.range:
            low, high = map(float, source.range.split(","))
            scale = (high - low) / (most - least)
            offset = low - scale * least
        self._scale, self._offset = scale * metres, offset * metres
        self.step = abs(self._scale) if kind in "iu" else 0.0
        self._voids = _INT16_VOIDS if self._dtype.name == "int16" and not source.range else ()
        self.may_be_signed = kind == "u" and is_wide and not source.range
        raws = (*SENTINELS, *_INT16_VOIDS, *voids, *((most,) if self.may_be_signed else ()))
        found = [] if source.range else np.unique([*SENTINELS, *map(self._metres, raws)]).tolist()
        self.sentinels = tuple(each for each in found if abs(each) <= MAX_HEIGHT)

    def _metres(self, raw: Any) -> Any:
        with np.errstate(over="ignore", invalid="ignore"):
            return np.float32(np.asarray(raw, np.float64) * self._scale + self._offset)

    def heights(self, raw: npt.NDArray[Any]) -> Float32Array:
        """Return a copy of stored values in metres."""
        raw = raw.view(self._dtype)  # signed if that is stated
        if (self._scale, self._offset) == (1.0, 0.0):
            return raw.astype(np.float32)
        heights: Float32Array = self._metres(raw)
        void = np.isin(raw, self._voids)
        heights[void] = raw[void]
        return heights

    def sign_finding(self, raw: npt.NDArray[Any]) -> Findings:
        """Report stored values of which several different ones are heights only if they are signed."""
        if not self.may_be_signed or not raw.size:
            return ()
        heights, signed = self._metres(raw), self._metres(raw.view(self._signed))
        odd = (np.abs(heights) > MAX_HEIGHT) & (np.abs(signed) <= MAX_HEIGHT)
        share = f"{100.0 * np.mean(odd):.2g} % of its numbers"
        told = f"{share} are heights only as signed ones: signed (--signed) reads them so"
        return (told,) if len(np.unique(raw[odd])) > 3 else ()
