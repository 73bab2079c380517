"""Legends of coloured maps: colours and their meanings, a layer with a label, unpainted, or ink."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, NamedTuple

import msgspec
import numpy as np

from sketchterrain.document.label_layers import to_oklab
from sketchterrain.document.parameters import LAYERS
from sketchterrain.document.toml_format import load_toml
from sketchterrain.errors import InputError, did_you_mean, format_value, one_line

Rgb = tuple[int, int, int]

TOLERANCE: Final = 0.1  # Oklab distance from a legend's colour; black and white are 1 apart

_MAX_BYTES = 1 << 20  # of a legend's file
_MAX_COLOURS = 1000
_HEX = re.compile(r"#?([0-9a-fA-F]{6}|[0-9a-fA-F]{3})")
_NAMED = re.compile(r"([a-z]+)[\s._#:(-]*(\d{1,3})?\)?(?:\.png)?", re.IGNORECASE)
_GIVEN = re.compile(r"\s*([A-Za-z]+)(?:\.(\d{1,9}))?\s*=\s*(\S+)\s*")


class Meaning(NamedTuple):
    """Meaning of a colour: a layer and a label from 1 to 255, or `NOTHING` (unpainted), or `INK`.

    Ink is lettering and outlines, filled from their surroundings.
    """

    layer: str
    label: int

    def __str__(self) -> str:
        return f"{self.layer} {self.label}" if self.label else self.layer


NOTHING: Final = Meaning("nothing", 0)
INK: Final = Meaning("ink", 0)


@dataclass(frozen=True)
class Legend:
    """Meanings of colours (sRGB, 0 to 255), and the tolerance of a match (Oklab)."""

    colours: Mapping[Rgb, Meaning]
    tolerance: float = TOLERANCE

    @classmethod
    def parse(cls, texts: Iterable[str], *, tolerance: float = TOLERANCE) -> Legend:
        """Parse texts such as ``mountain=#8b5a2b``, ``river.2=#0000ff`` or ``ink=#000000``."""
        colours = []
        for text in texts:
            match = _GIVEN.fullmatch(text)
            if match is None:
                raise InputError(
                    f"colour {format_value(text)}: expected LAYER=#rrggbb or LAYER.LABEL=#rrggbb"
                )
            where, label = f"colour {format_value(text)}", int(match[2]) if match[2] else None
            colours.append((_rgb(match[3], where), _meaning(match[1].lower(), label, where)))
        return cls(_checked(colours, "colours"), tolerance)

    def meaning(self, rgb: Rgb) -> Meaning | None:
        """Return the meaning of the nearest colour of the legend, or None beyond the tolerance."""
        lab = to_oklab(np.array([rgb, *self.colours]) / 255.0)
        distance = np.sqrt(((lab[1:] - lab[0]) ** 2).sum(axis=1))
        nearest = int(np.argmin(distance))
        return list(self.colours.values())[nearest] if distance[nearest] <= self.tolerance else None


class _Entry(msgspec.Struct, forbid_unknown_fields=True):
    rgb: str
    layer: str
    label: int | None = None


class _LegendFile(msgspec.Struct, forbid_unknown_fields=True):
    colour: Annotated[list[_Entry], msgspec.Meta(max_length=_MAX_COLOURS)]


def read_legend(path: Path, *, tolerance: float = TOLERANCE) -> Legend:
    """Read a legend from a TOML file: tables ``[[colour]]`` of ``rgb``, ``layer`` and ``label``, else 1."""
    location = one_line(path)
    try:
        with path.open("rb") as stream:
            data = stream.read(_MAX_BYTES + 1)
    except OSError as error:
        raise InputError(f"{location}: cannot be read ({one_line(error.strerror or error)})") from None
    if len(data) > _MAX_BYTES:
        raise InputError(f"{location}: too large for a legend: expected at most {_MAX_BYTES >> 20} MiB")
    try:
        entries = msgspec.convert(load_toml(data), _LegendFile).colour
        colours = []
        for number, entry in enumerate(entries, start=1):
            where = f"[[colour]] {number}"
            colours.append((_rgb(entry.rgb, where), _meaning(entry.layer, entry.label, where)))
        return Legend(_checked(colours, "[[colour]]"), tolerance)
    except msgspec.ValidationError as error:
        raise InputError(
            f"{location}: {one_line(error)}: expected [[colour]] with rgb, layer, label"
        ) from None
    except InputError as error:
        raise InputError(f"{location}: {error}") from None


def _rgb(value: str, where: str) -> Rgb:
    match = _HEX.fullmatch(value)
    if match is None:
        raise InputError(f'{where}: expected a colour as "#rrggbb", got {format_value(value)}')
    digits = match[1] if len(match[1]) == 6 else "".join(2 * digit for digit in match[1])
    return int(digits[:2], 16), int(digits[2:4], 16), int(digits[4:], 16)


def _meaning(layer: str, label: int | None, where: str) -> Meaning:
    for special in (NOTHING, INK):
        if layer == special.layer:
            if label is not None:
                raise InputError(f"{where}: {layer} has no labels")
            return special
    if layer not in LAYERS:
        names = (*LAYERS, NOTHING.layer, INK.layer)
        raise InputError(
            f"{where}: unknown layer {format_value(layer)}: expected {', '.join(names)}"
            f"{did_you_mean(layer, names)}"
        )
    if label is not None and not 1 <= label <= 255:
        raise InputError(f"{where}: expected a label from 1 to 255, got {label}")
    return Meaning(layer, label or 1)


def _checked(colours: list[tuple[Rgb, Meaning]], where: str) -> dict[Rgb, Meaning]:
    meanings: dict[Rgb, Meaning] = {}
    for rgb, meaning in colours:
        if meanings.setdefault(rgb, meaning) != meaning:
            code = "#{:02x}{:02x}{:02x}".format(*rgb)
            raise InputError(f"{where}: {code} means both {meanings[rgb]} and {meaning}")
    if not colours:
        raise InputError(f"{where}: expected at least one colour")
    return meanings


def _own() -> Legend:
    common = (
        # Common choices.
        *("mountain=#8b5a2b", "mountain=#a0522d", "mountain=#5b3a1e", "hill=#9acd32", "forest=#008000"),
        *("river=#0000ff", "river=#1f4e9c", "lake=#87ceeb", "dune=#ffff00", "dune=#f0e68c"),
        *("nothing=#ffffff", "ink=#000000", "ink=#101010", "ink=#202020", "ink=#303030"),
        # OpenStreetMap's standard style (openstreetmap-carto, style/landcover.mss, style/water.mss).
        *("lake=#aad3df", "forest=#add19e", "dune=#f5e9c6", "material=#eee5dc", "nothing=#f2efe9"),
        *("nothing=#cdebb0", "nothing=#ddecec"),
    )
    layers = {layer.colour: Meaning(name, 1) for name, layer in LAYERS.items()}
    return Legend({**layers, **Legend.parse(common).colours, **layers})


OWN_LEGEND: Final = _own()  # the program's colours, and those of common maps


def parse_layer_name(name: str) -> Meaning | None:
    """Parse a name such as ``Mountains``, ``river 2`` or ``lake_3.png``; None if it is not a layer."""
    match = _NAMED.fullmatch(name.strip())
    if match is None:
        return None
    word, label = match[1].lower(), int(match[2] or 1)
    known = {**{name: name for name in LAYERS}, **{LAYERS[name].title.lower(): name for name in LAYERS}}
    return Meaning(known[word], label) if word in known and 1 <= label <= 255 else None
