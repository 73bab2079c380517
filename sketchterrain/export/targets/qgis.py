"""QGIS: a project with styles and a 3-D view over the files of the GIS target."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import shapely
from rasterio.crs import CRS

from sketchterrain.document.drapes import STYLE, DrapedLayer
from sketchterrain.document.own_materials import rgb_from_hex
from sketchterrain.export import qgis_project as qgis
from sketchterrain.export.drapes import table_names
from sketchterrain.export.qgis_project import MapLayer
from sketchterrain.export.rasters import Georeference, write_cloud_tiff
from sketchterrain.export.sampled import srgb_of
from sketchterrain.export.target import Export, ExportOutput
from sketchterrain.export.targets.geotiff import GEOTIFF, export_georeference, write_gis
from sketchterrain.schema.materials import Colour
from sketchterrain.schema.parameters import Properties, defaults

_LOCAL_METRES: Final = (
    'PROJCS["sketch, metres from its south-west corner",GEOGCS["none",DATUM["none",SPHEROID["sphere",6371000,'
    '0]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],'
    'PARAMETER["latitude_of_origin",0],PARAMETER["central_meridian",0],PARAMETER["scale_factor",1],'
    'PARAMETER["false_easting",0],PARAMETER["false_northing",0],UNIT["metre",1],'
    'AXIS["Easting",EAST],AXIS["Northing",NORTH]]'
)
"""A plane on a sphere: QGIS draws no terrain in 3-D in a CRS that is nowhere."""
_PIXEL: Final = 0.000264583  # m on a screen of 96 dpi
_WINDOW: Final = 0.2  # m of the longer side of a map on a screen
_EXPOSURE: Final = 2.5  # of albedos, as in a photograph
_PLANTS_FROM, _ALL_FROM, _GRASS_FROM = 60_000.0, 12_000.0, 2_500.0  # denominators of the smallest scales
_LAND: Final[tuple[tuple[float, Colour], ...]] = (
    *((0.0, (190, 208, 170)), (0.15, (212, 219, 181)), (0.35, (232, 226, 190))),
    *((0.6, (231, 216, 186)), (0.8, (222, 208, 190)), (1.0, (246, 244, 240))),
)
"""Colours from the lowest land, 0, to the highest, 1."""
_SHORE, _DEPTH = (198, 223, 236), (104, 152, 190)
_CROWNS: Final = {"spruce": ("cone", 0.17), "pine": ("cone", 0.2), "oak": ("sphere", 0.36)}
"""3-D shapes of species, and their radius over their height; others are as birches."""
_BIRCH, _HERB = ("sphere", 0.26), 0.5  # and the height (m) of plants that are not woody
_GROWTH: Final = ((0.0, 0.6, 0.4), (0.6, 1.0, 0.8), (1.0, 99.0, 1.2))
"""Classes of plants in 3-D: least and greatest scale, and the scale that they are drawn at."""
_PARTS: Final = {"marker": ((0, 4), "Point"), "line": ((1, 5), "LineString"), "fill": ((3, 6), "Polygon")}
"""Shapely's type ids that symbols are for, and OGR's name of the geometry."""
_BUILDING_3D, _BRIDGE_3D, _VIOLET = (196, 176, 160), (186, 182, 176), (112, 72, 232)


def _write(export: Export) -> ExportOutput:
    georeference = export_georeference(export, CRS.from_wkt(_LOCAL_METRES))
    output = write_gis(export, georeference)
    with export.stages.stage("project", "Writing the QGIS project"):
        rasters = _rasters(export, georeference, output.files)
        groups = _vectors(export, output.facts["layers"])
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
    colours = [_colour(albedo) for albedo in material_appearance(terrain).albedo]
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


def _colour(albedo: npt.ArrayLike) -> Colour:
    red, green, blue = srgb_of(np.minimum(_EXPOSURE * np.asarray(albedo, np.float64), 1.0)).tolist()
    return red, green, blue


def _vectors(export: Export, counts: dict[str, int]) -> dict[str, list[MapLayer]]:
    """Return the layers of the GeoPackages from the top down."""
    from sketchterrain.export.map.features import DEEP, FOREST, MIN_RIVER, WATER
    from sketchterrain.export.map.relief import LAND_TINTS
    from sketchterrain.export.map.roads import BUILDING, HEDGE, INK, WALL, YARD

    def wide(field: str) -> str:
        return f'max("{field}", {MIN_RIVER / 1000.0} * @map_scale)'

    def lines(*drawings: str) -> str:
        return qgis.single(qgis.symbol("line", *drawings))

    course = f"tapered_buffer($geometry, {wide('width_spring')}, {wide('width_mouth')}, 8)"
    taper = {"SymbolType": "Fill", "geometryModifier": course, "units": "MapUnit"}
    pads = [("1", "Building", qgis.fill(BUILDING)), ("0", "Level ground", qgis.fill(YARD, 0.7))]
    stone, hedge = (qgis.symbol("line", qgis.line(each, metres=wide("width"))) for each in (WALL, HEDGE))
    walls = [("stone", "Wall", stone), ("hedge", "Hedge", hedge)]
    land = LAND_TINTS | {"forest": ("Forest", FOREST)}
    uses = [(name, title, qgis.fill(colour, 0.8)) for name, (title, colour) in land.items()]
    water, shore = qgis.area_3d(WATER, "0"), qgis.line(DEEP, 0.2)
    houses = qgis.classes(pads, 'if("building" > 0, 1, 0)') + qgis.area_3d(_BUILDING_3D, '"building"')
    decks = qgis.single(qgis.fill((255, 255, 255), 1.0, qgis.line(INK, 0.3))) + qgis.area_3d(_BRIDGE_3D, "1")
    tables: dict[str, tuple[tuple[str, str, str, str], ...]] = {
        "Roads and buildings": (
            ("pads", "Buildings and level ground", "fill", houses),
            ("walls", "Walls and hedges", "line", qgis.classes(walls, "material")),
            ("railways", "Railways", "line", _ways("railway")),
            ("roads", "Roads", "line", _ways("road")),
            ("paths", "Paths", "line", _ways("path")),
            ("tunnels", "Tunnels", "line", lines(qgis.line(INK, 0.25, dash="0.9;0.9"))),
            ("bridge_decks", "Bridges", "fill", decks),
            ("road_edges", "Edges of roads", "line", lines(qgis.line(INK, 0.1))),
        ),
        "Plants": (
            ("plants", "Plants", "marker", _plants("woody")),
            ("grass", "Grass", "marker", _plants("grass")),
        ),
        "Water": (
            ("rivers", "Rivers", "line", lines(qgis.drawing("GeometryGenerator", taper, qgis.fill(WATER)))),
            ("lakes", "Lakes", "fill", qgis.single(qgis.fill(WATER, 1.0, shore)) + water),
            ("sea", "Sea", "fill", qgis.single(qgis.fill(WATER, 0.3, shore)) + water),
            ("river_stations", "River stations", "marker", qgis.single(qgis.marker(DEEP, 0.6))),
        ),
        "Land use": (("landuse", "Land use", "fill", qgis.classes(uses, "use")),),
        "Sketch": (("features", "Landforms and groves", "marker", qgis.single(qgis.marker(_VIOLET, 1.2))),),
    }
    scales = {"plants": (0.0, _PLANTS_FROM), "grass": (0.0, _GRASS_FROM)}
    hidden = ("road_edges", "river_stations", "features")
    groups = {"Drapes": list[MapLayer]()}
    for each, table in zip(export.drapes, table_names(export.drapes), strict=True):
        groups["Drapes"] += _parts(
            f"{export.name}_drapes", table, each.layer.title, each.geometry, each.layer
        )
    for group, rows in tables.items():
        groups[group] = [
            MapLayer(
                *(title, f"./{export.name}.gpkg|layername={table}", kind, style, table not in hidden),
                scales=scales.get(table, qgis.ANY_SCALE),
            )
            for table, title, kind, style in rows
            if counts.get(table)
        ]
    for name, vectors in export.terrain.sketch.vectors.items():
        groups["Sketch"] += _parts(export.name, f"sketch_{name}", f"Sketch: {name}", vectors.shapes())
    return groups


def _ways(layer: str) -> str:
    """Return the renderer of roads, railways or paths: classes as on the program's topographic maps."""
    from sketchterrain.export.map.roads import CASING, INK, SYMBOLS

    entries, narrower = [], "\"structure\" <> 'tunnel'"
    for way in (each for each in SYMBOLS if each.layer == layer):
        width = f'max("width", {way.width / 1000.0} * @map_scale)'
        casing = f"{width} + {2.0 * CASING / 1000.0} * @map_scale"
        drawn = [qgis.line(INK, way.width, dash=";".join(map(str, way.dashes)))]
        if way.fill is not None:
            drawn = [qgis.line(INK, metres=casing), qgis.line(way.fill, metres=width, order=1)]
        elif layer == "railway":
            ties = qgis.line((255, 255, 255), 1.2 * way.width, dash="1.5;1.5", order=1)
            drawn = [qgis.line(INK, 2.0 * way.width), ties]
        wide = f'"width" + 2 * "shoulder" >= {way.least}'
        entries.append((f"{narrower} AND {wide}", way.title, qgis.symbol("line", *drawn)))
        narrower += f" AND NOT ({wide})"
    return qgis.classes(entries)


def _plants(storey: str) -> str:
    """Return the renderers of plants: discs as wide as crowns, fewer at small scales, and 3-D crowns."""
    from sketchterrain.export.gltf_plants import plant_colour
    from sketchterrain.look.tree_species import HEIGHTS
    from sketchterrain.vegetation.plants import STOREYS

    discs, crowns = [], []
    woody = storey == "woody"
    for name, height in zip(STOREYS[storey], HEIGHTS if woody else [_HERB] * 3, strict=True):
        colour, (shape, share) = _colour(plant_colour(name)), _CROWNS.get(name, _BIRCH)
        width = f'max({2.0 * share * height} * "scale", 0.0003 * @map_scale)'
        discs.append((name, name.capitalize(), qgis.marker(colour, metres=width)))
        for least, most, scale in _GROWTH if woody else ():
            own = f'"scale" > {least} AND "scale" <= {most} AND "level" >= 1 AND "species" = \'{name}\''
            crowns.append((own, colour, shape, share * height * scale, height * scale))
    shown = f'if("level" >= if(@map_scale < {_ALL_FROM}, 0, 2), "species", NULL)'  # levels thin evenly
    return qgis.classes(discs, shown) + (qgis.crowns_3d(crowns) if crowns else "")


def _parts(
    file: str, table: str, title: str, shapes: Any, drape: DrapedLayer | None = None
) -> list[MapLayer]:
    """Return a layer for the points, the lines and the areas of a table; a sketch's own are hidden."""
    kinds = set(shapely.get_type_id(shapes).tolist())
    found = {kind: name for kind, (ids, name) in _PARTS.items() if kinds.intersection(ids)}
    source, own, layers = f"./{file}.gpkg|layername={table}", title, []
    for kind, name in found.items():
        if len(found) > 1:
            source, own = f"./{file}.gpkg|layername={table}|geometrytype={name}", f"{title} ({name})"
        if drape is not None:
            layers.append(_draped(MapLayer(own, source, kind, ""), drape))
        else:
            style = _drawn(kind, defaults(STYLE) | {"colour": "#7048e8", "fill_opacity": 0.1})
            layers.append(MapLayer(own, source, kind, qgis.single(style), visible=False))
    return layers


def _draped(layer: MapLayer, drape: DrapedLayer) -> MapLayer:
    """Return a draped layer with its styles."""
    style = drape.style_of(-1)
    renderer = qgis.single(_drawn(layer.kind, style))
    if numbers := drape.class_numbers:
        classes = [(value, value, _drawn(layer.kind, drape.style_of(at))) for value, at in numbers.items()]
        renderer = qgis.classes([*classes, ("", "others", _drawn(layer.kind, style))], drape["by"])
    if style["label"]:
        renderer += qgis.labels(style["label"], style["label_size"], rgb_from_hex(style["label_colour"]))
    scales = drape["finest"] / _PIXEL, drape["coarsest"] / _PIXEL or qgis.ANY_SCALE[1]
    return layer._replace(style=renderer, opacity=drape["opacity"], blend=drape["blend"], scales=scales)


def _drawn(kind: str, style: Properties) -> str:
    """Return the symbol of a draped layer's style for points, lines or areas."""
    colour, unit = style["colour"], {"m": "MapUnit", "px": "Pixel"}[style["unit"]]
    if kind == "marker":
        return qgis.marker(rgb_from_hex(colour or style["fill"] or "#808080"), style["width"], unit=unit)
    ends = {"butt": "flat", "mitre": "miter"}
    shape: dict[str, Any] = {f"{key}style": ends.get(style[key], style[key]) for key in ("cap", "join")}
    shape |= {"dash": style["dash"].replace(" ", ";"), "line_style": "solid" if colour else "no"}
    outline = qgis.line(rgb_from_hex(colour or "#000000"), style["width"], unit=unit, **shape)
    if kind == "line" or not style["fill"]:
        return qgis.symbol(kind, outline)
    inside, opacity = rgb_from_hex(style["fill"]), style["fill_opacity"]
    if style["hatch"] == "none":
        return qgis.fill(inside, opacity, outline)
    stroke = qgis.symbol("line", qgis.line(inside, style["width"], unit=unit), opacity=opacity)
    gap = {"distance": style["hatch_spacing"], "distance_unit": unit}
    turns = (0.0,) if style["hatch"] == "lines" else (0.0, 90.0)
    hatches = ({"angle": style["hatch_angle"] + turn} | gap for turn in turns)
    return qgis.symbol("fill", *(qgis.drawing("LinePatternFill", each, stroke) for each in hatches), outline)


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
