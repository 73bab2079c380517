"""Frame and samples of a map, and its shaded relief."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt
from contourpy import LineType, contour_generator
from scipy.ndimage import gaussian_filter, map_coordinates

from sketchterrain.export.map.drawing import Box, Points
from sketchterrain.export.vectors import land_shares
from sketchterrain.generation.terrain import Terrain
from sketchterrain.schema.layers import LAND_USES, LAYERS
from sketchterrain.schema.materials import Material, MaterialTable
from sketchterrain.schema.styles import rgb_from_hex

Grid: TypeAlias = npt.NDArray[np.float32]

MAX_SIDE: Final = 275.0  # mm of the map's longer side, for A3
MARGIN, TOP = 12.5, 28.0  # mm from the sheet's edges to the map
MIN_WIDTH: Final = 160.0  # mm of the sheet, for the legend
SCALES: Final = (1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.5, 8.0)

LAND_CLASSES: Final = {str(each.value): each for each in LAYERS["landuse"].classes if each.value != "forest"}
"""Classes by use; forests are drawn where the ground's material says so."""

STEP, SMOOTH = 0.2, 0.5  # mm between samples; mm, cell size of the heights for contours
COVER_SIGMA: Final = 0.45  # mm, blur of materials against speckles

_DRY: Final = np.float32(-1e6)  # m of depth where there is no water
LIGHTS: Final = ((315.0, 0.46), (270.0, 0.2), (0.0, 0.2), (225.0, 0.14))
"""Azimuth (degrees) and weight of each light: after Mark (1992), with more weight in the north-west."""
ELEVATION: Final = np.radians(45.0)  # of all lights
SIZES: Final = ((0.0, 0.5), (3.0, 0.3), (12.0, 0.2))  # blur (samples) and weight of each scale of landforms
STEEP, EXAGGERATION = 0.9, (0.8, 6.0)  # target of the 90th percentile of slope; limits of the factor
SHADOW: Final = np.array([0.55, 0.55, 0.66], np.float32)  # factors of colour in full shadow
LIGHT, LIGHT_SHARE = np.array([255.0, 252.0, 236.0], np.float32), 0.55  # and its opacity on slopes facing it
HOLLOW, HOLLOW_SIZE = 0.16, 9.0  # darkening of the deepest hollows; their size (samples)
LOW, HIGH = np.array([[0.93, 0.965, 0.935], [1.05, 1.02, 0.99]], np.float32)
"""Factors of colour at the lowest and the highest terrain."""
FAINT: Final = 0.78  # contrast of the lowest over the highest terrain: aerial perspective (Imhof 1965)


@dataclass(frozen=True)
class MapFrame:
    """Position, extent and scale of a map on the sheet."""

    left: float  # mm, north-west corner on the sheet
    top: float
    east: float  # m, extent
    north: float
    scale: float  # 1 : n
    corner: tuple[float, float] = (0.0, 0.0)  # coordinates (m) of the south-west corner …
    crs: str = ""  # … in a CRS; empty: from the corner

    @property
    def mm_per_metre(self) -> float:
        """Length of a metre on the sheet (mm)."""
        return 1000.0 / self.scale

    @property
    def box(self) -> Box:
        """Box of the map on the sheet (mm)."""
        return self.left, self.top, self.east * self.mm_per_metre, self.north * self.mm_per_metre

    def to_sheet(self, points: npt.ArrayLike) -> Points:
        """Convert points (…, ≥ 2) x, y (m) to the sheet: (…, 2) mm, y down."""
        point = np.asarray(points, np.float64)
        x = self.left + point[..., 0] * self.mm_per_metre
        y = self.top + (self.north - point[..., 1]) * self.mm_per_metre
        return np.stack([x, y], axis=-1)


@dataclass(frozen=True, eq=False)
class MapSamples:
    """Samples (rows, columns) of the terrain at the vertices of a grid over the sketch, row 0 north."""

    frame: MapFrame
    spacing: tuple[float, float]  # m between columns and between rows
    height: Grid  # m, at the cell size of the samples
    smooth: Grid  # m, at a coarser cell size, for contours
    cell_size: float  # m, of the smooth heights
    depth: Grid  # m of water in lakes, negative elsewhere
    sea_depth: Grid  # m of water in the sea, negative elsewhere
    cover: Grid  # weights of the materials (rows, columns, materials), blurred
    materials: MaterialTable
    land: Grid | None = None  # shares of `LAND_USES` (rows, columns, uses)

    @cached_property
    def water(self) -> Grid:
        """Depth of any water (m), negative on land."""
        return np.maximum(self.depth, self.sea_depth)

    @cached_property
    def slope(self) -> tuple[Grid, Grid, Grid]:
        """Rise over run of the smooth heights: eastward, northward, and steepest."""
        return _slopes(self.smooth, self.spacing)

    def cover_weight(self, chosen: Callable[[Material], bool]) -> Grid:
        """Return the total weight of the materials that are chosen, (rows, columns)."""
        weights = (self.cover[..., index] for index, each in enumerate(self.materials) if chosen(each))
        return np.asarray(sum(weights), np.float32)

    def metres(self, row: float, column: float) -> tuple[float, float]:
        """Return x, y (m) of a sample."""
        return column * self.spacing[0], (len(self.height) - 1 - row) * self.spacing[1]

    def interpolate(self, field: npt.NDArray[np.floating], points: Points) -> Points:
        """Interpolate a field at points (n, ≥ 2) x, y (m)."""
        index = [len(self.height) - 1 - points[:, 1] / self.spacing[1], points[:, 0] / self.spacing[0]]
        return np.asarray(map_coordinates(field, index, np.float64, order=1, mode="nearest"))

    def isolines(self, field: Grid, levels: list[float], *, border: int = 0) -> list[list[Points]]:
        """Return lines x, y (m) of each level of a field, which may have a border of more samples."""
        rows, columns = field.shape
        x = (np.arange(columns) - border) * self.spacing[0]
        y = (rows - 1 - border - np.arange(rows)) * self.spacing[1]
        generator = contour_generator(x, y, field, name="serial", line_type=LineType.Separate)
        return [generator.lines(level) for level in levels]


def fit_frame(size: tuple[float, float], place: Mapping[str, Any] | None = None) -> MapFrame:
    """Return the frame for a sketch of a size (m), at a `[frame]`, at the largest round scale that fits."""
    scale = nearest_round(max(size) * 1000.0 / MAX_SIDE, steps=SCALES, up=True)
    left = max(MARGIN, (MIN_WIDTH - size[0] * 1000.0 / scale) / 2.0)
    corner = (place["east"], place["north"]) if place and place["crs"] else (0.0, 0.0)
    return MapFrame(left, TOP, *size, scale, corner, place["crs"] if place else "")


def nearest_round(number: float, *, steps: tuple[float, ...] = (1.0, 2.0, 5.0), up: bool = False) -> float:
    """Return the nearest step times a power of ten, by ratio; with `up` the least one not below."""
    power = np.floor(np.log10(number))
    choices = np.array([step * 10.0 ** (power + shift) for shift in (-1, 0, 1) for step in steps])
    if up:
        return float(choices[choices >= number * (1.0 - 1e-9)].min())
    return float(choices[np.argmin(np.abs(np.log(choices / number)))])


def sample_map(terrain: Terrain, frame: MapFrame) -> MapSamples:
    """Sample a terrain at the resolution of its map."""
    raster = terrain.raster(max(round(max(frame.box[2:]) / STEP), 64) + 1)
    rows, columns = raster.height.shape
    cell = SMOOTH / frame.mm_per_metre
    x = np.arange(columns, dtype=np.float64) * raster.spacing[0]
    y = np.arange(rows, dtype=np.float64)[::-1] * raster.spacing[1]
    smooth = terrain.heights(x[None, :], y[:, None], cell_size=cell)
    cover = np.empty_like(raster.materials)
    for material in range(cover.shape[-1]):
        gaussian_filter(raster.materials[..., material], COVER_SIGMA / STEP, output=cover[..., material])
    sea = np.full_like(smooth, _DRY) if terrain.sea_level is None else terrain.sea_level - smooth
    depths = (_lake_depth(terrain, smooth, x, y), sea)
    land = None
    if len(terrain.sketch.vectors["landuse"]):
        land = land_shares(terrain.sketch, raster.spacing, raster.height.shape)
    return MapSamples(
        *(frame, raster.spacing, raster.height, smooth, cell, *depths, cover, terrain.materials, land)
    )


def shaded_relief(samples: MapSamples) -> npt.NDArray[np.uint8]:
    """Return the terrain's colours with multidirectional hillshading: (rows, columns, 3), row 0 north."""
    tints = np.array([each.tint for each in samples.materials], np.float32)
    colour = samples.cover @ tints / np.maximum(samples.cover.sum(axis=-1, keepdims=True), 1e-6)
    if samples.land is not None:
        styles = [each.style for each in LAND_CLASSES.values()]
        land = np.array([rgb_from_hex(each["fill"]) for each in styles], np.float32)
        shares = samples.land[..., [LAND_USES.index(name) for name in LAND_CLASSES]]
        shares = shares * np.array([each["fill_opacity"] for each in styles], np.float32)
        colour += shares @ land - shares.sum(axis=-1, keepdims=True) * colour
    rise = _rise(samples.height)[..., None]
    colour *= LOW + rise * (HIGH - LOW)
    lit = _light(samples)[..., None]
    flat = np.float32(np.sin(ELEVATION))
    contrast = FAINT + (1.0 - FAINT) * rise
    colour *= 1.0 - np.clip((flat - lit) / flat * contrast, 0.0, 1.0) * (1.0 - SHADOW)
    colour += LIGHT_SHARE * np.clip((lit - flat) / (1.0 - flat) * contrast, 0.0, 1.0) * (LIGHT - colour)
    under = np.maximum(gaussian_filter(samples.height, HOLLOW_SIZE) - samples.height, 0.0)[..., None]
    colour *= 1.0 - HOLLOW * np.clip(under / max(float(np.percentile(under, 99.0)), 1e-6), 0.0, 1.0)
    return np.asarray(np.clip(np.rint(colour), 0, 255), np.uint8)


def _lake_depth(terrain: Terrain, height: Grid, x: Points, y: Points) -> Grid:
    """Return the depth of lakes (m), falling with the distance outside of their painted shapes."""
    depth = np.full(height.shape, _DRY, np.float32)
    for lake in terrain.features.lakes:
        field = lake.shape
        column, row = (x - field.west) / field.spacing, (y - field.south) / field.spacing
        columns = np.flatnonzero((column >= 0) & (column <= field.inside.shape[1] - 1))
        rows = np.flatnonzero((row >= 0) & (row <= field.inside.shape[0] - 1))
        index = np.meshgrid(row[rows], column[columns], indexing="ij")
        # Water extends at most two samples beyond the painted shape.
        inside = map_coordinates(field.inside, index, np.float64, order=1) + 2.0 * field.spacing
        there = np.ix_(rows, columns)
        depth[there] = np.maximum(depth[there], np.minimum(lake.level - height[there], inside))
    return depth


def _rise(height: Grid) -> Grid:
    """Return relative elevation, 0 … 1: the mean of normalised height and percentile rank."""
    share = np.linspace(0.0, 1.0, 65)
    steps = np.quantile(height, share)
    rank = np.interp(height, steps, share)
    part = (height - steps[0]) / max(float(steps[-1] - steps[0]), 1e-6)
    return np.asarray(0.5 * rank + 0.5 * part, np.float32)


def _light(samples: MapSamples) -> Grid:
    """Return the weighted mean cosine of incidence over all lights and scales of landforms."""
    total = np.zeros(samples.height.shape, np.float32)
    up, level = np.sin(ELEVATION), np.cos(ELEVATION)
    for sigma, share in SIZES:
        height = gaussian_filter(samples.height, sigma) if sigma else samples.height
        east, north, steep = _slopes(height, samples.spacing)
        times = np.float32(np.clip(STEEP / max(float(np.percentile(steep, 90.0)), 1e-6), *EXAGGERATION))
        east, north, length = east * times, north * times, np.hypot(1.0, steep * times)
        for bearing, part in LIGHTS:
            x, y = np.sin(np.radians(bearing)) * level, np.cos(np.radians(bearing)) * level
            lit = (np.float32(up) - east * np.float32(x) - north * np.float32(y)) / length
            total += np.float32(share * part) * np.maximum(lit, 0.0)
    return total


def _slopes(height: Grid, spacing: tuple[float, float]) -> tuple[Grid, Grid, Grid]:
    """Return the rise over run eastward, northward, and along the steepest slope."""
    south, east = (np.asarray(part, np.float32) for part in np.gradient(height, spacing[1], spacing[0]))
    return east, -south, np.hypot(east, south)
