"""GIS: rasters as Cloud-Optimised GeoTIFF, features and plants as a GeoPackage."""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from rasterio.crs import CRS

from sketchterrain.export.engines import requested_storeys
from sketchterrain.export.foliage_files import plant_pieces
from sketchterrain.export.gis_layers import gis_layers, write_styles
from sketchterrain.export.rasters import APPEARANCE, NO_DATA, Georeference, local_metres, write_cloud_tiff
from sketchterrain.export.roads import MASKS, built_ground, coverage, road_layers
from sketchterrain.export.sampled import SampleGrid, appearance_picture
from sketchterrain.export.target import Export, ExportOutput, Target
from sketchterrain.export.vectors import (
    LAND_FIELDS,
    GeoPackage,
    Origin,
    feature_layer,
    geopackage,
    lake_layer,
    land_layer,
    plant_layer,
    river_layer,
    sea_layer,
    sketch_layer,
    station_layer,
)
from sketchterrain.io.crs import parse_metric_crs
from sketchterrain.vegetation.plants import PLANT

_PLANTS_AT_ONCE = 1_000_000
_FIELDS = {
    "rivers": "length, width, depth: m; the mean, and at the spring and the mouth; z is the water",
    "river_stations": "distance from the spring, width, depth: m; river is the river's id",
    "lakes": "level, depth: m",
    "sea": "level: m",
    "features": "radius: m; strength: m of height, of forests a share of the trees; wind: degrees, 0 north",
    "roads, railways, paths": "length, width, shoulder: m; steepest, cut, fill: rise over run; "
    "leg, part: parts with one leg follow each other; z is the surface",
    "pads, walls": "level, building, height, width: m",
    "landuse": LAND_FIELDS,
    "sketch_river, sketch_lake": "as drawn; width, depth: m, if not the label's; directed: 1 or 0, downhill",
    "plants and grass": "scale: 1 is grown; rotation: degrees, counter-clockwise; tint: 0 to 1; "
    "level: a filter level >= n thins them evenly",
}


def _write(export: Export) -> ExportOutput:
    return write_gis(export, export_georeference(export, local_metres()))


def export_georeference(export: Export, local: CRS) -> Georeference:
    """Return the CRS of an export, `local` if none is given, and the sketch's corner in it."""
    crs = local if export.options.crs is None else parse_metric_crs(export.options.crs)
    return Georeference(crs, *export.options.origin or (0.0, 0.0))


def write_gis(export: Export, georeference: Georeference) -> ExportOutput:
    """Write rasters and vectors."""
    crs, origin = georeference.crs, Origin(georeference.east, georeference.north)
    with export.stages.stage("rasters", "Writing Cloud-Optimised GeoTIFF"):
        files = _write_rasters(export, georeference)
    vectors = export.folder / f"{export.name}.gpkg"
    with (
        export.stages.stage("vectors", "Writing the GeoPackage") as progress,
        geopackage(vectors, crs.to_wkt()) as file,
    ):
        _write_vectors(export, file, origin, progress)
    layers = gis_layers(export, file.counts)
    write_styles(vectors, (each for name, group in layers.items() if name != "Drapes" for each in group))
    files[vectors] = f"GeoPackage with the layers {', '.join(file.counts)}"
    transform = georeference.transform(export.grid)
    facts: dict[str, Any] = {
        "heights": {"numbers": "float32"},
        "byte_order": "little-endian",
        "axes": {"x": "east", "y": "north", "z": "up", "units": "m"},
        "crs": export.options.crs,
        "origin": list(origin),
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
    return ExportOutput(files, settings, facts)


def _write_rasters(export: Export, georeference: Georeference) -> dict[Path, str]:
    samples, names = export.samples, export.terrain.material_names
    height, normal, weights = (
        export.folder / f"{export.name}_{what}.tif" for what in ("height", "normal", "materials")
    )
    write_tiff = partial(write_cloud_tiff, grid=samples.grid, georeference=georeference)
    write_tiff(height, {"height": samples.height}, unit="m", no_data=NO_DATA)
    components = enumerate(("east", "north", "up"))
    write_tiff(normal, {name: samples.normal[..., axis] for axis, name in components}, rgb=True)
    write_tiff(weights, {name: samples.weights[..., index] for index, name in enumerate(names)})
    files = {
        _write_drainage(export, georeference): "float32; bands drainage_area, m², and wetness, 0 to 1",
        height: "heights, float32, m",
        normal: "normals: 0 is -1, 255 is 1; bands east, north, up",
        weights: f"weights of the materials, with a sum of 255; bands {', '.join(names)}",
    }
    if samples.appearance is not None:
        picture = appearance_picture(samples.appearance)
        bands = {name: picture[..., band] for band, name in enumerate(("red", "green", "blue", "covered"))}
        files[write_tiff(export.folder / f"{export.name}_appearance.tif", bands)] = APPEARANCE
    if outlines := built_ground(export.terrain.features.network, samples.grid):
        masks = {kind: coverage(areas, samples.grid) for kind, areas in outlines.items()}
        path = write_tiff(export.folder / f"{export.name}_roads.tif", masks)
        files[path] = "; ".join(f"band {kind}: {MASKS[kind]}" for kind in masks)
    return files


def _write_drainage(export: Export, georeference: Georeference) -> Path:
    """Write drainage areas and wetness at the nodes of the drained ground."""
    drainage = export.terrain.drainage()
    rows, columns = drainage.area.shape
    east, north = (columns - 1) * drainage.spacing, (rows - 1) * drainage.spacing
    grid = SampleGrid(0.0, 0.0, east, north, columns, rows)
    wetness = drainage.wetness.astype(np.float32) / np.float32(255)
    bands = {"drainage_area": drainage.area, "wetness": wetness}
    path = export.folder / f"{export.name}_drainage.tif"
    return write_cloud_tiff(path, bands, grid=grid, georeference=georeference)


def _write_vectors(
    export: Export, file: GeoPackage, origin: Origin, progress: Callable[[float], None]
) -> None:
    terrain = export.terrain
    placed = terrain.features
    if placed.sea_level is not None:
        file.add(sea_layer(placed.sea_level, export.samples, origin))
    file.add(lake_layer(placed.lakes, origin))
    file.add(river_layer(placed.rivers, origin))
    file.add(station_layer(placed.rivers, origin))
    for layer in road_layers(placed.network, origin):
        file.add(layer)
    if len(terrain.sketch.vectors["landuse"]):
        file.add(land_layer(terrain.sketch, origin))
    height = terrain.heights(placed.points["x"], placed.points["y"], cell_size=max(export.grid.spacing))
    file.add(feature_layer(placed.points, height, origin))
    for vectors in terrain.sketch.vectors.values():
        if vectors:
            file.add(sketch_layer(vectors, origin))
    layers = requested_storeys(export.options)
    for index, (storey, name) in enumerate(layers.items()):

        def report(share: float, index: int = index) -> None:
            progress((index + share) / len(layers))

        for plants in _large_chunks(plant_pieces(terrain, export.grid.bounds, storey, report)):
            file.add(plant_layer(name, plants, terrain.species_names, origin))
        if name not in file.counts:
            file.add(plant_layer(name, np.zeros(0, PLANT), terrain.species_names, origin))


def _large_chunks(chunks: Iterator[npt.NDArray[np.void]]) -> Iterator[npt.NDArray[np.void]]:
    """Join small chunks: each append to a layer has a cost."""
    pending: list[npt.NDArray[np.void]] = []
    for chunk in chunks:
        pending.append(chunk)
        if sum(map(len, pending)) >= _PLANTS_AT_ONCE:
            yield np.concatenate(pending)
            pending = []
    if pending:
        yield np.concatenate(pending)


GEOTIFF = Target(
    name="geotiff",
    title="GIS",
    summary="Cloud-Optimised GeoTIFF; rivers, lakes, plants and features as GeoPackage",
    write=_write,
    options=frozenset({"crs", "origin"}),
    disk=24.0,  # 17 bytes, a third more for overviews, and temporary files
    memory=20.0,  # copies of the materials, and a file
    bytes_per_plant=160.0,
)

TARGETS = (GEOTIFF,)
