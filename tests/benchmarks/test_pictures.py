"""Pictures of the documentation that benchmarks draw."""

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

from sketchterrain.benchmarks import figures
from sketchterrain.schema.materials import BUILT_IN


def pixels_of(path: Path) -> npt.NDArray[np.int64]:
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB")).astype(np.int64)


@pytest.mark.soak
def test_pictures_of_methods_are_drawn(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(figures, "_RASTER_SIDE", 33)
    assert figures.main(["methods", str(tmp_path)]) == 0
    names = {f"{name}.png" for name in figures.METHODS}
    assert {path.name for path in tmp_path.iterdir()} == names
    for name in names:
        assert pixels_of(tmp_path / name).std() > 10, name


@pytest.mark.slow
def test_every_material_is_in_the_picture(tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "_TEXTURE_SIDE", 64)
    assert figures.main(["textures", str(tmp_path)]) == 0
    picture = pixels_of(tmp_path / "textures.jpg")
    rows = math.ceil(len(BUILT_IN.layers) / 3)
    assert picture.shape == (350 * rows, 1920, 3)
    panels = picture.reshape(rows, 350, 3, 640, 3)[:, 30:].std(axis=(1, 3)).reshape(3 * rows, 3)
    assert (panels[: len(BUILT_IN.layers)] > 3.0).all()


@pytest.mark.gl
@pytest.mark.soak
def test_a_row_of_plants_is_drawn_for_each_level(tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "SIZE", (240, 40))
    monkeypatch.setattr(figures, "LEAVES", (10.0, 0.05))
    assert figures.main(["trees", str(tmp_path)]) == 0
    pixels = pixels_of(tmp_path / "trees.jpg")
    assert pixels.shape == (80, 240, 3)
    fine, coarse = pixels[:40], pixels[40:]
    assert fine.std() > 15
    assert coarse.mean() == pytest.approx(fine.mean(), rel=0.1)
    # Where plants stand is dark before the sky.
    assert np.corrcoef(fine[8:20].mean(axis=(0, 2)), coarse[8:20].mean(axis=(0, 2)))[0, 1] > 0.7
