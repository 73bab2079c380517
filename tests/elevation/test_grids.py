"""Reading of DEM files: registration, voids of every kind, and files that are none."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
import rasterio.shutil
from PIL import Image
from rasterio.transform import Affine

from sketchterrain.document.rasters import RASTER, RasterSource, raster_source
from sketchterrain.elevation import raster_reader
from sketchterrain.elevation.grids import SketchFrame, read_grid
from sketchterrain.elevation.quirks import CleanedSamples, Findings
from sketchterrain.elevation.raster_reader import file_stamps
from sketchterrain.errors import InputError

from .conftest import FRAME, HEIGHTS, write


def from_origin(west: float, north: float, width: float, height: float) -> Affine:
    return Affine(width, 0.0, west, 0.0, -height, north)


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
    assert "heights in ft, converted by 0.3048" in grid.findings
    assert grid.accuracy == pytest.approx(0.05 * 0.3048)  # half a step
    assert read_grid(path, FRAME, RasterSource("a", units="cm")).samples[0, 0] == pytest.approx(3.05)


@pytest.mark.parametrize(
    ("dtype", "scale", "offset", "void"),
    [
        ("uint16", 0.1, -1000.0, 65535),
        ("int32", 0.01, 0.0, -(2**31)),
        ("int32", 0.01, 0.0, -999900),
        ("int16", 0.1, 100.0, -32768),
        ("float32", 0.5, 0.0, -9999.0),
        ("float32", 2.0, 0.0, 3.4e38),
    ],
)
def test_scaled_values_are_judged_in_metres(
    tmp_path: Path, dtype: str, scale: float, offset: float, void: float
) -> None:
    truth = np.linspace(10.0, 2643.0, 900).reshape(30, 30)
    raw = np.round((truth - offset) / scale).astype(dtype)
    raw[10:12, 10:12] = void
    path = write(tmp_path / "a.tif", raw)
    with rasterio.open(path, "r+") as file:
        file.scales, file.offsets = (scale,), (offset,)
    grid = read_grid(path, FRAME)
    assert np.abs(grid.samples - truth).max() <= 0.51 * scale
    assert len(grid.findings) == 2, grid.findings  # the void, filled


@pytest.mark.parametrize(
    ("unit", "metres"),
    [
        *(("mm", 1e-3), ("centimetres", 1e-2), ("dm", 0.1), ("Meters", 1.0), ("km", 1e3), ("inches", 0.0254)),
        *(
            ("Foot (International)", 0.3048),
            ("yards", 0.9144),
            ("fathom", 1.8288),
            ("US fathoms", 1.8288 * 1.000002),
        ),
        *(("us-ft", 1200 / 3937), ("US survey foot", 1200 / 3937), ("foot_us", 1200 / 3937)),
        *(("us-yd", 3600 / 3937), ("nautical miles", 1852.0)),
    ],
)
def test_units_are_converted(tmp_path: Path, unit: str, metres: float) -> None:
    path = write(tmp_path / "a.tif", np.linspace(1, 2, 900).reshape(30, 30).astype(np.float32))
    with rasterio.open(path, "r+") as file:
        file.units = (unit,)
    grid = read_grid(path, FRAME)
    assert grid.samples[-1, -1] == pytest.approx(2.0 * metres, rel=1e-7)
    assert grid.findings == (() if metres == 1.0 else (f"heights in {unit}, converted by {metres:.8g}",))


def test_units_that_are_none_are_named(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif")
    for unit in ("furlongs", "m/s", "hPa"):
        with rasterio.open(path, "r+") as file:
            file.units = (unit,)
        with pytest.raises(InputError, match=rf"a\.tif: heights in .{unit}.: expected .* \(--units\)"):
            read_grid(path, FRAME)
    for scale in (0.0, np.nan, np.inf):
        with rasterio.open(scaled := write(tmp_path / "b.tif"), "r+") as file:
            file.scales = (scale,)
        with pytest.raises(InputError, match="scale"):
            read_grid(scaled, FRAME)
    assert np.array_equal(read_grid(path, FRAME, RasterSource("a", units="m")).samples, HEIGHTS)


def test_signed_numbers_stored_without_a_sign_are_recognised(tmp_path: Path) -> None:
    depths = np.linspace(-400.0, 380.0, 900).reshape(30, 30).round()
    path = write(tmp_path / "a.tif", depths.astype(np.int16).view(np.uint16))
    assert any("signed (--signed)" in each for each in read_grid(path, FRAME).findings)
    grid = read_grid(path, FRAME, RasterSource("a", signed=1))
    assert np.array_equal(grid.samples, depths)
    assert not grid.findings
    deep = write(tmp_path / "b.tif", (depths - 500.0).astype(np.int16).view(np.uint16))
    with pytest.raises(InputError, match=r"no heights.*signed \(--signed\)"):
        read_grid(deep, FRAME)
    with pytest.raises(InputError, match="signed = 1: expected"):
        read_grid(write(tmp_path / "c.tif"), FRAME, RasterSource("a", signed=1))


def test_no_data_in_a_sidecar(tmp_path: Path) -> None:
    heights = HEIGHTS.copy()
    heights[10:12, 10:12] = -500.0
    path = write(tmp_path / "a.tif", heights)
    assert not any("no data" in each for each in read_grid(path, FRAME).findings)
    stamps = file_stamps(path)
    (tmp_path / "a.tif.aux.xml").write_text(
        '<PAMDataset><PAMRasterBand band="1"><NoDataValue>-500</NoDataValue></PAMRasterBand></PAMDataset>'
    )
    assert file_stamps(path) != stamps  # stored patches are read again
    before = sorted((each.name, each.stat().st_mtime_ns) for each in tmp_path.iterdir())
    grid = read_grid(path, FRAME)
    assert np.allclose(grid.samples, HEIGHTS, atol=0.01)
    assert grid.findings[0] == "4 samples of no data (the file's mask or tag)"
    assert sorted((each.name, each.stat().st_mtime_ns) for each in tmp_path.iterdir()) == before
    with pytest.raises(InputError, match=r"a\.tif\.aux\.xml: its no-data value"):
        raster_source(path, "elevation", embed=True)


def terrain_rgb(code: str) -> Any:
    number = np.round((HEIGHTS + 10000.0) * 10.0 if code == "mapbox" else (HEIGHTS + 32768.0) * 256.0).astype(
        np.uint32
    )
    return np.stack([number >> 16, number >> 8 & 255, number & 255], -1).astype(np.uint8)


@pytest.mark.parametrize("code", ["mapbox", "terrarium"])
def test_heights_in_colours(tmp_path: Path, code: str) -> None:
    Image.fromarray(terrain_rgb(code)).save(tmp_path / "a.png")
    for encoding in ("", code):
        grid = read_grid(tmp_path / "a.png", source=RasterSource("a", cell=30.0, encoding=encoding))
        assert np.abs(grid.samples - HEIGHTS).max() <= 0.06
        assert grid.findings == (f"heights in the colours of {code.title()}",)
    clear = np.dstack([terrain_rgb(code), np.full(HEIGHTS.shape, 255, np.uint8)])
    clear[:3, :3] = 0
    Image.fromarray(clear).save(tmp_path / "b.png")
    assert np.isnan(read_grid(tmp_path / "b.png", source=RasterSource("b", cell=30.0)).samples).sum() == 9
    noise = np.random.default_rng(1).integers(0, 255, (20, 25, 3), np.uint8)
    Image.fromarray(noise).save(tmp_path / "c.png")
    with pytest.raises(InputError, match="encoding"):
        read_grid(tmp_path / "c.png", source=RasterSource("c", cell=30.0))


@pytest.mark.parametrize("name", ["a.png", "a.r16", "a.raw", "wide.raw"])
def test_heightmaps_of_engines(tmp_path: Path, name: str) -> None:
    share = np.add.outer(np.arange(33.0), np.arange(33.0)) / 64.0
    share = share[:20] if name == "wide.raw" else share
    raw = np.round(65535 * share).astype("<u2" if name == "a.r16" else ">u2")
    if name == "a.png":
        Image.fromarray(raw.astype(np.uint16)).save(tmp_path / name)
    else:
        (tmp_path / name).write_bytes(raw.tobytes())
    stated: dict[str, Any] = {"cell": 2.0, "range": "0,900", "columns": 33 if name == "wide.raw" else 0}
    grid = read_grid(tmp_path / name, source=RasterSource("a", **stated))
    assert np.abs(grid.samples - 900.0 * share).max() < 0.01
    assert grid.place == (2.0, 0.0, 1.0, 0.0, -2.0, 2.0 * len(raw) - 1.0)
    assert grid.accuracy == pytest.approx(450.0 / 65535)
    for key, message in (("range", "--range 0,900"), ("cell", "--cell 2")):
        with pytest.raises(InputError, match=message):
            read_grid(tmp_path / name, source=RasterSource("a", **{**stated, key: RASTER[key].default}))
    if name == "a.png":  # 8 bits, saved in colour
        Image.fromarray((share * 255).round().astype(np.uint8)).convert("RGB").save(tmp_path / name)
        found = read_grid(tmp_path / name, source=RasterSource("a", **stated)).samples
        assert np.abs(found - 900.0 * share).max() < 1.8
    if name == "wide.raw":
        with pytest.raises(InputError, match="expected a square"):
            read_grid(tmp_path / name, source=RasterSource("a", **{**stated, "columns": 0}))


def test_formats_of_gis(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = np.round(HEIGHTS)
    path = write(tmp_path / "src.tif", whole.astype(np.int16))
    for name, driver in (
        ("a.img", "HFA"),
        ("a.bil", "EHdr"),
        ("a.xyz", "XYZ"),
        ("a.jp2", "JP2OpenJPEG"),
        ("a.nc", "netCDF"),
    ):
        options = {"REVERSIBLE": "YES", "QUALITY": "100"} if driver == "JP2OpenJPEG" else {}
        rasterio.shutil.copy(path, tmp_path / name, driver=driver, **options)
        grid = read_grid(tmp_path / name, FRAME, crs="EPSG:32632")
        assert np.array_equal(grid.samples, whole), name
        assert grid.place == (30.0, 0.0, 500_115.0, 0.0, -30.0, 5_200_985.0), name
    Image.fromarray(whole.astype(np.int16)).save(bare := tmp_path / "b.tif")
    (tmp_path / "b.tfw").write_text("30\n0\n0\n-30\n500115\n5200985\n")
    assert read_grid(bare, FRAME, crs="EPSG:32632").place == grid.place
    monkeypatch.setitem(raster_reader._DRIVERS, ".tif", "ECW")
    with pytest.raises(ValueError, match="no driver ECW"):
        raster_reader._read({"path": str(path), "band": 1}, {})


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
        ("good.tif", {"source": RasterSource("a", band=2)}, "band = 2"),
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
