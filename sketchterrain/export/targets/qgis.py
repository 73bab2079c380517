"""QGIS: a project with styles and a 3-D view over the files of the GIS target."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from rasterio.crs import CRS

from sketchterrain.export import qgis_project as qgis
from sketchterrain.export.gis_layers import albedo_colour, gis_layers
from sketchterrain.export.qgis_project import MapLayer
from sketchterrain.export.rasters import Georeference, write_cloud_tiff
from sketchterrain.export.target import Export, ExportOutput
from sketchterrain.export.targets.geotiff import GEOTIFF, export_georeference, write_gis
from sketchterrain.schema.materials import Colour

_LOCAL_METRES: Final = (
    'PROJCS["sketch, metres from its south-west corner",GEOGCS["none",DATUM["none",SPHEROID["sphere",6371000,'
    '0]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],'
    'PARAMETER["latitude_of_origin",0],PARAMETER["central_meridian",0],PARAMETER["scale_factor",1],'
    'PARAMETER["false_easting",0],PARAMETER["false_northing",0],UNIT["metre",1],'
    'AXIS["Easting",EAST],AXIS["Northing",NORTH]]'
)
"""A plane on a sphere: QGIS draws no terrain in 3-D in a CRS that is nowhere."""
_WINDOW: Final = 0.2  # m of the longer side of a map on a screen
_LAND: Final[tuple[tuple[float, Colour], ...]] = (
    *((0.0, (190, 208, 170)), (0.15, (212, 219, 181)), (0.35, (232, 226, 190))),
    *((0.6, (231, 216, 186)), (0.8, (222, 208, 190)), (1.0, (246, 244, 240))),
)
"""Colours from the lowest land, 0, to the highest, 1."""
_SHORE, _DEPTH = (198, 223, 236), (104, 152, 190)


def _write(export: Export) -> ExportOutput:
    georeference = export_georeference(export, CRS.from_wkt(_LOCAL_METRES))
    output = write_gis(export, georeference)
    with export.stages.stage("project", "Writing the QGIS project"):
        rasters = _rasters(export, georeference, output.files)
        groups = gis_layers(export, output.facts["layers"])
        land = groups.pop("Land use")
        groups["Terrain"] = [rasters["Contours"], rasters["Hillshade"], *land, *list(rasters.values())[2:]]
        path = _write_project(export, georeference, groups, rasters)
    output.files[path] = "QGIS project with styles and a 3-D view"
    use = {"program": "QGIS 3.22 or later", "project": f"open {path.name}; it needs the files beside it"}
    return ExportOutput(output.files, use | {"crs": output.settings["crs"]}, output.facts)


def _write_project(
    export: Export,
    place: Georeference,
    groups: dict[str, list[MapLayer]],
    rasters: dict[str, MapLayer],
) -> Path:
    grid, path = export.grid, export.folder / f"{export.name}.qgz"
    shown = [each for group in groups.values() for each in group if each.visible]
    ground = [each for each in shown if each != rasters["Relief"]] + [rasters["Materials"]]
    flat = [each for each in ground if each.title not in ("Hillshade", "Contours", "Forest")]
    themes = {"Relief": shown, "Materials": ground, qgis.VIEW: flat}
    west, south = place.east + grid.west, place.north + grid.south
    bounds = west, south, place.east + grid.east, place.north + grid.north
    filled = {name: group for name, group in groups.items() if group}
    about = export.terrain.sketch.name, place.crs.to_wkt(), bounds
    return qgis.write_project(path, *about, filled, themes, rasters["Relief"], export.scene_view)


def _rasters(export: Export, place: Georeference, files: dict[Path, str]) -> dict[str, MapLayer]:
    """Return the rasters from the top down, and write the heaviest material of each vertex."""
    from sketchterrain.export.gltf import material_appearance
    from sketchterrain.export.map.features import FOREST, INDEX, PENS, WIDTHS, contour_interval
    from sketchterrain.export.map.relief import EXAGGERATION, STEEP

    samples, terrain = export.samples, export.terrain
    height, sea = samples.height, terrain.features.sea_level
    slope = np.hypot(*np.gradient(height, *samples.grid.spacing[::-1]))
    steep = STEEP / max(float(np.percentile(slope, 90.0)), 1e-6)
    light = {"zfactor": float(np.clip(steep, *EXAGGERATION)), "azimuth": 315, "angle": 45}
    interval = contour_interval(max(terrain.size) / _WINDOW, slope, height)
    heights = {"contour-interval": interval, "contour-index-interval": INDEX * interval, "downscale": 4}
    pens = "".join(
        qgis.symbol("line", qgis.line(PENS["ground"], WIDTHS[index]), name=name, opacity=0.75)
        for name, index in (("contour", False), ("index", True))
    )
    low, high = float(height.min()), float(height.max())
    shore = low if sea is None else max(low, sea)
    tints = [(shore + share * max(high - shore, 1.0), colour) for share, colour in _LAND]
    if sea is not None and low < sea:
        tints = [(low, _DEPTH), (sea - 0.01, _SHORE), *tints]
    material = samples.weights.argmax(axis=-1).astype(np.uint8)
    colours = [albedo_colour(albedo) for albedo in material_appearance(terrain).albedo]
    names = [each.title for each in terrain.materials]
    path = export.folder / f"{export.name}_material.tif"
    classes = dict(zip(names, colours, strict=True))
    write_cloud_tiff(path, {"material": material}, grid=samples.grid, georeference=place, classes=classes)
    files[path] = f"number of the heaviest material, from 0: {', '.join(names)}"
    woods = [(number, FOREST, "Forest") for number, each in enumerate(terrain.materials) if each.is_wooded]
    used = [(number, colours[number], names[number]) for number in np.unique(material).tolist()]
    pictures = sum(each["visible"] for each in terrain.sketch.drapes) > len(export.drapes)
    bands = {"redBand": 1, "greenBand": 2, "blueBand": 3, "alphaBand": 4}
    wet = [(0.0, (255, 255, 255)), (1.0, (52, 110, 168))]
    layers = {
        "Contours": ("height", qgis.raster("contour", heights, f"<symbols>{pens}</symbols>")),
        # Brighter, so that level ground keeps its colour.
        "Hillshade": (
            "height",
            qgis.raster("hillshade", light | {"multidirection": 1, "opacity": 0.7}, brightness=50),
        ),
        "Roads, land and drapes": ("appearance", qgis.raster("multibandcolor", bands)),
        "Forest": ("material", qgis.palette(woods, opacity=0.5)),
        "Materials": ("material", qgis.palette(used)),
        "Relief": ("height", qgis.ramp(tints, " m")),
        "Wetness": ("drainage", qgis.ramp(wet, band=2)),
    }
    if samples.appearance is None:
        layers.pop("Roads, land and drapes")
    hidden = {"Materials", "Wetness"} | (set() if pictures else {"Roads, land and drapes"})
    return {
        title: MapLayer(
            *(title, f"./{export.name}_{what}.tif", "raster", style, title not in hidden),
            blend="multiply" if title == "Hillshade" else "normal",
        )
        for title, (what, style) in layers.items()
    }


TARGETS = (
    replace(
        GEOTIFF,
        name="qgis",
        title="QGIS",
        summary="a project with styles, legend and a 3-D view, on the files of geotiff",
        write=_write,
        disk=GEOTIFF.disk + 2.0,  # a byte with overviews
        memory=GEOTIFF.memory + 2.0,
        scene=True,
    ),
)
