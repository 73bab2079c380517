"""Contours and features of a map."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
import shapely
from scipy.ndimage import distance_transform_edt, gaussian_filter, label, maximum_position

from sketchterrain.export.map.drawing import Colour, Label, LabelSpace, Points, Polygons, Polylines, Shape
from sketchterrain.export.map.ground import Grid, MapSamples, nearest_round
from sketchterrain.terrain.terrain import Terrain

INDEX: Final = 5  # every 5th contour is an index contour: heavier, with its height
STEEP_SHARE: Final = 85.0  # per cent of the ground that is less steep than what the interval is chosen for
SHORTEST, SHORTEST_PIECE = 2.4, 0.8  # mm around closed contours, and of pieces, at least
PENS: Final[dict[str, Colour]] = {"ground": (158, 108, 66), "rock": (98, 94, 92), "snow": (92, 138, 178)}
"""Colour of the contours on soil, on rock and scree, and on snow."""
WIDTHS: Final = {False: 0.12, True: 0.25}  # mm of contours, and of index contours
CROWDED: Final = 0.26  # mm between contours under which only index contours are drawn
GAP: Final = 0.45  # mm between a label and its contour

LABEL_SIZE, LABEL_COLOUR = 1.75, (110, 72, 40)  # mm
LABEL_EVERY: Final = 1.6  # mm between the places that are looked at
BEND: Final = 0.22  # mm by which a line may leave the straight under its label
LABEL_CROWDED: Final = 0.42  # mm between contours under which no heights are written
APART, AIR = 26.0, 2.2  # mm between two labels of one height, and between any two
UPRIGHT: Final = -0.15  # cosine of a label's turn beyond which it would be upside down


@dataclass(frozen=True, eq=False)
class Contour:
    """A line of one height (m): (n, 2) x, y (m), the last point the first where it is closed."""

    height: float
    index: bool
    points: Points


def choose_interval(ground: MapSamples) -> float:
    """Return the contour interval (m) for a ground, a round number.

    Imhof (Cartographic Relief Presentation, 1965, ch. C): A = n · log₁₀ n · tan α with n = √(scale/100 + 1),
    and α the slope of the steep ground that there is plenty of.
    """
    n = np.sqrt(ground.frame.scale / 100.0 + 1.0)
    slope = float(np.percentile(ground.slope[2], STEEP_SHARE))
    return nearest_round(max(n * np.log10(n) * slope, float(np.ptp(ground.smooth)) / 100.0, 0.1))


def trace_contours(ground: MapSamples, interval: float) -> list[Contour]:
    """Return the contours of the ground without those too small to be seen."""
    low, high = float(ground.smooth.min()), float(ground.smooth.max())
    numbers = range(int(np.floor(low / interval)) + 1, int(np.ceil(high / interval)))
    lines = ground.isolines(ground.smooth, [interval * number for number in numbers])
    return [
        Contour(interval * number, number % INDEX == 0, points)
        for number, of_level in zip(numbers, lines, strict=True)
        for points in of_level
        if arc_lengths(points)[-1] * ground.frame.mm_per_metre >= SHORTEST or (points[0] != points[-1]).any()
    ]


def contour_lines(
    contours: Sequence[Contour], ground: MapSamples, labels: Sequence[Label], interval: float
) -> list[Shape]:
    """Return the lines to draw, one set a pen, with gaps at labels and none on water."""
    kind = pen_numbers(ground)
    apart = interval / np.maximum(ground.slope[2], 1e-6) * ground.frame.mm_per_metre
    gaps = shapely.union_all([label.outline(air=GAP) for label in labels])
    shapely.prepare(gaps)
    paths: dict[tuple[bool, int], list[Points]] = {(i, pen): [] for i in (False, True) for pen in range(3)}
    for contour in contours:
        path = ground.frame.place(contour.points)
        drawn = (ground.at(ground.depth, contour.points) < 0.0) & ~shapely.contains_xy(gaps, path)
        if not contour.index:
            drawn &= ground.at(apart, contour.points) > CROWDED
        code = np.where(drawn, np.rint(ground.at(kind, contour.points)), -1).astype(int)
        for piece, pen in pieces(path, code):
            if arc_lengths(piece)[-1] >= SHORTEST_PIECE:
                paths[contour.index, pen].append(piece)
    colours = list(PENS.values())
    return [Polylines(found, colours[pen], WIDTHS[i]) for (i, pen), found in paths.items() if found]


def pen_numbers(ground: MapSamples) -> Grid:
    """Return which of the pens belongs to the ground at each sample."""
    stone = ground.share("rock", "scree") > 0.5
    return np.where(ground.share("snow") > 0.5, 2, np.where(stone, 1, 0)).astype(np.float32)


def pieces(path: Points, code: npt.NDArray[np.int_]) -> Iterator[tuple[Points, int]]:
    """Cut a path where its points' code changes; return pieces of a code ≥ 0, up to the next one's start."""
    cuts = (np.flatnonzero(np.diff(code)) + 1).tolist()
    for start, end in zip([0, *cuts], [*cuts, len(path)], strict=True):
        piece = path[start : end + 1]
        if code[start] >= 0 and len(piece) > 1:
            yield piece, int(code[start])


def label_contours(
    contours: Sequence[Contour], ground: MapSamples, space: LabelSpace, interval: float
) -> list[Label]:
    """Return the heights of index contours, the best places first."""
    indexed = (contour for contour in contours if contour.index)
    found = [candidate for contour in indexed for candidate in _candidates(contour, ground, interval)]
    chosen: dict[str, list[Label]] = {}
    for _, place in sorted(found, key=lambda each: -each[0]):
        same = chosen.setdefault(place.text, [])
        apart = all(np.hypot(place.x - other.x, place.y - other.y) >= APART for other in same)
        if apart and space.reserve(place.outline(air=AIR)):
            same.append(place)
    return [label for same in chosen.values() for label in same]


def _candidates(contour: Contour, ground: MapSamples, interval: float) -> list[tuple[float, Label]]:
    """Return places for labels along a contour, each with its score."""
    decimals = max(0, -int(np.floor(np.log10(interval) + 1e-9)))
    text = f"{contour.height:.{decimals}f}"
    path = ground.frame.place(contour.points)
    arc = arc_lengths(path)
    half = 0.5 * Label(text, 0.0, 0.0, LABEL_SIZE, LABEL_COLOUR).width + 0.4
    middles = np.arange(half, arc[-1] - half, LABEL_EVERY)
    at = along(path, arc, middles[:, None] + np.linspace(-1.0, 1.0, 9) * half)
    chord = at[:, -1] - at[:, 0]
    length = np.hypot(chord[:, 0], chord[:, 1])
    chord /= np.maximum(length, 1e-9)[:, None]
    off = at - at[:, :1]
    bend = np.abs(off[..., 0] * chord[:, None, 1] - off[..., 1] * chord[:, None, 0]).max(axis=1)
    points = along(contour.points, arc, middles)
    east, north, steep = (ground.at(field, points) for field in ground.slope)
    apart = interval / np.maximum(steep, 1e-6) * ground.frame.mm_per_metre
    # The top of the digits is uphill: on the sheet (y down) along (east, −north).
    chord *= np.where(chord[:, 1] * east + chord[:, 0] * north >= 0.0, 1.0, -1.0)[:, None]
    good = (bend < BEND) & (apart > LABEL_CROWDED) & (length > 1.7 * half) & (chord[:, 0] > UPRIGHT)
    good &= ground.at(ground.depth, points) < 0.0
    score = chord[:, 0] - 2.0 * bend / BEND + 0.6 * np.tanh(apart / 1.5)
    turn = np.degrees(np.arctan2(chord[:, 1], chord[:, 0]))
    rows = np.column_stack([score, at[:, 4], turn])[good]
    return [(s, Label(text, x, y, LABEL_SIZE, LABEL_COLOUR, "middle", t)) for s, x, y, t in rows.tolist()]


def arc_lengths(path: Points) -> Points:
    """Return the length of a path from its start to each of its points."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])


def along(path: Points, arc: Points, lengths: Points) -> Points:
    """Return the points at lengths along a path."""
    return np.stack([np.interp(lengths, arc, path[:, axis]) for axis in (0, 1)], axis=-1)


WATER, DEEP = (166, 206, 230), (92, 150, 196)
BANK: Final = (48, 110, 160)
LEVEL: Final = (16, 58, 104)  # of the digits on lakes
FOREST, FOREST_EDGE, FOREST_OPACITY = (128, 172, 108), (84, 130, 76), 0.52  # the relief shows through
NARROWEST: Final = 0.24  # mm of the smallest rivers
CASED: Final = 0.42  # mm from which on a river has banks on both sides
BANK_WIDTH, SHORE_WIDTH = 0.14, 0.2  # mm
WIDTH_STEP: Final = 0.04  # mm between the widths that a river is drawn in
ARROWS: Final = (14.0, 48.0)  # mm along a river to its first arrow, and from one to the next
ARROW: Final = (2.6, 1.1, 0.8)  # mm: its length, its head's length and width
SMALLEST_FOREST: Final = 1.2  # mm²
CELL, LEAST = 1.2, 1.6  # mm of a peak's cell; prominence of the lowest peaks, in contour intervals
FEATURES_APART, MOST = 8.0, 48  # mm between peaks, and their number
PEAK_SIZE, PEAK_INK, PEAK_HALO = 2.05, (34, 30, 28), (250, 248, 238)  # mm of the digits, and their colours


def draw_rivers(terrain: Terrain, ground: MapSamples, space: LabelSpace) -> list[Shape]:
    """Return rivers in their widths, and arrows in the direction they flow."""
    frame = ground.frame
    paths: dict[int, list[Points]] = {}
    arrows: list[Shape] = []
    for river in terrain.features.rivers:
        path = frame.place(river.centreline)
        width = np.maximum(river.centreline_width * frame.mm_per_metre, NARROWEST)
        dry = ground.at(ground.depth, river.centreline) <= 0.0
        # On a lake no river is seen.
        for piece, steps in pieces(path, np.where(dry, np.rint(width / WIDTH_STEP), -1).astype(int)):
            paths.setdefault(steps, []).append(piece)
        arrows += _arrows(path, width, dry, space)
    rivers = sorted((steps * WIDTH_STEP, found) for steps, found in paths.items())
    wide = [(width, found) for width, found in rivers if width >= CASED]
    return [
        *(Polylines(found, BANK, width) for width, found in rivers if width < CASED),
        *(Polylines(found, BANK, width + 2 * BANK_WIDTH) for width, found in wide),
        *(Polylines(found, WATER, width) for width, found in wide),
        *arrows,
    ]


def flow_arrow(middle: Points, flow: Points) -> list[Shape]:
    """Return an arrow around a place (mm) in a direction."""
    length, head, wide = ARROW
    tip = middle + flow * length / 2
    neck, aside = tip - flow * head, np.array([-flow[1], flow[0]]) * wide / 2
    shaft = np.stack([middle - flow * length / 2, neck])
    return [Polylines([shaft], BANK, 0.18), Polygons([np.stack([tip, neck + aside, neck - aside])], BANK)]


def _arrows(path: Points, width: Points, dry: npt.NDArray[np.bool_], space: LabelSpace) -> list[Shape]:
    """Return arrows beside a river, none where it is not `dry`."""
    arc = arc_lengths(path)
    shapes: list[Shape] = []
    for middle in np.arange(ARROWS[0], arc[-1], ARROWS[1]):
        ends = along(path, arc, middle + np.array([-1.0, 1.0]))
        flow = (ends[1] - ends[0]) / max(float(np.hypot(*(ends[1] - ends[0]))), 1e-9)
        off = float(np.interp(middle, arc, width)) / 2 + 1.0
        at = ends.mean(axis=0) + off * np.array([-flow[1], flow[0]])
        shaft = shapely.LineString([at - ARROW[0] / 2 * flow, at + ARROW[0] / 2 * flow])
        if np.interp(middle, arc, dry) == 1.0 and space.reserve(shaft.buffer(0.6)):
            shapes += flow_arrow(at, flow)
    return shapes


def draw_lakes(ground: MapSamples) -> list[Shape]:
    """Return lakes, darker where they are deeper, with their shores."""
    deepest = float(ground.depth.max())
    if deepest <= 0.0:
        return []
    step = nearest_round(deepest / 3)
    depths = np.arange(step, deepest, step).tolist()
    shores, *deeper = rings_above(ground.depth, [0.0, *depths], ground)
    shapes: list[Shape] = [Polygons(shores, WATER)]
    for rings in deeper:
        shapes += [Polygons(rings, DEEP, 0.3), Polylines(rings, BANK, 0.08, 0.7)]
    return [*shapes, Polylines(shores, BANK, SHORE_WIDTH)]


def label_lakes(terrain: Terrain, ground: MapSamples, space: LabelSpace) -> list[Shape]:
    """Return the height of each lake's water, written where the shore is farthest."""
    shapes: list[Shape] = []
    areas, count = label(ground.depth > 0.0)
    inland = distance_transform_edt(np.pad(areas > 0, 1))[1:-1, 1:-1]
    for number in range(1, count + 1):
        row, column = np.atleast_1d(maximum_position(inland, areas, number)).tolist()
        surface = float(ground.smooth[row, column] + ground.depth[row, column])
        level = min((lake.level for lake in terrain.features.lakes), key=lambda each: abs(each - surface))
        x, y = ground.frame.place(ground.metres(row, column)).tolist()
        text = Label(f"{level:.0f}", x, y, 2.0, LEVEL, "middle", halo=WATER)
        wide = inland[row, column] * ground.spacing[0] * ground.frame.mm_per_metre > 1.3
        if wide and space.reserve(text.outline(air=0.4)):
            shapes.append(text)
    return shapes


def draw_forests(ground: MapSamples) -> list[Shape]:
    """Return the forests as areas of colour, with their edges."""
    share = gaussian_filter(ground.share("forest_floor"), 1.0)
    (rings,) = rings_above(share, [0.5], ground)
    rings = [ring for ring in rings if shapely.Polygon(ring).area >= SMALLEST_FOREST]
    return forest(rings) if rings else []


def forest(rings: list[Points]) -> list[Shape]:
    """Return areas (mm) as forest."""
    return [Polygons(rings, FOREST, FOREST_OPACITY), Polylines(rings, FOREST_EDGE, 0.14, 0.8)]


def rings_above(field: Grid, levels: list[float], ground: MapSamples) -> list[list[Points]]:
    """Return closed rings (mm) around where a field is above each level; the map's border closes them."""
    floor = levels[0] - 50.0
    padded = np.pad(np.maximum(field, floor), 1, constant_values=floor)
    lines = ground.isolines(padded, levels, border=1)
    return [[ground.frame.place(line) for line in of_level] for of_level in lines]


def label_peaks(terrain: Terrain, ground: MapSamples, space: LabelSpace, interval: float) -> list[Shape]:
    """Return a triangle and a height for each summit that there is space for, the most prominent first."""
    shapes: list[Shape] = []
    sides = ((1.1, -1.0, "start"), (-1.1, -1.0, "end"), (0.0, -2.0, "middle"), (1.1, 1.2, "start"))
    for east, north, height in find_peaks(terrain, ground, interval):
        x, y = ground.frame.place([east, north]).tolist()
        for dx, dy, anchor in sides:
            text = Label(f"{height:.0f}", x + dx, y + dy, PEAK_SIZE, PEAK_INK, anchor, halo=PEAK_HALO)
            if space.reserve(text.outline(air=0.3) | shapely.Point(x, y).buffer(0.9)):
                shapes += [*peak_triangle(x, y), text]
                break
    return shapes


def peak_triangle(x: float, y: float) -> list[Shape]:
    """Return a triangle around a place (mm)."""
    corners = np.array([[0.0, -0.85], [0.8, 0.55], [-0.8, 0.55]])
    return [Polygons([[x, y] + scale * corners], ink) for scale, ink in ((1.35, PEAK_HALO), (1.0, PEAK_INK))]


def find_peaks(terrain: Terrain, ground: MapSamples, interval: float) -> list[Points]:
    """Return the summits x, y, z (m) of more prominence than about a contour interval."""
    cell = max(round(CELL / (ground.spacing[0] * ground.frame.mm_per_metre)), 1)
    rows, columns = (length // cell for length in ground.smooth.shape)
    cut = ground.smooth[: rows * cell, : columns * cell].reshape(rows, cell, columns, cell)
    blocks = cut.transpose(0, 2, 1, 3).reshape(rows, columns, cell * cell)
    peaks: list[Points] = []
    for prominence, row, column in prominences(blocks.max(axis=-1)):
        if prominence < LEAST * interval or len(peaks) == MOST:
            break
        inner = divmod(int(blocks[row, column].argmax()), cell)
        x, y = ground.metres(row * cell + inner[0], column * cell + inner[1])
        if all(
            np.hypot(x - peak[0], y - peak[1]) >= FEATURES_APART / ground.frame.mm_per_metre for peak in peaks
        ):
            # The highest place of full detail around.
            off = np.linspace(-ground.cell_size, ground.cell_size, 9)
            near = np.clip(np.stack(np.meshgrid(x + off, y + off), axis=-1).reshape(-1, 2), 0.0, terrain.size)
            heights = terrain.heights(*near.T)
            peaks.append(np.append(near[heights.argmax()], heights.max()))
    return peaks


def prominences(heights: npt.NDArray[np.floating]) -> list[tuple[float, int, int]]:
    """Return (prominence, row, column) of all summits in a grid, the greatest prominence first.

    From the highest place down, islands grow out of a falling sea: where two meet, the lower one's summit
    has the height that the sea has fallen since as its prominence.
    """
    rows, columns = heights.shape
    flat = heights.ravel().tolist()
    order = np.argsort(-heights.ravel(), kind="stable").tolist()
    island = [-1] * len(flat)  # the place through which each one's summit is found
    found: list[tuple[float, int]] = []

    def summit(place: int) -> int:
        while island[place] != place:
            island[place] = island[island[place]]
            place = island[place]
        return place

    for place in order:
        row, column = divmod(place, columns)
        block = (
            range(max(row - 1, 0), min(row + 2, rows)),
            range(max(column - 1, 0), min(column + 2, columns)),
        )
        near = [r * columns + c for r in block[0] for c in block[1]]
        summits = {summit(other) for other in near if island[other] >= 0}
        highest, *lower = sorted(summits, key=lambda each: (-flat[each], each)) or [place]
        island[place] = highest
        for low in lower:
            island[low] = highest
            found.append((flat[low] - flat[place], low))
    found.append((max(flat) - min(flat), order[0]))
    found = sorted((each for each in found if each[0] > 0.0), key=lambda each: (-each[0], each[1]))
    return [(prominence, *divmod(place, columns)) for prominence, place in found]
