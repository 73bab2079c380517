"""Rivers of OpenStreetMap through a sketch, its files and a GeoPackage, against the original lines."""

from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely

from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch, save_sketch
from sketchterrain.export.vectors import Origin, geopackage, sketch_layer
from sketchterrain.features.table import FeatureTable
from sketchterrain.importing.images import detect_kind
from sketchterrain.importing.vector_files import reproject
from sketchterrain.importing.vectors import sketch_from_vectors
from sketchterrain.io.crs import parse_crs

RIVERS = Path(__file__).parent.parent / "data" / "openstreetmap" / "valira_d_orient.osm"
CENTIMETRE = 0.01


def original_waters(path, crs):
    """Return the waters of a file as the driver reads them, projected: geometries by layer."""
    found = {}
    for layer, where in (("lines", "waterway IS NOT NULL"), ("multipolygons", "natural = 'water'")):
        _, _, wkb, _ = pyogrio.raw.read(path, layer=layer, where=where)
        degrees = shapely.get_parts(shapely.from_wkb(wkb))
        found[layer] = shapely.transform(
            degrees, lambda at: reproject(at, parse_crs("EPSG:4326"), parse_crs(crs))
        )
    return found


def exported_layer(sketch, name, folder):
    """Return the geometries and fields of vectors after save, load and export."""
    save_sketch(sketch, folder / "a.sketch")
    loaded = load_sketch(folder / "a.sketch")
    frame = loaded.frame
    with geopackage(folder / f"{name}.gpkg", frame["crs"]) as file:
        file.add(sketch_layer(loaded.vectors[name], Origin(frame["east"], frame["north"])))
    meta, _, wkb, fields = pyogrio.raw.read(folder / f"{name}.gpkg")
    assert meta["crs"] == frame["crs"]
    return shapely.from_wkb(wkb), dict(zip(meta["fields"], fields, strict=True))


def farthest(a, b):
    """Return the greatest distance (m) between two densified lines, both ways."""
    a, b = (shapely.segmentize(each, 5.0) for each in (a, b))
    shapely.prepare([a, b])
    return max(
        float(shapely.distance(shapely.points(shapely.get_coordinates(one)), other).max())
        for one, other in ((a, b), (b, a))
    )


def test_imported_rivers_are_exported_at_their_place(tmp_path) -> None:
    assert detect_kind(RIVERS) == "vectors"
    traced = sketch_from_vectors(RIVERS, size_px=64)
    sketch = traced.sketch
    assert traced.notes[0] == "used: 18 lines as river, 1 area as river, 7 areas as lake"
    assert not any(image.any() for image in sketch.layers.values())
    original = original_waters(RIVERS, sketch.frame["crs"])

    rivers, fields = exported_layer(sketch, "river", tmp_path)
    assert len(rivers) == len(original["lines"]) == 19
    for river, line, name in zip(rivers, original["lines"], fields["name"], strict=True):
        outline = river.exterior if river.geom_type == "Polygon" else river
        assert farthest(outline, line) < CENTIMETRE, name
        if river.geom_type == "LineString":  # downstream
            assert outline.coords[0] == pytest.approx(line.coords[0], abs=CENTIMETRE), name
    assert {"Valira d'Orient", "Riu d'Incles", "Riu de Juclar"} <= set(fields["name"])
    directed = [1 if river.geom_type == "LineString" else None for river in rivers]
    assert [None if value != value else int(value) for value in fields["directed"].tolist()] == directed

    lakes, _ = exported_layer(sketch, "lake", tmp_path)
    for lake, area in zip(lakes, original["multipolygons"], strict=True):
        assert farthest(lake.exterior, area.exterior) < CENTIMETRE

    # Lines with a common node have a common vertex, bit for bit.
    at, of = shapely.get_coordinates(original["lines"], return_index=True)
    mine, own = shapely.get_coordinates(sketch.vectors["river"].shapes(), return_index=True)

    def shared(points, lines):
        owners = {}
        for point, line in zip(map(tuple, points.tolist()), lines.tolist(), strict=True):
            owners.setdefault(point, set()).add(line)
        return sorted(tuple(sorted(each)) for each in owners.values() if len(each) > 1)

    assert shared(mine, own) == shared(at, of) != []


def test_coordinates_of_large_sketches_keep_centimetres(tmp_path) -> None:
    random = np.random.default_rng(5)
    for extent in (100.0, 10_000.0, 100_000.0):
        at = random.uniform(0, extent, (200, 2))
        layer = FeatureTable.from_shapes("river", np.array([shapely.LineString(at)]))
        frame = {"crs": "EPSG:32631", "east": 834_567.123, "north": 9_312_345.678}
        sketch = Sketch(extent=extent, frame=frame, vectors={"river": layer})
        folder = tmp_path / f"{extent:g}"
        folder.mkdir()
        (line,), _ = exported_layer(sketch, "river", folder)
        expected = np.add(at, (frame["east"], frame["north"]))
        np.testing.assert_allclose(line.coords, expected, rtol=0, atol=0.001)


def write_osm(path, nodes, ways):
    text = ['<osm version="0.6">']
    text += [f'<node id="{number}" lat="{lat}" lon="{lon}"/>' for number, (lon, lat) in nodes.items()]
    for number, (refs, tags) in enumerate(ways, start=1):
        inside = "".join(f'<nd ref="{ref}"/>' for ref in refs)
        inside += "".join(f'<tag k="{key}" v="{value}"/>' for key, value in tags.items())
        text.append(f'<way id="{number}">{inside}</way>')
    path.write_text("\n".join([*text, "</osm>"]))
    return path
