"""Where a world in a Zarr store lies, told in the words of each reader.

xarray, rioxarray and GDAL look for the grid mapping and the coordinates of the CF conventions ("Grid Mappings
and Projections"), newer programs for the Zarr conventions ``proj:``, ``spatial:`` and ``multiscales``
(github.com/zarr-conventions, release 0.1), as the driver Zarr of GDAL 3.13 does (its documentation: "Zarr").
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt
    from rasterio.crs import CRS

    from sketchterrain.world.grid import Level, World
    from sketchterrain.world.job import Job

__all__ = ["GRID_MAPPING", "ZarrPlace"]

GRID_MAPPING = "spatial_ref"
"""The array of each level that carries the coordinate reference system."""

_CONVENTIONS = {
    "multiscales": ("d35379db-88df-4056-af3a-620245f8e347", "Multiscale layout of zarr datasets"),
    "proj": (
        "f17cb550-5864-4468-aeb7-f3180cfb622f",
        "Coordinate reference system information for geospatial data",
    ),
    "spatial": ("689b58e2-cf7b-45e0-9fff-9cfc0883d6b4", "Spatial coordinate information"),
}
_RELEASE = "v0.1"  # of these conventions
_CODE = re.compile(r"[A-Z]+:[0-9]+")  # what ``proj:code`` may hold


@dataclass(frozen=True)
class ZarrPlace:
    """The attributes that tell where the grids of a world lie.

    Attributes
    ----------
    world : World
    crs : str or None
        As in `Job`.
    origin : (float, float)
        As in `Job`.
    """

    world: World
    crs: str | None
    origin: tuple[float, float]

    @classmethod
    def of(cls, job: Job) -> ZarrPlace:
        """Return where a job's world lies."""
        return cls(job.world, job.crs, job.origin)

    def along(self, axis: str, level: Level, first: int, count: int) -> npt.NDArray[np.float64]:
        """Return coordinates of vertices along ``x`` or ``y``, in the coordinate reference system.

        Parameters
        ----------
        axis
        level
        first, count
            Columns along x, eastward; rows along y, southward.
        """
        steps = np.arange(first, first + count, dtype=np.float64) * level.cell
        if axis == "x":
            return self.origin[0] + (self.world.west + steps)
        return self.origin[1] + (self.world.north - steps)

    def root(self) -> dict[str, Any]:
        """Return what the root group says: the pyramid."""
        layout = []
        for level in self.world.levels:
            entry: dict[str, Any] = {"asset": str(level.number), "transform": {"scale": [1.0, 1.0]}}
            if level.number:
                entry |= {"derived_from": str(level.number - 1), "transform": {"scale": [2.0, 2.0]}}
            layout.append(entry | self._grid(level))
        return {
            "zarr_conventions": _conventions("multiscales", "proj", "spatial"),
            "multiscales": {"layout": layout},
            "spatial:dimensions": ["y", "x"],
            "spatial:bbox": self._bounds(self.world.levels[0]),
            **self._projection,
        }

    def group(self, level: Level) -> dict[str, Any]:
        """Return what a level's group says, for all its layers."""
        return {
            "zarr_conventions": _conventions("proj", "spatial"),
            "spatial:dimensions": ["y", "x"],
            "spatial:bbox": self._bounds(level),
            **self._grid(level),
            **self._projection,
        }

    def layer(self) -> dict[str, Any]:
        """Return what a layer's array says."""
        # What xarray makes a coordinate stays with an array that is taken out of its level.
        return {"grid_mapping": GRID_MAPPING, "coordinates": GRID_MAPPING}

    def mapping(self, level: Level) -> dict[str, Any]:
        """Return what the array `GRID_MAPPING` of a level says."""
        a, b, c, d, e, f = self._corner(level)
        wkt = self._crs.to_wkt()
        gdal = " ".join(repr(number) for number in (c, a, b, f, d, e))
        return {"crs_wkt": wkt, "spatial_ref": wkt, "GeoTransform": gdal}

    def axis(self, name: str) -> dict[str, Any]:
        """Return what the coordinates along ``x`` or ``y`` say."""
        return {
            "standard_name": f"projection_{name}_coordinate",
            "long_name": {"x": "easting", "y": "northing"}[name] + " of the vertices",
            "units": "m",
            "axis": name.upper(),
        }

    def _grid(self, level: Level) -> dict[str, Any]:
        return {"spatial:shape": [level.rows, level.columns], "spatial:transform": self._corner(level)}

    def _corner(self, level: Level) -> list[float]:
        """Return the affine transform of pixels whose middles are the vertices: it speaks of corners."""
        west, north = self._north_west(level)
        return [level.cell, 0.0, west, 0.0, -level.cell, north]

    def _bounds(self, level: Level) -> list[float]:
        west, north = self._north_west(level)
        return [west, north - level.rows * level.cell, west + level.columns * level.cell, north]

    def _north_west(self, level: Level) -> tuple[float, float]:
        """Return the outer corner of the pixel of vertex (0, 0)."""
        half = 0.5 * level.cell
        return self.origin[0] + self.world.west - half, self.origin[1] + self.world.north + half

    @cached_property
    def _crs(self) -> CRS:
        from sketchterrain.export.geotiff import local_metres
        from sketchterrain.metric_crs import metric_crs

        return local_metres() if self.crs is None else metric_crs(self.crs)

    @cached_property
    def _wkt(self) -> str:
        from rasterio.enums import WktVersion

        wkt: str = self._crs.to_wkt(version=WktVersion.WKT2_2019)
        return wkt

    @cached_property
    def _projection(self) -> dict[str, Any]:
        authority = self._crs.to_authority()
        code = "" if authority is None else ":".join(authority)
        # The convention wants one of them and no more.
        return {"proj:code": code} if _CODE.fullmatch(code) else {"proj:wkt2": self._wkt}


def _conventions(*names: str) -> list[dict[str, str]]:
    """Return what declares that attributes follow conventions, as their pages on GitHub ask for it."""
    found = []
    for name in names:
        uuid, description = _CONVENTIONS[name]
        place = f"zarr-conventions/{name}"
        found.append(
            {
                "schema_url": f"https://raw.githubusercontent.com/{place}/refs/tags/{_RELEASE}/schema.json",
                "spec_url": f"https://github.com/{place}/blob/{_RELEASE}/README.md",
                "uuid": uuid,
                "name": name,
                "description": description,
            }
        )
    return found
