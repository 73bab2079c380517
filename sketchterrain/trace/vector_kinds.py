"""Which layer of a sketch a feature of a map belongs to, and what it says of its properties there."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from sketchterrain.sketch import LAYERS
from sketchterrain.trace.layer_names import meant_by

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sketchterrain.sketch.parameter import Parameter, Value

__all__ = ["READ", "Wanted", "number_in", "tags_of", "wanted_by"]


class Wanted(NamedTuple):
    """What a feature becomes.

    Attributes
    ----------
    layer : str
    properties : dict
        Of the label, only what is said.
    guessed : frozenset of str
        Those of them that follow from what the feature is called.
    clipped, unread : int
        Values that were out of range and were taken to its end; values that nothing could be made of.
    """

    layer: str
    properties: dict[str, Value]
    guessed: frozenset[str]
    clipped: int
    unread: int


_Rule = tuple[str, dict[str, "Value"]]


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
    {"layer", "other_tags", "radius", *_KEYS}
    | {name for layer in LAYERS.values() for name in layer.parameters}
    | {name for names in _ALSO.values() for name in names}
)
"""Names of the properties that count, in lower case."""

_HSTORE = re.compile(r'"((?:[^"\\]|\\.)*)"=>"((?:[^"\\]|\\.)*)"')
_NUMBER = re.compile(r"\s*([+-]?\d+(?:\.\d+)?)\s*(?:m|metres?|meters?)?\s*", re.I)


def tags_of(properties: Mapping[str, Any]) -> dict[str, Any]:
    """Return what counts of a feature's properties, by lower-case names.

    Tags in an object ``tags`` (Overpass) or in a text ``other_tags`` (GDAL's driver OSM) are laid out flat.
    """
    nested = properties.get("tags")
    flat = {**nested, **properties} if isinstance(nested, dict) else dict(properties)
    others = flat.get("other_tags")
    if isinstance(others, str):
        flat = dict(_HSTORE.findall(others)) | flat
    return {
        name.lower(): value
        for name, value in flat.items()
        if name.lower() in READ and value is not None and value != "" and value == value  # no NaN
    }


def wanted_by(tags: Mapping[str, Any], source: str, layer: str | None) -> Wanted | None:
    """Return what a feature becomes, or None if nothing says so.

    What its property ``layer`` names counts most, then its tags, then the name of the layer that it is from,
    then what is to be taken for all others.

    Parameters
    ----------
    tags
        From `tags_of`.
    source
        Name of the layer or file.
    layer
        For what says nothing of itself.
    """
    named = tags.get("layer")
    name, given = _named(named) if isinstance(named, str) else None, dict[str, "Value"]()
    if name is None:
        name, given = _tagged(tags)
    name = name or _named(source) or _SOURCES.get(source.lower()) or layer
    return None if name is None else _with_properties(name, given, tags)


def number_in(value: object) -> float | None:
    """Return the number that a value is or that a text such as ``12.5 m`` has, or None."""
    if isinstance(value, bool):
        return None
    if isinstance(value, int | float):
        return float(value) if abs(value) < 1e300 and math.isfinite(value) else None
    match = _NUMBER.fullmatch(value) if isinstance(value, str) and len(value) < 40 else None
    return float(match[1]) if match else None


def _named(text: str) -> str | None:
    meaning = meant_by(text)
    return meaning.layer if meaning is not None else None


def _tagged(tags: Mapping[str, Any]) -> tuple[str | None, dict[str, Value]]:
    for key, rules in _KEYS.items():
        value = tags.get(key)
        if isinstance(value, str):
            found = rules.get(value.strip().lower().replace(" ", "_"))
            if found is not None:
                return found[0], dict(found[1])
    return None, {}


def _with_properties(layer: str, given: dict[str, Value], tags: Mapping[str, Any]) -> Wanted:
    said: dict[str, Value] = {}
    clipped = unread = 0
    for name, parameter in LAYERS[layer].parameters.items():
        value = next((tags[each] for each in _ALSO.get(name, (name,)) if each in tags), None)
        if value is None:
            continue
        taken = _taken(value, parameter)
        if taken is None:
            unread += 1
            continue
        said[name] = taken
        number = number_in(value)
        clipped += number is not None and not parameter.low <= number <= parameter.high
    guessed = frozenset(given.keys() - said.keys())
    return Wanted(layer, given | said, guessed, clipped, unread)


def _taken(value: object, parameter: Parameter) -> Value | None:
    if parameter.kind is str:
        return value if isinstance(value, str) and value in parameter.choices else None
    number = number_in(value)
    if number is None:
        return None
    inside = min(max(number, parameter.low), parameter.high)
    # A float32's 0.8999999762 is 0.9.
    return round(inside) if parameter.kind is int else float(f"{inside:.6g}")
