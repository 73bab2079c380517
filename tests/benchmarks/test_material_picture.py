"""The page on textures has a picture of all of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from sketchterrain.benchmarks import material_picture

if TYPE_CHECKING:
    from pathlib import Path

    import pytest


def test_every_material_is_in_the_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(material_picture, "_SIDE", 64)
    path = tmp_path / "materials.jpg"
    assert material_picture.main([str(path)]) == 0
    picture = np.asarray(Image.open(path))
    assert picture.shape == (960, 1920, 3)
    panels = picture.reshape(3, 320, 3, 640, 3)
    assert (panels.std(axis=(1, 3)) > 3.0).all()
