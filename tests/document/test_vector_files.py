"""Vector layers as files: round trips, and damaged or wrong files."""

import resource

import numpy as np
import pytest
import shapely

from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch, save_sketch
from sketchterrain.errors import InputError
from sketchterrain.features.files import decode_vectors, encode_vectors
from sketchterrain.features.table import FeatureTable

from .conftest import refusal, same_vectors

FRAME = {"crs": "EPSG:32631", "east": 500_000.0, "north": 4_700_000.0}
HOLE = shapely.box(500, 500, 900, 800) - shapely.box(600, 600, 700, 700)


@pytest.fixture(scope="module")
def layer():
    """Return lines and areas with numbers, whole numbers and texts."""
    random = np.random.default_rng(1)
    lines = [shapely.LineString(random.uniform(0, 1000, (count, 2))) for count in (2, 5, 40)]
    columns = {
        "width": np.array([np.nan, 4.0, 5.5, 6.0, 7.0]),
        "directed": np.array([1, 0, 1, 0, 1]),
        "name": ("Inn", "", "ä\U0001f30a", 'a "b"', "x" * 300),
        "Name": np.array([1.0, 2.0, np.nan, 4.0, 5.0]),
    }
    shapes = np.array([*lines, shapely.box(0, 0, 50, 20), HOLE])
    labels, ids = [1, 2, 255, 1, 1], [7, 3, 2**31 - 1, 1, 2]
    return FeatureTable.from_shapes("river", shapes, ids=ids, labels=labels, columns=columns)


def test_layers_are_the_same_after_saving(layer, tmp_path) -> None:
    for frame in (FRAME, {"crs": "", "east": 0.0, "north": 0.0}):
        data = encode_vectors(layer, frame)
        assert data == encode_vectors(layer, frame)
        same_vectors(decode_vectors(data, "river", frame), layer)
    lake = FeatureTable.from_shapes("lake", np.array([HOLE]))
    sketch = Sketch(extent=1000.0, frame=FRAME, vectors={"river": layer, "lake": lake})
    save_sketch(sketch, tmp_path / "a")
    loaded = load_sketch(tmp_path / "a")
    same_vectors(loaded.vectors["river"], layer)
    same_vectors(loaded.vectors["lake"], lake)


def test_damaged_files_load_or_are_refused(layer) -> None:
    data = encode_vectors(layer, FRAME)
    random = np.random.default_rng(2)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    messages = []
    damaged = [data[:length] for length in random.integers(0, len(data), 100).tolist()]
    for place in random.integers(3, len(data), 300).tolist():
        length = int(random.integers(1, 64))
        filling = random.bytes(length) if place % 2 else b"\xff" * length
        damaged.append(data[:place] + filling + data[place + length * (place % 3 > 0) :])
    # Counts in the header, of features among others.
    values = (1 << 28, 1 << 34, 1 << 62)
    damaged += [
        data[:place] + values[place % 3].to_bytes(8, "little") + data[place + 8 :] for place in range(8, 160)
    ]
    for content in damaged:
        try:
            decode_vectors(content, "river", FRAME)
        except InputError as error:
            messages.append(str(error))
    assert len(messages) > 250
    assert all(message.isprintable() for message in messages)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak < 200_000  # KiB


def test_no_feature_of_a_short_file_is_lost_silently(layer) -> None:
    many = FeatureTable.from_shapes("river", np.repeat(layer.shapes()[1:2], 40))
    data = encode_vectors(many, FRAME)
    for length in range(len(data) - 400, len(data)):  # one of them ends between two features
        with pytest.raises(InputError, match="not a whole FlatGeobuf file"):
            decode_vectors(data[:length], "river", FRAME)


def test_wrong_files_in_a_sketch_are_refused_by_name(layer, tmp_path) -> None:
    save_sketch(Sketch(extent=1000.0, frame=FRAME, vectors={"river": layer}), tmp_path / "a")
    path = tmp_path / "a" / "river.fgb"
    points = FeatureTable.from_shapes("river", layer.shapes()[:1])
    whole = path.read_bytes()
    lines = encode_vectors(points, FRAME)
    for content, expected in (
        (b"", "river.fgb: expected a FlatGeobuf file"),
        (b"\x89PNG\r\n", "river.fgb: expected a FlatGeobuf file"),
        (whole[:500], "river.fgb: not a whole FlatGeobuf file"),
        (encode_vectors(layer, FRAME | {"crs": "EPSG:32632"}), "river.fgb: its CRS is EPSG:32632: expected"),
        (encode_vectors(layer, FRAME | {"crs": "EPSG:4326"}), "river.fgb: its CRS is EPSG:4326: expected"),
    ):
        path.write_bytes(content)
        assert expected in refusal(tmp_path / "a"), expected
    path.rename(tmp_path / "a" / "lake.fgb")
    (tmp_path / "a" / "lake.fgb").write_bytes(lines)
    assert "lake.fgb: lake feature 1: expected area" in refusal(tmp_path / "a")
