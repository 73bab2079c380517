from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
import rasterio
from PIL import Image

from sketchterrain.export import write_height_tif

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import sketchterrain as st
    from sketchterrain.terrain import Raster

PIXEL_SCALE, TIE_POINT, GEO_KEYS = 33550, 33922, 34735
RASTER_TYPE_KEY, PIXEL_IS_POINT = 1025, 2


def test_heights_round_trip_bit_for_bit_north_up(tmp_path: Path, raster: Raster) -> None:
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


def test_vertices_lie_at_their_places_for_gdal_and_in_the_raw_tags(
    tmp_path: Path, terrain: st.Terrain, raster: Raster, ground: Callable[[object], Raster]
) -> None:
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
