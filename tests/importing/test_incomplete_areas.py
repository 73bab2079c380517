"""Areas of OpenStreetMap's relations of which an extract lacks ways or nodes."""

from __future__ import annotations

import zlib

import pytest
import shapely

from sketchterrain.document.drapes import DrapedLayer
from sketchterrain.drape.drapes import Drapes
from sketchterrain.features.files import reproject
from sketchterrain.features.osm_relations import incomplete_areas
from sketchterrain.importing.vectors import sketch_from_vectors
from sketchterrain.io.crs import parse_crs

# A lake of 1200 × 1000 m with an island, beside the west edge of the extract at 9.000°.
NODES = {
    1: (8.990, 47.000),
    2: (9.010, 47.000),
    3: (9.010, 47.010),
    4: (8.990, 47.010),
    5: (9.004, 47.004),
    6: (9.006, 47.004),
    7: (9.006, 47.006),
    8: (9.000, 46.99),
    9: (9.03, 47.03),
}
WAYS = {11: [1, 2], 12: [2, 3], 13: [3, 4], 15: [5, 6, 7, 5], 16: [8, 9]}
EDGE = (9.0, 46.99, 9.03, 47.03)
LAKE = {"type": "multipolygon", "natural": "water", "name": "Lago"}


def xml(relations, ways, nodes, box):
    west, south, east, north = box
    text = [f'<osm version="0.6"><bounds minlon="{west}" minlat="{south}" maxlon="{east}" maxlat="{north}"/>']
    text = text if any(box) else ['<osm version="0.6">']
    text += [f'<node id="{number}" lat="{lat}" lon="{lon}"/>' for number, (lon, lat) in nodes.items()]
    for number, refs in ways.items():
        inside = "".join(f'<nd ref="{ref}"/>' for ref in refs)
        tags = '<tag k="waterway" v="river"/>' if number == 16 else ""
        text.append(f'<way id="{number}">{inside}{tags}</way>')
    for number, (members, tags) in relations.items():
        inside = "".join(f'<member type="way" ref="{way}" role="{role}"/>' for way, role in members)
        inside += "".join(f'<tag k="{key}" v="{value}"/>' for key, value in tags.items())
        text.append(f'<relation id="{number}">{inside}</relation>')
    return "\n".join([*text, "</osm>"]).encode()


def varint(value):
    found = b""
    while value > 127:
        found, value = found + bytes([value & 127 | 128]), value >> 7
    return found + bytes([value])


def field(number, value):
    if isinstance(value, int):
        return varint(number << 3) + varint(value)
    return varint(number << 3 | 2) + varint(len(value)) + value


def packed(number, values):
    return field(number, b"".join(map(varint, values)))


def deltas(number, values):
    steps = [value - before for value, before in zip(values, [0, *values[:-1]], strict=True)]
    return packed(number, [step << 1 if step >= 0 else (-step << 1) - 1 for step in steps])


def pbf(relations, ways, nodes, box):
    texts = [b""]

    def at(text):
        texts.extend([text.encode()] if text.encode() not in texts else [])
        return texts.index(text.encode())

    def keyed(tags):
        return packed(2, map(at, tags)) + packed(3, map(at, tags.values())) if tags else b""

    unit = 1e-7
    rows = [(number, round(lat / unit), round(lon / unit)) for number, (lon, lat) in nodes.items()]
    *others, last = rows
    dense = b"".join(map(deltas, (1, 8, 9), zip(*others, strict=True)))
    groups = [field(2, dense), field(1, b"".join(map(field, (1, 8, 9), (2 * each for each in last))))]
    groups += [
        b"".join(
            field(
                3, field(1, number) + keyed({"waterway": "river"} if number == 16 else {}) + deltas(8, refs)
            )
            for number, refs in ways.items()
        )
    ]
    rows = []
    for number, (members, tags) in relations.items():
        roles = packed(8, [at(role) for _, role in members])
        refs = deltas(9, [way for way, _ in members]) + packed(10, [1] * len(members))
        rows.append(field(4, field(1, number) + keyed(tags) + roles + refs))
    groups.append(b"".join(rows))

    def blob(kind, data):
        content = field(2, len(data)) + field(3, zlib.compress(data))
        header = field(1, kind) + field(3, len(content))
        return len(header).to_bytes(4, "big") + header + content

    west, south, east, north = (round(each * 1e9) << 1 for each in box)
    bounds = field(1, west) + field(2, east) + field(3, north) + field(4, south)
    head = field(1, bounds) + field(4, b"OsmSchema-V0.6") + field(4, b"DenseNodes")
    table = field(1, b"".join(field(1, text) for text in texts))
    return blob(b"OSMHeader", head) + b"".join(blob(b"OSMData", table + field(2, group)) for group in groups)


def lake_of(tmp_path, relations, *, ways, nodes=NODES, box=EDGE, write=xml, layer="lake"):
    """Return the traced areas in degrees² of latitude and longitude, and the notes."""
    path = tmp_path / ("a.osm" if write is xml else "a.osm.pbf")
    path.write_bytes(write(relations, ways, nodes, box))
    traced = sketch_from_vectors(path, size_px=16)
    frame = traced.sketch.frame
    corner, crs = (frame["east"], frame["north"]), parse_crs(frame["crs"])
    areas = [
        shapely.transform(each, lambda at: reproject(at + corner, crs, parse_crs("OGC:CRS84")))
        for each in traced.sketch.vectors[layer].shapes()
    ]
    return areas, " | ".join(traced.notes)


OUTER = [(11, "outer"), (12, "outer"), (13, "outer"), (14, "outer"), (15, "inner")]
ISLAND = 0.5 * 0.002**2
CLOSED = "incomplete areas, closed at the edge of the extract (1): relation 77 'Lago' without ways 14"
LEFT_OUT = "incomplete areas, open outlines left out (1): relation 77 'Lago' without ways 14"


@pytest.mark.parametrize("write", [xml, pytest.param(pbf, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("relations", "change", "area", "note"),
    [
        pytest.param({77: (OUTER, LAKE)}, {}, 1e-4 - ISLAND, CLOSED, id="ends beyond the edge"),
        pytest.param(
            {77: (OUTER, LAKE)},
            {"nodes": {**NODES, 1: (9.0002, 47.0), 4: (9.0001, 47.01)}},
            *(1e-4 - ISLAND, CLOSED),
            id="ends before the edge",
        ),
        pytest.param(
            {77: ([*OUTER[:3], OUTER[4]], LAKE)},
            {
                "nodes": {each: at for each, at in NODES.items() if each != 4},
                "box": (8.99, 46.99, 9.03, 47.03),
            },
            *(0.0, "incomplete areas, open outlines left out (1): relation 77 'Lago'"),
            id="a node is missing in the middle",
        ),
        pytest.param(
            {77: (OUTER, LAKE)}, {"box": (8.95, 46.95, 9.05, 47.05)}, 0.0, LEFT_OUT, id="a gap in the middle"
        ),
        pytest.param(
            {77: ([*OUTER, (17, "outer")], LAKE)},
            {
                "box": (8.95, 46.95, 9.05, 47.05),
                "ways": {**WAYS, 17: [8, 9, 10, 8]},
                "nodes": {**NODES, 10: (9.03, 46.99)},
            },
            *(0.5 * 0.03 * 0.04, LEFT_OUT),
            id="other rings close",
        ),
        pytest.param(
            {77: ([(12, "outer"), (14, "outer")], LAKE)},
            {"nodes": {**NODES, 2: (9.01, 46.98), 3: (9.01, 47.04)}},
            *(0.01 * 0.04, CLOSED),
            id="the smaller side",
        ),
        pytest.param(
            {77: ([(12, "outer"), (14, "outer"), (15, "inner")], LAKE)},
            {"nodes": {**NODES, 2: (9.003, 46.98), 3: (9.003, 47.04)}},
            *(0.027 * 0.04 - ISLAND, CLOSED),
            id="the side with islands",
        ),
        pytest.param(
            {77: (OUTER[:3], LAKE)}, {"box": (0, 0, 0, 0)}, 2e-4, "closed at the edge", id="no bounds"
        ),
    ],
)
def test_incomplete_lakes_are_closed_or_named(tmp_path, write, relations, change, area, note) -> None:
    if write is xml or change.get("box") != (0, 0, 0, 0):
        areas, notes = lake_of(tmp_path, relations, write=write, **{"ways": WAYS, **change})
        assert sum(each.area for each in areas) == pytest.approx(area, rel=1e-3)
        assert note in notes, notes


def test_land_use_is_closed_and_complete_areas_are_unchanged(tmp_path) -> None:
    forest = {"type": "multipolygon", "landuse": "forest"}
    areas, notes = lake_of(tmp_path, {77: (OUTER, forest)}, ways=WAYS, layer="landuse")
    assert sum(each.area for each in areas) == pytest.approx(1e-4 - ISLAND, rel=1e-3)
    assert "closed at the edge of the extract (1): relation 77 without ways 14" in notes
    ways = {**WAYS, 14: [4, 1]}
    areas, notes = lake_of(tmp_path, {77: (OUTER, LAKE)}, ways=ways)
    assert sum(each.area for each in areas) == pytest.approx(2e-4 - ISLAND, rel=1e-3)
    assert "incomplete" not in notes


def test_areas_elsewhere_are_not_mentioned(tmp_path) -> None:
    (tmp_path / "a.osm").write_bytes(xml({77: (OUTER, LAKE)}, WAYS, NODES, EDGE))
    for inside, count in (((9.0, 47.0, 9.01, 47.01), 1), ((9.02, 47.02, 9.03, 47.03), 0)):
        found = incomplete_areas(tmp_path / "a.osm", ("natural",), inside)
        assert len(found.shapes) == len(found.notes) == count


def test_draped_layers_name_incomplete_areas(tmp_path) -> None:
    (tmp_path / "a.osm").write_bytes(xml({77: (OUTER, LAKE)}, WAYS, NODES, EDGE))
    frame = {"crs": "EPSG:32632", "east": 500_000.0, "north": 5_204_000.0}
    layers = [DrapedLayer(str(tmp_path / "a.osm"), {"table": table}) for table in ("multipolygons", "lines")]
    notes = Drapes.open(layers, frame, (900.0, 900.0), 900.0).notes
    assert "a: areas with missing ways are absent or wrong: relations 77" in notes
    assert sum("relations" in note for note in notes) == 1
