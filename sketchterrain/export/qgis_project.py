"""QGIS projects as XML: symbols, renderers, layers and a 3-D view, as QGIS 3.22 and later read them."""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple
from xml.sax.saxutils import escape, quoteattr

from sketchterrain.array_types import Bounds
from sketchterrain.document.materials import Colour
from sketchterrain.io.files import write_atomic

BLENDS: Final = {"normal": 0, "screen": 2, "add": 4, "multiply": 6}
"""QGIS's numbers of modes in which colours mix with those below."""
WHOLE_MAP: Final = (0.0, 1e8)

_GEOMETRY: Final = {"marker": "Point", "line": "Line", "fill": "Polygon"}


class Layer(NamedTuple):
    """A layer of a project."""

    title: str
    source: str  # relative to the project: ``./name.tif``, ``./name.gpkg|layername=rivers``
    kind: str  # ``raster``, or symbols of vectors: ``marker``, ``line``, ``fill``
    style: str  # renderers and labels
    visible: bool = True
    folded: bool = True  # whether the tree hides its legend
    opacity: float = 1.0
    blend: str = "normal"
    scales: tuple[float, float] = WHOLE_MAP  # denominators of the largest and smallest scale that show it

    @property
    def id(self) -> str:
        """Its id, unique among layers of different sources or titles."""
        text = f"{self.source.removeprefix('./')} {self.title}"
        return "".join(letter if letter.isalnum() else f"_{ord(letter):x}_" for letter in text)


class View(NamedTuple):
    """A 3-D view; coordinates of the project's CRS, m."""

    terrain: Layer
    theme: str  # what is painted on the terrain
    centre: tuple[float, float, float]
    distance: float
    heading: float  # compass bearing, degrees
    pitch: float  # degrees; 0 looks straight down
    fov: float  # vertical, degrees
    sun: tuple[float, float]  # azimuth and elevation, degrees


def rgba(colour: Colour, opacity: float = 1.0) -> str:
    """Return a colour as QGIS writes it."""
    return ",".join(map(str, (*colour, round(255 * opacity))))


def _hex(colour: Colour) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)


def _tag(name: str, values: Mapping[str, Any], content: str = "") -> str:
    own = "".join(f" {key}={quoteattr(str(value))}" for key, value in values.items())
    return f"<{name}{own}>{content}</{name}>"


def _map(values: Mapping[str, Any]) -> str:
    """Return named values as QGIS stores settings."""
    own = (_tag("Option", {"name": key, "type": "QString", "value": each}) for key, each in values.items())
    return _tag("Option", {"type": "Map"}, "".join(own))


def _evaluated(tag: str, expressions: Mapping[str, str]) -> str:
    """Return properties by expressions, which are evaluated for each feature."""
    own = "".join(
        f'<Option name="{key}" type="Map"><Option name="active" type="bool" value="true"/>'
        f'<Option name="type" type="int" value="3"/>'
        f'<Option name="expression" type="QString" value={quoteattr(text)}/></Option>'
        for key, text in expressions.items()
    )
    properties = f'<Option name="properties" type="Map">{own}</Option>'
    return f'<{tag}><Option type="Map">{properties}</Option></{tag}>'


def symbol(kind: str, *drawings: str, name: str = "0", opacity: float = 1.0) -> str:
    """Return a symbol of drawings from the lowest to the highest."""
    return _tag("symbol", {"type": kind, "name": name, "alpha": opacity}, "".join(drawings))


def drawing(
    kind: str, inner: str = "", *, order: int = 0, by: Mapping[str, str] | None = None, **values: Any
) -> str:
    """Return one drawing of a symbol; `by` has expressions that replace values feature by feature."""
    content = _map(values) + _evaluated("data_defined_properties", by or {}) + inner
    return _tag("layer", {"class": kind, "enabled": 1, "pass": order}, content)


def fill(
    colour: Colour | None, outline: Colour | None = None, width: float = 0.2, opacity: float = 1.0
) -> str:
    """Return a symbol of areas: one colour, and an outline (mm)."""
    styles = {"style": "solid" if colour else "no", "outline_style": "solid" if outline else "no"}
    colours = {"color": rgba(colour or (0, 0, 0), opacity), "outline_color": rgba(outline or (0, 0, 0))}
    return symbol("fill", drawing("SimpleFill", outline_width=width, **styles, **colours))


def line(
    colour: Colour, width: float = 0.0, *, metres: str = "", dash: str = "", unit: str = "MM", **values: Any
) -> str:
    """Return a drawing of lines of a width, or an expression of it in metres; dashes are ``6;3``."""
    units = {"line_width_unit": "MapUnit" if metres else unit, "customdash_unit": unit}
    shape = {"capstyle": "flat" if dash else "round", "joinstyle": "round"} | values
    dashes = {"use_custom_dash": int(bool(dash)), "customdash": dash or "5;2"}
    by = {"outlineWidth": metres} if metres else None
    return drawing("SimpleLine", line_color=rgba(colour), line_width=width, by=by, **units, **dashes, **shape)


def marker(colour: Colour, diameter: float = 0.0, *, metres: str = "", unit: str = "MM") -> str:
    """Return a symbol of points: a disc of a diameter, or an expression of it in metres."""
    size = {"size": diameter, "size_unit": "MapUnit" if metres else unit, "name": "circle"}
    by = {"size": metres} if metres else None
    return symbol("marker", drawing("SimpleMarker", color=rgba(colour), outline_style="no", by=by, **size))


def _renderer(kind: str, content: str, symbols: Sequence[str], **values: Any) -> str:
    numbered = (each.replace('name="0"', f'name="{number}"', 1) for number, each in enumerate(symbols))
    found = f"<symbols>{''.join(numbered)}</symbols>"
    return _tag("renderer-v2", {"type": kind, **values}, content + found)


def single(each: str) -> str:
    """Return a renderer that draws all features alike."""
    return _renderer("singleSymbol", "", [each])


def categories(by: str, entries: Sequence[tuple[str, str, str]]) -> str:
    """Return a renderer of the values of an expression: value, title and symbol of each."""
    named = "".join(
        _tag("category", {"value": value, "label": title, "symbol": number, "render": "true"})
        for number, (value, title, _) in enumerate(entries)
    )
    symbols = [each for _, _, each in entries]
    return _renderer("categorizedSymbol", f"<categories>{named}</categories>", symbols, attr=by)


def rules(entries: Sequence[tuple[str, str, str]]) -> str:
    """Return a renderer of rules, whose drawings are in order: condition, title and symbol of each."""
    named = "".join(
        _tag("rule", {"filter": condition, "label": title, "symbol": number, "key": title})
        for number, (condition, title, _) in enumerate(entries)
    )
    symbols = [each for _, _, each in entries]
    return _renderer("RuleRenderer", f'<rules key="all">{named}</rules>', symbols, symbollevels=1)


def rules_3d(entries: Iterable[tuple[str, str]]) -> str:
    """Return a 3-D renderer of rules: condition and 3-D symbol of each."""
    named = "".join(
        _tag("rule", {"filter": condition, "key": number}, each)
        for number, (condition, each) in enumerate(entries)
    )
    tiling = '<vector-layer-3d-tiling zoom-levels-count="3" show-bounding-boxes="0"/>'
    return f'<renderer-3d type="rulebased">{tiling}<rules key="all">{named}</rules></renderer-3d>'


def crown_3d(colour: Colour, shape: str, radius: float, height: float) -> str:
    """Return a 3-D symbol of points: a ``cone`` or ``sphere`` (m) on the ground."""
    unit = {"bottomRadius": 0.5, "topRadius": 0, "length": 1, "radius": 0.5}
    across = 2.0 * radius
    matrix = f"{across:g} 0 0 0 0 {height:g} 0 0 0 0 {across:g} 0 0 {0.5 * height:g} 0 1"
    return (
        f'<symbol type="point" shape="{shape}" material_type="phong"><data alt-clamping="terrain"/>'
        f'{_material(colour)}<shape-properties>{_map(unit)}</shape-properties><transform matrix="{matrix}"/></symbol>'
    )


def area_3d(colour: Colour, height: str) -> str:
    """Return a 3-D renderer of areas at their own height, extruded by an expression (m)."""
    data = '<data alt-clamping="absolute" alt-binding="vertex" culling-mode="no-culling" height="0"/>'
    extruded = _evaluated("data-defined-properties", {"extrusionHeight": height})
    each = f'<symbol type="polygon" material_type="phong">{data}{_material(colour)}{extruded}</symbol>'
    return f'<renderer-3d type="vector">{each}</renderer-3d>'


def _material(colour: Colour) -> str:
    ambient = rgba((colour[0] // 2, colour[1] // 2, colour[2] // 2))
    return f'<material ambient="{ambient}" diffuse="{rgba(colour)}" specular="0,0,0,255" shininess="1"/>'


def raster(
    kind: str,
    content: str = "",
    *,
    smooth: bool = True,
    brightness: int = 0,
    opacity: float = 1.0,
    **values: Any,
) -> str:
    """Return a renderer of a raster."""
    own = {"type": kind, "band": 1, "alphaBand": -1, "opacity": opacity}
    own |= {key.replace("_", "-"): value for key, value in values.items()}
    resampler = '<rasterresampler zoomedInResampler="bilinear" maxOversampling="2"/>' if smooth else ""
    tone = _tag("brightnesscontrast", {"brightness": brightness, "contrast": 0, "gamma": 1})
    return f"<pipe>{_tag('rasterrenderer', own, content)}{tone}{resampler}</pipe>"


def palette(entries: Iterable[tuple[int, Colour, str]], **values: Any) -> str:
    """Return a renderer of classes, nothing elsewhere: value, colour and title of each."""
    named = "".join(
        _tag("paletteEntry", {"value": value, "color": _hex(colour), "label": title, "alpha": 255})
        for value, colour, title in entries
    )
    return raster("paletted", f"<colorPalette>{named}</colorPalette>", smooth=False, **values)


def ramp(stops: Sequence[tuple[float, Colour]], unit: str = "", **values: Any) -> str:
    """Return a renderer that interpolates colours of numbers, the lowest first."""
    items = "".join(
        _tag("item", {"value": value, "color": _hex(colour), "label": f"{value:.4g}{unit}", "alpha": 255})
        for value, colour in stops
    )
    limits = {"minimumValue": stops[0][0], "maximumValue": stops[-1][0]}
    legend = _tag("rampLegendSettings", {"useContinuousLegend": 1, "suffix": unit, "orientation": 2})
    shader = _tag("colorrampshader", {"colorRampType": "INTERPOLATED", **limits}, items + legend)
    ends = {"classificationMin": stops[0][0], "classificationMax": stops[-1][0]}
    return raster("singlebandpseudocolor", f"<rastershader>{shader}</rastershader>", **ends, **values)


def labels(field: str, size: float, colour: Colour) -> str:
    """Return labels of a field with a pale outline; size in pixels."""
    style = {"fieldName": field, "fontSize": size, "fontSizeUnit": "Pixel", "textColor": rgba(colour)}
    halo = '<text-buffer bufferDraw="1" bufferSize="1" bufferColor="255,255,255,200"/>'
    return f'<labeling type="simple"><settings>{_tag("text-style", style, halo)}</settings></labeling>'


def write_project(
    path: Path,
    title: str,
    crs: str,
    bounds: Bounds,
    groups: Mapping[str, Sequence[Layer]],
    themes: Mapping[str, Sequence[Layer]],
    view: View,
) -> Path:
    """Write a ``.qgz``: groups of layers from the top down, in a CRS as WKT, and one 3-D view; deterministic."""
    reference = f"<spatialrefsys><wkt>{escape(crs)}</wkt></spatialrefsys>"
    corners = dict(zip(("xmin", "ymin", "xmax", "ymax"), bounds, strict=True))
    extent = "".join(f"<{key}>{value}</{key}>" for key, value in corners.items())
    layers = [layer for group in groups.values() for layer in group]
    terrain = {"layer": view.terrain.id, "layerName": view.terrain.title, "layerSource": view.terrain.source}
    text = f"""<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<qgis version="3.22.16" projectname={quoteattr(title)}><title>{escape(title)}</title>
<projectCrs>{reference}</projectCrs>
<layer-tree-group>{"".join(_group(name, group) for name, group in groups.items())}</layer-tree-group>
<mapcanvas name="theMapCanvas" annotationsVisible="1"><units>meters</units><extent>{extent}</extent>
<rotation>0</rotation><destinationsrs>{reference}</destinationsrs></mapcanvas>
<projectlayers>{"".join(_layer(layer, reference) for layer in layers)}</projectlayers>
<properties><Measurement><DistanceUnits type="QString">meters</DistanceUnits></Measurement>
<Paths><Absolute type="bool">false</Absolute></Paths>
<SpatialRefSys><ProjectionsEnabled type="int">1</ProjectionsEnabled></SpatialRefSys></properties>
<visibility-presets>{"".join(_theme(*theme) for theme in themes.items())}</visibility-presets>
<mapViewDocks3D>{_view(view, layers, reference)}</mapViewDocks3D>
<ProjectViewSettings>{_tag("DefaultViewExtent", corners, reference)}</ProjectViewSettings>
<ElevationProperties><terrainProvider type="raster">
{_tag("TerrainProvider", {"offset": 0, "scale": 1, "layerProvider": "gdal", **terrain})}
</terrainProvider></ElevationProperties></qgis>
"""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as file:
        # An entry by its name alone has a fixed time.
        file.writestr(zipfile.ZipInfo(f"{path.stem}.qgs"), text, zipfile.ZIP_DEFLATED)
    return write_atomic(path, content.getvalue())


def _provider(layer: Layer) -> str:
    return "gdal" if layer.kind == "raster" else "ogr"


def _group(title: str, layers: Sequence[Layer]) -> str:
    entries = "".join(
        _tag(
            "layer-tree-layer",
            {"id": each.id, "name": each.title, "source": each.source, "providerKey": _provider(each)}
            | {"checked": f"Qt::{'C' if each.visible else 'Unc'}hecked", "expanded": int(not each.folded)},
        )
        for each in layers
    )
    return _tag("layer-tree-group", {"name": title, "expanded": 1, "checked": "Qt::Checked"}, entries)


def _layer(layer: Layer, reference: str) -> str:
    largest, smallest = layer.scales
    own = {"hasScaleBasedVisibilityFlag": int(layer.scales != WHOLE_MAP)}
    own |= {"maxScale": largest, "minScale": smallest}
    if layer.kind == "raster":
        kind = {"type": "raster"}
    else:
        kind = {"type": "vector", "geometry": _GEOMETRY[layer.kind], "simplifyDrawingHints": "1"}
        own |= {"labelsEnabled": int("<labeling" in layer.style)}
    return _tag(
        "maplayer",
        kind | own,
        f"<id>{layer.id}</id><datasource>{escape(layer.source)}</datasource>"
        f"<layername>{escape(layer.title)}</layername><srs>{reference}</srs>"
        f'<provider encoding="UTF-8">{_provider(layer)}</provider>{layer.style}'
        f"<blendMode>{BLENDS[layer.blend]}</blendMode><layerOpacity>{layer.opacity}</layerOpacity>\n",
    )


def _theme(name: str, layers: Sequence[Layer]) -> str:
    shown = (_tag("layer", {"id": each.id, "style": "default", "visible": 1}) for each in layers)
    return _tag("visibility-preset", {"name": name}, "".join(shown))


def _view(view: View, layers: Sequence[Layer], reference: str) -> str:
    x, y, z = view.centre
    azimuth, elevation = map(math.radians, view.sun)
    light = {  # where it goes: x east, y up, z south
        "x": -math.sin(azimuth) * math.cos(elevation),
        "y": -math.sin(elevation),
        "z": math.cos(azimuth) * math.cos(elevation),
    }
    # The point that the camera looks at: from the origin, and since QGIS 3.42 in the project's CRS.
    camera = {"x": 0, "y": 0, "elev": z, "xMap": x, "yMap": y, "zMap": z}
    camera |= {"dist": view.distance, "pitch": view.pitch, "yaw": -view.heading}
    shown = "".join(_tag("layer", {"id": each.id}) for each in layers)
    return f"""<view name="3-D view" isOpen="1" area="2" floating="0" width="700" height="600"><qgis3d>
<origin x="{x}" y="{y}" z="0"/><camera field-of-view="{view.fov}" projection-type="1"/>
<color background="214,228,240,255" selection="255,255,0,255"/><crs>{reference}</crs>
<terrain exaggeration="1" texture-size="512" max-terrain-error="2" shading-enabled="1" map-theme="{view.theme}">
<shading-material ambient="150,155,165,255" diffuse="255,255,255,255" specular="0,0,0,255" shininess="1"/>
<layers>{shown}</layers><generator type="dem" layer="{view.terrain.id}" resolution="32" skirt-height="10"/>
</terrain><point-lights/><directional-lights>
{_tag("directional-light", light | {"color": "255,250,240,255", "intensity": 0.8})}
</directional-lights></qgis3d>{_tag("camera", camera)}</view>"""
