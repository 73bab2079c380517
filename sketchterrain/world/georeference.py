"""Georeferencing of a world: GDAL's transforms, and the attributes of a Zarr store.

xarray, rioxarray and GDAL look for the grid mapping and the coordinates of the CF conventions ("Grid Mappings
and Projections"), newer programs for the Zarr conventions ``proj:``, ``spatial:`` and ``multiscales``
(github.com/zarr-conventions, release 0.1), as GDAL 3.13 does (its documentation: "Zarr").
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from rasterio import Affine
from rasterio.crs import CRS
from rasterio.enums import WktVersion

from sketchterrain.export.geotiff import local_metres
from sketchterrain.metric_crs import parse_metric_crs
from sketchterrain.world.grid import SHARD, Level, Shard
from sketchterrain.world.job import Job

GRID_MAPPING: Final = "spatial_ref"
"""The array of each level that carries the coordinate reference system."""

_CONVENTIONS: Final = {  # identifier and description
    "multiscales": "d35379db-88df-4056-af3a-620245f8e347 Multiscale layout of zarr datasets",
    "proj": "f17cb550-5864-4468-aeb7-f3180cfb622f "
    "Coordinate reference system information for geospatial data",
    "spatial": "689b58e2-cf7b-45e0-9fff-9cfc0883d6b4 Spatial coordinate information",
}
_CODE = re.compile(r"[A-Z]+:[0-9]+")  # what ``proj:code`` may hold


@dataclass(frozen=True, eq=False)
class Georeference:
    """Where the vertices of a job's levels lie."""

    job: Job

    @cached_property
    def crs(self) -> CRS:
        """The job's coordinate reference system, or local metres that lie nowhere on Earth."""
        return local_metres() if self.job.crs is None else parse_metric_crs(self.job.crs)

    def transform(self, level: Level, shard: Shard | None = None) -> Affine:
        """Return the transform of a level or of one of its shards.

        Pixels are centred at vertices, and a transform maps corners of pixels: it begins half a cell
        north-west of the first vertex.
        """
        row, column = (0, 0) if shard is None else (shard.row * SHARD, shard.column * SHARD)
        (east, north), world, cell = self.job.origin, self.job.world, level.cell
        west = east + world.west + (column - 0.5) * cell
        return Affine(cell, 0.0, west, 0.0, -cell, north + world.north - (row - 0.5) * cell)

    def coordinates(self, axis: str, level: Level) -> npt.NDArray[np.float64]:
        """Return coordinates of columns along ``x``, eastward, or of rows along ``y``, southward."""
        (east, north), world = self.job.origin, self.job.world
        steps = np.arange(level.columns if axis == "x" else level.rows, dtype=np.float64) * level.cell
        return east + (world.west + steps) if axis == "x" else north + (world.north - steps)

    def root_attributes(self) -> dict[str, Any]:
        """Return the attributes of the root group: the pyramid."""
        levels = self.job.world.levels
        layout = [{"asset": "0", "transform": {"scale": [1.0, 1.0]}} | self._grid(levels[0])]
        for level in levels[1:]:
            source = {"asset": str(level.number), "derived_from": str(level.number - 1)}
            layout.append(source | {"transform": {"scale": [2.0, 2.0]}} | self._grid(level))
        return {
            "zarr_conventions": _conventions("multiscales", "proj", "spatial"),
            "multiscales": {"layout": layout},
            "spatial:dimensions": ["y", "x"],
            "spatial:bbox": self._bounds(levels[0]),
            **self._projection,
        }

    def group_attributes(self, level: Level) -> dict[str, Any]:
        """Return the attributes of a level's group."""
        return {
            "cell": level.cell,
            "zarr_conventions": _conventions("proj", "spatial"),
            "spatial:dimensions": ["y", "x"],
            "spatial:bbox": self._bounds(level),
            **self._grid(level),
            **self._projection,
        }

    def mapping_attributes(self, level: Level) -> dict[str, Any]:
        """Return the attributes of a level's array `GRID_MAPPING`."""
        wkt = self.crs.to_wkt()
        gdal = " ".join(map(repr, self.transform(level).to_gdal()))
        return {"crs_wkt": wkt, "spatial_ref": wkt, "GeoTransform": gdal}

    def _grid(self, level: Level) -> dict[str, Any]:
        transform = list(self.transform(level))[:6]
        return {"spatial:shape": [level.rows, level.columns], "spatial:transform": transform}

    def _bounds(self, level: Level) -> list[float]:
        cell, _, west, _, _, north = list(self.transform(level))[:6]
        return [west, north - level.rows * cell, west + level.columns * cell, north]

    @cached_property
    def _projection(self) -> dict[str, Any]:
        code = ":".join(self.crs.to_authority() or ())
        # The convention wants exactly one of them.
        if _CODE.fullmatch(code):
            return {"proj:code": code}
        return {"proj:wkt2": self.crs.to_wkt(version=WktVersion.WKT2_2019)}


def axis_attributes(name: str) -> dict[str, Any]:
    """Return the attributes of the coordinates along ``x`` or ``y``."""
    long_name = {"x": "easting", "y": "northing"}[name] + " of the vertices"
    standard_name = f"projection_{name}_coordinate"
    return {"standard_name": standard_name, "long_name": long_name, "units": "m", "axis": name.upper()}


def _conventions(*names: str) -> list[dict[str, str]]:
    """Return the declaration that attributes follow conventions, as their pages on GitHub ask for it."""
    raw, pages = "https://raw.githubusercontent.com/zarr-conventions", "https://github.com/zarr-conventions"
    return [
        {
            "schema_url": f"{raw}/{name}/refs/tags/v0.1/schema.json",
            "spec_url": f"{pages}/{name}/blob/v0.1/README.md",
            "uuid": _CONVENTIONS[name].partition(" ")[0],
            "name": name,
            "description": _CONVENTIONS[name].partition(" ")[2],
        }
        for name in names
    ]
