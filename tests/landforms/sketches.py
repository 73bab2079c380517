"""Sketches as different people would paint them, to judge landforms by.

Each function paints its strokes through fixed points with an unsteady hand: another `seed` is another attempt
of the same person, and the random seed of the terrain. Points are (x, y) in pixels from the top left corner.
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from skimage.draw import polygon2mask

from sketchterrain.array_types import BoolArray
from sketchterrain.document.sketch import Sketch
from sketchterrain.schema.parameters import Properties

Points = str | Sequence[tuple[float, float]]
Labels = Mapping[tuple[str, int], Properties]
FloatArray = npt.NDArray[np.float64]


def _points(text: str) -> list[tuple[float, float]]:
    """Return the points of a list in SVG's notation, "x,y x,y …"."""
    return [(float(x), float(y)) for x, y in (pair.split(",") for pair in text.split())]


class _Canvas:
    """Label images of one size, and the unsteady hand that paints them."""

    def __init__(self, width: int, height: int, seed: int) -> None:
        self.shape = height, width
        self.images: dict[str, npt.NDArray[np.uint8]] = {}
        self.seed = seed
        self.rng = np.random.default_rng([width, height, seed])

    def sketch(self, name: str, extent: float, labels: Labels, **settings: Any) -> Sketch:
        return Sketch(name=name, extent=extent, seed=self.seed, layers=self.images, labels=labels, **settings)

    def paint(self, layer: str, label: int, *masks: BoolArray) -> None:
        """Replace what was painted there in the layer; label 0 erases."""
        image = self.images.setdefault(layer, np.zeros(self.shape, np.uint8))
        for mask in masks:
            image[mask] = label

    def noise(self, count: int, smooth: float, *, closed: bool = False) -> FloatArray:
        """Return `count` smooth random offsets in x and y with a standard deviation of 1."""
        white = self.rng.standard_normal((count, 2))
        mode: Literal["wrap", "reflect"] = "wrap" if closed else "reflect"
        unit = np.sqrt(2 * np.sqrt(np.pi) * smooth)
        return np.asarray(unit * gaussian_filter1d(white, smooth, axis=0, mode=mode), np.float64)

    def line(
        self,
        points: Points,
        sway: float,
        *,
        tremor: float = 0.5,
        closed: bool = False,
        straight: bool = False,
    ) -> FloatArray:
        """Return a hand-drawn line through points, a sample each half pixel.

        It strays by `sway` px over tens of pixels and by `tremor` px over a few.
        """
        points = _points(points) if isinstance(points, str) else points
        knots = np.array([*points, points[0]] if closed else points, np.float64)
        chords = np.hypot(*np.diff(knots, axis=0).T)
        at = np.concatenate([[0], np.cumsum(chords if straight else np.sqrt(chords))])
        samples = np.linspace(0, at[-1], int(2 * chords.sum()) + 2)
        if straight:
            line = np.stack([np.interp(samples, at, knots[:, axis]) for axis in (0, 1)], axis=1)
        else:
            line = CubicSpline(at, knots, bc_type="periodic" if closed else "natural")(samples)
        count = len(line)
        return (
            line
            + sway * self.noise(count, 30.0, closed=closed)
            + tremor * self.noise(count, 9.0, closed=closed)
        )

    def outline(
        self, points: Points, sway: float, *, tremor: float = 0.5, straight: bool = False
    ) -> BoolArray:
        """Return the inside of an outline that is drawn by hand and filled."""
        line = self.line(points, sway, tremor=tremor, closed=True, straight=straight)
        return np.asarray(polygon2mask(self.shape, line[::4, ::-1]), np.bool_)

    def stroke(self, points: Points, radius: float, sway: float, *, pressure: float = 0.15) -> BoolArray:
        """Return the stroke of a round brush, whose radius varies by `pressure`, over its mean."""
        line = self.line(points, sway)
        radii = radius * (1 + pressure * self.noise(len(line), 40.0)[:, 0].clip(-2, 2))
        mask = np.zeros(self.shape, np.bool_)
        step = max(int(radius / 2), 1)
        for (x, y), r in zip(line[::step], radii[::step], strict=True):
            top, left = max(int(y - r), 0), max(int(x - r), 0)
            window = mask[top : max(int(y + r) + 2, 0), left : max(int(x + r) + 2, 0)]
            down, across = np.ogrid[: window.shape[0], : window.shape[1]]
            window |= np.hypot(down + top + 0.5 - y, across + left + 0.5 - x) <= max(r, 0.75)
        return mask

    def blob(self, x: float, y: float, across: float, down: float, turn: float = 0.0) -> BoolArray:
        """Return a lopsided ellipse, turned by `turn` radians."""
        angles = np.linspace(0, 2 * np.pi, 8, endpoint=False) + self.rng.uniform(0, 0.5, 8)
        u, v = across * np.cos(angles), down * np.sin(angles)
        reach = self.rng.uniform(0.88, 1.15, 8)
        xs = x + reach * (u * np.cos(turn) - v * np.sin(turn))
        ys = y + reach * (u * np.sin(turn) + v * np.cos(turn))
        return self.outline(list(zip(xs, ys, strict=True)), 0.06 * min(across, down))

    def scribble(
        self, x: float, y: float, across: float, down: float, brush: float, turn: float = 0.0
    ) -> BoolArray:
        """Return an ellipse filled by zigzags of a brush, with gaps."""
        points: list[tuple[float, float]] = []
        for row, v in enumerate(np.linspace(-down, down, max(round(down / (0.65 * brush)), 2) + 1)):
            half = (
                across * max(np.sqrt(max(1 - (v / (1.1 * down)) ** 2, 0)), 0.3) * self.rng.uniform(0.8, 1.1)
            )
            lean = 0.35 * brush
            ends = ((-half, v - lean), (half, v + lean)) if row % 2 else ((half, v - lean), (-half, v + lean))
            points += [
                (x + u * np.cos(turn) - w * np.sin(turn), y + u * np.sin(turn) + w * np.cos(turn))
                for u, w in ends
            ]
        return self.stroke(points, brush, 0.6)


def range_across(seed: int = 0) -> Sketch:
    """A hiking-map maker's main range of 1,800 m from edge to edge, outlined and filled, and foothills."""
    canvas = _Canvas(512, 384, seed)
    north = _points("-30,128 40,110 105,84 170,92 228,58 300,72 365,50 430,74 545,46")
    south = _points("545,190 478,216 420,205 355,236 290,226 226,262 160,240 88,276 -30,250")
    canvas.paint("mountain", 1, canvas.outline([*north, *south], 5.0, tremor=0.9))
    canvas.paint("mountain", 2, canvas.blob(88, 330, 58, 36, 0.2), canvas.blob(455, 300, 50, 40, -0.4))
    canvas.paint(
        "hill",
        1,
        canvas.scribble(250, 330, 60, 22, 11, 0.1),
        canvas.scribble(420, 22, 60, 9, 9, -0.1),
        canvas.scribble(60, 40, 48, 20, 9, 0.3),
    )
    canvas.paint(
        "river",
        1,
        canvas.stroke("268,210 262,248 286,286 338,310 346,345 372,390", 1.8, 2.0),
        canvas.stroke("180,118 192,84 176,52 196,22 190,-6", 1.5, 2.0),
    )
    canvas.paint("river", 2, canvas.stroke("398,192 404,236 380,276 339,311", 1.2, 1.5))
    canvas.paint("river", 2, canvas.stroke("132,262 150,300 170,338 160,390", 1.2, 1.5))
    for x, y, across, down in ((300, 268, 34, 12), (196, 288, 26, 15), (135, 44, 24, 14), (250, 30, 30, 14)):
        canvas.paint("forest", 1, canvas.scribble(x, y, across, down, 5))
    labels: Labels = {
        ("mountain", 1): {"height": 1800.0, "peakiness": 0.75, "erosion": 0.9, "multitude": 7},
        ("mountain", 2): {"height": 700.0},
        ("river", 1): {"width": 22.0, "depth": 3.0},
        ("river", 2): {"width": 10.0},
    }
    climate = {"snow_line": 1500.0, "tree_line": 1000.0}
    return canvas.sketch("Range across", 12000.0, labels, climate=climate, ground={"relief": 90.0})


def island_group(seed: int = 0) -> Sketch:
    """A fantasy author's archipelago: coasts drawn with a pencil, the sea poured in with the bucket."""
    canvas = _Canvas(512, 512, seed)
    main = _points("118,196 160,128 232,106 286,134 352,122 396,170 372,226 398,282 338,330")
    main += [(282, 308), (238, 352), (168, 338), (178, 282), (124, 258)]
    island = canvas.outline(main, 6.0, tremor=1.5)
    volcano = canvas.blob(418, 420, 58, 52)
    canvas.paint("sea", 1, np.ones(canvas.shape, np.bool_))
    canvas.paint("sea", 0, island, volcano)
    canvas.paint("sea", 0, canvas.blob(96, 404, 54, 30, 0.5), canvas.outline("52,66 92,52 110,84 70,104", 3))
    for x, y, size in (
        (176, 424, 11),
        (204, 452, 7),
        (468, 308, 12),
        (452, 78, 18),
        (30, 300, 5),
        (300, 398, 9),
    ):
        canvas.paint("sea", 0, canvas.blob(x, y, size, 0.8 * size))
    canvas.paint("mountain", 1, canvas.outline("182,170 250,140 322,168 342,222 290,258 206,252", 4))
    canvas.paint("mountain", 2, canvas.blob(420, 420, 38, 35))
    canvas.paint("hill", 1, canvas.blob(96, 404, 34, 16, 0.5), canvas.scribble(350, 288, 20, 18, 8, 0.4))
    canvas.paint("hill", 1, canvas.scribble(206, 308, 14, 18, 6))
    canvas.paint(
        "river",
        1,
        canvas.stroke("262,226 258,268 264,298 268,330", 1.4, 1.4),
        canvas.stroke("224,172 196,158 172,160 134,150", 1.2, 1.4),
        canvas.stroke("312,204 346,218 362,240 392,246", 1.2, 1.4),
    )
    canvas.paint("forest", 1, canvas.scribble(156, 222, 18, 24, 6), canvas.scribble(362, 170, 18, 22, 6, 0.5))
    canvas.paint("forest", 1, canvas.stroke("72,388 98,392 122,414", 7, 1.0))
    canvas.paint("material", 1, canvas.stroke("236,356 254,340 278,322", 4, 1.0))
    labels: Labels = {
        ("mountain", 1): {"peakiness": 0.6, "multitude": 3},
        ("mountain", 2): {"height": 420.0, "peakiness": 0.9, "erosion": 0.4},
        ("hill", 1): {"height": 110.0, "multitude": 3},
        ("river", 1): {"width": 7.0, "depth": 1.0},
        ("material", 1): {"material": "sand"},
        ("sea", 1): {"depth": 60.0},
    }
    return canvas.sketch("The Spilled Isles", 8000.0, labels, climate={"aridity": 0.1})


def plateau_canyon(seed: int = 0) -> Sketch:
    """A geology teacher's escarpment for a lecture: a ragged rim, a canyon erased out of it, two buttes."""
    canvas = _Canvas(400, 400, seed)
    rim = _points("-20,300 34,286 58,316 96,300 112,262 150,270 186,232 176,204 222,192")
    rim += _points("262,206 280,168 262,140 306,122 352,130 372,92 420,84 420,-20 -20,-20")
    canvas.paint("plateau", 1, canvas.outline(rim, 3.0, tremor=1.1))
    canyon = [(128, -10), (136, 36), (106, 74), (120, 118), (166, 132), (178, 176), (200, 214), (226, 240)]
    side = [(-10, 164), (34, 158), (62, 128), (114, 112)]
    canvas.paint("plateau", 0, canvas.stroke(canyon, 11, 1.5, pressure=0.2), canvas.stroke(side, 6, 1.5))
    canvas.paint("plateau", 2, canvas.blob(298, 226, 24, 18, 0.4), canvas.blob(240, 302, 13, 12))
    canvas.paint("hill", 1, canvas.blob(64, 222, 28, 18, 0.3), canvas.blob(244, 60, 40, 22, -0.3))
    canvas.paint(
        "river", 1, canvas.stroke([*canyon, (232, 276), (286, 312), (300, 352), (340, 408)], 1.8, 1.0)
    )
    canvas.paint("river", 2, canvas.stroke(side, 1.1, 0.8))
    canvas.paint("forest", 1, canvas.stroke("244,282 276,296 306,326 316,352", 6, 1.5, pressure=0.3))
    canvas.paint("dune", 1, canvas.scribble(110, 362, 56, 20, 10, -0.1))
    labels: Labels = {
        ("plateau", 1): {"height": 420.0, "cliffness": 0.9, "strata": 0.8},
        ("hill", 1): {"height": 70.0, "multitude": 2},
        ("river", 1): {"width": 20.0, "depth": 2.5},
        ("river", 2): {"width": 4.0, "depth": 0.6},
        ("forest", 1): {"density": 0.35, "multitude": 8},
    }
    return canvas.sketch("Escarpment", 5000.0, labels, climate={"aridity": 0.75}, ground={"relief": 30.0})


def broad_hills(seed: int = 0) -> Sketch:
    """A landscape painter's downs: a large soft brush, posterized to two labels, and brooks that just end."""
    canvas = _Canvas(320, 256, seed)
    down, across = np.mgrid[: canvas.shape[0], : canvas.shape[1]] + 0.5
    clear = np.ones(canvas.shape)
    strokes: tuple[Points, ...] = (
        ((-10, 60), (50, 52), (104, 70), (160, 48)),
        ((228, 40), (275, 56), (350, 52)),
        ((40, 190), (96, 204), (150, 186)),
        ((222, 178), (262, 200), (300, 192)),
        ((236, 152), (290, 148)),
    )
    for points in strokes:
        for x, y in canvas.line(points, 4.0)[::20]:
            spread = canvas.rng.uniform(20, 27)
            clear *= 1 - 0.45 * np.exp(-0.5 * ((across - x) ** 2 + (down - y) ** 2) / spread**2)
    grain = gaussian_filter1d(
        gaussian_filter1d(canvas.rng.standard_normal(canvas.shape), 3.0, axis=0), 3.0, axis=1
    )
    opacity = 1 - clear + 0.15 * grain
    canvas.paint("hill", 1, opacity > 0.42)
    canvas.paint("hill", 2, opacity > 0.8)
    canvas.paint("river", 1, canvas.stroke("186,-8 194,40 182,84 206,112 198,138", 1.4, 1.6))
    canvas.paint("lake", 1, canvas.blob(197, 148, 14, 11))
    canvas.paint("river", 1, canvas.stroke("120,124 84,130 40,120 -8,134", 1.2, 1.6))
    canvas.paint(
        "forest", 1, canvas.scribble(148, 130, 18, 12, 6, 0.3), canvas.scribble(186, 222, 22, 12, 6, -0.4)
    )
    labels: Labels = {
        ("hill", 1): {"height": 60.0, "multitude": 8, "erosion": 0.15},
        ("hill", 2): {"height": 150.0, "multitude": 3, "erosion": 0.15},
        ("river", 1): {"width": 6.0, "depth": 1.0},
        ("lake", 1): {"depth": 3.0},
    }
    return canvas.sketch(
        "Downs", 10000.0, labels, fidelity=0.6, ground={"relief": 50.0, "wavelength": 2600.0}
    )


def childs_drawing(seed: int = 0) -> Sketch:
    """A child's holiday: pointed mountains far too steep for their size, a river through all of them."""
    canvas = _Canvas(362, 256, seed)
    big = ([(30, 158), (86, 30), (142, 162)], [(206, 142), (262, 22), (324, 150)])
    small = ([(124, 164), (170, 78), (214, 158)], [(12, 226), (46, 172), (88, 230)])
    canvas.paint("mountain", 1, *(canvas.outline(each, 1.5, straight=True) for each in big))
    canvas.paint("mountain", 2, *(canvas.outline(each, 1.5, straight=True) for each in small))
    wiggle = [(x, 128 + 14 * (-1) ** turn) for turn, x in enumerate(range(-12, 380, 26))]
    canvas.paint("river", 1, canvas.stroke(wiggle, 2.4, 1.5))
    canvas.paint("lake", 1, canvas.scribble(168, 212, 26, 10, 6))
    for x, y in ((250, 190), (276, 206), (304, 186), (330, 214), (232, 222), (118, 200)):
        canvas.paint("forest", 1, canvas.scribble(x, y, 6, 7, 3))
    canvas.paint("hill", 1, canvas.blob(300, 242, 30, 16), canvas.blob(344, 96, 18, 16))
    labels: Labels = {
        ("mountain", 1): {"height": 900.0, "peakiness": 1.0},
        ("mountain", 2): {"height": 300.0},
    }
    return canvas.sketch("Holiday", 3000.0, labels)


SKETCHES: Mapping[str, Callable[[int], Sketch]] = MappingProxyType(
    {
        each.__name__: each
        for each in (
            range_across,
            island_group,
            plateau_canyon,
            broad_hills,
            childs_drawing,
        )
    }
)
"""The sketches by name."""
