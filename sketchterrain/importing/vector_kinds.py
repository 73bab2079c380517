"""Layers and labels of vector features by their tags, and clusters of similar labels."""

import json
import math
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

from sketchterrain.document.parameter_types import Value
from sketchterrain.document.parameters import LAYERS
from sketchterrain.importing.legend import parse_layer_name

Properties = dict[str, Value]
_Rule = tuple[str, Properties]


@dataclass(frozen=True)
class FeatureLabel:
    """The layer of a feature and the properties of its label."""

    layer: str
    properties: Properties
    guessed: frozenset[str]  # names of properties that follow from the kind of feature
    clipped: int  # values out of range
    unread: int  # invalid values


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
# Other names of properties: in our own exports strength is the height of hills and mountains.
_ALIASES = {
    "height": ("height", "strength"),
    "density": ("density", "strength"),
    "width": ("width", "est_width"),
}

RELEVANT_TAGS: Final = frozenset(
    {"layer", "tags", "other_tags", "radius", *_KEYS}
    | {name for layer in LAYERS.values() for name in layer.parameters}
    | {name for names in _ALIASES.values() for name in names}
)  # lower-case names of properties that are read

_HSTORE = re.compile(r'"((?:[^"\\]|\\.)*)"=>"((?:[^"\\]|\\.)*)"')
_NUMBER = re.compile(r"\s*([+-]?\d+(?:\.\d+)?)\s*(?:m|metres?|meters?)?\s*", re.I)


def relevant_tags(properties: Mapping[str, Any]) -> dict[str, Any]:
    """Return the relevant properties by lower-case names, with nested tags flattened.

    These are an object ``tags`` (Overpass), as JSON, and ``other_tags`` (GDAL's driver OSM).
    """
    flat = _relevant(properties)
    nested, others = flat.get("tags"), flat.get("other_tags")
    if isinstance(nested, str) and nested.startswith("{"):
        with suppress(ValueError, RecursionError):
            flat = _relevant(json.loads(nested)) | flat
    if isinstance(others, str):
        flat = _relevant(dict(_HSTORE.findall(others))) | flat
    return flat


def _relevant(tags: Mapping[str, Any]) -> dict[str, Any]:
    """Return the relevant tags with a value, by lower-case names."""
    return {
        name.lower(): value
        for name, value in tags.items()
        if name.lower() in RELEVANT_TAGS and value is not None and value != "" and value == value  # no NaN
    }


def feature_label(tags: Mapping[str, Any], source: str, layer: str | None) -> FeatureLabel | None:
    """Return the layer and properties of a feature, or None if unknown.

    By its property ``layer``, else its tags, else the name of its `source` layer, else the default `layer`.
    """
    name, defaults = _layer_name(tags.get("layer")), Properties()
    if name is None:
        name, defaults = _layer_of_tags(tags)
    name = name or _layer_name(source) or _SOURCES.get(source.lower()) or layer
    return None if name is None else _feature_label(name, defaults, tags)


def parse_number(value: object) -> float | None:
    """Return a number, also from a text such as ``12.5 m``, or None."""
    if isinstance(value, bool):
        return None
    if isinstance(value, int | float):
        return float(value) if abs(value) < 1e300 and math.isfinite(value) else None
    match = _NUMBER.fullmatch(value) if isinstance(value, str) and len(value) < 40 else None
    return float(match[1]) if match else None


def _layer_name(text: object) -> str | None:
    meaning = parse_layer_name(text) if isinstance(text, str) else None
    return meaning.layer if meaning is not None else None


def _layer_of_tags(tags: Mapping[str, Any]) -> tuple[str | None, Properties]:
    for key, rules in _KEYS.items():
        value = tags.get(key)
        if isinstance(value, str):
            found = rules.get(value.strip().lower().replace(" ", "_"))
            if found is not None:
                return found[0], dict(found[1])
    return None, {}


def _feature_label(layer: str, defaults: Properties, tags: Mapping[str, Any]) -> FeatureLabel:
    properties: Properties = {}
    clipped = unread = 0
    for name, parameter in LAYERS[layer].parameters.items():
        value = next((tags[tag] for tag in _ALIASES.get(name, (name,)) if tag in tags), None)
        number = parse_number(value)
        if parameter.kind is str and isinstance(value, str) and value in parameter.choices:
            properties[name] = value
        elif parameter.kind is not str and number is not None:
            inside = min(max(number, parameter.low), parameter.high)
            clipped += inside != number
            # 0.8999999762 of a float32 is 0.9.
            properties[name] = round(inside) if parameter.kind is int else float(f"{inside:.6g}")
        else:
            unread += value is not None
    guessed = frozenset(defaults.keys() - properties.keys())
    return FeatureLabel(layer, defaults | properties, guessed, clipped, unread)


def cluster_properties(
    features: Sequence[Properties], limit: int
) -> tuple[list[int], list[Properties], float]:
    """Cluster features by equal properties: the cluster of each, the clusters' properties, and the error.

    With more than `limit` clusters, numbers are binned on the finest geometric scale that suffices and
    averaged; the error is the largest relative one of a number.
    """
    steps = math.inf
    while True:
        keys = [
            tuple((name, _step(value, steps)) for name, value in sorted(feature.items()))
            for feature in features
        ]
        order = {key: index for index, key in enumerate(dict.fromkeys(keys))}
        if len(order) <= limit:
            break
        if steps < 1 / 64:  # too many different texts, signs or sets of properties
            return [0] * len(features), [{}], math.inf
        steps = 64.0 if steps == math.inf else steps / 2.0
    cluster_of = [order[key] for key in keys]
    members: list[list[Properties]] = [[] for _ in order]
    for index, feature in zip(cluster_of, features, strict=True):
        members[index].append(feature)
    properties = [_mean(cluster) for cluster in members]
    assigned = zip(cluster_of, features, strict=True)
    error = max((_error(feature, properties[index]) for index, feature in assigned), default=0.0)
    return cluster_of, properties, error


def _step(value: Value, steps: float) -> Value:
    """Return a key of a value's bin, `steps` per octave."""
    if isinstance(value, str) or value == 0 or steps == math.inf:
        return value
    return f"{'-' if value < 0 else '+'} {round(math.log2(abs(value)) * steps)}"


def _mean(members: Sequence[Properties]) -> Properties:
    """Return the properties of a cluster, with the mean of numbers that differ."""
    mean = dict(members[0])
    for name, first in mean.items():
        if not isinstance(first, str) and any(member[name] != first for member in members):
            value = math.fsum(float(member[name]) for member in members) / len(members)
            mean[name] = round(value) if isinstance(first, int) else float(f"{value:.4g}")
    return mean


def _error(features: Properties, clustered: Properties) -> float:
    numbers = (
        (clustered[name], value) for name, value in features.items() if value and not isinstance(value, str)
    )
    return max((abs(float(mean) / float(value) - 1.0) for mean, value in numbers), default=0.0)
