from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some
from PIL import Image

from sketchterrain.errors import InputError
from sketchterrain.export import quantised_weights, write_materials
from sketchterrain.terrain import Raster

if TYPE_CHECKING:
    from pathlib import Path

    import sketchterrain as st

CHANNELS = ("red", "green", "blue", "alpha")


def test_the_files_sum_to_255_and_hold_the_weights(
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


def test_the_last_file_is_filled_up_with_zeros(tmp_path: Path) -> None:
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
