"""Values of elevation files as heights in metres: units, scales, signs, ranges and codes in colours."""

from __future__ import annotations

import math
import re
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float32Array
from sketchterrain.document.rasters import RasterSource
from sketchterrain.elevation.quirks import MAX_HEIGHT, SENTINELS, Findings
from sketchterrain.errors import InputError, format_value, one_line

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
