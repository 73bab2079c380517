"""300 hostile or odd inputs over all readers: what was put in comes out, or one line says what is lost.

Each case writes known heights, labels, features or settings in an odd encoding, or damages the file, and
reads it back. An odd but whole file is read exactly, or refused; of a damaged one, losses are reported.
"""

import gzip
import resource
import shutil
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
import pyogrio
import pytest
import rasterio
import shapely
from PIL import Image
from rasterio.transform import Affine
from rasterio.warp import transform

from sketchterrain.batch.plan import read_sweep
from sketchterrain.document.label_layers import encode_layer
from sketchterrain.document.store import load_sketch
from sketchterrain.elevation.grids import SketchFrame, read_grid
from sketchterrain.errors import SketchterrainError
from sketchterrain.importing.images import detect_kind, read_map
from sketchterrain.importing.traced_layers import TraceOptions
from sketchterrain.importing.vectors import sketch_from_vectors
from sketchterrain.schema.layers import LAYERS
from tests.importing.conftest import KnownMap

Rng = np.random.Generator
Notes = tuple[str, ...]

MOST_CPU = 2.0  # s, of a refusal

HEIGHTS = np.round(600 + 300 * np.sin(np.arange(40) / 9) * np.cos(np.arange(30) / 7)[:, None], 1)
UNITS = {"": 1.0, "m": 1.0, "metre": 1.0, "km": 1e3, "dm": 0.1, "cm": 0.01, "mm": 1e-3, "ft": 0.3048}
UNITS |= {"US survey foot": 1200 / 3937, "yd": 0.9144, "fathom": 1.8288, "parsec": np.nan}
SCALES = ((1.0, 0.0), (0.1, -1000.0), (0.01, 0.0), (0.5, 100.0), (2.0, -50.0))
LAYOUTS: tuple[dict[str, Any], ...] = ({}, {"endianness": "big"}, {"bigtiff": "yes"}, {"compress": "deflate"})
LAYOUTS += ({"tiled": True, "blockxsize": 16, "blockysize": 16, "compress": "lzw", "predictor": 2},)
PICTURES: list[tuple[str, str, dict[str, Any]]] = [("BMP", "RGB", {}), ("GIF", "P", {}), ("TIFF", "CMYK", {})]
PICTURES += [("PNG", mode, {}) for mode in ("P", "RGBA", "RGB")] + [("WEBP", "RGB", {"lossless": True})]
PICTURES += [("TIFF", "RGB", {"compression": name}) for name in ("tiff_lzw", "packbits", "tiff_deflate")]
PICTURES += [("JPEG", "RGB", {"quality": 92, "progressive": True}), ("JPEG", "CMYK", {"quality": 95})]
PICTURES += [("PNG", "P", {"transparency": 255}), ("PNG", "RGB", {"icc_profile": bytes(64)})]


def damaged(data: bytes, rng: Rng) -> bytes:
    """Return a file that is cut off, or has a run of bytes zeroed, changed or left out."""
    at, length, way = int(rng.integers(len(data))), int(rng.integers(1, 40)), rng.integers(4)
    if way == 0:
        return data[:at]
    inside = (bytes(length), rng.bytes(length), b"")[way - 1]
    return data[:at] + inside + data[at + length :]


def rasters(rng: Rng, folder: Path, _: KnownMap) -> tuple[str, Notes]:
    """Heights of any type, scale, unit, layout and tag for voids, as a GeoTIFF or NumPy file, or damaged."""
    dtype = str(rng.choice(["int16", "uint16", "int32", "uint32", "float32", "float64"]))
    unit, (scale, offset) = str(rng.choice(list(UNITS))), SCALES[rng.integers(len(SCALES))]
    metres, is_whole = UNITS[unit] if unit != "parsec" else 1.0, np.dtype(dtype).kind in "iu"
    stored = (HEIGHTS / metres - offset) / scale
    if is_whole and (stored.min() < np.iinfo(dtype).min or stored.max() > np.iinfo(dtype).max - 1):
        dtype = "int32"
    values = (np.round(stored) if is_whole else stored).astype(dtype)
    tag, by = np.iinfo(dtype).max if is_whole else -9999, str(rng.choice(["none", "tag", "sidecar"]))
    if by != "none":
        values[10:12, 20:22] = tag
    path, step = folder / "a.tif", int(rng.choice([-30, -30, 30]))
    shape = {"height": 30, "width": 40, "count": 1, "dtype": dtype, "crs": "EPSG:32632"}
    place = Affine(30, 0, 500_100, 0, step, 5_200_500 - 15 * step)
    with rasterio.open(path, "w", transform=place, **shape, **LAYOUTS[rng.integers(len(LAYOUTS))]) as file:
        file.write(values, 1)
        file.scales, file.offsets, file.units = (scale,), (offset,), (unit,)
        file.nodata = tag if by == "tag" else None
    if by == "sidecar":
        band = f"<PAMRasterBand band='1'><NoDataValue>{tag}</NoDataValue></PAMRasterBand>"
        path.with_name("a.tif.aux.xml").write_text(f"<PAMDataset>{band}</PAMDataset>")
    if rng.random() < 0.2:
        path, (metres, scale, unit, is_whole) = folder / "a.npz", (1.0, 1.0, "", False)
        spans = {"xmin": 500_100.0, "xmax": 501_300.0, "ymin": 5_200_400.0, "ymax": 5_201_300.0}
        np.savez(path, z=HEIGHTS, crs="EPSG:32632", **spans)
    if is_damaged := rng.random() < 0.3:
        path.write_bytes(damaged(path.read_bytes(), rng))
    grid = read_grid(path, SketchFrame("EPSG:32632", 500_000.0, 5_200_000.0))
    if is_damaged:  # changed bytes of heights are heights: lost rows are reported
        lost = grid.samples.shape != HEIGHTS.shape or np.isnan(grid.samples).any()
        return f"damaged {path.suffix}" * bool(lost), tuple(grid.found)
    off = np.abs(grid.samples - HEIGHTS)
    off[10:12, 20:22] *= 0.005  # small voids are filled
    is_right = unit != "parsec" and off.max() <= 0.5 * scale * metres * is_whole + 0.01
    return "" if is_right else f"{dtype} {scale} {offset} {unit!r}, void by {by}: off by {off.max()} m", ()


def pictures(rng: Rng, folder: Path, known: KnownMap) -> tuple[str, Notes]:
    """A coloured map in any format, mode and orientation, or damaged."""
    kind, mode, options = PICTURES[rng.integers(len(PICTURES))]
    image = known.picture
    if kind in ("JPEG", "PNG", "WEBP") and rng.random() < 0.3:
        image, exif = image.transpose(Image.Transpose.ROTATE_90), Image.Exif()
        exif[0x0112] = 6  # to be turned by a quarter to the right
        options = {**options, "exif": exif}
    path = folder / f"map.{rng.choice(['png', 'PNG', 'jpg', 'tiff'])}"  # the first bytes decide
    image.convert(mode, palette=Image.Palette.ADAPTIVE).save(path, format=kind, **options)
    if is_damaged := rng.random() < 0.4 and kind != "JPEG":  # of which no decoder knows
        path.write_bytes(damaged(path.read_bytes(), rng))
    traced = read_map(path).traced(TraceOptions())
    found = np.zeros((traced.sketch.height_px, traced.sketch.width_px), np.uint8)
    for place, layer in enumerate(traced.sketch.layers.values(), start=1):
        found[layer > 0] = place
    same = float((found == known.labels).mean()) if found.shape == known.labels.shape else 0.0
    least = 0.5 if is_damaged else 0.97  # changed bytes of pixels are pixels
    return "" if same > least else f"{kind} {mode} {options}: {same:.1%} of the labels", ()


WIDTHS = {"12'6\"": 3.81, "12 ft": 3.6576, "3,5": 3.5, "~20": 20.0, "8 m": 8.0, "0.01 km": 10.0, "7;9": 7.0}
ISLAND = shapely.box(500_550, 5_200_650, 500_600, 5_200_700)
FEATURES: dict[Any, dict[str, str]] = {
    shapely.LineString([(500_000, 5_200_000), (500_400, 5_200_300)]): {"waterway": "river", "name": "Öre 湖"},
    shapely.LineString([(500_000, 5_200_900), (501_000, 5_200_950)]): {"highway": "residential"},
    shapely.box(500_450, 5_200_500, 500_800, 5_200_800).difference(ISLAND): {"natural": "water"},
    shapely.box(500_050, 5_200_400, 500_300, 5_200_600): {"natural": "wood"},
}
LAYER_OF = {"river": "river", "residential": "road", "water": "lake", "wood": "landuse"}
DRIVERS = {"GeoJSON": "geojson", "GPKG": "gpkg", "FlatGeobuf": "fgb", "ESRI Shapefile": "shp", "OSM": "osm"}
LOSSES = ("skipped", "damaged", "lack", "lost", "cannot", "ends after", "left out")


def vectors(rng: Rng, folder: Path, _: KnownMap) -> tuple[str, Notes]:
    """A river, a road, a lake with an island and a wood in any format, CRS and spelling, or damaged."""
    driver, width = str(rng.choice(list(DRIVERS))), str(rng.choice(list(WIDTHS)))
    # A Shapefile has one kind of shapes; OpenStreetMap's ways have no holes.
    count, in_degrees = 2 if driver == "ESRI Shapefile" else 4, driver == "OSM" or rng.random() < 0.4
    shapes = np.array(list(FEATURES), object)[:count]
    tags = [{"width": width, **each} if "waterway" in each else each for each in FEATURES.values()][:count]
    if in_degrees:
        xy = transform("EPSG:32632", "EPSG:4326", *shapely.get_coordinates(shapes).T)
        shapes = shapely.set_coordinates(shapes, np.stack(xy, axis=-1))
    path, crs = folder / f"map.{DRIVERS[driver]}", "EPSG:4326" if in_degrees else "EPSG:32632"
    if driver == "OSM":
        path.write_text(openstreetmap(shapes, tags), encoding="utf-8")
    else:
        keys = ("waterway", "highway", "natural", "width", "name")
        values = [np.array([each.get(key) for each in tags], object) for key in keys]
        shapes = shapely.force_3d(shapes, 7.0) if rng.random() < 0.4 else shapes
        given = {"driver": driver, "geometry_type": "Unknown" if count == 4 else "LineString", "crs": crs}
        wkb = shapely.to_wkb(shapes, output_dimension=3)
        pyogrio.raw.write(path, wkb, values, list(keys), layer="map", **given)
    if driver == "GeoJSON" and rng.random() < 0.5:
        path.write_bytes(b"\xef\xbb\xbf\r\n" + path.read_bytes())
    if driver == "ESRI Shapefile" and rng.random() < 0.3:
        path.with_suffix(str(rng.choice([".shx", ".cpg"]))).unlink(missing_ok=True)
    if is_damaged := rng.random() < 0.5:
        path.write_bytes(damaged(path.read_bytes(), rng))
    elif rng.random() < 0.2:
        path.write_bytes(gzip.compress(path.read_bytes()))
        path = path.rename(path.with_name(path.name + ".gz"))
    detect_kind(path)
    traced = sketch_from_vectors(path, size_px=64)
    told = tuple(note for note in traced.notes if any(word in note for word in LOSSES))
    found = sorted(name for name, layer in traced.sketch.vectors.items() for _ in range(len(layer)))
    if is_damaged:
        return "" if len(found) >= count else f"damaged {driver}: {found}", told
    if found != sorted(list(LAYER_OF.values())[:count]):
        return f"{driver}: {found}", ()
    (properties,) = traced.sketch.vectors["river"].properties([0])
    if abs(float(properties.get("width", 0.0)) - WIDTHS[width]) > 0.01:
        return f"{driver}: width {width}: {properties}", tuple(each for each in traced.notes if width in each)
    island = len(shapely.get_rings(traced.sketch.vectors["lake"].shapes())) - 1 if count == 4 else 0
    is_right = properties["name"] == "Öre 湖" and island == (count == 4 and driver != "OSM")
    return "" if is_right else f"{driver}: {properties}, islands: {island}", ()


def openstreetmap(shapes: Any, tags: list[dict[str, str]]) -> str:
    """Return ways as OpenStreetMap's XML."""
    nodes, ways = "", ""
    for number, (shape, each) in enumerate(zip(shapes, tags, strict=True), start=1):
        ring = getattr(shape, "exterior", shape)
        at = [f"{number}{n:03d}" for n in range(len(ring.coords))]
        for n, (x, y) in zip(at, ring.coords, strict=True):
            nodes += f'<node id="{n}" lat="{y}" lon="{x}"/>'
        refs = "".join(f'<nd ref="{n}"/>' for n in (at if shape is ring else [*at[:-1], at[0]]))
        ways += f'<way id="{number}">{refs}'
        ways += "".join(f"<tag k={quoteattr(k)} v={quoteattr(v)}/>" for k, v in each.items()) + "</way>"
    return f'<?xml version="1.0" encoding="UTF-8"?><osm version="0.6">{nodes}{ways}</osm>'


def layers(rng: Rng, folder: Path, _: KnownMap) -> tuple[str, Notes]:
    """Layers as paint programs save them: other palettes, modes and depths, or damaged."""
    labels = rng.choice(np.array([0, 0, 0, 1, 2, 3], np.uint8), (24, 30))
    path = folder / "mountain.png"
    path.write_bytes(encode_layer(labels, LAYERS["mountain"].colour))
    own = Image.open(path)
    order = rng.permutation(256).astype(np.uint8)
    palette = np.zeros((256, 3), np.uint8)
    palette[order] = np.array(own.getpalette(), np.uint8).reshape(256, 3)
    exchanged = Image.fromarray(order[labels])  # the same picture, its entries in another order
    exchanged.putpalette(palette.ravel().tolist())
    kinds, picture = {"palette": Image.Palette.ADAPTIVE}, own.convert("RGB")
    ways = {mode: picture.convert(mode, **kinds) for mode in ("RGB", "RGBA", "P")} | {"exchanged": exchanged}
    ways |= {"16 bits": Image.fromarray(labels.astype(np.uint16)), "grey": Image.fromarray(labels)}
    ways["1 bit"] = Image.fromarray((labels > 0).astype(np.uint8) * 255).convert("1")
    way = str(rng.choice([*ways, "damaged"]))
    if way == "damaged":
        path.write_bytes(damaged(path.read_bytes(), rng))
    else:
        ways[way].save(path)
        labels = np.minimum(labels, 1 if way == "1 bit" else 3)
    (folder / "sketch.toml").write_text("format = 2\n")
    found = load_sketch(folder).layers["mountain"]
    return "" if np.array_equal(found, labels) else f"{way}: {int((found != labels).sum())} labels", ()


ODD = ("1e400", "true", "[[1]]", "'ä'", "nan", "1_0", "+3.0", "0x10", "{ x = 1 }", "''", "1979-05-27")


def settings(rng: Rng, folder: Path, _: KnownMap) -> tuple[str, Notes]:
    """A setting of a label, or of a sweep, in any spelling and encoding."""
    name = str(rng.choice([layer for layer in LAYERS if LAYERS[layer].is_painted]))
    key, parameter = list(LAYERS[name].parameters.items())[rng.integers(len(LAYERS[name].parameters))]
    value = parameter.default if parameter.choices or rng.random() < 0.3 else parameter.high
    is_odd, is_sweep = rng.random() < 0.4, rng.random() < 0.3
    text = str(rng.choice(ODD)) if is_odd else repr(value)
    forms = (
        f"[{name}.1]\n{key} = {text}",
        f"{name}.1.{key} = {text}",
        f"{name} = {{ 1 = {{ {key} = {text} }} }}",
    )
    body = f"[set]\n{name}.1.{key} = {text}" if is_sweep else f"format = 2\n{forms[rng.integers(3)]}"
    path = folder / ("sweep.toml" if is_sweep else "sketch.toml")
    code = str(rng.choice(["utf-8", "utf-8-sig", "utf-8", "utf-16", "latin-1"]))
    path.write_bytes(body.replace("\n", str(rng.choice(["\n", "\r\n"]))).encode(code))
    Image.fromarray(np.ones((4, 4), np.uint8)).save(folder / f"{name}.png")
    if is_sweep:
        found: Any = {each.name: each.values[0] for each in read_sweep(path).settings}[f"{name}.1.{key}"]
    else:
        found = load_sketch(folder).properties(name, 1)[key]
    wanted = {"1_0": 10, "+3.0": 3, "0x10": 16}.get(text) if is_odd else value
    return "" if found == wanted else f"{name}.{key} = {text}: {found}", ()


READERS = {rasters: 110, pictures: 40, vectors: 80, layers: 40, settings: 30}


def cpu() -> float:
    own, children = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime


@pytest.mark.soak
@pytest.mark.filterwarnings("ignore")  # of the libraries that write the files
@pytest.mark.parametrize(("reader", "count"), READERS.items(), ids=[each.__name__ for each in READERS])
def test_nothing_is_lost_without_a_word(reader, count, tmp_path, known) -> None:
    wrong = []
    for number in range(count):
        folder, began, lost = tmp_path / str(number), cpu(), ""
        folder.mkdir()
        try:
            lost, notes = reader(np.random.default_rng([51, number]), folder, known)
            lost *= not notes
        except SketchterrainError as error:
            if not str(error).isprintable() or len(str(error)) > 500:
                lost = f"not one line: {error!r}"
            if number and cpu() - began > MOST_CPU:  # the first one starts processes and imports
                lost = f"refused after {cpu() - began:.1f} s: {error}"
        except Exception as error:  # noqa: BLE001 # any is a defect
            lost = repr(error)
        wrong += [f"{number}: {lost}"] * bool(lost)
        shutil.rmtree(folder)
    assert wrong == []
