"""The frame of a sketch: what is refused, and which georeference outputs get."""

import pytest
from rasterio.crs import CRS

from sketchterrain.document.frame import georeference
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError

UTM = {"crs": "EPSG:25832", "east": 600000.0, "north": 5270000.0}


@pytest.mark.parametrize(
    ("frame", "problem"),
    [
        ({"crs": "EPSG:999999"}, "not a coordinate reference system"),
        ({"crs": "EPSG:4326"}, "is in degrees"),
        ({"crs": "EPSG:2263"}, "is in the unit"),
        ({"crs": "file.prj"}, "not a coordinate reference system"),
        ({"vertical": "EPSG:25832"}, "not a vertical datum"),
        ({"vertical": "EGM96"}, "frame.vertical = 'EGM96': expected a code"),
        ({"crs": "EPSG:25832+5773", "vertical": "EPSG:5773"}, "has a vertical datum"),
        ({"east": float("nan")}, "frame.east"),
        ({"origin": 1.0}, "origin"),
    ],
)
def test_invalid_frames_are_refused(frame, problem) -> None:
    with pytest.raises(InputError, match=problem):
        Sketch(frame=frame)


def test_outputs_have_the_georeference_of_the_frame_or_a_given_one() -> None:
    assert georeference(Sketch().frame) == (None, (0.0, 0.0))
    assert georeference(Sketch().frame, origin=(1.0, 2.0)) == (None, (1.0, 2.0))
    frame = Sketch(frame=UTM).frame
    assert georeference(frame) == ("EPSG:25832", (600000.0, 5270000.0))
    assert georeference(frame, "EPSG:25832") == ("EPSG:25832", (600000.0, 5270000.0))
    assert georeference(frame, "EPSG:25832", (1.0, 2.0)) == ("EPSG:25832", (1.0, 2.0))
    assert georeference(frame, "EPSG:25833") == ("EPSG:25833", (0.0, 0.0))


def test_a_vertical_datum_makes_the_crs_compound() -> None:
    frame = UTM | {"vertical": "EPSG:5773"}
    assert georeference(Sketch(frame=frame).frame)[0] == "EPSG:25832+5773"
    crs, _ = georeference(Sketch(frame=frame | {"crs": CRS.from_epsg(25832).to_wkt()}).frame)
    assert crs is not None
    assert CRS.from_wkt(crs) == CRS.from_user_input("EPSG:25832+5773")
