"""Reading of DEM files: registration, voids of every kind, and files that are none."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from rasterio.transform import Affine

from sketchterrain.elevation.grids import SketchFrame, read_grid
from sketchterrain.elevation.quirks import CleanedSamples, Findings
from sketchterrain.errors import InputError


def from_origin(west: float, north: float, width: float, height: float) -> Affine:
    return Affine(width, 0.0, west, 0.0, -height, north)


FRAME = SketchFrame("EPSG:32632", 500_000.0, 5_200_000.0)
HEIGHTS = (300.0 + np.add.outer(3.0 * np.arange(20), 7.0 * np.arange(25))).astype(np.float32)


def write(path: Path, heights: Any = HEIGHTS, **profile: Any) -> Path:
    tags = profile.pop("tags", {})
    profile = {"crs": "EPSG:32632", "transform": from_origin(500_100.0, 5_201_000.0, 30.0, 30.0), **profile}
    rows, columns = heights.shape
    with rasterio.open(
        path, "w", driver="GTiff", width=columns, height=rows, count=1, dtype=heights.dtype, **profile
    ) as file:
        file.update_tags(**tags)
        file.write(heights, 1)
    return path


def cleaned(raw: Any) -> tuple[Any, Findings]:
    """Return cleaned samples 30 m apart, and what was found."""

    def read(first: int, last: int) -> tuple[Any, Any]:
        values = np.array(raw[first:last], np.float32)
        return values, np.ones(values.shape, bool)

    found = CleanedSamples(read, raw.shape, 30.0)
    return found[:], found.findings


def test_samples_are_centres_of_cells_in_any_registration(tmp_path: Path) -> None:
    for registration in ("Area", "Point"):
        grid = read_grid(write(tmp_path / "a.tif", tags={"AREA_OR_POINT": registration}), FRAME)
        assert np.array_equal(grid.samples, HEIGHTS)
        x, y = grid.to_metres(np.array([0.0, 24.0]), np.array([0.0, 19.0]))
        assert x.tolist() == [115.0, 835.0]
        assert y.tolist() == [985.0, 415.0]
        assert grid.is_affine
    text = "ncols 5\nnrows 4\nxllcenter 10\nyllcenter 20\ncellsize 2\n" + "1 2 3 4 5\n" * 4
    (tmp_path / "centre.asc").write_text(text)
    (tmp_path / "corner.asc").write_text(text.replace("center", "corner"))
    for name, expected in (("centre", [10.0, 26.0]), ("corner", [11.0, 27.0])):
        x, y = read_grid(tmp_path / f"{name}.asc").to_metres(np.zeros(1), np.zeros(1))
        assert [x[0], y[0]] == expected


def test_rotated_and_mirrored_grids(tmp_path: Path) -> None:
    for transform in (
        Affine.translation(500_500, 5_200_500) @ Affine.rotation(30) @ Affine.scale(10, -10),
        Affine.translation(500_500, 5_200_500) @ Affine.scale(10, 10),  # south up
    ):
        grid = read_grid(write(tmp_path / "a.tif", transform=transform), FRAME)
        expected = transform @ (3.5, 6.5)
        x, y = grid.to_metres(np.array(3.0), np.array(6.0))
        assert x + 500_000.0 == pytest.approx(expected[0])
        assert y + 5_200_000.0 == pytest.approx(expected[1])


def test_numpy_files_have_a_place_by_their_borders_or_as_given(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", z=HEIGHTS, xmin=10.0, xmax=260.0, ymin=200.0, ymax=0.0)
    grid = read_grid(tmp_path / "a.npz")
    assert grid.to_metres(np.array(0.0), np.array(0.0)) == (15.0, 195.0)
    assert grid.id == read_grid(tmp_path / "a.npz").id
    np.save(tmp_path / "a.npy", HEIGHTS)
    grid = read_grid(tmp_path / "a.npy", place=(5.0, 0.0, 1.0, 0.0, -5.0, 99.0), accuracy=2.0)
    assert (grid.place[2], grid.accuracy) == (1.0, 2.0)


def test_file_in_an_archive(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif")
    with zipfile.ZipFile(tmp_path / "a.tif.zip", "w") as archive:
        archive.write(path, "a.tif")
    for name in ("a.tif.zip", "a.tif.zip/a.tif"):
        assert np.array_equal(read_grid(tmp_path / name, FRAME).samples, HEIGHTS)


def test_degrees_are_placed_by_their_projection(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif", crs="EPSG:4326", transform=from_origin(9.0, 47.0, 1e-3, 1e-3))
    grid = read_grid(path, FRAME)
    x, y = grid.to_metres(np.array(0.0), np.array(0.0))
    east, north = rasterio.warp.transform("EPSG:4326", "EPSG:32632", [9.0005], [46.9995])
    assert (x, y) == (pytest.approx(east[0] - 500_000.0), pytest.approx(north[0] - 5_200_000.0))


@pytest.mark.parametrize(
    ("value", "dtype", "tag"),
    [
        (-32768, "int16", -32768),
        (-32768, "int16", None),
        (-32767, "int16", None),
        (9999.0, "float32", None),
        (-9999.0, "float32", None),
        (-999.0, "float32", None),
        (np.nan, "float32", None),
        (np.inf, "float32", None),
        (3.4e38, "float32", None),
        (-3.4028235e38, "float32", None),
        (55.0, "float32", 55.0),
        (0.0, "float32", 0.0),
    ],
)
def test_voids_of_every_kind(tmp_path: Path, value: float, dtype: str, tag: float | None) -> None:
    heights = HEIGHTS.astype(dtype)
    heights[:4, :5] = value  # at a corner: left out
    heights[10:13, 10:14] = value  # small: filled
    grid = read_grid(write(tmp_path / "a.tif", heights, nodata=tag), FRAME)
    assert np.isnan(grid.samples[:4, :5]).all()
    assert np.isfinite(grid.samples).sum() == HEIGHTS.size - 20
    assert np.abs(grid.samples - HEIGHTS)[10:13, 10:14].max() < 0.01  # a plane: the membrane is exact
    assert any("32 samples of no data" in each for each in grid.findings), grid.findings
    assert "12 samples in 1 small voids, filled" in grid.findings


def test_several_kinds_of_voids_in_one_file() -> None:
    raw = np.tile(HEIGHTS, (8, 8))
    raw[5, 5], raw[9, 30], raw[50, 50], raw[0, 0] = np.nan, 9999.0, 3.4e38, -32768.0
    raw[20:100, 60:140] = -9999.0  # too large
    samples, findings = cleaned(raw)
    assert np.isnan(samples).sum() == 6400 + 1
    text = " ".join(findings)
    for part in ("3 samples of no data (", "6400 samples of no data (-9999)", "1 samples of no data (9999)"):
        assert part in text, findings
    assert "3 samples in 3 small voids, filled" in text


def test_heights_near_a_sentinel_are_kept() -> None:
    raw = -np.linspace(900.0, 1100.0, 400).reshape(20, 20)
    raw[3, 3] = -999.0
    samples, findings = cleaned(raw)
    assert np.isfinite(samples).all()
    assert not findings


def test_collars_of_zeros_and_the_sea() -> None:
    high = HEIGHTS.copy()
    high[:, :3] = 0.0
    samples, findings = cleaned(high)
    assert np.isnan(samples).sum() == 60
    assert any("60 zeros in collars" in each for each in findings)
    coast = np.maximum(np.add.outer(np.zeros(20), 2.0 * np.arange(25)) - 20.0, 0.0)
    samples, findings = cleaned(coast)
    assert np.isfinite(samples).all()
    assert not any("collar" in each for each in findings)


def test_spikes_and_terraces_are_reported_and_kept() -> None:
    rng = np.random.default_rng(1)
    raw = np.tile(HEIGHTS, (4, 4)) + rng.normal(size=(80, 100))
    raw[20, 30] += 900.0
    raw[40, 60] -= 900.0
    samples, findings = cleaned(raw)
    assert any(each.startswith("2 spikes") for each in findings)
    assert np.allclose(samples, raw, atol=1e-3)
    steps = np.round(np.cumsum(rng.normal(size=(60, 60)) * 0.1, axis=1) * 2.0) / 2.0 + 100.0
    _, findings = cleaned(steps)
    assert any(each.startswith("terraces") and "steps of 0.5 m" in each for each in findings), findings


def test_feet_and_scales(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif", (HEIGHTS * 10).astype(np.int16))
    with rasterio.open(path, "r+") as file:
        file.units, file.scales, file.offsets = ("ft",), (0.1,), (5.0,)
    grid = read_grid(path, FRAME)
    assert np.allclose(grid.samples, (HEIGHTS + 5.0) * 0.3048, atol=0.05)
    assert any("feet" in each for each in grid.findings)


def test_bad_files_are_one_line(tmp_path: Path) -> None:
    good = write(tmp_path / "good.tif").read_bytes()
    (tmp_path / "truncated.tif").write_bytes(good[: len(good) // 2])
    for name in ("empty.tif", "empty.npy", "notes.pdf"):
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "noise.tif").write_bytes(np.random.default_rng(1).bytes(5000))
    (tmp_path / "text.asc").write_text("ncols 5\nnrows x\n")
    (tmp_path / "noise.zip").write_bytes(b"PK\3\4" + bytes(100))
    with zipfile.ZipFile(tmp_path / "two.zip", "w") as archive:
        archive.writestr("a.tif", good)
        archive.writestr("b.tif", good)
    vrt = '<VRTDataset rasterXSize="9" rasterYSize="9"><VRTRasterBand band="1"><SimpleSource>'
    vrt += "<SourceFilename>/vsicurl/http://example.org/a.tif</SourceFilename></SimpleSource></VRTRasterBand>"
    (tmp_path / "address.vrt").write_text(vrt + "</VRTDataset>")
    (tmp_path / "address.tif").write_text(vrt + "</VRTDataset>")
    with rasterio.open(
        tmp_path / "huge.tif",
        "w",
        driver="GTiff",
        width=200_000,
        height=200_000,
        count=1,
        dtype="int16",
        tiled=True,
        sparse_ok=True,
        bigtiff="yes",
        transform=from_origin(5.0, 5.0, 2.0, 2.0),
    ):
        pass
    write(tmp_path / "complex.tif", HEIGHTS.astype(np.complex64))
    write(tmp_path / "voids.tif", np.full((9, 9), -32768, np.int16), nodata=-32768)
    write(tmp_path / "small.tif", HEIGHTS[:3, :3])
    write(tmp_path / "degrees.tif", crs=None, transform=from_origin(9.0, 47.0, 1e-3, 1e-3))
    np.save(tmp_path / "line.npy", np.zeros(9))
    np.save(tmp_path / "objects.npy", np.array([{}]), allow_pickle=True)
    np.savez(tmp_path / "two.npz", a=HEIGHTS, b=HEIGHTS)
    (tmp_path / "plain.npz").write_bytes((tmp_path / "line.npy").read_bytes())
    np.save(tmp_path / "place.npy", HEIGHTS)
    place = (1.0, 0.0, 0.0, 0.0, -1.0, 0.0)
    cases: list[tuple[str, dict[str, Any], str]] = [
        *((name, {}, "cannot be read") for name in ("truncated.tif", "empty.tif", "noise.tif", "text.asc")),
        *((name, {}, "cannot be read") for name in ("noise.zip", "missing.tif", "complex.tif", "line.npy")),
        ("two.zip", {}, "archive of one file"),
        ("two.zip/c.tif", {}, "archive of one file"),
        ("address.vrt", {}, "address"),
        ("address.tif", {}, "cannot be read"),
        ("empty.npy", {"place": place}, "cannot be read"),
        ("notes.pdf", {}, "expected a file .tif"),
        ("huge.tif", {}, "at most"),
        ("voids.tif", {}, "no heights"),
        ("small.tif", {}, "at least 4"),
        ("degrees.tif", {}, "look like degrees"),
        ("objects.npy", {"place": place}, "cannot be read"),
        ("two.npz", {}, "one array"),
        ("plain.npz", {}, "cannot be read"),
        ("place.npy", {}, "no georeference"),
        ("place.npy", {"place": (1.0, 1.0, 0.0, 1.0, 1.0, 0.0)}, "degenerate"),
        ("good.tif", {"band": 2}, "band = 2"),
        ("good.tif", {"accuracy": -1.0}, "accuracy"),
        ("good.tif", {"frame": SketchFrame()}, "with a CRS"),
        ("good.tif", {"crs": "nonsense"}, "coordinate reference system"),
    ]
    for name, arguments, message in cases:
        with pytest.raises(InputError, match=message) as raised:
            read_and_place(tmp_path / name, {"frame": FRAME, **arguments})
        assert "\n" not in str(raised.value)
        assert len(str(raised.value)) < 400


def read_and_place(path: Path, arguments: dict[str, Any]) -> None:
    read_grid(path, **arguments).to_metres(np.array(0.0), np.array(0.0))


def test_damaged_files_are_read_or_refused(tmp_path: Path) -> None:
    whole = write(tmp_path / "whole.tif", compress="deflate").read_bytes()
    np.savez_compressed(tmp_path / "whole.npz", z=HEIGHTS)
    (tmp_path / "whole.vrt").write_text(
        '<VRTDataset rasterXSize="25" rasterYSize="20"><GeoTransform>5, 30, 0, 9, 0, -30</GeoTransform>'
        '<VRTRasterBand dataType="Float32" band="1"><SimpleSource><SourceFilename relativeToVRT="1">whole.tif'
        "</SourceFilename></SimpleSource></VRTRasterBand></VRTDataset>"
    )
    place = (1.0, 0.0, 0.0, 0.0, -1.0, 0.0)
    assert np.array_equal(read_grid(tmp_path / "whole.vrt").samples, HEIGHTS)
    rng = np.random.default_rng(3)
    refused = 0
    for suffix, content in ((".tif", whole), (".npz", (tmp_path / "whole.npz").read_bytes())):
        for _ in range(60):
            damaged = bytearray(content)
            for at in rng.integers(len(damaged), size=4):
                damaged[at] = rng.integers(256)
            (tmp_path / f"damaged{suffix}").write_bytes(damaged)
            try:
                read_grid(tmp_path / f"damaged{suffix}", FRAME, place=place)
            except InputError:
                refused += 1
    assert refused > 10
