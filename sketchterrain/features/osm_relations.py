"""Areas of OpenStreetMap that refer to ways which are not in the file, as at the edge of every extract.

GDAL leaves them out without a word. Formats: OSM XML, and PBF (wiki.openstreetmap.org/wiki/PBF_Format).
"""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry
from shapely.ops import substring

from sketchterrain.array_types import Int64Array
from sketchterrain.errors import first_few, format_value

_FIELDS: Final = {"node": 2, "way": 3, "relation": 4}  # of a group in PBF
_MAX_BLOCK: Final = 1 << 25  # bytes, of PBF
_REACH: Final = 0.02  # of the extract's longer side, from its edge to the end of an outline
_NANO: Final = 1e-9  # degrees, the unit of PBF


class _Element(NamedTuple):
    kind: str  # of `_FIELDS`, or bounds
    id: Any  # of nodes an array
    tags: dict[str, str]
    members: Any  # nodes: degrees (n, 2); ways: nodes; relations: ways, and whether each is an inner one


class IncompleteAreas(NamedTuple):
    """Relations of areas that are incomplete, what closes of them (degrees) with its tags, and notes."""

    ids: set[int]
    shapes: list[BaseGeometry]
    tags: list[dict[str, str]]
    notes: list[str]


def incomplete_areas(path: Path, keys: Collection[str], inside: Sequence[float] | None) -> IncompleteAreas:
    """Return the incomplete areas near a rectangle (degrees) of relations with some keys; by default of all.

    Rings that close are kept. Open outlines that end at the extract's edge are closed along it. Raise
    ValueError if the file is damaged.
    """
    box, relations = None, list[_Element]()
    for each in _elements(path, "relation"):
        is_area = each.tags.get("type") in ("multipolygon", "boundary")
        box = each.members if each.kind == "bounds" else box
        relations += [each] if is_area and (not keys or not each.tags.keys().isdisjoint(keys)) else []
    used = {way for relation in relations for way, _ in relation.members}
    ways = {each.id: each.members for each in _elements(path, "way") if each.id in used} if used else {}
    needed = {node for refs in ways.values() for node in refs}
    places, corners = dict[int, list[float]](), list[Any]()  # degrees
    for each in _elements(path, "node") if needed else ():
        rows = [row for row, number in enumerate(each.id.tolist()) if number in needed]
        places |= dict(zip(each.id[rows].tolist(), each.members[rows].tolist(), strict=True))
        corners += [each.members.min(axis=0), each.members.max(axis=0)]
    extract = shapely.box(*(box or [*np.min(corners, axis=0), *np.max(corners, axis=0)])) if places else None
    areas, closed, dropped = IncompleteAreas(set(), [], [], []), list[str](), list[str]()
    for relation in relations:
        known = [(ways[way], is_inner) for way, is_inner in relation.members if ways.get(way)]
        missing = [str(way) for way, _ in relation.members if not ways.get(way)]
        ends = Counter(node for refs, _ in known for node in (refs[0], refs[-1]))
        has_nodes = all(places.keys() >= set(refs) for refs, _ in known)
        is_whole = has_nodes and not missing
        if (is_whole and not any(count % 2 for count in ends.values())) or extract is None:
            continue
        parts: tuple[list[BaseGeometry], list[BaseGeometry]] = ([], [])
        for refs, is_inner in known:
            line = [places[node] for node in refs if node in places]
            parts[is_inner].extend([shapely.LineString(line)] if len(line) > 1 else [])
        around = shapely.GeometryCollection(parts[False] + parts[True]).envelope
        if around.is_empty or (inside and not around.intersects(shapely.box(*inside))):
            continue  # it is elsewhere
        island, *inner = _filled(parts[True], extract, shapely.Polygon())
        shape, *outer = _filled(parts[False], extract, island)
        is_closed, is_open = np.logical_or(inner, outer).tolist()
        if is_whole and not is_closed and not is_open:
            continue  # inner lines meet the outline
        name = f" {format_value(relation.tags['name'])}" if "name" in relation.tags else ""
        title = f"relation {relation.id}{name}{' without ways ' if missing else ''}{first_few(missing, 3)}"
        closed += [title] if is_closed else []
        dropped += [title] if is_open or not is_closed else []
        areas.ids.add(relation.id)
        areas.shapes.append(shape.difference(island))
        areas.tags.append({**relation.tags, "osm_id": str(relation.id)})
    for what, titles in (("closed at the edge of the extract", closed), ("open outlines left out", dropped)):
        found = f"incomplete areas, {what} ({len(titles)}): {first_few(titles, 3, '; ')}"
        areas.notes.extend([found] if titles else [])
    return areas


def _filled(
    lines: list[BaseGeometry], extract: BaseGeometry, island: BaseGeometry
) -> tuple[BaseGeometry, bool, bool]:
    """Return the inside of lines, whether some of it is closed along the extract's edge, or some is open."""
    rings, *rest = shapely.polygonize_full(lines)
    filled, edge = shapely.union_all(shapely.get_parts(rings)), extract.exterior
    part, crosses, is_open = shapely.Polygon(), False, False
    reach = _REACH * np.ptp(shapely.get_coordinates(extract), axis=0).max()
    for chain in shapely.get_parts(shapely.line_merge(shapely.union_all(rest[:2]))):
        ends = [shapely.Point(at) for at in (chain.coords[:1] + chain.coords[-1:])]
        if not all(end.distance(edge) <= reach or not end.within(extract) for end in ends):
            is_open = True
            continue
        first, *last = (edge.interpolate(edge.project(end)) for end in ends)
        inside = shapely.LineString([first, *chain.coords, *last]).intersection(extract)
        for piece in shapely.get_parts(shapely.line_merge(inside)):
            if piece.geom_type == "LineString" and not piece.is_closed:
                start, end = (edge.project(shapely.Point(piece.coords[at])) for at in (0, -1))
                side = shapely.Polygon([*piece.coords, *substring(edge, end, start).coords])
                part, crosses = part.symmetric_difference(shapely.make_valid(side)), True
    if not crosses:
        return filled, False, is_open
    # Lines across the extract tell its two sides apart: water is where islands are, else the smaller one.
    sides = [each for each in (part, extract.difference(part)) if each.area > 1e-9 * extract.area]
    part = max(sides, key=lambda side: (side.intersection(island).area, -side.area))
    return filled.union(part), True, is_open


def _elements(path: Path, kind: str) -> Iterator[_Element]:
    """Yield a file's elements of a kind, with relations its bounds; raise ValueError if it is damaged."""
    with path.open("rb") as stream:
        read = _pbf_elements if stream.peek(1)[:1] == b"\0" else _xml_elements
        try:
            yield from (each for each in read(stream, kind) if kind in (each.kind, "relation"))
        except (LookupError, TypeError, AttributeError, zlib.error, ET.ParseError) as error:
            raise ValueError(f"damaged relations: {error}") from None


def _xml_elements(stream: BinaryIO, kind: str) -> Iterator[_Element]:
    for _, each in ET.iterparse(stream):  # noqa: S314 # GDAL has read it, and expat limits entities
        given, number = each.attrib, int(each.attrib.get("id", 0))
        if each.tag == "bounds":
            box = [float(given[name]) for name in ("minlon", "minlat", "maxlon", "maxlat")]
            yield _Element("bounds", 0, {}, box)
        elif each.tag == kind == "node":
            place = np.array([[float(given["lon"]), float(given["lat"])]])
            yield _Element(kind, np.array([number]), {}, place)
        elif each.tag == kind:
            tags = {tag.attrib["k"]: tag.attrib["v"] for tag in each.iter("tag")}
            members: list[Any] = [int(node.attrib["ref"]) for node in each.iter("nd")]
            parts = [part.attrib for part in each.iter("member") if part.attrib["type"] == "way"]
            members += [(int(part["ref"]), part["role"] == "inner") for part in parts]
            yield _Element(kind, number, tags, members)
        if each.tag in _FIELDS:
            each.clear()


def _pbf_elements(stream: BinaryIO, kind: str) -> Iterator[_Element]:
    while size := stream.read(4):
        header = dict(_fields(stream.read(int.from_bytes(size, "big"))))
        blob = dict(_fields(stream.read(header[3])))
        data = blob[1] if 1 in blob else zlib.decompressobj().decompress(blob[3], _MAX_BLOCK)
        block = list(_fields(data))
        if header[1] == b"OSMHeader":
            box = {field: _NANO * _signed(value) for field, value in _fields(dict(block).get(1, b""))}
            if box:
                yield _Element("bounds", 0, {}, [box[field] for field in (1, 4, 2, 3)])
            continue
        values, texts = {17: 100, 19: 0, 20: 0, **dict(block)}, list[bytes]()
        for field, content in (each for at, group in block if at == 2 for each in _fields(group)):
            if kind == "node" and field in (1, 2):  # one, or many by their differences
                node = dict(_fields(content))
                integers: Any = _numbers if field == 2 else np.atleast_1d
                ids, y, x = (np.cumsum(_signed(integers(node[each]))) for each in (1, 8, 9))
                shift = [value - (value >> 63 << 64) for value in (values[20], values[19])]
                places = np.stack([x, y], axis=-1) * values[17]
                yield _Element(kind, ids, {}, _NANO * (places + shift))
            elif field == _FIELDS[kind]:
                texts = texts or [text for _, text in _fields(values[1])]
                yield _pbf_element(kind, dict(_fields(content)), texts)


def _pbf_element(kind: str, fields: dict[int, Any], texts: list[bytes]) -> _Element:
    names, values, refs, ids, types = (_numbers(fields.get(each, b"")) for each in (2, 3, 8, 9, 10))
    pairs = zip(names.tolist(), values.tolist(), strict=True)
    tags = {texts[name].decode(): texts[value].decode(errors="replace") for name, value in pairs}
    members: list[Any] = np.cumsum(_signed(refs)).tolist()
    if kind == "relation":  # the same field has roles
        parts = zip(np.cumsum(_signed(ids)).tolist(), refs.tolist(), types.tolist(), strict=True)
        members = [(way, texts[role] == b"inner") for way, role, each in parts if each == 1]
    return _Element(kind, fields[1], tags, members)


def _fields(data: bytes) -> Iterator[tuple[int, Any]]:
    """Yield the fields of a protobuf message by number: integers and bytes."""
    at = 0
    while at < len(data):
        key, at = _number(data, at)
        size, at = _number(data, at) if key & 7 in (0, 2) else (8 if key & 7 == 1 else 4, at)
        start, at = at, at + size if key & 7 else at
        yield key >> 3, data[start:at] if key & 7 else size


def _number(data: bytes, at: int) -> tuple[Any, int]:
    value = shift = 0
    while data[at] > 127:
        value, shift, at = value | (data[at] & 127) << shift, shift + 7, at + 1
    return value | data[at] << shift, at + 1


def _numbers(data: bytes) -> Int64Array:
    """Return the integers of a packed field."""
    octets = np.frombuffer(data, np.uint8)
    start = np.flatnonzero(np.append(True, octets[:-1] < 128)) if data else np.zeros(0, np.int64)
    place = np.arange(len(octets)) - np.repeat(start, np.diff(np.append(start, len(octets))))
    return np.add.reduceat((octets & 127).astype(np.int64) << 7 * place, start) if data else start


def _signed(value: Any) -> Any:
    """Return integers of the zigzag encoding."""
    return value >> 1 ^ -(value & 1)
