"""The pictures of the pages on kernels are drawn, and are no plain surfaces."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from sketchterrain.benchmarks import method_pictures
from sketchterrain.terrain.materials import MATERIALS
from sketchterrain.terrain.plant import STOREYS

if TYPE_CHECKING:
    from pathlib import Path

pytest.importorskip("matplotlib")


def test_pictures_are_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(method_pictures, "_SIDE", 33)
    assert method_pictures.main([str(tmp_path)]) == 0
    names = {f"{name}.png" for name in method_pictures.PICTURES}
    assert {path.name for path in tmp_path.iterdir()} == names
    for name in names:
        with Image.open(tmp_path / name) as picture:
            assert np.asarray(picture.convert("RGB")).std() > 10


def test_every_species_has_a_mark_of_its_own() -> None:
    assert tuple(method_pictures._SPECIES) == STOREYS["woody"]
    assert len(set(method_pictures._SPECIES.values())) == len(method_pictures._SPECIES)


def test_every_material_has_a_colour_of_its_own() -> None:
    assert tuple(method_pictures.COLOURS) == MATERIALS
    assert len(set(method_pictures.COLOURS.values())) == len(MATERIALS)
