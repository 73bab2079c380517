"""Layers of GeoPackages with their styles, for QGIS and as Styled Layer Descriptors."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path
from typing import Any, Final
from xml.sax.saxutils import escape

import numpy as np
import numpy.typing as npt
import shapely

from sketchterrain.document.drapes import DrapedLayer
from sketchterrain.export import qgis_project as qgis
from sketchterrain.export.drapes import table_names
from sketchterrain.export.qgis_project import MapLayer, Rule
from sketchterrain.export.sampled import srgb_of
from sketchterrain.export.target import Export
from sketchterrain.schema.layers import INK, LAYERS, STANDING_LAYERS, WAY_LAYERS
from sketchterrain.schema.materials import Colour
from sketchterrain.schema.parameters import Properties
from sketchterrain.schema.styles import PIXEL, rgb_from_hex, style_class

_PIXEL: Final = 0.000264583  # m on a screen of 96 dpi
_EXPOSURE: Final = 2.5  # of albedos, as in a photograph
_PLANTS_FROM, _ALL_FROM, _GRASS_FROM = 60_000.0, 12_000.0, 2_500.0  # denominators of the smallest scales
_CROWNS: Final = {"spruce": ("cone", 0.17), "pine": ("cone", 0.2), "oak": ("sphere", 0.36)}
"""3-D shapes of species, and their radius over their height; others are as birches."""
_BIRCH, _HERB = ("sphere", 0.26), 0.5  # and the height (m) of plants that are not woody
_GROWTH: Final = ((0.0, 0.6, 0.4), (0.6, 1.0, 0.8), (1.0, 99.0, 1.2))
"""Classes of plants in 3-D: least and greatest scale, and the scale that they are drawn at."""
_PARTS: Final = {"marker": ((0, 4), "Point"), "line": ((1, 5), "LineString"), "fill": ((3, 6), "Polygon")}
"""Shapely's type ids that symbols are for, and OGR's name of the geometry."""
ELSE: Final = "<ElseFilter/>"
_STYLE_COLUMNS: Final = (
    "id INTEGER PRIMARY KEY AUTOINCREMENT, f_table_catalog TEXT, f_table_schema TEXT, f_table_name TEXT, "
    "f_geometry_column TEXT, styleName TEXT, styleQML TEXT, styleSLD TEXT, useAsDefault BOOLEAN, "
    "update_time DATETIME"
)
_BUILDING_3D, _BRIDGE_3D, _VIOLET = (196, 176, 160), (186, 182, 176), "#7048e8"


def albedo_colour(albedo: npt.ArrayLike) -> Colour:
    """Return the sRGB of a linear albedo, exposed as in a photograph."""
    red, green, blue = srgb_of(np.minimum(_EXPOSURE * np.asarray(albedo, np.float64), 1.0)).tolist()
    return red, green, blue


def gis_layers(export: Export, counts: dict[str, int]) -> dict[str, list[MapLayer]]:
    """Return the layers of the GeoPackages from the top down."""

    def wide(field: str) -> str:
        return f'max("{field}", {least} * @map_scale)'

    def alike(title: str, **style: Any) -> tuple[Rule, ...]:
        return (Rule(title, style_class(title, **style).style),)

    river, lake = (LAYERS[name].class_of().style for name in ("river", "lake"))
    least, blue = river["width"] * PIXEL / 1000.0, rgb_from_hex(river["colour"])
    course = f"tapered_buffer($geometry, {wide('width_spring')}, {wide('width_mouth')}, 8)"
    taper = {"SymbolType": "Fill", "geometryModifier": course, "units": "MapUnit"}
    tapered = qgis.single(qgis.symbol("line", qgis.drawing("GeometryGenerator", taper, qgis.fill(blue))))
    houses, water = qgis.area_3d(_BUILDING_3D, '"building"'), qgis.area_3d(blue, "0")
    decks = alike("Bridge", colour=INK, width=1.5, fill="#ffffff", fill_opacity=1.0)
    sea = alike("Sea", **{**lake, "fill_opacity": 0.3})
    tables: dict[str, tuple[tuple[str, str, str, tuple[Rule, ...], str], ...]] = {
        "Roads and buildings": (
            ("pads", "Buildings and level ground", "fill", _rules("pad"), houses),
            *(
                (f"{name}s", LAYERS[name].title, "line", _rules(name), "")
                for name in (*STANDING_LAYERS, *WAY_LAYERS)
            ),
            ("tunnels", "Tunnels", "line", alike("Tunnel", colour=INK, width=1.25, dash="4.5 4.5"), ""),
            ("bridge_decks", "Bridges", "fill", decks, qgis.area_3d(_BRIDGE_3D, "1")),
            ("road_edges", "Edges of roads", "line", alike("Edge", colour=INK, width=0.5), ""),
        ),
        "Plants": (
            ("plants", "Plants", "marker", (), _plants("woody")),
            ("grass", "Grass", "marker", (), _plants("grass")),
        ),
        "Water": (
            ("rivers", "Rivers", "line", _rules("river"), tapered),
            ("lakes", "Lakes", "fill", _rules("lake"), water),
            ("sea", "Sea", "fill", sea, water),
            ("river_stations", "River stations", "marker", alike("Station", colour="#5c96c4", width=3.0), ""),
        ),
        "Land use": (("landuse", "Land use", "fill", _rules("landuse"), ""),),
        "Sketch": (
            ("features", "Landforms and groves", "marker", alike("Feature", colour=_VIOLET, width=6.0), ""),
        ),
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
                *(title, f"./{export.name}.gpkg|layername={table}", kind),
                own if "<renderer-v2" in own else qgis.ruled(kind, rules) + own,
                table not in hidden,
                scales=scales.get(table, qgis.ANY_SCALE),
                rules=rules,
            )
            for table, title, kind, rules, own in rows
            if counts.get(table)
        ]
    for name, vectors in export.terrain.sketch.vectors.items():
        groups["Sketch"] += _parts(export.name, f"sketch_{name}", f"Sketch: {name}", vectors.shapes())
    return groups


def _rules(name: str) -> tuple[Rule, ...]:
    """Return the styles of the classes of a sketch's layer."""
    layer, rules, before = LAYERS[name], list[Rule](), list[tuple[str, str]]()
    value, sum_of = f'"{layer.by}"', _property(layer.by)
    if layer.kind == "way":
        value = '"width" + 2 * "shoulder"'
        twice = f"<ogc:Mul>{_property('shoulder')}<ogc:Literal>2</ogc:Literal></ogc:Mul>"
        sum_of = f"<ogc:Add>{sum_of}{twice}</ogc:Add>"
        before = [("\"structure\" <> 'tunnel'", _compared("NotEqualTo", _property("structure"), "tunnel"))]
    for each in layer.classes:
        is_text, literal = isinstance(each.value, str), str(each.value)
        sign, kind = ("= ", "EqualTo") if is_text else (">= ", "GreaterThanOrEqualTo")
        expression = f"{value} {sign}{repr(literal) if is_text else literal}"
        own = [(expression, _compared(kind, sum_of, literal))] if layer.by else []
        terms, filters = zip(*before, *own, strict=True) if before or own else ((), ())
        joined = "".join(filters) if len(filters) < 2 else f"<ogc:And>{''.join(filters)}</ogc:And>"
        is_wide = "width" in layer.parameters
        rules.append(Rule(each.title, each.style, " AND ".join(terms), joined, is_wide=is_wide))
        before += [(f"NOT ({term})", f"<ogc:Not>{each}</ogc:Not>") for term, each in own]
    return tuple(rules)


def _property(name: str) -> str:
    return f"<ogc:PropertyName>{escape(name)}</ogc:PropertyName>"


def _compared(kind: str, value: str, literal: str) -> str:
    return f"<ogc:PropertyIs{kind}>{value}<ogc:Literal>{escape(literal)}</ogc:Literal></ogc:PropertyIs{kind}>"


def _plants(storey: str) -> str:
    """Return the renderers of plants: discs as wide as crowns, fewer at small scales, and 3-D crowns."""
    from sketchterrain.export.gltf_plants import plant_colour
    from sketchterrain.look.tree_species import HEIGHTS
    from sketchterrain.vegetation.plants import STOREYS

    discs, crowns = [], []
    woody = storey == "woody"
    for name, height in zip(STOREYS[storey], HEIGHTS if woody else [_HERB] * 3, strict=True):
        colour, (shape, share) = albedo_colour(plant_colour(name)), _CROWNS.get(name, _BIRCH)
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
            style = style_class(own, colour=_VIOLET, fill_opacity=0.1).style
            symbol, rules = qgis.single(qgis.styled(kind, style)), (Rule(own, style),)
            layers.append(MapLayer(own, source, kind, symbol, visible=False, rules=rules))
    return layers


def _draped(layer: MapLayer, drape: DrapedLayer) -> MapLayer:
    """Return a draped layer with its styles."""
    style, numbers, by = drape.style_of(-1), drape.class_numbers, _property(drape["by"])
    rules = [
        Rule(value, drape.style_of(at), value, _compared("EqualTo", by, value))
        for value, at in numbers.items()
    ]
    rules.append(Rule("others" if numbers else drape.title, style, "", ELSE if numbers else ""))
    symbols = [(each.expression, each.title, qgis.styled(layer.kind, each.style)) for each in rules]
    renderer = qgis.classes(symbols, drape["by"]) if numbers else qgis.single(symbols[0][2])
    if style["label"]:
        renderer += qgis.labels(style["label"], style["label_size"], rgb_from_hex(style["label_colour"]))
    scales = drape["finest"] / _PIXEL, drape["coarsest"] / _PIXEL or qgis.ANY_SCALE[1]
    look = {"opacity": drape["opacity"], "blend": drape["blend"], "scales": scales}
    return layer._replace(style=renderer, rules=tuple(rules), **look)


def write_styles(path: Path, layers: Iterable[MapLayer]) -> None:
    """Write the styles of a GeoPackage's layers into it, as QML, where QGIS reads it, and SLD.

    Of a table with several kinds of geometry only the first kind has one.
    """
    names = {each.source.split("|layername=")[1].split("|")[0]: each for each in reversed(list(layers))}
    with closing(sqlite3.connect(path)) as file, file:
        file.execute(f"CREATE TABLE layer_styles ({_STYLE_COLUMNS})")
        for name, each in sorted(names.items()):
            qml = f'<qgis version="3.22.16" styleCategories="Symbology|Labeling">{each.style}</qgis>'
            row = ("", "", name, "geom", name, qml, sld(name, each) if each.rules else None, 1, "2000-01-01")
            file.execute("INSERT INTO layer_styles VALUES (NULL, ?, ?, ?, ?, ?, ?, ?, ?, ?)", row)


def sld(name: str, layer: MapLayer) -> str:
    """Return a layer's rules as a Styled Layer Descriptor 1.0 (OGC 02-070); lengths are pixels or metres."""
    passes = ""
    for is_casing in (True, False):
        own = "".join(
            f"<Rule><Title>{escape(each.title)}</Title>{_filter(each.filter)}"
            f"{_symbolizers(layer.kind, each.style, is_casing=is_casing)}</Rule>"
            for each in layer.rules
            if each.style["casing"] or not is_casing
        )
        passes += f"<FeatureTypeStyle>{own}</FeatureTypeStyle>" if own else ""
    head = 'version="1.0.0" xmlns="http://www.opengis.net/sld" xmlns:ogc="http://www.opengis.net/ogc"'
    layer_style = f"<Name>{escape(name)}</Name><UserStyle>{passes}</UserStyle>"
    return f"<StyledLayerDescriptor {head}><NamedLayer>{layer_style}</NamedLayer></StyledLayerDescriptor>"


def _filter(content: str) -> str:
    return content if content in ("", ELSE) else f"<ogc:Filter>{content}</ogc:Filter>"


def _symbolizers(kind: str, style: Properties, *, is_casing: bool) -> str:
    def css(tag: str, **values: Any) -> str:
        own = (
            f'<CssParameter name="{key.replace("_", "-")}">{value}</CssParameter>'
            for key, value in values.items()
        )
        return f"<{tag}>{''.join(own)}</{tag}>"

    colour = style["casing" if is_casing else "colour"]
    width = style["width"] + 2.0 * style["casing_width"] * is_casing
    if kind == "marker":
        mark = (
            f"<Mark><WellKnownName>circle</WellKnownName>{css('Fill', fill=colour or style['fill'])}</Mark>"
        )
        return f"<PointSymbolizer><Graphic>{mark}<Size>{width}</Size></Graphic></PointSymbolizer>"
    ends = {"stroke_linecap": style["cap"], "stroke_linejoin": style["join"]}
    dash = {"stroke_dasharray": style["dash"]} if style["dash"] and not is_casing else {}
    stroke = css("Stroke", stroke=colour, stroke_width=width, **ends, **dash) if colour else ""
    if kind == "line":
        return f"<LineSymbolizer>{stroke}</LineSymbolizer>"
    inside = {"fill": style["fill"], "fill_opacity": style["fill_opacity"]}
    area = css("Fill", **inside) if style["fill"] and not is_casing else ""
    return f"<PolygonSymbolizer>{area}{stroke}</PolygonSymbolizer>"
