"""The sheet of plants is drawn: one row a level, plants in it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from sketchterrain.benchmarks import plant_sheet

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.gl
def test_a_row_of_plants_is_drawn_for_each_level(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plant_sheet, "SIZE", (240, 40))
    monkeypatch.setattr(plant_sheet, "LEAVES", (10.0, 0.05))
    assert plant_sheet.main([str(tmp_path)]) == 0
    with Image.open(tmp_path / "trees.jpg") as picture:
        pixels = np.asarray(picture.convert("RGB")).astype(float)
    assert pixels.shape == (80, 240, 3)
    fine, coarse = pixels[:40], pixels[40:]
    assert fine.std() > 15
    assert coarse.mean() == pytest.approx(fine.mean(), rel=0.1)
    # Where plants stand is dark before the sky.
    assert np.corrcoef(fine[8:20].mean(axis=(0, 2)), coarse[8:20].mean(axis=(0, 2)))[0, 1] > 0.7
