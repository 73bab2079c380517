"""Legends: which colours of a picture stand for which label, which for nothing, which are written over it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from sketchterrain.document.label_layers import to_oklab
from sketchterrain.document.parameters import LAYERS
from sketchterrain.document.toml_format import load_toml
from sketchterrain.errors import InputError, did_you_mean, format_value, one_line

Rgb = tuple[int, int, int]

TOLERANCE: Final = 0.1  # Oklab, from a legend's colour; black and white are 1 apart, like shades 0.05

_LARGEST = 1 << 20  # bytes of a legend's file
_MOST_COLOURS = 1000
_KEYS = ("rgb", "layer", "label")
_HEX = re.compile(r"#?([0-9a-fA-F]{6}|[0-9a-fA-F]{3})")
_NAMED = re.compile(r"([a-z]+)[\s._#:(-]*(\d{1,3})?\)?(?:\.png)?", re.IGNORECASE)
_GIVEN = re.compile(r"\s*([A-Za-z]+)(?:\.(\d{1,9}))?\s*=\s*(\S+)\s*")


class Meaning(NamedTuple):
    """What a colour stands for: a layer and a label, 1 to 255, or `NOTHING` (no paint) or `INK` with 0.

    Ink is lettering and outlines: what is beside them lies beneath them too.
    """

    layer: str
    label: int

    def __str__(self) -> str:
        return f"{self.layer} {self.label}" if self.label else self.layer


NOTHING: Final = Meaning("nothing", 0)
INK: Final = Meaning("ink", 0)


@dataclass(frozen=True)
class Legend:
    """What colours (sRGB, 0 to 255) stand for, and how far, in Oklab, a colour may be from one of these."""

    colours: Mapping[Rgb, Meaning]
    tolerance: float = TOLERANCE

    @classmethod
    def given(cls, texts: Iterable[str], *, tolerance: float = TOLERANCE) -> Legend:
        """Return the legend of texts like ``mountain=#8b5a2b``, ``river.2=#0000ff`` or ``ink=#000000``.

        Raise `InputError` if a text is not like that, or a colour has two meanings.
        """
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
        """Return what the nearest colour of the legend stands for; None if none is near enough."""
        lab = to_oklab(np.array([rgb, *self.colours]) / 255.0)
        distance = np.sqrt(((lab[1:] - lab[0]) ** 2).sum(axis=1))
        nearest = int(np.argmin(distance))
        return list(self.colours.values())[nearest] if distance[nearest] <= self.tolerance else None


def read_legend(path: Path, *, tolerance: float = TOLERANCE) -> Legend:
    """Read a legend from a TOML file: tables ``[[colour]]`` of ``rgb``, ``layer`` and ``label``, else 1."""
    place = one_line(path)
    try:
        with path.open("rb") as stream:
            data = stream.read(_LARGEST + 1)
    except OSError as error:
        raise InputError(f"{place}: cannot be read ({one_line(error.strerror or error)})") from None
    if len(data) > _LARGEST:
        raise InputError(f"{place}: too large for a legend: expected at most {_LARGEST >> 20} MiB")
    try:
        return Legend(_from_toml(load_toml(data)), tolerance)
    except InputError as error:
        raise InputError(f"{place}: {error}") from None


def _from_toml(read: dict[str, object]) -> dict[Rgb, Meaning]:
    tables = read.get("colour")
    others = [key for key in read if key != "colour"]
    if others:
        raise InputError(f"unknown key {format_value(others[0])}: expected tables [[colour]]")
    if not isinstance(tables, list) or not all(isinstance(each, dict) for each in tables):
        raise InputError('expected tables [[colour]] with rgb = "#rrggbb" and layer = "river"')
    if len(tables) > _MOST_COLOURS:
        raise InputError(f"{len(tables)} colours: expected at most {_MOST_COLOURS}")
    colours = []
    for number, table in enumerate(tables, start=1):
        where = f"[[colour]] {number}"
        for key in table:
            if key not in _KEYS:
                near = did_you_mean(str(key), _KEYS)
                raise InputError(
                    f"{where}: unknown key {format_value(key)}: expected {', '.join(_KEYS)}{near}"
                )
        layer, label = table.get("layer"), table.get("label")
        if not isinstance(layer, str):
            raise InputError(f"{where}: expected layer, a layer's name, got {format_value(layer)}")
        if label is not None and (not isinstance(label, int) or isinstance(label, bool)):
            raise InputError(f"{where}: expected label, 1 to 255, got {format_value(label)}")
        colours.append((_rgb(table.get("rgb"), where), _meaning(layer, label, where)))
    return _checked(colours, "[[colour]]")


def _rgb(value: object, where: str) -> Rgb:
    match = _HEX.fullmatch(value) if isinstance(value, str) else None
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
    meant: dict[Rgb, Meaning] = {}
    for rgb, meaning in colours:
        if meant.setdefault(rgb, meaning) != meaning:
            code = "#{:02x}{:02x}{:02x}".format(*rgb)
            raise InputError(f"{where}: {code} stands for {meant[rgb]} and for {meaning}")
    if not colours:
        raise InputError(f"{where}: expected at least one colour")
    return meant


def _own() -> Legend:
    common = (
        # What people take for these without asking.
        *("mountain=#8b5a2b", "mountain=#a0522d", "mountain=#5b3a1e", "hill=#9acd32", "forest=#008000"),
        *("river=#0000ff", "river=#1f4e9c", "lake=#87ceeb", "dune=#ffff00", "dune=#f0e68c"),
        *("nothing=#ffffff", "ink=#000000", "ink=#101010", "ink=#202020", "ink=#303030"),
        # OpenStreetMap's standard style (openstreetmap-carto, style/landcover.mss, style/water.mss).
        *("lake=#aad3df", "forest=#add19e", "dune=#f5e9c6", "material=#eee5dc", "nothing=#f2efe9"),
        *("nothing=#cdebb0", "nothing=#ddecec"),
    )
    layers = {layer.colour: Meaning(name, 1) for name, layer in LAYERS.items()}
    return Legend({**layers, **Legend.given(common).colours, **layers})


OWN_LEGEND: Final = _own()  # the program's own colours and those that people and common maps use


def meant_by(name: str) -> Meaning | None:
    """Return the layer and label of a name such as ``Mountains``, ``river 2`` or ``lake_3.png``, or None."""
    match = _NAMED.fullmatch(name.strip())
    if match is None:
        return None
    word, label = match[1].lower(), int(match[2] or 1)
    known = {**{each: each for each in LAYERS}, **{LAYERS[each].title.lower(): each for each in LAYERS}}
    return Meaning(known[word], label) if word in known and 1 <= label <= 255 else None
