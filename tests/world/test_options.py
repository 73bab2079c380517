"""Options of a world: what cannot be written is refused in one line, before anything is opened."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError, SketchterrainError
from sketchterrain.terrain.building import make_recipe
from sketchterrain.world.options import WorldOptions, check_layers, output_form

SKETCH = Sketch(extent=512.0, layers={"mountain": np.zeros((24, 32), np.uint8)})


def test_output_name_decides_the_form() -> None:
    for form, names in {
        "zarr": ("world.zarr", "world.ZARR/"),
        "tif": ("a.b/world.tif", "world.tiff"),
        "tiles": ("world", "world.v2/"),
    }.items():
        assert {output_form(name) for name in names} == {form}


def test_other_endings_are_refused_unless_they_are_folders(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"world\.png: expected a name that ends in \.zarr or \.tif"):
        output_form("world.png")
    (tmp_path / "out.v2").mkdir()
    assert output_form(str(tmp_path / "out.v2")) == "tiles"


def test_layers_are_ordered_and_checked() -> None:
    assert check_layers(["materials", "height"]) == ("height", "materials")
    for text, told in (
        (("height", "colour"), "expected some of"),
        (["normal"], "expected height among them"),
    ):
        with pytest.raises(InputError, match=told):
            check_layers(text)


def test_default_bounds_are_the_sketch() -> None:
    for step in (2.0**-7, 1.0, 2.0**10, 2.0**-24):
        WorldOptions(step=step).check(SKETCH)
    world = WorldOptions().check(SKETCH)
    assert (world.west, world.south, world.east, world.north, world.cell) == (0.0, 0.0, 512.0, 384.0, 1.0)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"bounds": (1.0, 0.0, 1.0, 2.0)}, "west < east"),
        ({"bounds": (0.0, 2.0, 1.0, 1.0)}, "south < north"),
        ({"cell": 0.0}, "cell of more than 0 m"),
        ({"cell": -1.0}, "cell of more than 0 m"),
        ({"cell": float("nan")}, "finite"),
        ({"cell": 1e-5}, "cell 1e-05 m: expected at least 3.05e-05 m, the finest for a sketch of 512 m"),
        ({"bounds": (0.0, 0.0, 1e12, 1e12), "cell": 1e6}, "bounds 0,0,1e.12,1e.12: coordinates must be"),
        ({"bounds": (-1e11, 0.0, -1e11 + 5.0, 5.0)}, "within ±6.87e.10 m"),
        ({"step": 0.3}, "step 0.3: expected a power of two"),
        ({"step": -0.5}, "expected a power of two"),
        ({"step": 4096.0}, "expected a power of two"),
        ({"plants": "csv"}, "expected plants as none, parquet or flatgeobuf, got 'csv'"),
        ({"grass": True}, "grass without plants"),
        ({"crs": "EPSG:4326"}, "in degrees"),
        ({"crs": "nowhere"}, "not a coordinate reference system"),
        ({"origin": (float("inf"), 0.0)}, "finite origin"),
        ({"layers": ("normal",)}, "expected height among them"),
    ],
)
def test_invalid_options_are_refused(options: dict[str, Any], told: str) -> None:
    with pytest.raises(InputError, match=told) as caught:
        WorldOptions(**options).check(SKETCH)
    assert "\n" not in str(caught.value)


def test_workers_need_a_library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sketchterrain.world.job.find_spec", lambda _: None)
    WorldOptions().check(SKETCH)
    with pytest.raises(SketchterrainError, match=r"pip install 'sketchterrain\[world\]'"):
        WorldOptions(workers=True).check(SKETCH)


def test_job_carries_the_options(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    options = WorldOptions(
        bounds=(0.0, 0.0, 8.0, 8.0), layers=("materials", "height"), crs="EPSG:25832", step=0.5
    )
    job = options.job(SKETCH, make_recipe(SKETCH), Path("w.zarr"), "zarr")
    assert job.output == tmp_path / "w.zarr"
    assert job.layers == ("height", "materials")
    assert (job.crs, job.step, job.form, job.world.east) == ("EPSG:25832", 0.5, "zarr", 8.0)
