"""QGIS projects as XML: symbols, renderers, layers and a 3-D view, as QGIS 3.22 and later read them."""

from __future__ import annotations

import io
import math
import re
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple
from xml.sax.saxutils import escape, quoteattr

from sketchterrain.array_types import Bounds
from sketchterrain.export.target import SceneView
from sketchterrain.io.files import write_atomic
from sketchterrain.schema.materials import Colour
from sketchterrain.schema.parameters import Properties
from sketchterrain.schema.styles import PIXEL, rgb_from_hex

BLENDS: Final = {"normal": 0, "screen": 2, "add": 4, "multiply": 6}
"""QGIS's numbers of modes in which colours mix with those below."""
ANY_SCALE: Final = (0.0, 1e8)
VIEW: Final = "3-D view"
"""Name of the 3-D view and of its theme."""

_GEOMETRY: Final = {"marker": "Point", "line": "Line", "fill": "Polygon"}


class Rule(NamedTuple):
    """The style of features of a layer that meet a condition, if any."""

    title: str
    style: Properties
    expression: str = ""  # as QGIS reads it
    filter: str = ""  # as an OGC filter
    is_wide: bool = False  # whether lines are as wide as they are on the ground, if their style is narrower


class MapLayer(NamedTuple):
    """A layer of a project."""

    title: str
    source: str  # relative to the project: ``./name.tif``, ``./name.gpkg|layername=rivers``
    kind: str  # ``raster``, or symbols of vectors: ``marker``, ``line``, ``fill``
    style: str  # renderers and labels
    visible: bool = True
    blend: str = "normal"
    opacity: float = 1.0  # of vectors
    scales: tuple[float, float] = ANY_SCALE  # denominators of the largest and smallest scale that show it
    rules: tuple[Rule, ...] = ()  # of vectors whose style follows from them

    @property
    def id(self) -> str:
        """Its id, unique among layers of different sources or titles."""
        return re.sub(r"\W", lambda each: f"_{ord(each[0]):x}_", f"{self.source} {self.title}")

    @property
    def provider(self) -> str:
        """QGIS's name of what reads it."""
        return "gdal" if self.kind == "raster" else "ogr"


def rgba(colour: Colour, opacity: float = 1.0) -> str:
    """Return a colour as QGIS writes it."""
    return ",".join(map(str, (*colour, round(255 * opacity))))


def _tag(name: str, values: Mapping[str, Any], content: str = "") -> str:
    own = "".join(f" {key}={quoteattr(str(value))}" for key, value in values.items())
    return f"<{name}{own}>{content}</{name}>"


def _map(values: Mapping[str, Any]) -> str:
    """Return named values as QGIS stores settings."""
    own = (_tag("Option", {"name": key, "type": "QString", "value": each}) for key, each in values.items())
    return f'<Option type="Map">{"".join(own)}</Option>'


def _by_feature(tag: str, expressions: Mapping[str, str]) -> str:
    """Return properties by expressions, which are evaluated for each feature."""
    active = '<Option name="active" type="bool" value="true"/><Option name="type" type="int" value="3"/>'
    own = "".join(
        f'<Option name="{key}" type="Map">{active}'
        f'<Option name="expression" type="QString" value={quoteattr(text)}/></Option>'
        for key, text in expressions.items()
    )
    return f'<{tag}><Option type="Map"><Option name="properties" type="Map">{own}</Option></Option></{tag}>'


def symbol(kind: str, *drawings: str, name: str = "0", opacity: float = 1.0) -> str:
    """Return a symbol of drawings from the lowest to the highest."""
    return f'<symbol type="{kind}" name="{name}" alpha="{opacity}">{"".join(drawings)}</symbol>'


def drawing(
    kind: str, values: Mapping[str, Any], inner: str = "", *, metres: str = "", order: int = 0
) -> str:
    """Return one drawing of a symbol; `metres` is an expression of its width that replaces a constant."""
    key = "size" if kind == "SimpleMarker" else "outlineWidth"
    width = _by_feature("data_defined_properties", {key: metres}) if metres else ""
    return f'<layer class="{kind}" enabled="1" pass="{order}">{_map(values)}{width}{inner}</layer>'


def fill(colour: Colour, opacity: float = 1.0, *over: str) -> str:
    """Return a symbol of areas in one colour, with drawings on top of it."""
    values = {"color": rgba(colour, opacity), "outline_style": "no"}
    return symbol("fill", drawing("SimpleFill", values), *over)


def line(
    colour: Colour, width: float = 0.0, *, metres: str = "", unit: str = "MM", dash: str = "", **shape: Any
) -> str:
    """Return a drawing of lines, see `drawing`; dashes are ``6;3``."""
    order = shape.pop("order", 0)
    values = {"line_color": rgba(colour), "line_width": width, "customdash_unit": unit}
    values |= {"line_width_unit": "MapUnit" if metres else unit, "use_custom_dash": int(bool(dash))}
    values |= {"customdash": dash or "5;2", "capstyle": "flat" if dash else "round", "joinstyle": "round"}
    return drawing("SimpleLine", {**values, **shape}, metres=metres, order=order)


def marker(colour: Colour, diameter: float = 0.0, *, metres: str = "", unit: str = "MM") -> str:
    """Return a symbol of points: a disc."""
    values = {"name": "circle", "color": rgba(colour), "outline_style": "no", "size": diameter}
    units = {"size_unit": "MapUnit" if metres else unit}
    return symbol("marker", drawing("SimpleMarker", values | units, metres=metres))


def styled(kind: str, style: Properties, *, on_paper: bool = False, wide: bool = False) -> str:
    """Return the symbol of a style for points (``marker``), lines or areas (``fill``).

    Pixels are those of a screen, or of a map `on_paper`; `wide` lines with a casing are as wide as their
    feature's property ``width`` or their style.
    """
    unit, scale = ("MM", PIXEL) if on_paper else ({"m": "MapUnit", "px": "Pixel"}[style["unit"]], 1.0)
    colour, width, edge = style["colour"], scale * style["width"], 2.0 * scale * style["casing_width"]
    if kind == "marker":
        return marker(rgb_from_hex(colour or style["fill"] or "#808080"), width, unit=unit)
    ends = {"butt": "flat", "mitre": "miter"}
    shape: dict[str, Any] = {f"{key}style": ends.get(style[key], style[key]) for key in ("cap", "join")}
    dash = ";".join(f"{scale * float(each):g}" for each in style["dash"].split())
    metres = f'max("width", {width / 1000.0} * @map_scale)' if wide and style["casing"] else ""
    pens = list[str]()
    if style["casing"]:
        outer = metres and f"{metres} + {edge / 1000.0} * @map_scale"
        pens.append(line(rgb_from_hex(style["casing"]), width + edge, metres=outer, unit=unit))
    shape |= {"dash": dash, "line_style": "solid" if colour else "no", "order": len(pens)}
    pens.append(line(rgb_from_hex(colour or "#000000"), width, metres=metres, unit=unit, **shape))
    if kind == "line" or not style["fill"]:
        return symbol(kind, *pens)
    inside, opacity = rgb_from_hex(style["fill"]), style["fill_opacity"]
    if style["hatch"] == "none":
        return fill(inside, opacity, *pens)
    stroke = symbol("line", line(inside, width, unit=unit), opacity=opacity)
    gap = {"distance": scale * style["hatch_spacing"], "distance_unit": unit}
    turns = (0.0,) if style["hatch"] == "lines" else (0.0, 90.0)
    hatches = ({"angle": style["hatch_angle"] + turn} | gap for turn in turns)
    return symbol("fill", *(drawing("LinePatternFill", each, stroke) for each in hatches), *pens)


def ruled(kind: str, rules: Iterable[Rule]) -> str:
    """Return a renderer of classes on paper."""
    symbols = ((each, styled(kind, each.style, on_paper=True, wide=each.is_wide)) for each in rules)
    return classes((each.expression, each.title, symbol) for each, symbol in symbols)


def single(each: str) -> str:
    """Return a renderer that draws all features alike, one drawing of all of them after the other."""
    return f'<renderer-v2 type="singleSymbol" symbollevels="1"><symbols>{each}</symbols></renderer-v2>'


def classes(entries: Iterable[tuple[str, str, str]], by: str = "") -> str:
    """Return a renderer of classes by the value of an expression, or by conditions: either, title and symbol.

    All of a drawing of conditions lies beneath all of the next.
    """
    named, symbols = [], []
    for number, (value, title, symbol) in enumerate(entries):
        which = {"value": value, "render": "true"} if by else {"filter": value, "key": number}
        named.append(_tag("category" if by else "rule", which | {"label": title, "symbol": number}))
        symbols.append(symbol.replace('name="0"', f'name="{number}"', 1))
    kind = {"type": "categorizedSymbol", "attr": by} if by else {"type": "RuleRenderer", "symbollevels": 1}
    listed = _tag("categories" if by else "rules", {} if by else {"key": "all"}, "".join(named))
    return _tag("renderer-v2", kind, f"{listed}<symbols>{''.join(symbols)}</symbols>")


def crowns_3d(entries: Iterable[tuple[str, Colour, str, float, float]]) -> str:
    """Return a 3-D renderer of points: condition, colour, ``cone`` or ``sphere``, radius and height (m)."""
    unit, rules = _map({"bottomRadius": 0.5, "topRadius": 0, "length": 1, "radius": 0.5}), []
    for key, (condition, colour, shape, radius, height) in enumerate(entries):
        matrix = f"{2 * radius:g} 0 0 0 0 {height:g} 0 0 0 0 {2 * radius:g} 0 0 {height / 2:g} 0 1"
        kind = {"type": "point", "shape": shape, "material_type": "phong"}
        place = f'<data alt-clamping="terrain"/><transform matrix="{matrix}"/>'
        each = _tag("symbol", kind, f"{place}{_material(colour)}<shape-properties>{unit}</shape-properties>")
        rules.append(_tag("rule", {"filter": condition, "key": key}, each))
    return f'<renderer-3d type="rulebased"><rules key="all">{"".join(rules)}</rules></renderer-3d>'


def area_3d(colour: Colour, height: str) -> str:
    """Return a 3-D renderer of areas at their own height, extruded by an expression (m)."""
    data = '<data alt-clamping="absolute" alt-binding="vertex" culling-mode="no-culling" height="0"/>'
    extruded = _by_feature("data-defined-properties", {"extrusionHeight": height})
    each = f'<symbol type="polygon" material_type="phong">{data}{_material(colour)}{extruded}</symbol>'
    return f'<renderer-3d type="vector">{each}</renderer-3d>'


def _material(colour: Colour) -> str:
    ambient = rgba((colour[0] // 2, colour[1] // 2, colour[2] // 2))
    return f'<material ambient="{ambient}" diffuse="{rgba(colour)}" specular="0,0,0,255" shininess="1"/>'


def raster(
    kind: str, values: Mapping[str, Any], content: str = "", *, brightness: int = 0, smooth: bool = True
) -> str:
    """Return a renderer of a raster."""
    own: dict[str, Any] = {"type": kind, "band": 1, "alphaBand": -1, "opacity": 1, **values}
    tone = f'<brightnesscontrast brightness="{brightness}" contrast="0" gamma="1"/>'
    methods = 'zoomedInResamplingMethod="cubic" zoomedOutResamplingMethod="average" maxOversampling="2"'
    provider = f'<provider><resampling enabled="true" {methods}/></provider>' if smooth else ""
    stage = f"<resamplingStage>{'provider' if smooth else 'resamplingFilter'}</resamplingStage>"
    return f"<pipe>{provider}{_tag('rasterrenderer', own, content)}{tone}{stage}</pipe>"


def palette(entries: Iterable[tuple[int, Colour, str]], opacity: float = 1.0) -> str:
    """Return a renderer of classes, nothing elsewhere: value, colour and title of each."""
    named = "".join(
        _tag("paletteEntry", {"value": value, "color": _hex(colour), "label": title, "alpha": 255})
        for value, colour, title in entries
    )
    return raster("paletted", {"opacity": opacity}, f"<colorPalette>{named}</colorPalette>", smooth=False)


def ramp(stops: Sequence[tuple[float, Colour]], unit: str = "", band: int = 1) -> str:
    """Return a renderer that interpolates colours of numbers, the lowest first."""
    items = "".join(
        _tag("item", {"value": value, "color": _hex(colour), "label": f"{value:.4g}{unit}", "alpha": 255})
        for value, colour in stops
    )
    low, high = stops[0][0], stops[-1][0]
    legend = f'<rampLegendSettings useContinuousLegend="1" suffix="{unit}" orientation="2"/>'
    limits = {"colorRampType": "INTERPOLATED", "minimumValue": low, "maximumValue": high}
    shader = f"<rastershader>{_tag('colorrampshader', limits, items + legend)}</rastershader>"
    ends = {"classificationMin": low, "classificationMax": high, "band": band}
    return raster("singlebandpseudocolor", ends, shader)


def _hex(colour: Colour) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)


def labels(field: str, size: float, colour: Colour) -> str:
    """Return labels of a field with a pale outline; size in pixels."""
    style = {"fieldName": field, "fontSize": size, "fontSizeUnit": "Pixel", "textColor": rgba(colour)}
    halo = '<text-buffer bufferDraw="1" bufferSize="1" bufferColor="255,255,255,200"/>'
    return f'<labeling type="simple"><settings>{_tag("text-style", style, halo)}</settings></labeling>'


def write_project(
    path: Path,
    title: str,
    wkt: str,
    bounds: Bounds,
    groups: Mapping[str, Sequence[MapLayer]],
    themes: Mapping[str, Sequence[MapLayer]],
    terrain: MapLayer,
    scene: SceneView,
) -> Path:
    """Write a ``.qgz``: groups of layers and themes, from the top down, and a 3-D view; deterministic.

    The view shows the layers of the theme `VIEW` on the terrain, whose layer has heights.
    """
    reference = f"<spatialrefsys><wkt>{escape(wkt)}</wkt></spatialrefsys>"
    view = _view(terrain, themes[VIEW], scene, bounds, reference)
    corners = dict(zip(("xmin", "ymin", "xmax", "ymax"), bounds, strict=True))
    extent = "".join(f"<{key}>{value}</{key}>" for key, value in corners.items())
    layers = [layer for group in groups.values() for layer in group]
    tree = (_tag("layer-tree-group", {"name": name}, _entries(group)) for name, group in groups.items())
    presets = (_tag("visibility-preset", {"name": name}, _ids(each)) for name, each in themes.items())
    text = f"""<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<qgis version="3.22.16" projectname={quoteattr(title)}><title>{escape(title)}</title>
<projectCrs>{reference}</projectCrs><layer-tree-group>{"".join(tree)}</layer-tree-group>
<mapcanvas name="theMapCanvas" annotationsVisible="1"><units>meters</units><extent>{extent}</extent>
<rotation>0</rotation><destinationsrs>{reference}</destinationsrs></mapcanvas>
<projectlayers>{"".join(_layer(layer, reference) for layer in layers)}</projectlayers>
<properties><Measurement><DistanceUnits type="QString">meters</DistanceUnits></Measurement>
<Paths><Absolute type="bool">false</Absolute></Paths>
<SpatialRefSys><ProjectionsEnabled type="int">1</ProjectionsEnabled></SpatialRefSys></properties>
<visibility-presets>{"".join(presets)}</visibility-presets>
<mapViewDocks3D>{view}</mapViewDocks3D>
<ProjectViewSettings>{_tag("DefaultViewExtent", corners, reference)}</ProjectViewSettings></qgis>
"""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as file:  # an entry by its name alone has a fixed time
        file.writestr(zipfile.ZipInfo(f"{path.stem}.qgs"), text, zipfile.ZIP_DEFLATED)
    return write_atomic(path, content.getvalue())


def _entries(layers: Sequence[MapLayer]) -> str:
    return "".join(
        _tag(
            "layer-tree-layer",
            {"id": each.id, "name": each.title, "source": each.source, "providerKey": each.provider}
            | {"checked": "Qt::Checked" if each.visible else "Qt::Unchecked"}
            | {"expanded": int("</rules>" in each.style or "</categories>" in each.style)},
        )
        for each in layers
    )


def _layer(layer: MapLayer, reference: str) -> str:
    values: dict[str, Any] = {
        "type": "raster" if layer.kind == "raster" else "vector",
        "simplifyDrawingHints": 1,
    }
    values |= {"geometry": _GEOMETRY.get(layer.kind, ""), "labelsEnabled": int("<labeling" in layer.style)}
    values |= {"hasScaleBasedVisibilityFlag": int(layer.scales != ANY_SCALE)}
    values |= {"maxScale": layer.scales[0], "minScale": layer.scales[1]}
    return _tag(
        "maplayer",
        values,
        f"<id>{layer.id}</id><datasource>{escape(layer.source)}</datasource>"
        f"<layername>{escape(layer.title)}</layername><srs>{reference}</srs>"
        f'<provider encoding="UTF-8">{layer.provider}</provider>{layer.style}'
        f"<blendMode>{BLENDS[layer.blend]}</blendMode><layerOpacity>{layer.opacity}</layerOpacity>\n",
    )


def _ids(layers: Iterable[MapLayer]) -> str:
    return "".join(_tag("layer", {"id": each.id, "style": "default", "visible": 1}) for each in layers)


def _view(
    terrain: MapLayer, layers: Sequence[MapLayer], scene: SceneView, bounds: Bounds, reference: str
) -> str:
    """Return a bird's view of the whole map in the scene's direction, with its sun."""
    west, south, east, north = bounds
    x, y, z = 0.5 * (west + east), 0.5 * (south + north), scene.target[2]
    azimuth, elevation = math.radians(scene.sun_azimuth), math.radians(scene.sun_elevation)
    light = {"x": -math.sin(azimuth) * math.cos(elevation), "y": -math.sin(elevation)}
    light |= {"z": math.cos(azimuth) * math.cos(elevation)}  # where it goes: x east, y up, z south
    # The middle of the picture: from the origin, and since QGIS 3.42 in the project's CRS.
    camera = {"x": 0, "y": 0, "elev": z, "xMap": x, "yMap": y, "zMap": z}
    camera |= {"dist": 1.25 * max(east - west, north - south), "pitch": 58, "yaw": -scene.heading}
    return f"""<view name="{VIEW}" isOpen="1" area="2" floating="0" width="700" height="600"><qgis3d>
<origin x="{x}" y="{y}" z="0"/><camera field-of-view="{scene.fov}" projection-type="1"/>
<color background="214,228,240,255" selection="255,255,0,255"/><crs>{reference}</crs>
<terrain exaggeration="1" texture-size="512" max-terrain-error="2" shading-enabled="1" map-theme="{VIEW}">
<shading-material ambient="105,110,120,255" diffuse="255,255,255,255" specular="0,0,0,255" shininess="1"/>
<layers>{_ids(layers)}</layers>
<generator type="dem" layer="{terrain.id}" resolution="32" skirt-height="10"/></terrain><point-lights/>
<directional-lights>{_tag("directional-light", light | {"color": "255,250,240,255", "intensity": 0.8})}
</directional-lights></qgis3d>{_tag("camera", camera)}</view>"""
