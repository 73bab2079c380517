"""Heights, normals and weights as images and GeoTIFF, read by Pillow and GDAL; weights as bytes."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import rasterio
from hypothesis import given, settings
from hypothesis import strategies as some
from PIL import Image

import sketchterrain as st
from sketchterrain.errors import InputError
from sketchterrain.export import (
    quantised_weights,
    write_height_png,
    write_height_tif,
    write_materials,
    write_normals,
)
from sketchterrain.terrain import Raster

CHANNELS = ("red", "green", "blue", "alpha")
PIXEL_SCALE, TIE_POINT, GEO_KEYS = 33550, 33922, 34735
RASTER_TYPE_KEY, PIXEL_IS_POINT = 1025, 2


def read(path: Path) -> npt.NDArray[np.generic]:
    with Image.open(path) as image:
        return np.asarray(image)


def decoded(tmp_path: Path, raster: Raster) -> tuple[npt.NDArray[np.float64], dict[str, Any]]:
    image, meaning = write_height_png(tmp_path, raster)
    told = json.loads(meaning.read_text(encoding="utf-8"))
    value = read(image)
    assert value.dtype == np.uint16
    return told["minimum"] + value * told["metres_per_step"], told


def test_heights_round_trip_within_half_a_step_and_lie_where_the_json_says(
    tmp_path: Path, terrain: st.Terrain, raster: Raster, ground: Callable[[object], Raster]
) -> None:
    height, told = decoded(tmp_path, raster)
    np.testing.assert_allclose(height, raster.height, rtol=0, atol=0.5001 * told["metres_per_step"])
    assert (told["minimum"], told["maximum"]) == (raster.height.min(), raster.height.max())
    value = read(tmp_path / "height.png")
    assert (value.min(), value.max()) == (0, 65535)
    east, north = terrain.size
    assert told["bounds"] == {"west": 0.0, "south": 0.0, "east": east, "north": north}
    assert told["spacing"] == {"x": raster.spacing[0], "y": raster.spacing[1]}
    assert (told["height"], told["width"]) == raster.height.shape
    assert told["orientation"] == {"row_0": "north", "column_0": "west", "samples": "vertices"}
    assert (told["units"], told["file"]) == ("m", "height.png")

    for level in [0.0, -17.25, 8000.0]:
        height, told = decoded(tmp_path, ground(np.full((4, 6), level)))
        assert told["metres_per_step"] == 0, level
        np.testing.assert_array_equal(height, level)
    low = np.float32(1e-45)  # the smallest float32: a 65535th of it is no float32
    height, _ = decoded(tmp_path, ground([[0.0, low], [low, 0.0]]))
    np.testing.assert_allclose(height, [[0.0, low], [low, 0.0]], rtol=1e-6)


def test_normals_are_red_east_green_north_blue_up(tmp_path: Path, raster: Raster) -> None:
    normal = np.float32([[[0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]]])
    flat = np.zeros((1, 5), np.float32)
    colour = read(write_normals(tmp_path, Raster((1.0, 1.0), flat, normal, flat[..., None]))[0])
    assert colour.dtype == np.uint8
    expected = [[128, 128, 255], [255, 128, 128], [0, 128, 128], [128, 255, 128], [128, 0, 128]]
    assert colour[0].tolist() == expected

    colour = read(write_normals(tmp_path, raster)[0]).astype(np.float64)
    np.testing.assert_allclose(colour / 127.5 - 1, raster.normal, rtol=0, atol=0.5001 / 127.5)

    green = colour[..., 1]
    row, column = np.unravel_index(raster.height.argmax(), raster.height.shape)
    beside = slice(column - 4, column + 5)
    assert green[row - 8 : row, beside].mean() > 128 > green[row + 1 : row + 9, beside].mean()


def test_height_tif_round_trips_bit_for_bit_with_vertices_at_their_places(
    tmp_path: Path, raster: Raster, terrain: st.Terrain, ground: Callable[[object], Raster]
) -> None:
    (path,) = write_height_tif(tmp_path, raster)
    with rasterio.open(path, driver="GTiff") as file:
        assert (file.count, file.dtypes, file.units) == (1, ("float32",), ("m",))
        assert file.profile["compress"] == "deflate"
        assert file.tags()["AREA_OR_POINT"] == "Point"
        np.testing.assert_array_equal(file.read(1), raster.height)

        row, column = np.unravel_index(file.read(1).argmax(), file.shape)
        assert row < 0.4 * file.height
        assert column > 0.7 * file.width

    (tmp_path / "b").mkdir()
    (first,), (second,) = write_height_tif(tmp_path, raster), write_height_tif(tmp_path / "b", raster)
    assert first.read_bytes() == second.read_bytes()

    (path,) = write_height_tif(tmp_path, raster)
    east, north = terrain.size
    with rasterio.open(path) as file:
        rows, columns = file.shape
        assert file.xy(0, 0) == pytest.approx((0.0, north))  # the middle of a pixel is its vertex
        assert file.xy(rows - 1, columns - 1) == pytest.approx((east, 0.0))
        row, column = 20, 100
        x, y = file.xy(row, column)
        assert next(file.sample([(x, y)]))[0] == raster.height[row, column]
    assert terrain.heights(x, y, cell_size=raster.spacing[0]) == raster.height[row, column]

    (path,) = write_height_tif(tmp_path, ground(np.zeros((5, 7))))
    with Image.open(path) as image:
        tags = image.tag_v2  # type: ignore[attr-defined]
        assert tags[PIXEL_SCALE] == (2.0, 3.0, 0.0)
        assert tags[TIE_POINT] == (0.0, 0.0, 0.0, 0.0, 12.0, 0.0)  # 4 spacings of 3 m north of the origin
        keys = np.reshape(tags[GEO_KEYS][4:], (-1, 4))
    assert [RASTER_TYPE_KEY, 0, 1, PIXEL_IS_POINT] in keys.tolist()


def test_the_files_sum_to_255_hold_the_weights_and_are_filled_up_with_zeros(
    tmp_path: Path, terrain: st.Terrain, raster: Raster
) -> None:
    *images, meaning = write_materials(tmp_path, raster, terrain.material_names)
    assert [path.name for path in images] == ["materials.png", "materials-2.png"]
    told = json.loads(meaning.read_text(encoding="utf-8"))["materials"]
    assert [entry["name"] for entry in told] == list(terrain.material_names)
    by_file = {path.name: np.asarray(Image.open(path)) for path in images}
    weights = np.stack([by_file[e["file"]][..., CHANNELS.index(e["channel"])] for e in told], axis=-1)
    assert weights.dtype == np.uint8
    assert (weights.sum(axis=-1, dtype=int) == 255).all()
    assert np.abs(weights - 255.0 * raster.materials).max() < 1.001

    weights = np.zeros((2, 3, 5), np.float32)
    weights[..., 4] = 1
    flat = np.zeros((2, 3), np.float32)
    *images, meaning = write_materials(tmp_path, Raster((1.0, 1.0), flat, flat, weights), list("abcde"))
    second = np.asarray(Image.open(images[1]))
    assert second.reshape(-1, 4).tolist() == [[255, 0, 0, 0]] * 6
    last = json.loads(meaning.read_text(encoding="utf-8"))["materials"][-1]
    assert last == {"name": "e", "index": 4, "file": "materials-2.png", "channel": "red"}


@given(some.lists(some.lists(some.floats(0, 1, width=32), min_size=8, max_size=8), min_size=1, max_size=9))
@settings(max_examples=80, deadline=None)
def test_any_weights_sum_to_255_and_are_off_by_less_than_one(rows: list[list[float]]) -> None:
    weights = np.array([rows], np.float32)
    weights[weights.sum(axis=-1) == 0, 0] = 1
    result = quantised_weights(weights)
    exact = 255 * weights.astype(np.float64) / weights.sum(axis=-1, keepdims=True, dtype=np.float64)
    assert (result.sum(axis=-1, dtype=int) == 255).all()
    assert np.abs(result - exact).max() < 1 + 1e-6
    assert (result[weights == 0] == 0).all()


def test_the_largest_remainders_get_the_missing_steps() -> None:
    for weights, expected in [
        ([0, 1, 0], [0, 255, 0]),
        ([1, 1, 1], [85, 85, 85]),
        ([1, 1, 0], [128, 127, 0]),  # equal remainders: the first gets the step
        ([0.25, 0.5, 0.25], [64, 127, 64]),  # 63.75, 127.5, 63.75
        ([0.001, 0.001, 0.998], [0, 0, 255]),  # 0.255, 0.255, 254.49
    ]:
        assert quantised_weights(np.array([[weights]]))[0, 0].tolist() == expected, weights

    for bad in [[0.0, 0.0], [-0.1, 1.1], [np.nan, 1.0], [np.inf, 0.0]]:
        with pytest.raises(InputError, match="material weights"):
            quantised_weights(np.array([[bad]]))

    row = np.random.default_rng(1).random((1, 3, 8))
    tall = np.broadcast_to(row, (600, 3, 8))
    assert (quantised_weights(tall) == quantised_weights(row)).all()
