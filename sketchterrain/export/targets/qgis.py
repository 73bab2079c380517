"""QGIS: a project with styles and a 3-D view over the files of the GIS target."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import shapely
from rasterio.crs import CRS

from sketchterrain.document.materials import Colour
from sketchterrain.document.parameters import Properties
from sketchterrain.export import qgis_project as qgis
from sketchterrain.export.drapes import DrapedShapes, table_names
from sketchterrain.export.qgis_project import Layer
from sketchterrain.export.rasters import Georeference, write_cloud_tiff
from sketchterrain.export.sampled import srgb_of
from sketchterrain.export.target import Export, ExportOutput, Target
from sketchterrain.export.targets.geotiff import export_georeference, write_gis

_LOCAL_METRES: Final = (
    'PROJCS["sketch, metres from its south-west corner",GEOGCS["none",DATUM["none",SPHEROID["sphere",6371000,0]],'
    'PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],'
    'PARAMETER["latitude_of_origin",0],PARAMETER["central_meridian",0],PARAMETER["scale_factor",1],'
    'PARAMETER["false_easting",0],PARAMETER["false_northing",0],UNIT["metre",1],AXIS["Easting",EAST],AXIS["Northing",NORTH]]'
)
"""A plane on a sphere: without one QGIS cannot draw in 3-D."""
_EXPOSURE: Final = 2.5
_PIXEL: Final = 0.000264583  # m on a screen of 96 dpi
_WINDOW: Final = 0.2  # m of the longer side of a map on a screen
_PLANTS_FROM, _ALL_FROM = 60_000, 12_000  # denominators of scales that show some plants, and all
_LAND: Final[tuple[tuple[float, Colour], ...]] = (
    *((0.0, (190, 208, 170)), (0.15, (212, 219, 181)), (0.35, (232, 226, 190))),
    *((0.6, (231, 216, 186)), (0.8, (222, 208, 190)), (1.0, (246, 244, 240))),
)
"""Colours from the lowest land, 0, to the highest, 1."""
_SHORE, _DEPTH = (198, 223, 236), (104, 152, 190)
_CROWNS: Final = {"spruce": ("cone", 0.17), "pine": ("cone", 0.2), "oak": ("sphere", 0.36)}
_CROWN: Final = ("sphere", 0.26)
"""3-D shapes of species, and their radius over their height; of others."""
_HERB: Final = 0.5  # m, height of those that are not woody
_GROWTH: Final = ((0.0, 0.6, 0.4), (0.6, 1.0, 0.8), (1.0, 99.0, 1.2))
"""Classes of plants in 3-D: least and greatest scale, and the scale that they are drawn at."""
_PARTS: Final = {"marker": ((0, 4), "Point"), "line": ((1, 5), "LineString"), "fill": ((3, 6), "Polygon")}
"""Shapely's type ids that a kind of symbols draws, and OGR's name of the geometry."""


def _write(export: Export) -> ExportOutput:
    georeference = export_georeference(export, CRS.from_wkt(_LOCAL_METRES))
    output = write_gis(export, georeference)
    with export.stages.stage("project", "Writing the QGIS project"):
        groups = _vectors(export, output.facts["layers"])
        terrain = _terrain(export, georeference, output.files)
        groups["Terrain"] = [*terrain[:2], *groups.pop("Land use"), *terrain[2:]]
        path = _write_project(export, georeference, {name: layers for name, layers in groups.items() if layers})
    output.files[path] = "QGIS project with styles and a 3-D view"
    settings = {
        "program": "QGIS 3.22 or later",
        "project": f"open {path.name}, which needs the other files beside it",
        "crs": output.settings["crs"],
    }
    return ExportOutput(output.files, settings, output.facts)


def _write_project(export: Export, georeference: Georeference, groups: dict[str, list[Layer]]) -> Path:
    grid, view = export.grid, export.view
    if view is None:
        raise ValueError("expected a view")
    east, north = georeference.east, georeference.north
    bounds = east + grid.west, north + grid.south, east + grid.east, north + grid.north
    everything = [each for group in groups.values() for each in group]
    relief, materials = (next(each for each in everything if each.title == name) for name in _BASES)
    shown = [each for each in everything if each.visible]
    above = [each for each in shown if each.title != relief.title]
    painted = [each for each in above if each.title not in ("Hillshade", "Contours", "Plants", "Forest")]
    ahead = np.subtract(view.target, view.eye)
    project_view = qgis.View(
        terrain=relief,
        theme="3-D view",
        centre=(
            *(0.5 * (bounds[0] + bounds[2]), 0.5 * (bounds[1] + bounds[3])),
            float(export.samples.height[grid.rows // 2, grid.columns // 2]),
        ),
        distance=1.25 * max(grid.east - grid.west, grid.north - grid.south),
        heading=math.degrees(math.atan2(ahead[0], ahead[1])),
        pitch=58.0,
        fov=view.fov,
        sun=(view.sun_azimuth, view.sun_elevation),
    )
    themes = {"Relief": shown, "Materials": [*above, materials], "3-D view": [*painted, materials]}
    path = export.folder / f"{export.name}.qgz"
    crs = georeference.crs.to_wkt()
    return qgis.write_project(path, export.terrain.sketch.name, crs, bounds, groups, themes, project_view)


_BASES: Final = ("Relief", "Materials")


def _terrain(export: Export, georeference: Georeference, files: dict[Path, str]) -> list[Layer]:
    """Return the rasters from the top down, and write the heaviest material of each vertex."""
    from sketchterrain.export.gltf import material_appearance
    from sketchterrain.export.map.features import FOREST, INDEX, PENS, WIDTHS, contour_interval
    from sketchterrain.export.map.relief import EXAGGERATION, STEEP

    samples, terrain = export.samples, export.terrain
    height, grid = samples.height, samples.grid
    slope = np.hypot(*np.gradient(height, *grid.spacing[::-1]))
    interval = contour_interval(max(terrain.size) / _WINDOW, slope, height)
    pens = (
        qgis.symbol("line", qgis.line(PENS["ground"], WIDTHS[index]), name=name, opacity=0.55)
        for name, index in (("contour", False), ("index", True))
    )
    contours = {"contour_interval": interval, "contour_index_interval": INDEX * interval, "downscale": 4}
    steep = STEEP / max(float(np.percentile(slope, 90.0)), 1e-6)
    shade = {
        "azimuth": 315,
        "angle": 45,
        "zfactor": float(np.clip(steep, *EXAGGERATION)),
        "multidirection": 1,
    }
    material = samples.weights.argmax(axis=-1).astype(np.uint8)
    colours = [_colour(each) for each in material_appearance(terrain).albedo]
    classes = dict(zip((each.title for each in terrain.materials), colours, strict=True))
    path = export.folder / f"{export.name}_material.tif"
    write_cloud_tiff(path, {"material": material}, grid=grid, georeference=georeference, classes=classes)
    files[path] = f"number of the heaviest material, from 0: {', '.join(classes)}"
    used = [(number, colours[number], list(classes)[number]) for number in np.unique(material).tolist()]
    wet = qgis.ramp([(0.0, (255, 255, 255)), (1.0, (52, 110, 168))], band=2)
    shaded = qgis.raster("hillshade", opacity=0.7, brightness=50, **shade)  # level ground is white
    woods = [(number, FOREST, "Forest") for number, each in enumerate(terrain.materials) if each.is_wooded]
    lines = qgis.raster("contour", f"<symbols>{''.join(pens)}</symbols>", **contours)

    def layer(title: str, what: str, style: str, **values: Any) -> Layer:
        return Layer(title, f"./{export.name}_{what}.tif", "raster", style, **values)

    layers = [
        layer("Contours", "height", lines),
        layer("Hillshade", "height", shaded, blend="multiply"),
        layer("Forest", "material", qgis.palette(woods, opacity=0.5)),
        layer("Materials", "material", qgis.palette(used), visible=False, folded=False),
        layer("Relief", "height", _relief(export), folded=False),
        layer("Wetness", "drainage", wet, visible=False),
    ]
    if samples.appearance is not None:
        bands = {"redBand": 1, "greenBand": 2, "blueBand": 3, "alphaBand": 4}
        pictures = sum(each["visible"] for each in terrain.sketch.drapes) > len(export.drapes)
        style = qgis.raster("multibandcolor", **bands)
        layers.insert(2, layer("Roads, land and drapes", "appearance", style, visible=pictures))
    return layers


def _relief(export: Export) -> str:
    """Return the hypsometric tints, from the sea's depths on."""
    height, sea = export.samples.height, export.terrain.features.sea_level
    low, high = float(height.min()), float(height.max())
    shore = low if sea is None else max(low, sea)
    stops = [(shore + share * max(high - shore, 1.0), colour) for share, colour in _LAND]
    if sea is not None and low < sea:
        stops = [(low, _DEPTH), (sea - 0.01, _SHORE), *stops]
    return qgis.ramp(stops, " m")


def _colour(albedo: npt.ArrayLike) -> Colour:
    """Return a linear albedo as bright as in a photograph."""
    red, green, blue = srgb_of(np.minimum(_EXPOSURE * np.asarray(albedo, np.float64), 1.0)).tolist()
    return red, green, blue


def _vectors(export: Export, counts: dict[str, int]) -> dict[str, list[Layer]]:
    """Return the layers of the GeoPackages from the top down."""
    from sketchterrain.export.map.features import DEEP, FOREST, MIN_RIVER, WATER
    from sketchterrain.export.map.relief import LAND_TINTS
    from sketchterrain.export.map.roads import BUILDING, HEDGE, INK, WALL, YARD

    def table(name: str, title: str, kind: str, style: str, **values: Any) -> list[Layer]:
        source = f"./{export.name}.gpkg|layername={name}"
        return [Layer(title, source, kind, style, **values)] if counts.get(name) else []

    def wide(field: str) -> str:
        return f'max("{field}", {MIN_RIVER / 1000.0} * @map_scale)'

    course = f"tapered_buffer($geometry, {wide('width_spring')}, {wide('width_mouth')}, 8)"
    taper = {"SymbolType": "Fill", "geometryModifier": course, "units": "MapUnit"}
    river = qgis.symbol("line", qgis.drawing("GeometryGenerator", qgis.fill(WATER), **taper))
    pads = [("1", "Building", qgis.fill(BUILDING)), ("0", "Level ground", qgis.fill(YARD, opacity=0.7))]
    houses = qgis.categories('if("building" > 0, 1, 0)', pads) + qgis.area_3d((196, 176, 160), '"building"')
    walls = [
        (name, name.capitalize(), qgis.symbol("line", qgis.line(colour, metres=wide("width"))))
        for name, colour in (("stone", WALL), ("hedge", HEDGE))
    ]
    decks = qgis.single(qgis.fill((255, 255, 255), INK, 0.3)) + qgis.area_3d((186, 182, 176), "1")
    tunnels = qgis.single(qgis.symbol("line", qgis.line(INK, 0.25, dash="0.9;0.9")))
    edges = qgis.single(qgis.symbol("line", qgis.line(INK, 0.1)))
    land = (LAND_TINTS | {"forest": ("Forest", FOREST)}).items()
    uses = [(name, title, qgis.fill(colour, opacity=0.8)) for name, (title, colour) in land]
    surface = qgis.area_3d(WATER, "0")
    shore, sea = (qgis.single(qgis.fill(WATER, DEEP, opacity=each)) + surface for each in (1.0, 0.3))
    stations, dots = qgis.single(qgis.marker(DEEP, 0.6)), qgis.single(qgis.marker((120, 90, 70), 1.2))
    trees, herbs = (_plants(export, storey) for storey in ("woody", "grass"))
    drawn = export.terrain.sketch.vectors.items()
    return {
        "Drapes": [
            layer
            for name, each in zip(table_names(export.drapes), export.drapes, strict=True)
            for layer in _parts(f"{export.name}_drapes", name, each.layer.title, each.geometry, each)
        ],
        "Roads and buildings": [
            *table("pads", "Buildings and level ground", "fill", houses),
            *table("walls", "Walls and hedges", "line", qgis.categories("material", walls)),
            *(
                layer
                for name in ("railway", "road", "path")
                for layer in table(f"{name}s", f"{name.capitalize()}s", "line", _ways(name), folded=False)
            ),
            *table("tunnels", "Tunnels", "line", tunnels),
            *table("bridge_decks", "Bridges", "fill", decks),
            *table("road_edges", "Edges of roads", "line", edges, visible=False),
        ],
        "Plants": [
            *table("plants", "Plants", "marker", trees, scales=(0.0, _PLANTS_FROM), folded=False),
            *table("grass", "Grass", "marker", herbs, scales=(0.0, 2_500.0)),
        ],
        "Water": [
            *table("rivers", "Rivers", "line", qgis.single(river)),
            *table("lakes", "Lakes", "fill", shore),
            *table("sea", "Sea", "fill", sea),
            *table("river_stations", "River stations", "marker", stations, visible=False),
        ],
        "Land use": table("landuse", "Land use", "fill", qgis.categories("use", uses)),
        "Sketch": [
            *table("features", "Landforms and groves", "marker", dots, visible=False),
            *(
                layer
                for name, each in drawn
                for layer in _parts(export.name, f"sketch_{name}", f"Sketch: {name}", each.shapes())
            ),
        ],
    }


def _ways(layer: str) -> str:
    """Return the renderer of roads, railways or paths: classes as on the program's topographic maps."""
    from sketchterrain.export.map.roads import CASING, INK, SYMBOLS

    entries, narrower = [], ""
    for way in (each for each in SYMBOLS if each.layer == layer):
        width = f'max("width", {way.width / 1000.0} * @map_scale)'
        casing = f"{width} + {2.0 * CASING / 1000.0} * @map_scale"
        if way.fill is not None:
            drawn = [qgis.line(INK, metres=casing), qgis.line(way.fill, metres=width, order=1)]
        elif layer == "railway":
            ties = qgis.line((255, 255, 255), 1.2 * way.width, dash="1.5;1.5", order=1)
            drawn = [qgis.line(INK, 2.0 * way.width), ties]
        else:
            drawn = [qgis.line(INK, way.width, dash=";".join(map(str, way.dashes)))]
        wide = f'"width" + 2 * "shoulder" >= {way.least}'
        condition = f"\"structure\" <> 'tunnel' AND {wide}{narrower}"
        entries.append((condition, way.title, qgis.symbol("line", *drawn)))
        narrower = f" AND NOT ({wide})"
    return qgis.rules(entries)


def _plants(export: Export, storey: str) -> str:
    """Return the renderers of plants: discs as wide as crowns, fewer at small scales, and 3-D crowns."""
    from sketchterrain.export.gltf_plants import plant_colour
    from sketchterrain.look.tree_species import HEIGHTS
    from sketchterrain.vegetation.plants import STOREYS

    discs, crowns = [], []
    heights = HEIGHTS if storey == "woody" else [_HERB] * len(STOREYS[storey])
    for name, height in zip(STOREYS[storey], heights, strict=True):
        colour, (shape, share) = _colour(plant_colour(name)), _CROWNS.get(name, _CROWN)
        width = f'max({2.0 * share * height} * "scale", 0.0003 * @map_scale)'
        discs.append((name, name.capitalize(), qgis.marker(colour, metres=width)))
        for least, most, scale in _GROWTH if storey == "woody" else ():
            grown = f'"scale" > {least} AND "scale" <= {most} AND "level" >= 1 AND "species" = \'{name}\''
            crowns.append((grown, qgis.crown_3d(colour, shape, share * height * scale, height * scale)))
    # Levels thin plants evenly.
    shown = f'if("level" >= if(@map_scale < {_ALL_FROM}, 0, 2), "species", NULL)'
    return qgis.categories(shown, discs) + (qgis.rules_3d(crowns) if crowns else "")


def _parts(file: str, table: str, title: str, shapes: Any, drape: DrapedShapes | None = None) -> list[Layer]:
    """Return a layer for the points, the lines and the areas of a table; those as drawn are hidden."""
    kinds = set(shapely.get_type_id(shapes).tolist())
    found = {kind: name for kind, (ids, name) in _PARTS.items() if kinds.intersection(ids)}
    layers = []
    for kind, name in found.items():
        source, own = f"./{file}.gpkg|layername={table}", title
        if len(found) > 1:
            source, own = f"{source}|geometrytype={name}", f"{title} ({name})"
        if drape is None:
            style = {"colour": "#7048e8", "fill": "#7048e8", "fill_opacity": 0.2, "width": 0.4, "unit": "px"}
            layers.append(Layer(own, source, kind, qgis.single(_drawn(kind, style)), visible=False))
        else:
            layers.append(_draped(own, source, kind, drape))
    return layers


def _draped(title: str, source: str, kind: str, drape: DrapedShapes) -> Layer:
    """Return a draped layer in its styles."""
    layer, style = drape.layer, drape.layer.style_of(-1)
    renderer = qgis.single(_drawn(kind, style))
    if numbers := layer.class_numbers:
        entries = [(value, value, _drawn(kind, layer.style_of(number))) for value, number in numbers.items()]
        renderer = qgis.categories(layer["by"], [*entries, ("", "others", _drawn(kind, style))])
    if style["label"]:
        renderer += qgis.labels(style["label"], style["label_size"], _from_hex(style["label_colour"]))
    scales = layer["finest"] / _PIXEL, layer["coarsest"] / _PIXEL or qgis.WHOLE_MAP[1]
    values = {"opacity": layer["opacity"], "blend": layer["blend"], "scales": scales}
    return Layer(title, source, kind, renderer, folded=False, **values)


def _from_hex(colour: str) -> Colour:
    red, green, blue = bytes.fromhex(colour.removeprefix("#")[:6])
    return red, green, blue


def _drawn(kind: str, style: Properties) -> str:
    """Return the symbol of a draped layer's style for points, lines or areas."""
    unit = {"m": "MapUnit", "px": "Pixel"}[style["unit"]]
    colour, width = style["colour"], style["width"]
    if kind == "marker":
        return qgis.marker(_from_hex(colour or style["fill"] or "#808080"), width, unit=unit)
    pen = {"dash": style.get("dash", "").replace(" ", ";"), "unit": unit}
    ends = {"butt": "flat"}
    lines = [qgis.line(_from_hex(colour), width, **pen)] if colour else []
    if kind == "line":
        return qgis.symbol("line", *lines)
    drawings = []
    return qgis.symbol("fill", *drawings)


TARGETS = (
    Target(
        name="qgis",
        title="QGIS",
        summary="a project with styles, legend and a 3-D view, on the files of geotiff",
        write=_write,
        options=frozenset({"crs", "origin"}),
        disk=26.0,  # as for GIS, and a byte with overviews
        memory=22.0,
        bytes_per_plant=160.0,
        scene=True,
    ),
)
