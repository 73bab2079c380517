"""Legends: colours of images and tags of vector data, assigned to layers."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, NamedTuple

import msgspec
import numpy as np

from sketchterrain.document.label_layers import to_oklab
from sketchterrain.document.toml_format import load_toml
from sketchterrain.errors import InputError, did_you_mean, format_value, one_line, prefix_errors
from sketchterrain.features.table import vector_parameters
from sketchterrain.io.files import wrap_read_errors
from sketchterrain.schema.layers import LANE_WIDTHS, LAYERS, PAINTED_LAYERS, VECTOR_LAYERS
from sketchterrain.schema.materials import MATERIALS
from sketchterrain.schema.parameters import Value

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
    with wrap_read_errors(path), path.open("rb") as stream:
        data = stream.read(_MAX_BYTES + 1)
    if len(data) > _MAX_BYTES:
        raise InputError(f"{location}: too large for a legend: expected at most {_MAX_BYTES >> 20} MiB")
    with prefix_errors(location):
        try:
            entries = msgspec.convert(load_toml(data), _LegendFile).colour
        except msgspec.ValidationError as error:
            raise InputError(f"{one_line(error)}: expected [[colour]] with rgb, layer, label") from None
        colours = []
        for number, entry in enumerate(entries, start=1):
            where = f"[[colour]] {number}"
            colours.append((_rgb(entry.rgb, where), _meaning(entry.layer, entry.label, where)))
        return Legend(_checked(colours, "[[colour]]"), tolerance)


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
    if layer not in PAINTED_LAYERS:
        names = (*PAINTED_LAYERS, NOTHING.layer, INK.layer)
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


_NO_LAYER = (
    *("nothing=#ffffff", "ink=#000000", "ink=#101010", "ink=#202020", "ink=#303030"),
    # OpenStreetMap's standard style (openstreetmap-carto, style/landcover.mss, style/water.mss).
    *("nothing=#f2efe9", "nothing=#cdebb0", "nothing=#ddecec"),
)


def _own() -> Legend:
    named = (f"{name}={code}" for name, layer in LAYERS.items() for code in layer.map_colours.split())
    layers = {LAYERS[name].colour: Meaning(name, 1) for name in PAINTED_LAYERS}
    return Legend({**layers, **Legend.parse((*named, *_NO_LAYER)).colours, **layers})


OWN_LEGEND: Final = _own()  # the program's colours, and those of common maps


def parse_layer_name(name: str, layers: Iterable[str] = PAINTED_LAYERS) -> Meaning | None:
    """Parse a name such as ``Mountains``, ``river 2`` or ``lake_3.png``; None if it is not of the layers."""
    match = _NAMED.fullmatch(name.strip())
    if match is None:
        return None
    word, label = match[1].lower(), int(match[2] or 1)
    known = {text: layer for layer in layers for text in (layer, LAYERS[layer].title.lower())}
    return Meaning(known[word], label) if word in known and 1 <= label <= 255 else None


Properties = dict[str, Value]


class _Rule(NamedTuple):
    """What a tag means: a layer, properties, and a label of its own in layers of vectors alone."""

    layer: str
    properties: Properties
    label: int = 1


@dataclass(frozen=True)
class FeatureLabel:
    """The layer of a feature and its properties."""

    layer: str
    properties: Properties
    guessed: frozenset[str]  # names of properties that follow from the kind of feature
    clipped: tuple[str, ...]  # values out of range, each with its feature
    unread: tuple[str, ...]  # invalid values
    label: int = 1  # of layers of vectors alone: 1, or that of its tag, whose guessed properties it has


def label_properties(layer: str, label: int) -> Properties:
    """Return the properties of the label that imports give to features of a tag."""
    return dict(LAYERS[layer].tags[label - 2].properties) if label > 1 else {}


def _rules(*keys: str) -> dict[str, _Rule]:
    return {
        value: _Rule(name, dict(rule.properties), 1 if layer.is_painted else number)
        for name, layer in LAYERS.items()
        for number, rule in enumerate(layer.tags, start=2)
        if rule.key in keys
        for value in rule.values.split()
    }


_VECTOR_TAGS = [rule for layer in LAYERS.values() if not layer.is_painted for rule in layer.tags]
BUILT_KEYS: Final = tuple(dict.fromkeys(rule.key for rule in _VECTOR_TAGS if rule.key != "natural"))
_WATERWAY, _GROUND, _BUILDINGS = map(_rules, ("waterway", "natural", "building"))
# Lines of OpenStreetMap's waterways run downstream.
_DIRECTED: dict[str, _Rule] = {
    value: rule._replace(properties={**rule.properties, "directed": 1}) for value, rule in _WATERWAY.items()
}
# OpenStreetMap's keys (wiki: Map features), `fclass` of Geofabrik's extracts, `featurecla` of Natural Earth,
# `type` of this program's own exports.
_KEYS: dict[str, dict[str, _Rule]] = {
    "waterway": _DIRECTED,
    "water": _rules("water"),
    "natural": _GROUND,
    "landuse": _GROUND,
    **{key: _rules(key) for key in BUILT_KEYS},
    "fclass": {"building": _BUILDINGS["yes"]} | _GROUND | _rules("highway", "railway") | _DIRECTED,
    "featurecla": _GROUND | _WATERWAY,
    "type": {layer: _Rule(layer, {}) for layer in LAYERS},
}
OSM_KEYS: Final = ("waterway", "water", "natural", "landuse", *BUILT_KEYS)
"""OpenStreetMap's keys whose values may assign a feature to a layer; those of what is built no point."""
_NOT_BUILT = re.compile(
    "no|construction|proposed|planned|abandoned|razed|demolished|dismantled|destroyed|removed|ruins"
)  # values of these keys
_NO_WAYS = {"area": "yes", "indoor": "yes", "abandoned": "yes", "proposed": "yes", "service": "parking_aisle"}
_NO = ("no", "false", "f", "0")  # as of bridge=no; F in Geofabrik's extracts
_SURFACES = {
    "asphalt": "paved concrete chipseal paving_stones sett cobblestone unhewn_cobblestone bricks metal",
    "gravel": "unpaved compacted fine_gravel pebblestone ballast",
    "soil": "ground dirt earth mud clay wood woodchips",
    "rock": "stone",
    "sand": "salt",
    "grass": "grass_paver",
}
_MATERIALS = {name: name for name in MATERIALS} | {
    value: name for name, values in _SURFACES.items() for value in values.split()
}
_LEVEL = 3.0  # m, of a building
_SOURCES = {source: name for name, layer in LAYERS.items() for source in layer.source_names.split()}
# Other names of properties: in our own exports strength is the height of hills and mountains.
_ALIASES = {
    "height": ("height", "strength"),
    "density": ("density", "strength"),
    "width": ("width", "est_width"),
}

RELEVANT_TAGS: Final = frozenset(
    {"layer", "name", "tags", "other_tags", "radius", "osm_id", "osm_way_id", *_KEYS, *_NO_WAYS}
    | {"bridge", "tunnel", "oneway", "junction", "tracks", "building:levels"}
    | {name for layer in LAYERS for name in vector_parameters(layer)}
    | {name for names in _ALIASES.values() for name in names}
)  # lower-case names of properties that are read

_HSTORE = re.compile(r'"((?:[^"\\]|\\.)*)"=>"((?:[^"\\]|\\.)*)"')
# OpenStreetMap's numbers (wiki: Map features/Units), with a comma too unless it may separate thousands.
_NUMBER = re.compile(
    r"\s*~?\s*([+-]?\d+(?:\.\d+|,\d\d?)?)\s*(?:(m|metres?|meters?|km|cm|mm|mi|nmi|in|inch(?:es)?|\")"
    r"|(ft|feet|foot|')(?:\s*(\d+(?:\.\d+)?)\s*(?:in|inch(?:es)?|\"))?)?\s*",
    re.I,
)
_UNITS = {"km": 1000.0, "cm": 0.01, "mm": 0.001, "mi": 1609.344, "nm": 1852.0, "in": 0.0254, '"': 0.0254}  # m
_FOOT, _INCH = 0.3048, 0.0254  # m
_OSM_TYPES = {"points": "node", "lines": "way", "multipolygons": "relation"}  # by GDAL's layer


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
    name = _layer_name(tags.get("layer"))
    if "landuse" in source.lower() and "fclass" in tags:  # residential is a road's too
        tags = {"landuse": tags["fclass"], **tags}
    rule = None if name else _rule_of_tags(tags)
    name = name or _layer_name(source) or _SOURCES.get(source.lower()) or layer
    rule = rule or (None if name is None else _Rule(name, {}))
    if rule is None or LAYERS[rule.layer].is_painted:
        return None if rule is None else _feature_label(rule, tags, source)
    if any(_NOT_BUILT.fullmatch(str(tags.get(key)).lower()) for key in BUILT_KEYS):
        return None
    if LAYERS[rule.layer].kind == "way":
        if any(tags.get(key) == value for key, value in _NO_WAYS.items()):
            return None
        return _feature_label(rule, _of_way(rule, tags), source)
    return _feature_label(rule, _of_building(tags) if LAYERS[rule.layer].kind == "pad" else tags, source)


def _of_way(rule: _Rule, tags: Mapping[str, Any]) -> dict[str, Any]:
    """Return OpenStreetMap's tags of a road, railway or path by the names of its properties."""
    found = dict(tags)
    if "structure" not in tags:
        for key in ("bridge", "tunnel"):
            if str(tags.get(key, "no")).lower() not in _NO:
                found["structure"] = key
    if any(key in tags for key in BUILT_KEYS):
        found.pop("level", None)  # floors of a building
    if "layer" in tags and _layer_name(tags["layer"]) is None:
        found["level"] = tags["layer"]
    if isinstance(tags.get("surface"), str):
        surface = re.split("[;:]", tags["surface"])[0].strip().lower()
        found["surface"] = _MATERIALS.get(surface, surface)
    if rule.layer == "railway" and "tracks" in tags:
        found["lanes"] = tags["tracks"]
    is_one_way = str(tags.get("oneway", "no")).lower() in ("yes", "true", "1", "-1")
    by_lanes = bool(rule.properties) and not rule.properties.keys() & {"lanes", "width"}
    if is_one_way and by_lanes and tags.get("junction") != "roundabout":
        found.setdefault("lanes", 1)
    lanes = parse_number(found.get("lanes"))
    if lanes and lanes > 0.0 and lanes % 1.0:  # 1.5: cars pass each other slowly
        found = {"width": lanes * LANE_WIDTHS[rule.layer], **found, "lanes": max(math.floor(lanes), 1)}
    if "lanes" in found and "width" in rule.properties and not found.keys() & set(_ALIASES["width"]):
        found["width"] = 0.0  # by lanes
    return found


def _of_building(tags: Mapping[str, Any]) -> dict[str, Any]:
    """Return OpenStreetMap's tags of a building by the names of a pad's properties."""
    found = dict(tags)
    if parse_number(tags.get("building")) is None:
        found.pop("building", None)
        height, levels = (parse_number(tags.get(key)) for key in ("height", "building:levels"))
        if "height" in tags or "building:levels" in tags:
            known = height or _LEVEL * (levels or 0.0)
            found["building"] = known or tags.get("height", tags.get("building:levels"))
    return found


def parse_number(value: object) -> float | None:
    """Return a number, also from a text such as ``12.5 m``, ``~20`` or ``12'6"``, in metres, or None."""
    if isinstance(value, bool):
        return None
    if isinstance(value, int | float):
        return float(value) if abs(value) < 1e300 and math.isfinite(value) else None
    match = _NUMBER.fullmatch(value) if isinstance(value, str) and len(value) < 40 else None
    if match is None:
        return None
    number = float(match[1].replace(",", "."))
    if match[3]:
        return number * _FOOT + math.copysign(float(match[4] or 0.0), number) * _INCH
    return number * _UNITS.get((match[2] or "m").lower()[:2], 1.0)


def _layer_name(text: object) -> str | None:
    meaning = parse_layer_name(text, LAYERS) if isinstance(text, str) else None
    return meaning.layer if meaning is not None else None


def _rule_of_tags(tags: Mapping[str, Any]) -> _Rule | None:
    for key, rules in _KEYS.items():
        value = tags.get(key)
        if isinstance(value, str):
            any_other = rules["yes"] if key == "building" and parse_number(value) is None else None
            found = rules.get(value.strip().lower().replace(" ", "_"), any_other)
            if found is not None:
                return found
    return None


def _tag_text(value: object, tags: Mapping[str, Any], source: str) -> str:
    """Return a feature's name and the tag of a value."""
    title = format_value(tags["name"]) if "name" in tags else "feature"
    for key, kind in (("osm_id", _OSM_TYPES.get(source, "feature")), ("osm_way_id", "way")):
        title = f"{kind} {one_line(tags[key])}" if key in tags else title
    return f"{title} {next(tag for tag, each in tags.items() if each is value)}={format_value(value)}"


def _feature_label(rule: _Rule, tags: Mapping[str, Any], source: str) -> FeatureLabel:
    layer, defaults, properties = rule.layer, rule.properties, Properties()
    clipped, unread = list[str](), list[str]()
    for name, parameter in vector_parameters(layer).items():
        value = next((tags[tag] for tag in _ALIASES.get(name, (name,)) if tag in tags), None)
        if value is None:
            continue
        number = parse_number(value)
        is_number = parameter.kind is float or (parameter.kind is int and (number or 0.0) % 1.0 == 0.0)
        if parameter.kind is str and isinstance(value, str) and value in parameter.choices:
            properties[name] = value
        elif is_number and number is not None:
            inside = min(max(number, parameter.low), parameter.high)
            clipped += [_tag_text(value, tags, source)] if inside != number else []
            # 0.8999999762 of a float32 is 0.9.
            properties[name] = round(inside) if parameter.kind is int else float(f"{inside:.6g}")
        else:
            unread.append(_tag_text(value, tags, source))
    if layer in VECTOR_LAYERS and isinstance(tags.get("name"), str):
        properties["name"] = tags["name"]
    guessed = frozenset(defaults.keys() - properties.keys())
    return FeatureLabel(layer, defaults | properties, guessed, tuple(clipped), tuple(unread), rule.label)


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
