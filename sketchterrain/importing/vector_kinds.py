"""Layer and label of a map's feature by its tags; few labels for many features."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

from sketchterrain.document.parameter_types import Value
from sketchterrain.document.parameters import LAYERS
from sketchterrain.importing.legend import meant_by

Properties = dict[str, Value]
_Rule = tuple[str, Properties]


@dataclass(frozen=True)
class Wanted:
    """The layer of a feature and the properties of its label that the feature states.

    `guessed` names those that follow from the kind of feature; `clipped` counts values that were out of range
    and `unread` those that could not be read.
    """

    layer: str
    properties: Properties
    guessed: frozenset[str]
    clipped: int
    unread: int


def _rules(layer: str, values: str, **properties: Value) -> dict[str, _Rule]:
    return dict.fromkeys(values.split(), (layer, properties))


_WATERWAY: dict[str, _Rule] = {
    **_rules("river", "river tidal_channel riverbank"),
    **_rules("river", "canal fairway", width=10.0),
    **_rules("river", "stream brook", width=3.0, depth=0.5),
    **_rules("river", "ditch drain", width=1.5, depth=0.5),
}
_GROUND: dict[str, _Rule] = {
    **_rules("lake", "water reservoir basin lake pond lagoon"),
    **_rules("forest", "wood forest"),
    **_rules("mountain", "peak ridge arete volcano mountain mountain_range massif"),
    **_rules("hill", "hill"),
    **_rules("dune", "dune desert"),
    **_rules("material", "bare_rock rock cliff", material="rock"),
    **_rules("material", "scree shingle", material="scree"),
    **_rules("material", "sand beach", material="sand"),
    **_rules("material", "glacier", material="snow"),
    **_rules("material", "meadow grass grassland", material="grass"),
}
# OpenStreetMap's keys (wiki: Map features), `fclass` of Geofabrik's extracts, `featurecla` of Natural Earth,
# `type` of this program's own exports.
_KEYS: dict[str, dict[str, _Rule]] = {
    "waterway": _WATERWAY,
    "water": {**_rules("river", "river stream canal"), **_rules("lake", "lake reservoir pond basin lagoon")},
    "natural": _GROUND,
    "landuse": _GROUND,
    "fclass": _GROUND | _WATERWAY,
    "featurecla": _GROUND | _WATERWAY,
    "type": {layer: (layer, {}) for layer in LAYERS},
}
_SOURCES = {"wood": "forest", "woods": "forest", "water": "lake", "waterway": "river", "waterways": "river"}
# What else a property may be called: our own exports' strength is the height of what rises.
_ALSO = {
    "height": ("height", "strength"),
    "density": ("density", "strength"),
    "width": ("width", "est_width"),
}

READ: Final = frozenset(
    {"layer", "tags", "other_tags", "radius", *_KEYS}
    | {name for layer in LAYERS.values() for name in layer.parameters}
    | {name for names in _ALSO.values() for name in names}
)  # names of the properties that count, in lower case

_HSTORE = re.compile(r'"((?:[^"\\]|\\.)*)"=>"((?:[^"\\]|\\.)*)"')
_NUMBER = re.compile(r"\s*([+-]?\d+(?:\.\d+)?)\s*(?:m|metres?|meters?)?\s*", re.I)


def tags_of(properties: Mapping[str, Any]) -> dict[str, Any]:
    """Return the properties that count, by lower-case names, with nested tags laid out flat.

    These are an object ``tags`` (Overpass), which GDAL gives as JSON, and ``other_tags`` (GDAL's driver OSM).
    """
    flat = _stated(properties)
    nested, others = flat.get("tags"), flat.get("other_tags")
    if isinstance(nested, str) and nested.startswith("{"):
        with suppress(ValueError, RecursionError):
            flat = _stated(json.loads(nested)) | flat
    if isinstance(others, str):
        flat = _stated(dict(_HSTORE.findall(others))) | flat
    return flat


def _stated(tags: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tags that count and have a value, by lower-case names."""
    return {
        name.lower(): value
        for name, value in tags.items()
        if name.lower() in READ and value is not None and value != "" and value == value  # no NaN
    }


def wanted_by(tags: Mapping[str, Any], source: str, layer: str | None) -> Wanted | None:
    """Return the layer and properties of a feature, or None if nothing states them.

    Its property ``layer`` counts first, then its tags, then the name of its `source` layer, then `layer`.
    """
    name, given = _named(tags.get("layer")), Properties()
    if name is None:
        name, given = _tagged(tags)
    name = name or _named(source) or _SOURCES.get(source.lower()) or layer
    return None if name is None else _with_properties(name, given, tags)


def number_in(value: object) -> float | None:
    """Return a number, or that of a text such as ``12.5 m``, or None."""
    if isinstance(value, bool):
        return None
    if isinstance(value, int | float):
        return float(value) if abs(value) < 1e300 and math.isfinite(value) else None
    match = _NUMBER.fullmatch(value) if isinstance(value, str) and len(value) < 40 else None
    return float(match[1]) if match else None


def _named(text: object) -> str | None:
    meaning = meant_by(text) if isinstance(text, str) else None
    return meaning.layer if meaning is not None else None


def _tagged(tags: Mapping[str, Any]) -> tuple[str | None, Properties]:
    for key, rules in _KEYS.items():
        value = tags.get(key)
        if isinstance(value, str):
            found = rules.get(value.strip().lower().replace(" ", "_"))
            if found is not None:
                return found[0], dict(found[1])
    return None, {}


def _with_properties(layer: str, given: Properties, tags: Mapping[str, Any]) -> Wanted:
    said: Properties = {}
    clipped = unread = 0
    for name, parameter in LAYERS[layer].parameters.items():
        value = next((tags[each] for each in _ALSO.get(name, (name,)) if each in tags), None)
        number = number_in(value)
        if parameter.kind is str and isinstance(value, str) and value in parameter.choices:
            said[name] = value
        elif parameter.kind is not str and number is not None:
            inside = min(max(number, parameter.low), parameter.high)
            clipped += inside != number
            # A float32's 0.8999999762 is 0.9.
            said[name] = round(inside) if parameter.kind is int else float(f"{inside:.6g}")
        else:
            unread += value is not None
    guessed = frozenset(given.keys() - said.keys())
    return Wanted(layer, given | said, guessed, clipped, unread)


def classed(wanted: Sequence[Properties], most: int) -> tuple[list[int], list[Properties], float]:
    """Return the class of each feature, the properties of at most `most` classes, and the error.

    The error is the largest relative one of a number. Classes are in the order in which they appear. Equal
    properties share a class. Where these are too many, so do numbers within one step of a geometric scale, as
    fine a one as possible; a class has their mean.
    """
    steps = math.inf
    while True:
        keys = [tuple((name, _step(value, steps)) for name, value in sorted(each.items())) for each in wanted]
        order = {key: index for index, key in enumerate(dict.fromkeys(keys))}
        if len(order) <= most:
            break
        if steps < 1 / 64:  # texts, signs and what is said at all make too many
            return [0] * len(wanted), [{}], math.inf
        steps = 64.0 if steps == math.inf else steps / 2.0
    of = [order[key] for key in keys]
    members: list[list[Properties]] = [[] for _ in order]
    for index, each in zip(of, wanted, strict=True):
        members[index].append(each)
    properties = [_mean(each) for each in members]
    error = max((_off(each, properties[index]) for index, each in zip(of, wanted, strict=True)), default=0.0)
    return of, properties, error


def _step(value: Value, steps: float) -> Value:
    """Return a key that is equal for values within one of so many steps an octave."""
    if isinstance(value, str) or value == 0 or steps == math.inf:
        return value
    return f"{'-' if value < 0 else '+'} {round(math.log2(abs(value)) * steps)}"


def _mean(members: Sequence[Properties]) -> Properties:
    """Return the properties of a class, with the mean of numbers that differ."""
    mean = dict(members[0])
    for name, first in mean.items():
        if not isinstance(first, str) and any(each[name] != first for each in members):
            value = math.fsum(float(each[name]) for each in members) / len(members)
            mean[name] = round(value) if isinstance(first, int) else float(f"{value:.4g}")
    return mean


def _off(wanted: Properties, got: Properties) -> float:
    numbers = ((got[name], value) for name, value in wanted.items() if value and not isinstance(value, str))
    return max((abs(float(mean) / float(value) - 1.0) for mean, value in numbers), default=0.0)
