"""The target `geotiff`: rasters as Cloud-Optimised GeoTIFF, and what was placed as a GeoPackage."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from sketchterrain.export.geotiff import NO_DATA, Place, local_metres, write_cloud_tiff
from sketchterrain.export.placed_layers import (
    GeoPackage,
    Origin,
    feature_layer,
    geopackage,
    lake_layer,
    plant_layer,
    river_layer,
    station_layer,
)
from sketchterrain.export.target import Export, ExportOptions, Target, Written
from sketchterrain.metric_crs import parse_metric_crs
from sketchterrain.terrain.plant import PLANT

_PLANTS_AT_ONCE = 1_000_000
_FIELDS = {
    "rivers": "length, width, depth: m; the mean, and at the spring and the mouth; z is the water",
    "river_stations": "distance from the spring, width, depth: m; river is the river's id",
    "lakes": "level, depth: m",
    "features": "radius: m; strength: m of height, of forests a share of the trees; wind: degrees, 0 north",
    "plants and grass": "scale: 1 is grown; rotation: degrees, counter-clockwise; tint: 0 to 1; "
    "level: a filter level >= n thins them evenly",
}
_LAYERS = {"plants": "woody", "grass": "grass"}  # and the storey in each


def _check(options: ExportOptions) -> None:
    if options.crs is not None:
        parse_metric_crs(options.crs)


def _write(export: Export) -> Written:
    crs = local_metres() if export.options.crs is None else parse_metric_crs(export.options.crs)
    place = Place(crs, *export.options.origin)
    with export.stages.stage("rasters", "Writing Cloud-Optimised GeoTIFF"):
        files = _rasters(export, place)
    vectors = export.folder / f"{export.name}.gpkg"
    with (
        export.stages.stage("vectors", "Writing the GeoPackage") as tell,
        geopackage(vectors, crs.to_wkt()) as file,
    ):
        _vectors(export, file, Origin(place.east, place.north), tell)
    files[vectors] = f"GeoPackage with the layers {', '.join(file.counts)}"
    transform = place.transform(export.grid)
    facts: dict[str, Any] = {
        "heights": {"numbers": "float32"},
        "byte_order": "little-endian",
        "axes": {"x": "east", "y": "north", "z": "up", "units": "m"},
        "crs": export.options.crs,
        "origin": list(export.options.origin),
        "samples": "vertices (AREA_OR_POINT=Point)",
        "geotransform": list(transform.to_gdal()),
        "no_data": NO_DATA,
        "layers": file.counts,
        "fields": _FIELDS,
    }
    settings = {
        "program": "QGIS, or any program that reads GDAL's formats",
        "rasters": "Layer > Add Layer > Add Raster Layer: band 1 of the heights is in metres",
        "vectors": "Layer > Add Layer > Add Vector Layer: every layer of the GeoPackage",
        "crs": export.options.crs or "none: metres from the sketch's south-west corner",
        "vertical_unit": "m",
    }
    return Written(files, settings, facts)


def _rasters(export: Export, place: Place) -> dict[Path, str]:
    sampled, names = export.sampled, export.terrain.material_names
    height, normal, weights = (
        export.folder / f"{export.name}_{what}.tif" for what in ("height", "normal", "materials")
    )
    grid = sampled.grid
    write_cloud_tiff(height, [sampled.height], ["height"], grid=grid, place=place, unit="m", no_data=NO_DATA)
    parts = [sampled.normal[..., axis] for axis in range(3)]
    write_cloud_tiff(normal, parts, ["east", "north", "up"], grid=grid, place=place, picture=True)
    shares = [sampled.weights[..., index] for index in range(len(names))]
    write_cloud_tiff(weights, shares, names, grid=grid, place=place)
    return {
        height: "heights, float32, m",
        normal: "normals: 0 is -1, 255 is 1; bands east, north, up",
        weights: f"weights of the materials, that sum to 255; bands {', '.join(names)}",
    }


def _vectors(export: Export, file: GeoPackage, origin: Origin, tell: Callable[[float], None]) -> None:
    terrain = export.terrain
    placed = terrain.features
    file.add(lake_layer(placed.lakes, origin))
    file.add(river_layer(placed.rivers, origin))
    file.add(station_layer(placed.rivers, origin))
    height = terrain.heights(placed.points["x"], placed.points["y"], cell_size=max(export.grid.spacing))
    file.add(feature_layer(placed.points, height, origin))
    wanted = {"plants": export.options.plants, "grass": export.options.grass}
    layers = [name for name in _LAYERS if wanted[name]]
    _, south, _, north = export.grid.area
    for index, name in enumerate(layers):
        for plants in _gathered(terrain.foliage_pieces(*export.grid.area, storey=_LAYERS[name])):
            file.add(plant_layer(name, plants, terrain.species_names, origin))
            if len(plants):  # they come in rows from south to north
                done = (float(plants["y"].max()) - south) / (north - south)
                tell((index + min(done, 1.0)) / len(layers))
        if name not in file.counts:
            file.add(plant_layer(name, np.zeros(0, PLANT), terrain.species_names, origin))


def _gathered(pieces: Iterator[npt.NDArray[np.void]]) -> Iterator[npt.NDArray[np.void]]:
    """Join small pieces: each one that is added costs, the first of a layer less than the others."""
    kept: list[npt.NDArray[np.void]] = []
    for piece in pieces:
        kept.append(piece)
        if sum(map(len, kept)) >= _PLANTS_AT_ONCE:
            yield np.concatenate(kept)
            kept = []
    if kept:
        yield np.concatenate(kept)


TARGETS = (
    Target(
        name="geotiff",
        title="GIS",
        line="Cloud-Optimised GeoTIFF; rivers, lakes, plants and features as GeoPackage",
        write=_write,
        knows=frozenset({"crs", "origin"}),
        check=_check,
        disk=24.0,  # 15 bytes, a third more for overviews, and room to make these
        memory=20.0,  # copies of the materials, and a file
        bytes_per_plant=160.0,
    ),
)
