"""The layers of a world as GeoTIFFs have them: bands, where they lie, and how their blocks are packed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

from sketchterrain.terrain.materials import MATERIALS
from sketchterrain.world.grid import CHUNK, SHARD
from sketchterrain.world.tiff_directory import TILE_BYTES, TILE_OFFSETS, read_directories

if TYPE_CHECKING:
    from rasterio import Affine
    from rasterio.crs import CRS

    from sketchterrain.world.grid import Level, Shard
    from sketchterrain.world.job import Job
    from sketchterrain.world.tiff_directory import Tag

__all__ = ["DOMAIN", "TIFF_LAYERS", "Georeference", "TiffLayer"]

DOMAIN: Final = "sketchterrain"
"""GDAL's metadata domain for what a world is known by."""

# A level of 6 takes twice the time to save a fiftieth. Weights are mostly 0 or 255: differences only cost.
_LOSSLESS: Final[dict[str, Any]] = {
    "compress": "deflate",
    "zlevel": 1,
    "interleave": "pixel",
    "num_threads": 1,
}
_BLOCKS: Final = {"tiled": True, "blockxsize": CHUNK, "blockysize": CHUNK}
_OF_ITS_PIXELS: Final = (254, 256, 257, TILE_OFFSETS, TILE_BYTES)  # what is told anew of each image


@dataclass(frozen=True)
class TiffLayer:
    """A layer as bands.

    Attributes
    ----------
    name : str
        One of `LAYERS`.
    bands : tuple of str
        Names of the bands.
    dtype : str
        NumPy's name of the type.
    predictor : int
        TIFF's number for the differences that are compressed: 1 none, 2 of integers, 3 of floats.
    unit : str or None
    picture : bool
        Whether the bands are red, green and blue.
    shares : bool
        Whether the bands sum to 255 at each vertex.
    """

    name: str
    bands: tuple[str, ...]
    dtype: str
    predictor: int
    unit: str | None = None
    picture: bool = False
    shares: bool = False

    def profile(self, rows: int, columns: int) -> dict[str, Any]:
        """Return what GDAL's driver GTiff is told (its documentation: "GTiff -- GeoTIFF File Format")."""
        return {
            "driver": "GTiff",
            "width": columns,
            "height": rows,
            "count": len(self.bands),
            "dtype": self.dtype,
            "predictor": self.predictor,
            "photometric": "rgb" if self.picture else "minisblack",
            **_LOSSLESS,
            **_BLOCKS,
        }


TIFF_LAYERS: Final = {
    "height": TiffLayer("height", ("height",), "float32", 3, unit="m"),
    "normal": TiffLayer("normal", ("east", "north", "up"), "uint8", 2, picture=True),
    "materials": TiffLayer("materials", MATERIALS, "uint8", 1, shares=True),
}


@dataclass(frozen=True, eq=False)
class Georeference:
    """Where the vertices of a job lie.

    Attributes
    ----------
    job : Job
    """

    job: Job

    @cached_property
    def crs(self) -> CRS:
        """The job's coordinate reference system, or metres that lie nowhere on Earth."""
        from sketchterrain.export.geotiff import local_metres
        from sketchterrain.metric_crs import metric_crs

        return local_metres() if self.job.crs is None else metric_crs(self.job.crs)

    def transform(self, level: Level, *, row: int = 0, column: int = 0) -> Affine:
        """Return GDAL's transform of a window that begins at a vertex of a level.

        It speaks of the corners of pixels, so it begins half a cell north-west of that vertex.
        """
        from rasterio import Affine

        (east, north), world, cell = self.job.origin, self.job.world, level.cell
        west = east + world.west + (column - 0.5) * cell
        return Affine(cell, 0.0, west, 0.0, -cell, north + world.north - (row - 0.5) * cell)

    def of_shard(self, shard: Shard) -> Affine:
        """Return GDAL's transform of a shard."""
        level = self.job.world.levels[shard.level]
        return self.transform(level, row=shard.row * SHARD, column=shard.column * SHARD)

    def tags(
        self, layer: TiffLayer, transform: Affine, facts: dict[str, str] | None = None
    ) -> dict[int, Tag]:
        """Return a TIFF's tags that say where it lies and what its bands are, as GDAL writes them.

        Parameters
        ----------
        layer
        transform
        facts
            What stands in the domain `DOMAIN`.
        """
        from rasterio import Env
        from rasterio.enums import ColorInterp
        from rasterio.io import MemoryFile

        with Env(), MemoryFile() as memory:
            profile = layer.profile(CHUNK, CHUNK) | {"sparse_ok": True}
            with memory.open(**profile, crs=self.crs, transform=transform) as file:
                file.update_tags(AREA_OR_POINT="Point")
                if facts:
                    file.update_tags(ns=DOMAIN, **facts)
                if layer.picture:
                    file.colorinterp = (ColorInterp.red, ColorInterp.green, ColorInterp.blue)
                for index, name in enumerate(layer.bands, start=1):
                    file.set_band_description(index, name)
                    if layer.unit is not None:
                        file.set_band_unit(index, layer.unit)
            written = read_directories(memory.getbuffer())[0]
        return {number: tag for number, tag in written.items() if number not in _OF_ITS_PIXELS}

    def facts(self) -> dict[str, str]:
        """Return what a reader needs to find the levels, as texts that give the same numbers again."""
        world = self.job.world
        numbers = {"west": world.west, "south": world.south, "east": world.east, "north": world.north}
        made = {name: repr(float(number)) for name, number in (numbers | {"cell": world.cell}).items()}
        return made | {"layers": ",".join(self.job.layers), "materials": ",".join(MATERIALS)}
