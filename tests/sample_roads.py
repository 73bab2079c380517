"""Roads, pads and walls made by hand, for tests that need no terrain: all within 1024 × 768 m."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from sketchterrain.document.sketch import Sketch
from sketchterrain.features.table import AREA, LINE, Feature, FeatureTable
from sketchterrain.roads.build import road_network
from sketchterrain.roads.road_types import BRIDGE, GROUND, TUNNEL, LineObject, Pad, Road, RoadNetwork, Works
from sketchterrain.schema.layers import id_of_vector
from sketchterrain.schema.materials import MATERIALS
from sketchterrain.stages.runner import Runner
from sketchterrain.terrain.layers.layer import HostSamples, HostSite, WorldSettings
from sketchterrain.terrain.layers.pads import PadsLayer
from sketchterrain.terrain.layers.roads import RoadsLayer

WORKS = Works(cut=1.0, fill=0.67, surface="asphalt")


def make_road(points, *, vector=1, layer="road", bend=0.0, slope=None, width=6.0, shoulder=1.0, **given):
    """Return a part of a road through stations (m, 3); slopes are those of chords unless given."""
    axis = np.asarray(points, np.float64)
    count = len(axis)
    bend = np.full(count - 1, 0.0) + bend
    chords = np.hypot(*np.diff(axis[:, :2], axis=0).T)
    half_angle = 2.0 * np.arctan(bend)
    lengths = chords / np.sinc(half_angle / np.pi)  # chord · half angle / sin(half angle)
    if slope is None:
        rise = np.diff(axis[:, 2]) / lengths
        slope = np.interp(np.arange(count), np.arange(count - 1) + 0.5, rise)
    parts = {
        "leg": vector,
        "part": 0,
        "structure": GROUND,
        "along": np.concatenate([[0.0], np.cumsum(lengths)]),
        "crossfall": np.full((count, 2), -0.025),
        "works": WORKS,
        "ends": (1, 1),
    } | given
    parts["along"] = parts["along"] + parts.pop("start", 0.0)
    return Road(
        id=id_of_vector(layer, vector),
        layer=layer,
        axis=axis,
        bend=bend,
        slope=np.full(count, slope, np.float64),
        half_width=np.full(count, 0.5 * width),
        shoulder=np.full(count, shoulder, np.float64),
        reach=np.full(count, 0.5 * width + shoulder + 10.0),
        deepest=np.full(count, 20.0),
        **parts,
    )


def straight_road():
    """Return 800 m due east that rise by 5 %."""
    return make_road([(100, 100, 20), (500, 100, 40), (900, 100, 60)], vector=1)


def curved_road():
    """Return a road in three parts: straight north on the ground, a bridge in a bend to the right, east."""
    ground = make_road([(200, 200, 30), (200, 400, 30)], vector=2, ends=(1, 2))
    # A quarter of a circle of radius 100 m around (300, 400); its direction turns by 90°.
    quarter = float(np.tan(np.pi / 8.0))
    bridge = make_road(
        [(200, 400, 30), (300, 500, 32)],
        vector=2,
        bend=quarter,
        structure=BRIDGE,
        part=1,
        start=200.0,
        slope=(0.0, 2.0 / (50.0 * np.pi)),
        crossfall=np.array([[0.03, -0.03]] * 2),
    )
    rest = make_road([(300, 500, 32), (500, 500, 36)], vector=2, part=2, start=float(bridge.along[-1]))
    return ground, bridge, replace(rest, ends=(2, 1))


def tunnel():
    """Return a railway in three parts, the second a tunnel."""
    stations = [(600, 200, 25), (700, 300, 26), (800, 400, 27), (900, 500, 28)]
    parts = []
    for part, structure in enumerate((GROUND, TUNNEL, GROUND)):
        start = part * 100.0 * np.sqrt(2.0)
        shape = {"vector": 3, "layer": "railway", "width": 4.4, "shoulder": 0.6, "start": start}
        parts.append(make_road(stations[part : part + 2], structure=structure, part=part, **shape))
    return tuple(parts)


def path():
    """Return a path that winds uphill, in arcs to the right and to the left that touch each other."""
    stations = [(100, 550, 30), (160, 600, 36), (220, 600, 42), (280, 550, 48), (340, 500, 54)]
    quarter = np.tan(0.25 * np.arctan2(50.0, 60.0))
    bend = quarter * np.array([1.0, 1.0, 1.0, -1.0])
    shape = {"width": 1.2, "shoulder": 0.2, "crossfall": np.zeros((5, 2))}
    return make_road(stations, vector=4, layer="path", bend=bend, **shape)


def make_network():
    """Return one of each: straight road, curved road with a bridge, railway tunnel, path, pads, walls."""
    outline = np.array([[600.0, 600.0], [620.0, 600.0], [620.0, 612.0], [600.0, 612.0]])
    pads = (
        Pad(id_of_vector("pad", 5), outline, level=40.0, reach=8.0, building=6.0, works=WORKS),
        Pad(
            id_of_vector("pad", 6),
            outline + np.array([40.0, 0.0]),
            level=42.0,
            reach=8.0,
            building=0.0,
            works=WORKS,
        ),
    )
    line = np.array([[590.0, 580.0], [690.0, 580.0], [690.0, 640.0]])
    walls = tuple(
        LineObject(
            id_of_vector("wall", number),
            "wall",
            line + np.array([0.0, north]),
            {"height": high, "width": wide, "material": of},
        )
        for number, north, high, wide, of in ((7, 0.0, 1.2, 0.5, "stone"), (8, 60.0, 1.6, 1.0, "hedge"))
    )
    return RoadNetwork(
        (straight_road(), *curved_road(), *tunnel(), path()),
        pads,
        walls,
        ("road 1: grade of 12 % at (300, 100), over its limit of 10 %",),
    )


def sketch_with(*features, extent=1024.0, **given):
    """Return a sketch with features: layer, vertices (m), and properties with its `id`, each."""
    added = {}
    for layer, points, *own in features:
        kind, own = AREA if layer == "pad" else LINE, dict(*own)
        number = own.pop("id", 0)
        feature = Feature(kind, (np.asarray(points, np.float64),), 1, own, number)
        added.setdefault(layer, []).append(feature)
    vectors = {name: FeatureTable(name).edited(add=each) for name, each in added.items()}
    return Sketch(extent=extent, layers={"hill": np.zeros((16, 16), np.uint8)}, vectors=vectors, **given)


def hills(x, y):
    """Return the height of ground with slopes of up to 60 %."""
    return 40.0 * np.sin(x / 90.0) * np.cos(y / 120.0) + 15.0 * np.sin((x + y) / 37.0) + 0.02 * x


def no_water(x, y):
    """Return the level of floods: dry land."""
    del y
    return np.full(len(x), np.nan)


def network_on(sketch, ground=hills, water=no_water):
    """Return the roads, pads and walls of a sketch on a ground."""
    return road_network(sketch, Named(ground), Named(water), Runner())


class Named:
    """A function with a digest."""

    def __init__(self, function):
        self.function = function

    def __call__(self, x, y):
        return self.function(x, y)

    def digest_parts(self):
        return (id(self.function),)


def heights_with(network, at, ground=hills, cell=0.05, extent=1024.0):
    """Return the height (m) of a ground with the pads and roads of a network at positions (n, 2), m."""
    world = WorldSettings(extent, 0, 0.0)
    x, y = np.rint(np.asarray(at).T / world.unit).astype(np.int64)
    site = HostSite(SimpleNamespace(world=world, unit=world.unit, cell=cell), x, y)
    none = np.zeros(len(x))
    samples = HostSamples(ground(x * world.unit, y * world.unit), *[none] * 6)
    for layer in (PadsLayer(MATERIALS, network.pads), RoadsLayer(MATERIALS, network.roads)):
        samples = layer.heights(samples, site)
    return samples.height


def contents(network):
    """Return all values of a network, to compare bits."""
    return [
        [each.tobytes() if isinstance(each, np.ndarray) else each for each in vars(item).values()]
        for item in (*network.roads, *network.pads, *network.standing)
    ] + [network.findings]


def hairpins(x, y, *, legs=5, length=60.0, apart=7.0):
    """Return the vertices of a road that turns back several times."""
    rows = [[(x, y + apart * leg), (x + length, y + apart * leg)] for leg in range(legs)]
    return [at for leg, row in enumerate(rows) for at in row[:: -1 if leg % 2 else 1]]


def ring(x, y, radius, count=12):
    """Return the vertices of a polygon, counter-clockwise."""
    angle = 2.0 * np.pi * np.arange(count) / count
    return np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])


SCENE = (
    ("road", [(1000, 1000), (1200, 1050), (1400, 980), (1700, 1100), (2000, 1000)], {"id": 1, "smooth": 1}),
    ("road", hairpins(1500, 1300), {"id": 2, "structure": "ground"}),
    ("road", [(1400, 980), (1450, 1150), (1500, 1300)], {"id": 3}),
    ("railway", [(900, 800), (1500, 900), (2100, 1250)], {"id": 4, "superelevation": 0.08, "radius": 900.0}),
    ("path", [(1200, 1050), (1180, 1100), (1250, 1160), (1230, 1220)], {"id": 5, "smooth": 1}),
    ("road", [(1700, 900), (1700, 1400)], {"id": 6, "level": 1}),
    ("road", [(1600, 1100), (1800, 1100)], {"id": 7, "structure": "bridge", "level": 2}),
    ("road", [(2000, 1000), (2400, 1100), (2800, 1100)], {"id": 8, "grade": 0.04}),
    ("road", [*ring(1300, 1200, 6.0).tolist(), (1306, 1200)], {"id": 9}),
    ("pad", [(1210, 1060), (1230, 1060), (1230, 1075), (1210, 1075)], {"id": 10, "building": 5.0}),
    ("pad", [(1225, 1070), (1245, 1072), (1240, 1090)], {"id": 11}),
    ("pad", [(1475, 1005), (1495, 1005), (1495, 1020), (1475, 1020)], {"id": 12, "surface": "asphalt"}),
    ("wall", [(1100, 1100), (1150, 1100)], {"id": 13}),
)
"""Features within 4096 m: all structures on steep ground, bends under the width, pads on each other."""
