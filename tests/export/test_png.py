from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
import rasterio
from PIL import Image

from sketchterrain.errors import SketchterrainError
from sketchterrain.export.png import write_values_png

if TYPE_CHECKING:
    from pathlib import Path

KINDS = [
    ((1, 1), np.uint8),
    ((1, 7), np.uint16),
    ((64, 5), np.uint16),
    ((65, 5), np.uint8),
    ((200, 3), np.uint16),
    ((130, 9, 3), np.uint8),
    ((130, 9, 4), np.uint8),
]


def test_pillow_and_gdal_read_the_values_back(tmp_path: Path) -> None:
    for shape, kind in KINDS:
        values = np.random.default_rng(1).integers(0, np.iinfo(kind).max, shape, kind, endpoint=True)
        path = write_values_png(tmp_path / "a.png", values)
        with Image.open(path) as image:
            image.verify()
        with Image.open(path) as image:
            assert (
                image.mode
                == {(2, 1): "L", (2, 2): "I;16", (3, 3): "RGB", (3, 4): "RGBA"}[
                    values.ndim, shape[-1] if values.ndim == 3 else values.dtype.itemsize
                ]
            ), (shape, kind)
            np.testing.assert_array_equal(np.asarray(image), values)
        with pytest.warns(rasterio.errors.NotGeoreferencedWarning):
            other = rasterio.open(path)
        with other:
            bands = np.moveaxis(other.read(), 0, -1)
        np.testing.assert_array_equal(bands.reshape(shape), values)


def test_views_are_written_the_same_bytes_twice_and_compressed(tmp_path: Path) -> None:
    whole = np.arange(60 * 80, dtype=np.uint16).reshape(60, 80)
    for view in (whole[5:50:2, 70:3:-3], whole.T, np.broadcast_to(np.uint16(7), (9, 9))):
        with Image.open(write_values_png(tmp_path / "a.png", view)) as image:
            np.testing.assert_array_equal(np.asarray(image), view)

    values = np.random.default_rng(2).integers(0, 9, (100, 100, 4), np.uint8)
    one, other = (write_values_png(tmp_path / name, values).read_bytes() for name in ("a.png", "b.png"))
    assert one == other

    x = np.linspace(0.0, 6.0, 500)
    values = np.rint(20_000 * (1.0 + np.sin(x) * np.cos(x[:, None]))).astype(np.uint16)
    assert write_values_png(tmp_path / "a.png", values).stat().st_size < 0.8 * values.nbytes


def test_a_folder_that_is_not_there_is_told_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(SketchterrainError, match="cannot be written"):
        write_values_png(tmp_path / "no" / "a.png", np.zeros((2, 2), np.uint8))
