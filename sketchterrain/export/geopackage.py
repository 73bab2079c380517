"""Layers of points, lines and areas as a GeoPackage, for a GIS."""

from __future__ import annotations

import sqlite3
from contextlib import closing, contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

from sketchterrain.errors import SketchterrainError, one_line
from sketchterrain.gdal_paths import plain_path

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    import numpy as np
    import numpy.typing as npt

__all__ = ["GeometryKind", "VectorLayer", "geopackage"]

GeometryKind = str
"""As OGR names it: ``Point Z``, ``LineString Z``, ``MultiPolygon Z``."""

# GDAL writes the time of the last change into the file: the same terrain shall be the same bytes.
_WHEN = {"OGR_CURRENT_DATE": "2000-01-01T00:00:00.000Z"}


class VectorLayer(NamedTuple):
    """Some features of a layer.

    Attributes
    ----------
    name : str
    kind : str
        See `GeometryKind`.
    geometry : (n,) object
        Shapely geometries of that kind.
    fields : dict of str to ndarray, (n,)
        Attributes by name: numbers, bool, or object arrays of str.
    """

    name: str
    kind: GeometryKind
    geometry: npt.NDArray[np.object_]
    fields: Mapping[str, npt.NDArray[Any]]


class GeoPackage:
    """A file that layers are added to; made by `geopackage`.

    Attributes
    ----------
    counts : dict of str to int
        Features of each layer.
    indexed : dict of str to int
        Those of them that are somewhere, and so in the layer's spatial index.
    """

    def __init__(self, path: Path, crs: str) -> None:
        self._path = path
        self._crs = crs
        self.counts: dict[str, int] = {}
        self.indexed: dict[str, int] = {}

    def add(self, layer: VectorLayer) -> None:
        """Write features of a layer, after those it has; a layer without any features is written too."""
        import pyogrio.raw
        import shapely

        with plain_path(self._path) as path:
            pyogrio.raw.write(
                path,
                shapely.to_wkb(layer.geometry, flavor="iso"),
                list(layer.fields.values()),
                list(layer.fields),
                layer=layer.name,
                driver="GPKG",
                geometry_type=layer.kind,
                crs=self._crs,
                append=self._path.exists(),
                layer_options={"GEOMETRY_NAME": "geom"},
            )
        somewhere = int((~shapely.is_empty(layer.geometry)).sum())
        self.counts[layer.name] = self.counts.get(layer.name, 0) + len(layer.geometry)
        self.indexed[layer.name] = self.indexed.get(layer.name, 0) + somewhere


@contextmanager
def geopackage(path: Path, crs: str) -> Iterator[GeoPackage]:
    """Yield a GeoPackage to add layers to; the same layers give the same bytes.

    By the driver GPKG of GDAL (its documentation: "GPKG -- GeoPackage vector"), with a spatial index a layer.
    A layer's first million points take 10 s, which are added to it later 16 s.

    Parameters
    ----------
    path
        Where nothing is yet.
    crs
        Coordinate reference system as WKT.

    Raises
    ------
    SketchterrainError
        If the system cannot write it.
    """
    import pyogrio
    from pyogrio.errors import DataLayerError, DataSourceError

    before = {key: pyogrio.get_gdal_config_option(key) for key in _WHEN}
    pyogrio.set_gdal_config_options(_WHEN)
    file = GeoPackage(path, crs)
    try:
        yield file
        _check(path, file)
    except (DataLayerError, DataSourceError, sqlite3.Error, OSError) as error:
        raise SketchterrainError(f"{one_line(path)}: cannot be written ({one_line(error)})") from error
    finally:
        pyogrio.set_gdal_config_options(before)


def _check(path: Path, file: GeoPackage) -> None:
    """Find out whether all came to the disk: what fails when a layer is closed, GDAL does not tell."""
    rows = {f"rtree_{name}_geom_rowid": count for name, count in file.indexed.items()} | file.counts
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as connection:
        tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master")}
        for table, count in rows.items():
            counted = f'SELECT count(*) FROM "{table}"'  # noqa: S608 # our own names
            if table not in tables or connection.execute(counted).fetchone() != (count,):
                raise OSError("not all of it came to the disk")
