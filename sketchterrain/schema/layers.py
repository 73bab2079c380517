"""Declaration of the layers: what shapes or vectors become, how they look and what is imported as them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Final, Literal, NamedTuple

from sketchterrain.schema.materials import BUILT_IN, MATERIALS, Colour
from sketchterrain.schema.parameters import Parameter, Sentinel, Value, parameter_table
from sketchterrain.schema.styles import StyleClass, style_class


class TagRule(NamedTuple):
    """Values of an OpenStreetMap key whose features belong to a layer, and properties that follow from them.

    Keys with the same values follow: ``landuse`` those of ``natural``, ``fclass`` and ``featurecla`` both.
    """

    key: str
    values: str  # separated by spaces
    properties: Mapping[str, Value] = MappingProxyType({})


@dataclass(frozen=True)
class Layer:
    """A layer. Beside it stand only its placement rules, if any, and its layer of the terrain.

    Shapes become, by `kind`: ``summits``, point features that rise; ``patches``, point features that cover
    an area together; ``landform``, ``sea`` and ``water``, a field of distances from the border; ``course``,
    the lines of a river network; ``cover``, a material on top of the others. Vectors alone become ``way``, a
    road, railway or path; ``pad``, a level building ground; ``standing``, things along lines that leave the
    ground as it is; ``land``, an area of one use.
    """

    name: str  # key in the sketch file; the image is ``name.png`` if it is painted
    title: str
    code: int  # in the ids and hashes of its features; never renumber: every terrain would change
    kind: Literal[
        "summits", "patches", "landform", "sea", "water", "course", "cover", "way", "pad", "standing", "land"
    ]
    help: str
    parameters: Mapping[str, Parameter] = field(hash=False)  # of each label, by name; the main one is first
    colour: Colour  # of label 1
    hatch: str = ""  # of its paint, one of `ui.look.layer_colours.HATCHES`
    light_hatch: bool = False  # on a dark colour
    overlay: Colour | None = None  # of its lines in the overlay of features
    brush: float = 1.0 / 32.0  # radius that its brush opens with, over the sketch's longer side
    vectors: tuple[str, ...] = ()  # what of ``point``, ``line`` and ``area`` it takes as vectors
    by: str = ""  # property of vectors whose values make the classes; the width of ways is with shoulders
    classes: tuple[StyleClass, ...] = field(default=(), hash=False)  # of vectors, the topmost first
    # Of dunes and of forests of the fill from its paint, in their radii; 0: only unpainted; none: any.
    clearance: tuple[float, ...] = ()
    # Of point features:
    glyph: str = ""  # one of `ui.look.layer_colours.GLYPHS`
    added_radius: float = 0.05  # of a feature that the user adds, over the sketch's extent
    fill: str = ""  # name of what there is of it where nothing is painted
    # Of imports:
    map_colours: str = ""  # on common maps and in OpenStreetMap's standard style, separated by spaces
    tags: tuple[TagRule, ...] = ()
    source_names: str = ""  # of vector layers, besides `name` and `title`, separated by spaces
    narrow: str = ""  # layer of the narrow parts of its areas on a map, if asked for

    @property
    def is_painted(self) -> bool:
        """Whether it has a label image; the other layers have vectors alone."""
        return self.kind not in ("way", "pad", "standing", "land")

    @property
    def file(self) -> str:
        """Name of its file beside the sketch's settings: a label image, else vectors."""
        return f"{self.name}.{'png' if self.is_painted else 'fgb'}"

    @property
    def is_points(self) -> bool:
        """Whether shapes are broken into point features."""
        return self.kind in ("summits", "patches")

    @property
    def is_water(self) -> bool:
        """Whether water stands or runs in its shapes."""
        return self.kind in ("sea", "water", "course")

    @property
    def main(self) -> Parameter:
        """The parameter that lists show; of point features their strength."""
        return next(iter(self.parameters.values()))

    @property
    def style(self) -> tuple[Parameter, ...]:
        """The parameters of each point feature besides its strength."""
        rest = (each for each in self.parameters.values() if each is not self.main)
        return tuple(each for each in rest if each.name not in _OF_SHAPES)

    def class_of(self, value: float | str = 0.0) -> StyleClass:
        """Return the class of vectors with a value of the property `by`."""
        return next(
            each
            for each in self.classes
            if each.value == value or (not isinstance(value, str) and value >= each.value)  # type: ignore[operator] # numbers both
        )

    @property
    def is_share(self) -> bool:
        """Whether its features' strength is a share, 0 … 1, not a height in m."""
        return not self.main.unit


HEIGHT_LIMIT = 1.33
"""Height that 95 % of real summits stay below, over the radius of the largest circle in their outline."""

_OF_SHAPES = ("multitude", "height_limit", "reach")  # parameters of whole shapes, not of their features


def _heights(start: float, high: float, top: str) -> tuple[Parameter, Parameter]:
    return (
        Parameter(
            *("height", float, 0.0, 0.0, high, "m"),
            f"from foot to {top}; 0 is 0.7 of the shape's inradius, {start:g} m where nothing is painted",
            sentinel=Sentinel(0.0, "Automatic", start),
            soft_range=(1.0, high),
        ),
        Parameter(
            *("height_limit", float, HEIGHT_LIMIT, 0.1, 20.0, ""),
            "greatest height over the shape's inradius, up to a fidelity of 0.8; raise it for towers",
            soft_range=(0.5, 4.0),
        ),
    )


def _reach(top: str) -> Parameter:
    return Parameter(
        *("reach", str, "added", 0, 10, ""),
        f"whether real elevation has the height added, or the {top} reaches it as an absolute elevation",
        choices=("added", "absolute"),
    )


def _multitude(default: int, what: str) -> Parameter:
    return Parameter(
        "multitude", int, default, 1, 500, "", f"how many {what} a painted shape has, if it is large enough"
    )


def _erosion(default: float) -> Parameter:
    return Parameter(
        *("erosion", float, default, 0.0, 1.0, ""),
        "how steep slopes may be: 0 is 35°, 1 is 42°; more where a shape is narrow for its height",
    )


def _strata(default: float) -> Parameter:
    return Parameter("strata", float, default, 0.0, 1.0, "", "how far layers of rock stand out as ledges")


def _trees(density: str) -> tuple[Parameter, Parameter]:
    return (
        Parameter("density", float, 0.8, 0.0, 1.0, "", density),
        Parameter(
            *("conifers", float, -1.0, -1.0, 1.0, "", "share of conifers; -1 is by elevation"),
            sentinel=Sentinel(-1.0, "By elevation", 0.5),
            soft_range=(0.0, 1.0),
        ),
    )


def _earthworks() -> tuple[Parameter, Parameter]:
    return (
        Parameter("cut", float, 1.0, 0.1, 10.0, "", "rise over run of slopes cut into the ground"),
        Parameter("fill", float, 0.67, 0.1, 10.0, "", "rise over run of slopes of embankments"),
    )


def _surface(default: str) -> Parameter:
    return Parameter("surface", str, default, 0, 40, "", "its material", choices=MATERIALS)


def _way(
    width: tuple[float, float, str],
    shoulder: float,
    grade: float,
    radius: float,
    superelevation: float,
    surface: str,
) -> Mapping[str, Parameter]:
    """Return the properties of a way: its width by lanes is their number times the given one."""
    lanes, per_lane, what = width
    return parameter_table(
        Parameter(
            *("width", float, 0.0, 0.0, 60.0, "m"),
            f"of the carriageway; 0 is {per_lane:g} m {what}",
            sentinel=Sentinel(0.0, "By lanes", lanes * per_lane),
            soft_range=(0.5, 60.0),
        ),
        Parameter("lanes", int, int(lanes), 1, 12, "", "number of lanes or tracks"),
        Parameter("shoulder", float, shoulder, 0.0, 10.0, "m", "of level ground on each side"),
        Parameter("grade", float, grade, 0.005, 1.0, "", "greatest slope along it, rise over run"),
        Parameter("radius", float, radius, 1.0, 5000.0, "m", "least radius of bends that its vertices allow"),
        Parameter(
            *("superelevation", float, superelevation, 0.0, 0.15, ""),
            "greatest slope across it in bends; 0: level across",
        ),
        *_earthworks(),
        _surface(surface),
        Parameter(
            *("structure", str, "automatic", 0, 20, "", "what carries it"),
            choices=("automatic", "ground", "bridge", "tunnel"),
        ),
        Parameter("level", int, 0, -5, 5, "", "which of two ways that cross without a junction is higher"),
        Parameter(
            *("trees", float, 0.0, 0.0, 100.0, "m", "spacing of trees along it; 0: none"),
            sentinel=Sentinel(0.0, "None", 12.0),
            soft_range=(3.0, 100.0),
        ),
    )


LANE_WIDTHS: Final = {"road": 3.0, "railway": 4.4, "path": 1.2}
"""Width (m) of a lane, a track with its ballast, or a path."""


LAND_USES: Final = ("field", "meadow", "forest", "built_up")
CROPS: Final = ("automatic", "wheat", "maize", "rapeseed", "ploughed", "vineyard", "orchard")

INK: Final = "#342e2c"
"""Colour of what is built on maps."""
_CASING: Final[dict[str, Any]] = {"casing": INK, "casing_width": 0.6}
_STONE, _BANK = "#706a66", "#306ea0"
_WATER: Final[dict[str, Any]] = {"colour": "#a6cee6", "fill": "#a6cee6", "fill_opacity": 1.0}
_LAND: Final[dict[str, Any]] = {"colour": "#b4aa96", "width": 0.5, "fill_opacity": 0.8}

_ALL: Final = (
    Layer(
        *("mountain", "Mountains", 0, "summits", "where mountains rise"),
        parameter_table(
            *_heights(600.0, 9000.0, "summit"),
            Parameter("peakiness", float, 0.5, 0.0, 1.0, "", "0 is a broad top, 1 is a sharp peak"),
            _erosion(0.7),
            _strata(0.25),
            _multitude(1, "summits"),
            _reach("summit"),
        ),
        colour=(140, 92, 70),
        hatch="peaks",
        clearance=(0.90, 0.00),
        overlay=(230, 60, 40),
        brush=1.0 / 20.0,
        glyph="triangle",
        added_radius=0.12,
        fill="mountains",
        map_colours="#8b5a2b #a0522d #5b3a1e",
        tags=(TagRule("natural", "peak ridge arete volcano mountain mountain_range massif"),),
    ),
    Layer(
        *("hill", "Hills", 1, "summits", "where hills roll"),
        parameter_table(
            *_heights(80.0, 2000.0, "top"),
            _erosion(0.3),
            _multitude(6, "tops"),
            _reach("top"),
        ),
        colour=(122, 160, 72),
        hatch="waves",
        clearance=(0.90, 0.00),
        overlay=(250, 190, 40),
        glyph="arch",
        fill="hills",
        map_colours="#9acd32",
        tags=(TagRule("natural", "hill"),),
    ),
    Layer(
        *("river", "Rivers", 4, "course", "where rivers flow: paint strokes along their courses"),
        parameter_table(
            Parameter(
                *("width", float, 12.0, 0.0, 2000.0, "m"),
                "from bank to bank; 0 is as wide as painted",
                sentinel=Sentinel(0.0, "As wide as painted", 12.0),
                soft_range=(0.5, 2000.0),
            ),
            Parameter("depth", float, 2.0, 0.1, 100.0, "m", "from the water's surface to the bed"),
            Parameter(
                *("flow", float, -1.0, -1.0, 360.0, "°", "where it runs to: 0 north; -1 downhill"),
                sentinel=Sentinel(-1.0, "Downhill", 180.0),
                soft_range=(0.0, 360.0),
            ),
        ),
        colour=(56, 116, 196),
        hatch="falling",
        clearance=(1.20, 0.00),
        light_hatch=True,
        overlay=(40, 120, 255),
        vectors=("line", "area"),
        classes=(style_class("River", **_WATER, width=1.2, casing=_BANK, casing_width=0.7),),
        map_colours="#0000ff #1f4e9c",
        tags=(
            TagRule("waterway", "river tidal_channel riverbank"),
            TagRule("waterway", "canal fairway", {"width": 10.0}),
            TagRule("waterway", "stream brook", {"width": 3.0, "depth": 0.5}),
            TagRule("waterway", "ditch drain", {"width": 1.5, "depth": 0.5}),
            TagRule("water", "river stream canal"),
        ),
        source_names="waterway waterways",
    ),
    Layer(
        *("dune", "Dunes", 2, "patches", "where the ground is a desert of dunes"),
        parameter_table(
            Parameter("height", float, 14.0, 0.5, 300.0, "m", "from trough to crest"),
            Parameter("wavelength", float, 140.0, 5.0, 2000.0, "m", "from crest to crest"),
            Parameter("wind", float, 270.0, 0.0, 360.0, "°", "where the wind blows from: 0 north, 90 east"),
            _multitude(12, "dune fields"),
        ),
        colour=(222, 186, 108),
        hatch="dots",
        clearance=(0.80, 1.00),
        overlay=(225, 90, 220),
        glyph="crescent",
        added_radius=0.06,
        fill="dunes",
        map_colours="#ffff00 #f0e68c #f5e9c6",
        tags=(TagRule("natural", "dune desert"),),
    ),
    Layer(
        *("forest", "Forests", 3, "patches", "where trees grow"),
        parameter_table(
            *_trees("share of the trees that the ground can carry"),
            _multitude(20, "groves"),
        ),
        colour=(38, 104, 58),
        hatch="trees",
        clearance=(1.00, 0.50),
        light_hatch=True,
        overlay=(60, 200, 80),
        glyph="tree",
        fill="groves of trees",
        map_colours="#008000 #add19e",
        tags=(TagRule("natural", "wood forest"),),
        source_names="wood woods",
    ),
    Layer(
        *("plateau", "Plateaus", 8, "landform", "where mesas and tablelands rise"),
        parameter_table(
            Parameter("height", float, 180.0, 1.0, 3000.0, "m", "from the ground around to the top"),
            Parameter("cliffness", float, 0.8, 0.0, 1.0, "", "0 is a slope, 1 a cliff of up to 75°"),
            _strata(0.6),
            Parameter("foot", float, 0.5, 0.1, 0.9, "", "share of the height that is talus"),
        ),
        colour=(186, 104, 72),
        hatch="peaks",
        overlay=(200, 90, 50),
        clearance=(0.90, 0.00),
        map_colours="#cd853f",
        tags=(TagRule("natural", "mesa butte plateau tableland"),),
    ),
    Layer(
        *("lake", "Lakes", 5, "water", "where lakes are"),
        parameter_table(Parameter("depth", float, 6.0, 0.5, 200.0, "m", "greatest depth of the water")),
        colour=(98, 178, 214),
        hatch="level",
        overlay=(30, 220, 240),
        vectors=("area",),
        classes=(style_class("Lake", **_WATER | {"colour": _BANK}, width=1.0),),
        map_colours="#87ceeb #aad3df",
        tags=(
            TagRule("natural", "water reservoir basin lake pond lagoon"),
            TagRule("water", "lake reservoir pond basin lagoon"),
        ),
        source_names="water",
        narrow="river",
    ),
    Layer(
        *("sea", "Sea", 7, "sea", "where the sea is; all other ground is land"),
        parameter_table(
            Parameter(
                *("depth", float, 40.0, 0.5, 1e4, "m", "greatest depth of the water"),
                soft_range=(1.0, 500.0),
            )
        ),
        colour=(24, 52, 96),
        hatch="level",
        clearance=(1.00, 0.00),
        light_hatch=True,
        overlay=(20, 90, 190),
        map_colours="#14284b",
        tags=(TagRule("natural", "bay strait sea ocean"), TagRule("water", "sea ocean")),
        source_names="ocean",
    ),
    Layer(
        *("material", "Materials", 6, "cover", "a material that overrides the material rules"),
        parameter_table(
            Parameter("material", str, "rock", 0, 40, "", "the material", choices=MATERIALS),
            Parameter("strength", float, 1.0, 0.0, 1.0, "", "0 is no cover, 1 hides all else"),
        ),
        colour=(168, 160, 150),
        hatch="crossed",
        map_colours="#eee5dc",
        tags=tuple(TagRule("natural", each.tags, {"material": each.name}) for each in BUILT_IN if each.tags),
    ),
    Layer(
        *("road", "Roads", 9, "way", "where roads run"),
        _way((2, LANE_WIDTHS["road"], "a lane"), 1.0, 0.10, 20.0, 0.06, "asphalt"),
        colour=(90, 88, 96),
        overlay=(250, 240, 220),
        vectors=("line",),
        by="width",
        classes=(
            style_class("Main road", 8.5, colour="#e8785c", width=4.25, **_CASING),
            style_class("Road", 7.0, colour="#fad068", width=3.5, **_CASING),
            style_class("Minor road", 4.0, colour="#ffffff", width=2.5, **_CASING),
            style_class("Track", colour=INK, width=1.2),
        ),
        tags=(
            TagRule("highway", "motorway", {"lanes": 2, "grade": 0.06, "radius": 300.0, "shoulder": 2.5}),
            TagRule("highway", "trunk", {"lanes": 2, "grade": 0.10, "radius": 60.0, "shoulder": 1.5}),
            TagRule("highway", "primary", {"grade": 0.10, "radius": 60.0, "shoulder": 1.5}),
            TagRule("highway", "secondary tertiary", {"grade": 0.13, "radius": 25.0}),
            TagRule("highway", "motorway_link trunk_link primary_link", {"lanes": 1}),
            TagRule("highway", "secondary_link tertiary_link", {"lanes": 1, "grade": 0.13}),
            TagRule(
                *("highway", "unclassified residential living_street road pedestrian busway"),
                {"width": 5.0, "grade": 0.16, "radius": 8.0, "shoulder": 0.5},
            ),
            TagRule("highway", "service", {"width": 3.5, "grade": 0.20, "radius": 5.0, "shoulder": 0.5}),
            TagRule(
                *("highway", "track track_grade1 track_grade2 track_grade3 track_grade4 track_grade5"),
                {"width": 3.0, "grade": 0.35, "radius": 5.0, "shoulder": 0.3, "surface": "gravel"},
            ),
        ),
        source_names="highway highways street streets",
    ),
    Layer(
        *("railway", "Railways", 10, "way", "where railways run"),
        _way((1, LANE_WIDTHS["railway"], "a track"), 0.6, 0.03, 180.0, 0.0, "gravel"),
        colour=(70, 60, 56),
        overlay=(200, 170, 220),
        vectors=("line",),
        classes=(style_class("Railway", colour="#ffffff", width=1.8, dash="7.5 7.5", cap="butt", **_CASING),),
        tags=(
            TagRule("railway", "rail"),
            TagRule(
                "railway",
                "narrow_gauge tram light_rail subway funicular",
                {"width": 3.2, "grade": 0.08, "radius": 30.0},
            ),
        ),
        source_names="rail railways",
    ),
    Layer(
        *("path", "Paths", 11, "way", "where people walk"),
        _way((1, LANE_WIDTHS["path"], "a lane"), 0.2, 0.60, 1.0, 0.0, "soil"),
        colour=(168, 132, 92),
        overlay=(240, 200, 120),
        vectors=("line",),
        classes=(style_class("Path", colour=INK, width=1.0, dash="5.5 3"),),
        tags=(
            TagRule("highway", "path footway"),
            TagRule("highway", "cycleway bridleway", {"width": 2.0, "grade": 0.35}),
            TagRule("highway", "steps", {"grade": 1.0, "surface": "rock"}),
        ),
        source_names="trail trails footpath footpaths tracks routes",
    ),
    Layer(
        *("pad", "Building pads", 12, "pad", "where the ground is levelled for buildings"),
        parameter_table(
            Parameter(
                *("building", float, 0.0, 0.0, 500.0, "m", "height of a building on it; 0: none"),
                sentinel=Sentinel(0.0, "None", 6.0),
                soft_range=(2.0, 100.0),
            ),
            *_earthworks(),
            _surface("gravel"),
        ),
        colour=(196, 170, 160),
        overlay=(230, 150, 130),
        vectors=("area",),
        by="building",
        classes=(
            style_class("Building", 0.01, colour="#5c4e4a", width=0.5, fill="#5c4e4a", fill_opacity=1.0),
            style_class("Level ground", colour=_STONE, width=0.5, fill="#d6c8ba", fill_opacity=1.0),
        ),
        tags=(
            TagRule("building", "yes", {"building": 6.0}),  # and any other value
            TagRule(
                "building", "farm farm_auxiliary barn garage garages shed cabin chalet", {"building": 4.0}
            ),
            TagRule("building", "church hotel school public hospital office warehouse", {"building": 9.0}),
        ),
        source_names="building buildings",
    ),
    Layer(
        *("wall", "Walls and hedges", 13, "standing", "where walls and hedges stand"),
        parameter_table(
            Parameter("height", float, 1.2, 0.2, 50.0, "m", "above the ground"),
            Parameter("width", float, 0.5, 0.1, 20.0, "m", "from side to side"),
            Parameter("material", str, "stone", 0, 10, "", "what it is of", choices=("stone", "hedge")),
        ),
        colour=(110, 118, 84),
        overlay=(160, 200, 120),
        vectors=("line",),
        by="material",
        classes=(
            style_class("Wall", "stone", colour=_STONE, width=0.9),
            style_class("Hedge", "hedge", colour="#4a7a42", width=2.1, dash="0.05 2.75"),
        ),
        tags=(
            TagRule("barrier", "wall city_wall retaining_wall"),
            TagRule("barrier", "hedge", {"material": "hedge", "height": 1.6, "width": 1.0}),
        ),
        source_names="barrier barriers walls hedges",
    ),
    Layer(
        *("landuse", "Land use", 14, "land", "where fields, meadows, forests and settlements are"),
        parameter_table(
            Parameter("use", str, "field", 0, 10, "", "what the land is used for", choices=LAND_USES),
            Parameter(
                *("crop", str, "automatic", 0, 10, "", "what grows in fields; automatic: each its own"),
                choices=CROPS,
            ),
            Parameter(
                *("direction", float, -1.0, -1.0, 180.0, "°"),
                "of rows of crops: 0 north, 90 east; -1 along the contours",
                sentinel=Sentinel(-1.0, "Along the contours", 90.0),
                soft_range=(0.0, 180.0),
            ),
            Parameter(
                *("parcels", float, 0.0, 0.0, 1000.0, "m"),
                "width of the strips that a field is divided into across its rows; 0: undivided",
                sentinel=Sentinel(0.0, "Undivided", 40.0),
                soft_range=(5.0, 1000.0),
            ),
            *_trees("share of the trees that forests can carry"),
        ),
        colour=(206, 190, 110),
        overlay=(240, 220, 60),
        vectors=("area",),
        by="use",
        classes=(
            style_class("Field", "field", **_LAND, fill="#faf0c4"),
            style_class("Meadow", "meadow", **_LAND, fill="#d6e8aa"),
            style_class("Built-up area", "built_up", **_LAND, fill="#e2c6be"),
            style_class("Forest", "forest", colour="#54824c", width=0.7, fill="#80ac6c", fill_opacity=0.52),
        ),
        tags=(
            TagRule("natural", "farmland farm field arable cropland plant_nursery greenhouse_horticulture"),
            TagRule("natural", "vineyard", {"crop": "vineyard"}),
            TagRule("natural", "orchard plantation", {"crop": "orchard"}),
            TagRule(
                *("natural", "meadow grass grassland pasture heath fell village_green recreation_ground"),
                {"use": "meadow"},
            ),
            TagRule("natural", "forest wood", {"use": "forest"}),
            TagRule("natural", "scrub", {"use": "forest", "density": 0.25}),
            TagRule(
                *(
                    "natural",
                    "residential commercial industrial retail farmyard allotments garages education",
                ),
                {"use": "built_up"},
            ),
        ),
        source_names="farmland fields",
    ),
    Layer(
        *("powerline", "Power lines", 15, "standing", "where power lines run, on pylons or poles"),
        parameter_table(
            Parameter("height", float, 30.0, 4.0, 200.0, "m", "of pylons"),
            Parameter("spacing", float, 150.0, 10.0, 1000.0, "m", "from one pylon to the next, at most"),
            Parameter("material", str, "steel", 0, 10, "", "of pylons, or poles", choices=("steel", "wood")),
        ),
        colour=(96, 88, 128),
        overlay=(255, 120, 60),
        vectors=("line",),
        by="material",
        classes=(
            style_class("Power line", "steel", colour="#4a4458", width=1.0, dash="10 2.5 0.5 2.5"),
            style_class("Power line on poles", "wood", colour="#4a4458", width=0.6, dash="10 2.5 0.5 2.5"),
        ),
        tags=(
            TagRule("power", "line"),
            TagRule("power", "minor_line", {"height": 9.0, "spacing": 50.0, "material": "wood"}),
        ),
        source_names="power powerlines",
    ),
)

LAYERS: Mapping[str, Layer] = MappingProxyType({layer.name: layer for layer in _ALL})
"""The layers, in display order."""

PAINTED_LAYERS: Final = tuple(layer.name for layer in _ALL if layer.is_painted)
"""Layers with a label image."""

WAY_LAYERS: Final = tuple(layer.name for layer in _ALL if layer.kind == "way")
"""Layers whose lines are one network of roads, railways and paths."""

STANDING_LAYERS: Final = tuple(layer.name for layer in _ALL if layer.kind == "standing")
"""Layers of things that stand along lines."""

_CODES = {layer.code: layer.name for layer in _ALL}


def layer_of(feature: int) -> str:
    """Return the layer of a painted feature, river or lake by its id."""
    return _CODES[feature >> 48 & 0x3FFF]  # the two highest bits mark added features and those of the fill


_VECTOR_BIT = 1 << 46  # the id of the vector is in the lowest 31 bits


def id_of_vector(layer: str, vector: int) -> int:
    """Return the id of the river or lake that a vector makes, by the id of that."""
    return LAYERS[layer].code << 48 | _VECTOR_BIT | vector


def vector_of(feature: int) -> int | None:
    """Return the id of the vector that made a river or lake, by the id of that; None if no vector did."""
    is_vector = feature & _VECTOR_BIT and not feature & _VECTOR_BIT << 1  # set in ids of streams and mouths
    return feature & 0x7FFFFFFF if is_vector else None


def feature_name(feature: int) -> str:
    """Return the layer of a feature and the number of its vector, if any, or its id: "road 7"."""
    vector = vector_of(feature)
    return f"{layer_of(feature)} {feature if vector is None else vector}"


def storey(level: int, structure: str) -> int:
    """Return which of two ways that cross is higher: by their level, else by what carries them."""
    return level or {"bridge": 1, "tunnel": -1}.get(structure, 0)


POINT_LAYERS: Final = tuple(layer.name for layer in _ALL if layer.is_points)
"""Layers of point features: their types, which can be added and locked."""

PATCH_LAYERS: Final = tuple(layer.name for layer in _ALL if layer.kind == "patches")
"""Those whose features also fill unpainted ground."""

DENSITY: Mapping[str, Parameter] = parameter_table(
    *(
        Parameter(
            *(layer.name, float, 0.0, 0.0, 100.0, "1/km²"), f"{layer.fill} per km² where nothing is painted"
        )
        for layer in _ALL
        if layer.fill
    )
)
"""Keys of ``[density]``: features where nothing is painted."""

_BOTTOM_UP = ("cover", "landform", "summits", "patches", "sea", "water", "course")

DRAW_ORDER: Final = tuple(sorted(PAINTED_LAYERS, key=lambda name: _BOTTOM_UP.index(LAYERS[name].kind)))
"""The painted layers from bottom to top, as the canvas draws them; thin shapes are drawn last."""

VECTOR_LAYERS: Final = tuple(layer.name for layer in _ALL if layer.vectors)
"""Layers of points, lines and areas."""

VECTOR_ORDER: Final = (
    *(name for name in VECTOR_LAYERS if LAYERS[name].kind == "land"),
    *(name for name in DRAW_ORDER if LAYERS[name].vectors),
    *(
        name
        for kind in ("pad", "way", "standing")
        for name in reversed(VECTOR_LAYERS)
        if LAYERS[name].kind == kind
    ),
)
"""The layers of vectors from bottom to top."""
