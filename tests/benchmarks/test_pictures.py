"""Pictures of the documentation that benchmarks draw."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from sketchterrain.benchmarks import (
    material_picture,
    mesh_picture,
    method_pictures,
    plant_sheet,
    spectrum_picture,
)
from sketchterrain.terrain.materials import MATERIALS
from sketchterrain.terrain.plant import STOREYS

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt

    from sketchterrain.benchmarks.timing import TimedContext


def pixels_of(path: Path) -> npt.NDArray[np.int64]:
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB")).astype(np.int64)


def test_every_species_and_every_material_has_a_mark_of_its_own() -> None:
    for marks, names in (
        (method_pictures._SPECIES, STOREYS["woody"]),
        (method_pictures.COLOURS, MATERIALS),
    ):
        assert tuple(marks) == names
        assert len(set(marks.values())) == len(names)


@pytest.mark.slow
def test_pictures_of_methods_are_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(method_pictures, "_SIDE", 33)
    assert method_pictures.main([str(tmp_path)]) == 0
    names = {f"{name}.png" for name in method_pictures.PICTURES}
    assert {path.name for path in tmp_path.iterdir()} == names
    for name in names:
        assert pixels_of(tmp_path / name).std() > 10, name


@pytest.mark.slow
def test_every_material_is_in_the_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(material_picture, "_SIDE", 64)
    path = tmp_path / "materials.jpg"
    assert material_picture.main([str(path)]) == 0
    picture = pixels_of(path)
    assert picture.shape == (960, 1920, 3)
    panels = picture.reshape(3, 320, 3, 640, 3)
    assert (panels.std(axis=(1, 3)) > 3.0).all()


@pytest.mark.slow
def test_the_picture_of_meshes_has_a_panel_for_each_error(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    pytest.importorskip("pydelatin")
    path = tmp_path / "mesh.png"
    assert mesh_picture.main([str(path)], side=17) == 0
    shown = pixels_of(path)
    assert shown.std() > 10
    blue = (shown[..., 2] - shown[..., 0]) > 80
    left, right = np.array_split(blue, 2, axis=1)
    assert 100 < left.sum() < right.sum()  # the smaller error has more triangles


@pytest.mark.gl
@pytest.mark.slow
def test_a_row_of_plants_is_drawn_for_each_level(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plant_sheet, "SIZE", (240, 40))
    monkeypatch.setattr(plant_sheet, "LEAVES", (10.0, 0.05))
    assert plant_sheet.main([str(tmp_path)]) == 0
    pixels = pixels_of(tmp_path / "trees.jpg")
    assert pixels.shape == (80, 240, 3)
    fine, coarse = pixels[:40], pixels[40:]
    assert fine.std() > 15
    assert coarse.mean() == pytest.approx(fine.mean(), rel=0.1)
    # Where plants stand is dark before the sky.
    assert np.corrcoef(fine[8:20].mean(axis=(0, 2)), coarse[8:20].mean(axis=(0, 2)))[0, 1] > 0.7


@pytest.mark.slow
def test_the_picture_of_spectra_is_drawn(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    path = tmp_path / "spectrum.png"
    assert spectrum_picture.main([str(path)], sets=2) == 0
    shown = pixels_of(path)
    assert shown.std() > 10
    # The colours of lines outlive the few colours that a small file has.
    assert (shown[..., 2] - shown[..., 0] > 100).sum() > 1000


@pytest.mark.slow
def test_every_way_of_scattering_covers_the_measured_square(context: TimedContext) -> None:
    pytest.importorskip("matplotlib")
    for name, scatter in spectrum_picture.ways(context).items():
        points = scatter(1)
        assert points.dtype == np.float64, name
        assert points.min() < 1.5, name
        assert points.max() > 70.5, name
