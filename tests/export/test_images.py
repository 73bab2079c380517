from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from sketchterrain.export import write_height_png, write_normals
from sketchterrain.terrain import Raster

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import numpy.typing as npt

    import sketchterrain as st


def read(path: Path) -> npt.NDArray[np.generic]:
    with Image.open(path) as image:
        return np.asarray(image)


def decoded(tmp_path: Path, raster: Raster) -> tuple[npt.NDArray[np.float64], dict[str, object]]:
    image, meaning = write_height_png(tmp_path, raster)
    told = json.loads(meaning.read_text(encoding="utf-8"))
    value = read(image)
    assert value.dtype == np.uint16
    return told["minimum"] + value * float(told["metres_per_step"]), told


def test_heights_round_trip_within_half_a_step_and_use_all_values(tmp_path: Path, raster: Raster) -> None:
    height, told = decoded(tmp_path, raster)
    np.testing.assert_allclose(
        height, raster.height, rtol=0, atol=0.5001 * float(str(told["metres_per_step"]))
    )
    assert (told["minimum"], told["maximum"]) == (raster.height.min(), raster.height.max())

    value = read(write_height_png(tmp_path, raster)[0])
    assert (value.min(), value.max()) == (0, 65535)


def test_height_json_says_where_the_image_lies(tmp_path: Path, terrain: st.Terrain, raster: Raster) -> None:
    _, told = decoded(tmp_path, raster)
    east, north = terrain.size
    assert told["bounds"] == {"west": 0.0, "south": 0.0, "east": east, "north": north}
    assert told["spacing"] == {"x": raster.spacing[0], "y": raster.spacing[1]}
    assert (told["height"], told["width"]) == raster.height.shape
    assert told["orientation"] == {"row_0": "north", "column_0": "west", "samples": "vertices"}
    assert (told["units"], told["file"]) == ("m", "height.png")


def test_flat_and_tiny_ranges_stay_exact(tmp_path: Path, ground: Callable[[object], Raster]) -> None:
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
    assert colour[0].tolist() == [
        [128, 128, 255],
        [255, 128, 128],
        [0, 128, 128],
        [128, 255, 128],
        [128, 0, 128],
    ]

    colour = read(write_normals(tmp_path, raster)[0]).astype(np.float64)
    np.testing.assert_allclose(colour / 127.5 - 1, raster.normal, rtol=0, atol=0.5001 / 127.5)

    green = read(write_normals(tmp_path, raster)[0])[..., 1].astype(int)
    row, column = np.unravel_index(raster.height.argmax(), raster.height.shape)
    beside = slice(column - 4, column + 5)
    assert green[row - 8 : row, beside].mean() > 128 > green[row + 1 : row + 9, beside].mean()
