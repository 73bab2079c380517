"""Vector files of other programs, compressed ones, parts of a Shapefile, and addresses in files."""

import contextlib
import gzip
import http.server
import json
import threading

import pytest
import shapely

from sketchterrain.document.drapes import DrapedLayer
from sketchterrain.drape.drapes import Drapes
from sketchterrain.errors import InputError
from sketchterrain.importing.images import detect_kind
from sketchterrain.importing.vectors import sketch_from_vectors
from tests.geo_files import write_vectors

from .test_real_rivers import write_osm

FRAME = {"crs": "EPSG:32632", "east": 500_000.0, "north": 5_204_000.0}
POINTS = [(9.001, 47.001), (9.004, 47.005), (9.009, 47.006)]
GPX = (
    '<?xml version="1.0"?>\n<gpx version="1.1" creator="a" xmlns="http://www.topografix.com/GPX/1/1">'
    '<wpt lat="47.002" lon="9.002"><name>Hut</name></wpt><trk><name>Trail</name><trkseg>'
    + "".join(f'<trkpt lat="{y}" lon="{x}"><ele>900</ele></trkpt>' for x, y in POINTS)
    + "</trkseg></trk></gpx>"
)
KML = (
    '<kml xmlns="http://www.opengis.net/kml/2.2"><Document><name>a</name><Folder><name>trails</name><Placemark>'
    "<name>Trail</name><LineString><coordinates>"
    + " ".join(f"{x},{y},900" for x, y in POINTS)
    + "</coordinates></LineString></Placemark></Folder></Document></kml>"
)


def written(path):
    if path.suffix == ".gz":
        nodes = dict(enumerate(POINTS, start=1))
        plain = write_osm(path.with_suffix(""), nodes, [([1, 2, 3], {"highway": "path", "name": "Trail"})])
        path.write_bytes(gzip.compress(plain.read_bytes()))
    elif path.suffix == ".dxf":
        lines = [shapely.LineString([(0, 0), (300, 400), (500, 900)])]
        write_vectors(path, lines, {"Layer": ["path"]}, crs="EPSG:32632")
    else:
        path.write_text(GPX if path.suffix == ".gpx" else KML)
    return path


@pytest.mark.parametrize("name", ["a.gpx", "a.kml", "a.osm.gz", "a.dxf"])
def test_trails_of_other_formats_are_traced_and_draped(tmp_path, name) -> None:
    path = written(tmp_path / name)
    assert detect_kind(path) == "vectors"
    sketch = sketch_from_vectors(path, size_px=16).sketch
    (trail,) = sketch.vectors["path"].shapes()
    assert len(trail.coords) == 3
    assert sketch.vectors["path"].properties([0])[0].get("name") == (None if name == "a.dxf" else "Trail")
    drapes = Drapes.open(
        [DrapedLayer(str(path), {"table": "lines"} if "osm" in name else {})], FRAME, (900, 900), 900
    )
    assert drapes.problems == ()
    assert drapes.table(0).feature(0).geometry.geom_type in ("LineString", "MultiLineString")


@pytest.mark.parametrize("suffix", [".dbf", ".shx", ".prj"])
def test_parts_of_a_shapefile_name_it(tmp_path, suffix) -> None:
    lines = [shapely.LineString([(0, 0), (300, 400)])]
    path = write_vectors(tmp_path / "a.shp", lines, crs="EPSG:32632").with_suffix(suffix)
    for read in (detect_kind, sketch_from_vectors):
        with pytest.raises(InputError, match=rf"a\{suffix} is a part of a Shapefile: expected a\.shp"):
            read(path)
    (problem,) = Drapes.open([DrapedLayer(str(path))], FRAME, (900, 900), 900).problems
    assert problem.endswith("expected a.shp")


@pytest.fixture
def requests():
    """Return a local address, and the requests that a server there has got."""
    found = []

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            found.append(self.path)
            self.send_error(404)

        def log_message(self, *_):
            pass

    with http.server.HTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/a", found
        server.shutdown()
        thread.join()


def test_no_vector_file_makes_a_request(tmp_path, requests) -> None:
    address, found = requests
    line = {"type": "LineString", "coordinates": POINTS}
    feature = {"type": "Feature", "properties": {"waterway": "river"}, "geometry": line}
    links = {"link": {"href": address, "type": "proj4"}, "url": {"url": address}, "name": {"name": address}}
    texts = {
        f"{kind}.json": json.dumps(
            {"type": "FeatureCollection", "crs": {"type": kind, "properties": link}, "features": [feature]}
        )
        for kind, link in links.items()
    }
    texts["a.kml"] = KML.replace(
        "<Folder>", f"<NetworkLink><Link><href>{address}</href></Link></NetworkLink><Folder>"
    )
    nested = f"<OGRVRTLayer name='a'><SrcDataSource>{address}</SrcDataSource></OGRVRTLayer>"
    texts["b.kml"] = f"<OGRVRTDataSource><kml/>{nested}</OGRVRTDataSource>"
    texts["c.gpx"] = f"<gpx><OGRWFSDataSource><URL>{address}</URL></OGRWFSDataSource></gpx>"
    texts["d.vrt"] = f"<OGRVRTDataSource>{nested}</OGRVRTDataSource>"
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
        with contextlib.suppress(InputError):
            sketch_from_vectors(tmp_path / name, size_px=16)
        Drapes.open([DrapedLayer(str(tmp_path / name))], FRAME, (900, 900), 900)
    assert found == []
