"""Synthetic layers to drape, and the exact coverage of pixels by them on the drawn ground."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
import pyogrio.raw
import shapely

from sketchterrain.array_types import BoolArray, Float64Array

SEED: Final = 29
PAPER_RASTER: Final = (28_800, 72_000)
"""Pixels of the raster of the two-step draping paper: 10° × 4° of Landsat."""
_PICTURE = 4096  # px along the file that a large raster repeats
_BATCH = 1 << 18  # points

Shapes = npt.NDArray[np.object_]


def random_lines(count: int, extent: float, *, points: int = 6, step: float = 25.0) -> Shapes:
    """Return lines of so many points that wander through a square of a width (m)."""
    random = np.random.default_rng(SEED)
    start = random.uniform(0.0, extent, (count, 1, 2))
    heading = random.uniform(0.0, 2.0 * np.pi, (count, 1)) + np.cumsum(
        random.normal(0.0, 0.5, (count, points - 1)), axis=1
    )
    steps = step * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    vertices = np.concatenate([start, start + np.cumsum(steps, axis=1)], axis=1)
    owner = np.repeat(np.arange(count), points)
    return np.asarray(shapely.linestrings(vertices.reshape(-1, 2), indices=owner), object)


def random_areas(count: int, extent: float, *, radius: float = 20.0, corners: int = 7) -> Shapes:
    """Return star-shaped areas of about a radius (m) in a square of a width (m)."""
    random = np.random.default_rng(SEED + 1)
    middle = random.uniform(0.0, extent, (count, 1, 2))
    turn = (np.arange(corners) + random.uniform(0.0, 1.0, (count, corners))) * (2.0 * np.pi / corners)
    away = radius * random.uniform(0.4, 1.3, (count, corners))
    ring = middle + away[..., None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    ring = np.concatenate([ring, ring[:, :1]], axis=1)
    owner = np.repeat(np.arange(count), corners + 1)
    rings = shapely.linearrings(ring.reshape(-1, 2), indices=owner)
    return np.asarray(shapely.polygons(rings), object)


def write_layer(path: Path, shapes: Shapes, crs: str | None = None) -> Path:
    """Write shapes as a FlatGeobuf or GeoPackage file, with a number and a name as properties."""
    number = np.arange(len(shapes), dtype=np.int64)
    names = np.array([f"feature {each}" for each in number], object)
    kind = "Polygon" if len(shapes) and shapely.get_type_id(shapes[0]) == 3 else "LineString"
    driver = "GPKG" if path.suffix == ".gpkg" else "FlatGeobuf"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a file without a CRS
        pyogrio.raw.write(
            *(path, shapely.to_wkb(shapes), [number, names], ["number", "name"]),
            driver=driver,
            geometry_type=kind,
            crs=crs,
            layer_options={} if driver == "GPKG" else {"SPATIAL_INDEX": "NO"},  # keeps the order
        )
    return path


def write_raster(path: Path, bounds: tuple[float, float, float, float]) -> Path:
    """Write a VRT of `PAPER_RASTER` pixels that repeats a picture, in bounds west, south, east, north (m)."""
    import rasterio
    from rasterio.enums import Resampling

    picture = path.with_suffix(".tif")
    at = np.arange(_PICTURE, dtype=np.float32) * np.float32(2.0 * np.pi / _PICTURE)
    wave = np.sin(7.0 * at)[:, None] * np.sin(11.0 * at)[None, :]
    bands = [np.uint8(120.0 + 100.0 * scale * wave) for scale in (1.0, 0.6, -0.8)]
    options = {"driver": "GTiff", "tiled": True, "compress": "deflate", "photometric": "RGB"}
    sides = {"width": _PICTURE, "height": _PICTURE, "count": 3, "dtype": "uint8"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a file without a georeference
        with rasterio.open(picture, "w", **sides, **options) as file:
            file.write(np.stack(bands))
            file.build_overviews([2, 4, 8, 16, 32], Resampling.average)
    columns, rows = PAPER_RASTER
    x, y = np.meshgrid(np.arange(0, columns, _PICTURE), np.arange(0, rows, _PICTURE))
    west, south, east, north = bounds
    transform = f"{west}, {(east - west) / columns!r}, 0, {north}, 0, {(south - north) / rows!r}"
    lines = [f'<VRTDataset rasterXSize="{columns}" rasterYSize="{rows}">']
    lines += [f"<GeoTransform>{transform}</GeoTransform>"]
    for band, colour in enumerate(("Red", "Green", "Blue"), 1):
        lines += [f'<VRTRasterBand dataType="Byte" band="{band}"><ColorInterp>{colour}</ColorInterp>']
        for left, top in zip(x.ravel().tolist(), y.ravel().tolist(), strict=True):
            wide, high = min(_PICTURE, columns - left), min(_PICTURE, rows - top)
            size = f'xSize="{wide}" ySize="{high}"'
            lines += [
                f'<SimpleSource><SourceFilename relativeToVRT="1">{picture.name}</SourceFilename>',
                f'<SourceBand>{band}</SourceBand><SrcRect xOff="0" yOff="0" {size}/>',
                f'<DstRect xOff="{left}" yOff="{top}" {size}/></SimpleSource>',
            ]
        lines.append("</VRTRasterBand>")
    path.write_text("\n".join([*lines, "</VRTDataset>"]))
    return path


def inside(shapes: Shapes, points: Float64Array) -> BoolArray:
    """Return which of (n, 2) points are within any of some areas, (n,)."""
    tree = shapely.STRtree(shapes)
    found = np.zeros(len(points), np.bool_)
    for first in range(0, len(points), _BATCH):
        part = slice(first, first + _BATCH)
        at, _ = tree.query(shapely.points(points[part]), predicate="intersects")
        found[first + np.unique(at)] = True
    return found


def exact_coverage(shapes: Shapes, ground: Float64Array, samples: int) -> Float64Array:
    """Return the share of pixels (rows, columns) that areas cover.

    `ground` has the places (rows × samples, columns × samples, 2), m, of the ground that is drawn at samples²
    places of each pixel; NaN is sky.
    """
    rows, columns = (side // samples for side in ground.shape[:2])
    flat = ground.reshape(-1, 2)
    seen = np.isfinite(flat[:, 0])
    hit = np.zeros(len(flat))
    hit[seen] = inside(shapes, flat[seen])
    return np.asarray(hit.reshape(rows, samples, columns, samples).mean(axis=(1, 3)))


def edge_error(found: Float64Array, exact: Float64Array, *, reach: int = 2) -> Float64Array:
    """Return by how many px edges are displaced, at the pixels (n,) that the exact edges cross.

    A straight edge that is moved by d changes the sum over a square of 2 reach + 1 px by d times its side;
    blur within the square does not.
    """
    side = 2 * reach + 1
    windows = [
        np.lib.stride_tricks.sliding_window_view(each, (side, side)).sum(axis=(2, 3))
        for each in (found, exact)
    ]
    inner = exact[reach:-reach, reach:-reach]
    is_edge = (inner > 0.02) & (inner < 0.98)
    return np.asarray(np.abs(windows[0] - windows[1])[is_edge] / side)
