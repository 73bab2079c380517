"""Real elevation beneath a sketch: its rasters, by path and stored, their keys, the fade, and refusals."""

import io
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sketchterrain.document.rasters import RasterSource, raster_source
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch
from sketchterrain.elevation import base as module
from sketchterrain.elevation import grids
from sketchterrain.elevation.base import BaseElevation, held_grids, load_base
from sketchterrain.errors import InputError
from sketchterrain.io.resources import preset
from sketchterrain.stages.runner import Results, Runner

from .conftest import ground, write
from .test_grids import from_origin

EAST, NORTH = 500_000.0, 5_200_000.0
FRAME = {"crs": "EPSG:32632", "east": EAST, "north": NORTH}


def dem(
    path: Path, step: float = 30.0, *, south_west: tuple[float, float] = (0.0, 0.0), **profile: Any
) -> Path:
    """Write the hills over 3 km, from a place in the sketch."""
    cells = round(3000.0 / step)
    west, south = south_west
    x, y = west + (np.arange(cells) + 0.5) * step, south + 3000.0 - (np.arange(cells) + 0.5) * step
    heights = ground(*np.meshgrid(x, y)).astype(profile.pop("dtype", np.float32))
    transform = from_origin(EAST + west, NORTH + south + 3000.0, step, step)
    return write(path, heights, transform=transform, **profile)


def on(*sources: RasterSource, **fields: Any) -> Sketch:
    return Sketch(extent=3000.0, **{"frame": FRAME, "rasters": sources, **fields})


def base_of(*sources: RasterSource, **fields: Any) -> BaseElevation:
    found = load_base(on(*sources, **fields), Runner())
    assert found is not None
    return found


@pytest.fixture
def fine(tmp_path: Path) -> RasterSource:
    return raster_source(dem(tmp_path / "fine.tif"), "elevation")


@pytest.fixture
def coarse(tmp_path: Path) -> RasterSource:
    return raster_source(dem(tmp_path / "coarse.tif", 100.0), "elevation")


def test_samples_are_returned_in_sketch_metres(fine: RasterSource) -> None:
    base = base_of(fine)
    x, y = np.meshgrid(np.arange(15.0, 3000.0, 30.0), np.arange(15.0, 3000.0, 30.0))
    assert np.abs(base.heights(x, y, 1e-3).height - ground(x, y)).max() < 1e-3
    assert base.weight(x, y)[5:-5, 5:-5].min() > 1.0 - 1e-9
    assert base.weight(x, np.full_like(y, -20.0)).max() == 0.0
    assert base.heights(np.zeros(0), np.zeros(0), 1.0).height.shape == (0,)
    assert load_base(on(replace(fine, role="picture")), Runner()) is None


def test_order_copies_and_history_of_rasters_change_no_bit(
    tmp_path: Path, fine: RasterSource, coarse: RasterSource
) -> None:
    third = raster_source(dem(tmp_path / "third.tif", 50.0, south_west=(1000.0, 500.0)), "elevation")
    expected, memory = base_of(fine, coarse, third), Results()
    for sources in ((fine,), (third, fine), (third, coarse, fine), (coarse,), (fine, fine, coarse, third)):
        found = load_base(on(*sources), Runner(memory))
        assert found is not None
        assert (found.id == expected.id) == ({each.path for each in sources} > {fine.path, coarse.path})
    assert any("1 rasters have the content and place" in line for line in found.findings)
    x, y = np.meshgrid(np.linspace(10.0, 2990.0, 60), np.linspace(10.0, 2990.0, 60))
    for cell in (1.0, 100.0):
        assert np.array_equal(found.heights(x, y, cell)[:5], expected.heights(x, y, cell)[:5])
    assert found == expected
    assert hash(found) == hash(expected)


def test_files_are_read_once_until_they_change(
    tmp_path: Path, fine: RasterSource, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    calls, original = [], module.read_grid
    monkeypatch.setattr(module, "read_grid", lambda *a, **k: calls.append(a) or original(*a, **k))
    memory, source = Results(), replace(fine, sha256="")
    first = load_base(on(source), Runner(memory))
    assert load_base(on(source, base={"margin": 100.0}), Runner(memory)) != first
    assert load_base(on(source, base={"detail": 0.0}), Runner(memory)) == first
    assert len(calls) == 1
    again = load_base(on(source), Runner())  # as in another process
    assert again == first
    assert again is not None
    assert again.findings == first.findings
    assert len(calls) == 1
    dem(Path(source.path), south_west=(600.0, 0.0))
    assert load_base(on(source), Runner(memory)) != first
    assert len(calls) == 2


def test_rasters_read_by_rows_give_the_same_base(
    tmp_path: Path, fine: RasterSource, monkeypatch: pytest.MonkeyPatch
) -> None:
    sketch = on(replace(fine, offset=-12.5, vertical="EPSG:3855"), frame={**FRAME, "vertical": "EPSG:5773"})
    found = []
    for name in ("held", "rows"):
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / name))
        base = load_base(sketch, Runner())
        assert base is not None
        found.append((base.id, base.findings, base.grids[0].patches.law, held_grids(sketch)[0].id))
        monkeypatch.setattr(grids, "MAX_HELD", 0)
    assert found[0] == found[1]


def test_points_in_groups_have_the_bits_of_all_at_once(
    fine: RasterSource, coarse: RasterSource, monkeypatch: pytest.MonkeyPatch
) -> None:
    base = base_of(fine, coarse)
    x, y = np.random.default_rng(1).uniform(-100.0, 3100.0, (2, 30, 40))
    values = np.array([[1.0, 5.0], [2.0, 7.0]])
    expected = base.heights(x, y, 1.0, values)
    monkeypatch.setattr(module, "_AT_ONCE", 4)
    found = base.heights(x, y, 1.0, values)
    assert [each.tobytes() for each in found] == [each.tobytes() for each in expected]
    assert found.means.shape == (2, 30, 40)


def test_changes_of_files_of_a_mosaic_are_seen(tmp_path: Path) -> None:
    path = dem(tmp_path / "tile.tif")
    head = (
        f'<VRTDataset rasterXSize="100" rasterYSize="100"><GeoTransform>{EAST}, 30, 0, {NORTH + 3000}, 0, -30'
    )
    band = '</GeoTransform><VRTRasterBand dataType="Float32" band="1"><SimpleSource><SourceFilename '
    end = 'relativeToVRT="1">tile.tif</SourceFilename></SimpleSource></VRTRasterBand></VRTDataset>'
    (tmp_path / "a.vrt").write_text(head + band + end)
    source = RasterSource(str(tmp_path / "a.vrt"), "elevation")
    plain = {**FRAME, "crs": ""}
    first = base_of(source, frame=plain)
    dem(path, south_west=(600.0, 0.0))
    assert base_of(source, frame=plain) != first


def test_stored_files_of_every_format_equal_those_on_disk(tmp_path: Path, fine: RasterSource) -> None:
    heights = ground(*np.meshgrid(np.arange(20.0) * 50, np.arange(20.0) * 50)).astype(np.float32)
    np.savez(tmp_path / "a.npz", z=heights, xmin=0.0, xmax=1000.0, ymin=0.0, ymax=1000.0)
    rows = "\n".join(" ".join(map(str, row)) for row in heights.tolist())
    (tmp_path / "a.asc").write_text(f"NCOLS 20\nNROWS 20\nXLLCORNER 0\nYLLCORNER 0\nCELLSIZE 50\n{rows}\n")
    with zipfile.ZipFile(tmp_path / "a.asc.zip", "w") as archive:
        archive.write(tmp_path / "a.asc", "a.asc")
    hgt = np.full((1201, 1201), 1000, ">i2")
    hgt[:, 600:] = 1200
    (tmp_path / "N42E001.hgt").write_bytes(hgt.tobytes())
    utm = {"frame": {"crs": "EPSG:32631", "east": 300_000.0, "north": 4_600_000.0}}
    for name, fields in (
        ("fine.tif", {}),
        ("a.npz", {"frame": {}}),
        ("a.asc", {"frame": {}}),
        ("a.asc.zip", {"frame": {}}),
        ("N42E001.hgt", utm),
    ):
        linked, stored = (raster_source(tmp_path / name, "elevation", embed=e) for e in (False, True))
        assert base_of(linked, **fields).id == base_of(stored, **fields).id, name


def test_the_preset_andorra_lies_inside_of_its_data() -> None:
    sketch = load_sketch("andorra")
    base = load_base(sketch, Runner())
    assert base is not None
    x, y = np.meshgrid(*(np.linspace(0.0, side, 100) for side in sketch.size))
    height = base.heights(x, y, 60.0).height
    assert base.weight(x, y).min() > 1.0 - 1e-9
    assert 780.0 < height.min() < height.max() < 3100.0
    files = [path for path in preset("andorra").iterdir() if path.is_file()]
    assert sum(len(path.read_bytes()) for path in files) < 1_000_000
    for river in sketch.vectors["river"].ids.tolist():
        (line,) = sketch.vectors["river"].feature(river).rings
        along = base.heights(line[:, 0].copy(), line[:, 1].copy(), 60.0).height
        assert along[0] - along[-1] > 400.0


def test_a_grid_without_a_crs_has_the_coordinates_of_the_frame(tmp_path: Path, fine: RasterSource) -> None:
    plain = raster_source(dem(tmp_path / "plain.tif", crs=None), "elevation")
    for frame in (FRAME, {**FRAME, "crs": ""}):
        x = np.array([75.0])
        assert base_of(plain, frame=frame).heights(x, x, 1e-3).height == pytest.approx(ground(x, x), abs=1e-3)


def test_keys_of_a_raster(tmp_path: Path, fine: RasterSource) -> None:
    x = np.array([1515.0])
    moved = base_of(replace(fine, offset=-12.5))
    assert moved.heights(x, x, 1e-3).height == pytest.approx(ground(x, x) - 12.5, abs=2e-3)
    assert "fine.tif: -12.5 m added to all heights" in moved.findings
    assert base_of(replace(fine, accuracy=7.0)).facts["error"] == 7.0
    assert base_of(fine).facts["error"] == 0.0
    whole = raster_source(dem(tmp_path / "whole.tif", dtype=np.int16), "elevation")
    assert base_of(whole).facts["error"] == 0.5
    facts = base_of(whole, fine).facts
    assert [(each["name"], each["rows"], each["accuracy"]) for each in facts["grids"]] == [
        ("whole.tif", 100, 0.5),
        ("fine.tif", 100, 0.0),
    ]
    datum = base_of(replace(fine, vertical="EPSG:3855"), frame={**FRAME, "vertical": "EPSG:5773"})
    assert any("EGM2008 height not converted to EGM96 height" in line for line in datum.findings)


def test_the_margin_is_automatic_or_what_the_data_allow(fine: RasterSource) -> None:
    assert base_of(fine).margin == pytest.approx(0.04 * 3000.0, rel=0.05)
    assert base_of(fine, base={"margin": 300.0}).margin == 300.0
    for asked in (0.0, 99_000.0):
        found = base_of(fine, base={"margin": asked})
        assert 5.0 < found.margin < 1500.0
        assert (
            f"margin = {asked:g}: {found.margin:.4g} m is what the extent of the data allows"
            in found.findings
        )
        assert found.weight(np.array([1500.0]), np.array([1500.0])) == pytest.approx(1.0)


def test_data_outside_of_the_sketch_are_told(tmp_path: Path) -> None:
    far = raster_source(dem(tmp_path / "far.tif", south_west=(3000.0, 0.0)), "elevation")
    assert "far.tif: lies outside of the sketch" in base_of(far).findings


def test_refusals_are_one_line_that_names_the_raster(tmp_path: Path, fine: RasterSource) -> None:
    (tmp_path / "notes.tif").write_text("no heights")
    (tmp_path / "tiny.npy").write_bytes(_npy(np.ones((2, 2))))
    stored = raster_source(tmp_path / "notes.tif", "elevation", embed=True)
    voids = write(tmp_path / "voids.tif", np.full((9, 9), -32768, np.int16))
    gone = RasterSource(str(tmp_path / "gone.tif"), "elevation")
    for source, fields, problem in (
        (gone, {}, "gone.tif: the file is missing"),
        (replace(fine, sha256="0" * 64), {}, "fine.tif: its content has changed"),
        (replace(fine, band=2), {}, "band = 2: expected 1 to 1"),
        (fine, {"frame": {}}, "fine.tif: expected a sketch with a CRS, its frame has none"),
        (
            RasterSource(str(tmp_path / "notes.tif"), "elevation"),
            {},
            "notes.tif: cannot be read as elevation",
        ),
        (stored, {}, "cannot be read as elevation"),
        (RasterSource(str(tmp_path / "tiny.npy"), "elevation"), {}, "tiny.npy: has no georeference"),
        (RasterSource(str(voids), "elevation"), {}, "voids.tif: has no heights"),
    ):
        with pytest.raises(InputError) as refused:
            load_base(on(source, **fields), Runner())
        line = str(refused.value)
        assert line.startswith(f"raster {source.path}: ")
        assert problem in line
        assert line.isprintable()
        assert line.count(str(tmp_path)) <= 1


def _npy(array: np.ndarray[Any, Any]) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()
