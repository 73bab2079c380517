"""The picture of meshes is drawn, a panel an error."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from sketchterrain.benchmarks import mesh_picture

if TYPE_CHECKING:
    from pathlib import Path

pytest.importorskip("matplotlib")
pytest.importorskip("pydelatin")


def test_picture_is_written(tmp_path: Path) -> None:
    path = tmp_path / "mesh.png"
    assert mesh_picture.main([str(path)], side=17) == 0
    with Image.open(path) as picture:
        shown = np.asarray(picture.convert("RGB")).astype(int)
    assert shown.std() > 10
    blue = (shown[..., 2] - shown[..., 0]) > 80
    left, right = np.array_split(blue, 2, axis=1)
    assert 100 < left.sum() < right.sum()  # the smaller error has more triangles
