"""Contours, waters, forests and peaks of a map."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
import shapely
from scipy.ndimage import distance_transform_edt, gaussian_filter, label, maximum_position

from sketchterrain.export.map.drawing import (
    Colour,
    LabelSpace,
    MapText,
    Points,
    Polygons,
    Polylines,
    Shape,
    styled,
)
from sketchterrain.export.map.relief import Grid, MapSamples, nearest_round
from sketchterrain.generation.terrain import Terrain
from sketchterrain.geometry.splines import arc_length, at_lengths
from sketchterrain.schema.layers import LAYERS
from sketchterrain.schema.styles import PIXEL, rgb_from_hex

INDEX: Final = 5  # every 5th contour is an index contour: heavier and labelled
STEEP_SHARE: Final = 85.0  # percentile of slope for which the interval is chosen
MIN_LENGTH, MIN_PIECE = 2.4, 0.8  # mm of closed contours, and of pieces
PENS: Final[dict[str, Colour]] = {"ground": (158, 108, 66), "rock": (98, 94, 92), "snow": (92, 138, 178)}
"""Colours of contours by `Material.pen`."""
WIDTHS: Final = {False: 0.12, True: 0.25}  # mm of contours, and of index contours
CROWDED: Final = 0.26  # mm between contours below which only index contours are drawn
GAP: Final = 0.45  # mm between a label and its contour

LABEL_SIZE, LABEL_COLOUR = 1.75, (110, 72, 40)  # mm
LABEL_STEP: Final = 1.6  # mm between candidate positions
MAX_BEND: Final = 0.22  # mm, deviation of a line from a straight one under its label
LABEL_CROWDED: Final = 0.42  # mm between contours below which there are no labels
LABEL_SPACING, LABEL_MARGIN = 26.0, 2.2  # mm between labels of one height, and around any
MIN_COSINE: Final = -0.15  # of a label's rotation, against upside-down labels


@dataclass(frozen=True, eq=False)
class Contour:
    """A line of one height (m): (n, 2) x, y (m), the last point the first where it is closed."""

    height: float
    index: bool
    points: Points


def choose_interval(samples: MapSamples) -> float:
    """Return a round contour interval (m)."""
    return contour_interval(samples.frame.scale, samples.slope[2], samples.smooth)


def contour_interval(scale: float, slope: Grid, height: Grid) -> float:
    """Return a round contour interval (m) of a map of scale 1 : n, for slopes (rise over run) and heights.

    Imhof (Cartographic Relief Presentation, 1965, ch. C): A = n · log₁₀ n · tan α with n = √(scale/100 + 1)
    and α the slope of common steep terrain.
    """
    n = np.sqrt(scale / 100.0 + 1.0)
    steep = float(np.percentile(slope, STEEP_SHARE))
    return nearest_round(max(n * np.log10(n) * steep, float(np.ptp(height)) / 100.0, 0.1))


def trace_contours(samples: MapSamples, interval: float) -> list[Contour]:
    """Return the contours of a terrain without tiny ones."""
    low, high = float(samples.smooth.min()), float(samples.smooth.max())
    numbers = range(int(np.floor(low / interval)) + 1, int(np.ceil(high / interval)))
    lines = samples.isolines(samples.smooth, [interval * number for number in numbers])
    return [
        Contour(interval * number, number % INDEX == 0, points)
        for number, of_level in zip(numbers, lines, strict=True)
        for points in of_level
        if arc_length(points)[-1] * samples.frame.mm_per_metre >= MIN_LENGTH
        or (points[0] != points[-1]).any()
    ]


def contour_lines(
    contours: Sequence[Contour], samples: MapSamples, labels: Sequence[MapText], interval: float
) -> list[Shape]:
    """Return the contour lines, one set per pen, with gaps at labels and on water."""
    pens = pen_numbers(samples)
    spacing = interval / np.maximum(samples.slope[2], 1e-6) * samples.frame.mm_per_metre
    gaps = shapely.union_all([label.outline(margin=GAP) for label in labels])
    shapely.prepare(gaps)
    paths: dict[tuple[bool, int], list[Points]] = {(i, pen): [] for i in (False, True) for pen in range(3)}
    for contour in contours:
        path = samples.frame.to_sheet(contour.points)
        visible = (samples.interpolate(samples.water, contour.points) < 0.0) & ~shapely.contains_xy(
            gaps, path
        )
        if not contour.index:
            visible &= samples.interpolate(spacing, contour.points) > CROWDED
        code = np.where(visible, np.rint(samples.interpolate(pens, contour.points)), -1).astype(int)
        for piece, pen in pieces(path, code):
            if arc_length(piece)[-1] >= MIN_PIECE:
                paths[contour.index, pen].append(piece)
    colours = list(PENS.values())
    return [Polylines(found, colours[pen], WIDTHS[i]) for (i, pen), found in paths.items() if found]


def pen_numbers(samples: MapSamples) -> Grid:
    """Return the index of the pen for each sample."""
    stone = samples.cover_weight(lambda each: each.pen == "rock") > 0.5
    snow = samples.cover_weight(lambda each: each.pen == "snow") > 0.5
    return np.where(snow, 2, np.where(stone, 1, 0)).astype(np.float32)


def pieces(path: Points, code: npt.NDArray[np.int_]) -> Iterator[tuple[Points, int]]:
    """Cut a path where its points' code changes; return the pieces of codes ≥ 0 with their codes."""
    cuts = (np.flatnonzero(np.diff(code)) + 1).tolist()
    for start, end in zip([0, *cuts], [*cuts, len(path)], strict=True):
        piece = path[start : end + 1]
        if code[start] >= 0 and len(piece) > 1:
            yield piece, int(code[start])


def label_contours(
    contours: Sequence[Contour], samples: MapSamples, space: LabelSpace, interval: float
) -> list[MapText]:
    """Return the height labels of index contours, by score of their positions."""
    indexed = (contour for contour in contours if contour.index)
    candidates = [label for contour in indexed for label in _label_candidates(contour, samples, interval)]
    placed: dict[str, list[MapText]] = {}
    for _, candidate in sorted(candidates, key=lambda each: -each[0]):
        same = placed.setdefault(candidate.text, [])
        distant = all(
            np.hypot(candidate.x - other.x, candidate.y - other.y) >= LABEL_SPACING for other in same
        )
        if distant and space.reserve(candidate.outline(margin=LABEL_MARGIN)):
            same.append(candidate)
    return [label for same in placed.values() for label in same]


def _label_candidates(contour: Contour, samples: MapSamples, interval: float) -> list[tuple[float, MapText]]:
    """Return labels at positions along a contour, each with its score."""
    decimals = max(0, -int(np.floor(np.log10(interval) + 1e-9)))
    text = f"{contour.height:.{decimals}f}"
    path = samples.frame.to_sheet(contour.points)
    arc = arc_length(path)
    half = 0.5 * MapText(text, 0.0, 0.0, LABEL_SIZE, LABEL_COLOUR).width + 0.4
    middles = np.arange(half, arc[-1] - half, LABEL_STEP)
    at = at_lengths(path, arc, middles[:, None] + np.linspace(-1.0, 1.0, 9) * half)
    chord = at[:, -1] - at[:, 0]
    length = np.hypot(chord[:, 0], chord[:, 1])
    chord /= np.maximum(length, 1e-9)[:, None]
    off = at - at[:, :1]
    bend = np.abs(off[..., 0] * chord[:, None, 1] - off[..., 1] * chord[:, None, 0]).max(axis=1)
    points = at_lengths(contour.points, arc, middles)
    east, north, steep = (samples.interpolate(field, points) for field in samples.slope)
    spacing = interval / np.maximum(steep, 1e-6) * samples.frame.mm_per_metre
    # The top of the digits is uphill: on the sheet (y down) along (east, −north).
    chord *= np.where(chord[:, 1] * east + chord[:, 0] * north >= 0.0, 1.0, -1.0)[:, None]
    good = (bend < MAX_BEND) & (spacing > LABEL_CROWDED) & (length > 1.7 * half)
    good &= chord[:, 0] > MIN_COSINE
    good &= samples.interpolate(samples.depth, points) < 0.0
    score = chord[:, 0] - 2.0 * bend / MAX_BEND + 0.6 * np.tanh(spacing / 1.5)
    turn = np.degrees(np.arctan2(chord[:, 1], chord[:, 0]))
    rows = np.column_stack([score, at[:, 4], turn])[good]
    return [(s, MapText(text, x, y, LABEL_SIZE, LABEL_COLOUR, "middle", t)) for s, x, y, t in rows.tolist()]


_LAKE, _FOREST = LAYERS["lake"].class_of().style, LAYERS["landuse"].class_of("forest").style
WATER, BANK = rgb_from_hex(_LAKE["fill"]), rgb_from_hex(_LAKE["colour"])
DEEP, DEEPER = (92, 150, 196), 0.3  # the opacity of each depth's tint
LEVEL: Final = (16, 58, 104)  # of labels on lakes
FOREST: Final = rgb_from_hex(_FOREST["fill"])
MIN_RIVER: Final = PIXEL * LAYERS["river"].class_of().style["width"]  # mm
CASED: Final = 0.42  # mm from which on a river has banks on both sides
BANK_WIDTH, SHORE_WIDTH = 0.14, 0.2  # mm
WIDTH_STEP: Final = 0.04  # mm between the drawn widths of a river
ARROWS: Final = (14.0, 48.0)  # mm along a river to its first arrow, and between arrows
ARROW: Final = (2.6, 1.1, 0.8)  # mm: length; length and width of the head
MIN_FOREST: Final = 1.2  # mm²
CELL, LEAST = 1.2, 1.6  # mm of a peak's cell; prominence of the lowest peaks, in contour intervals
PEAKS_APART, MOST = 8.0, 48  # mm between peaks, and their number
PEAK_SIZE, PEAK_INK, PEAK_HALO = 2.05, (34, 30, 28), (250, 248, 238)  # mm of the digits, and their colours


def draw_rivers(terrain: Terrain, samples: MapSamples, space: LabelSpace) -> list[Shape]:
    """Return rivers in their widths, with arrows in the direction of flow."""
    frame = samples.frame
    paths: dict[int, list[Points]] = {}
    arrows: list[Shape] = []
    for river in terrain.features.rivers:
        path = frame.to_sheet(river.centreline)
        width = np.maximum(river.centreline_width * frame.mm_per_metre, MIN_RIVER)
        dry = samples.interpolate(samples.water, river.centreline) <= 0.0
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
    """Return an arrow centred at a point (mm) in a direction."""
    length, head, wide = ARROW
    tip = middle + flow * length / 2
    neck, side = tip - flow * head, np.array([-flow[1], flow[0]]) * wide / 2
    shaft = np.stack([middle - flow * length / 2, neck])
    return [Polylines([shaft], BANK, 0.18), Polygons([np.stack([tip, neck + side, neck - side])], BANK)]


def _arrows(path: Points, width: Points, dry: npt.NDArray[np.bool_], space: LabelSpace) -> list[Shape]:
    arc = arc_length(path)
    shapes: list[Shape] = []
    for middle in np.arange(ARROWS[0], arc[-1], ARROWS[1]):
        ends = at_lengths(path, arc, middle + np.array([-1.0, 1.0]))
        flow = (ends[1] - ends[0]) / max(float(np.hypot(*(ends[1] - ends[0]))), 1e-9)
        off = float(np.interp(middle, arc, width)) / 2 + 1.0
        at = ends.mean(axis=0) + off * np.array([-flow[1], flow[0]])
        shaft = shapely.LineString([at - ARROW[0] / 2 * flow, at + ARROW[0] / 2 * flow])
        if np.interp(middle, arc, dry) == 1.0 and space.reserve(shaft.buffer(0.6)):
            shapes += flow_arrow(at, flow)
    return shapes


def depth_step(depth: Grid) -> float:
    """Return the step (m) between the depth lines of lakes or of the sea; 0 without any water."""
    deepest = float(depth.max())
    return nearest_round(deepest / 3) if deepest > 0.0 else 0.0


def draw_still_water(depth: Grid, samples: MapSamples) -> list[Shape]:
    """Return lakes, or the sea, with depth tints, depth lines and shores."""
    step = depth_step(depth)
    if not step:
        return []
    depths = np.arange(step, float(depth.max()), step).tolist()
    shores, *deeper = contour_rings(depth, [0.0, *depths], samples)
    shapes: list[Shape] = [Polygons(shores, WATER)]
    for rings in deeper:
        shapes += [Polygons(rings, DEEP, DEEPER), Polylines(rings, BANK, 0.08, 0.7)]
    return [*shapes, Polylines(shores, BANK, SHORE_WIDTH)]


def label_lakes(terrain: Terrain, samples: MapSamples, space: LabelSpace) -> list[Shape]:
    """Return the level of each lake, at the point farthest from the shore."""
    shapes: list[Shape] = []
    areas, count = label(samples.depth > 0.0)
    inland = distance_transform_edt(np.pad(areas > 0, 1))[1:-1, 1:-1]
    for number in range(1, count + 1):
        row, column = np.atleast_1d(maximum_position(inland, areas, number)).tolist()
        surface = float(samples.smooth[row, column] + samples.depth[row, column])
        level = min((lake.level for lake in terrain.features.lakes), key=lambda each: abs(each - surface))
        x, y = samples.frame.to_sheet(samples.metres(row, column)).tolist()
        text = MapText(f"{level:.0f}", x, y, 2.0, LEVEL, "middle", halo=WATER)
        wide = inland[row, column] * samples.spacing[0] * samples.frame.mm_per_metre > 1.3
        if wide and space.reserve(text.outline(margin=0.4)):
            shapes.append(text)
    return shapes


def draw_forests(samples: MapSamples) -> list[Shape]:
    """Return the forests as areas with edges."""
    share = gaussian_filter(samples.cover_weight(lambda each: each.is_wooded), 1.0)
    (rings,) = contour_rings(share, [0.5], samples)
    rings = [ring for ring in rings if shapely.Polygon(ring).area >= MIN_FOREST]
    return forest(rings) if rings else []


def forest(rings: list[Points]) -> list[Shape]:
    """Return rings (mm) in the style of forests."""
    return styled(_FOREST, PIXEL, rings=rings)[1]


def contour_rings(field: Grid, levels: list[float], samples: MapSamples) -> list[list[Points]]:
    """Return closed rings (mm) around the areas of a field above each level, closed at the map's border."""
    floor = levels[0] - 50.0
    padded = np.pad(np.maximum(field, floor), 1, constant_values=floor)
    lines = samples.isolines(padded, levels, border=1)
    return [[samples.frame.to_sheet(line) for line in of_level] for of_level in lines]


def label_peaks(terrain: Terrain, samples: MapSamples, space: LabelSpace, interval: float) -> list[Shape]:
    """Return a triangle and a height for each summit with free space, the most prominent first."""
    shapes: list[Shape] = []
    sides = ((1.1, -1.0, "start"), (-1.1, -1.0, "end"), (0.0, -2.0, "middle"), (1.1, 1.2, "start"))
    for east, north, height in find_peaks(terrain, samples, interval):
        x, y = samples.frame.to_sheet([east, north]).tolist()
        for dx, dy, anchor in sides:
            text = MapText(f"{height:.0f}", x + dx, y + dy, PEAK_SIZE, PEAK_INK, anchor, halo=PEAK_HALO)
            if space.reserve(text.outline(margin=0.3) | shapely.Point(x, y).buffer(0.9)):
                shapes += [*peak_triangle(x, y), text]
                break
    return shapes


def peak_triangle(x: float, y: float) -> list[Shape]:
    """Return a triangle at a point (mm)."""
    corners = np.array([[0.0, -0.85], [0.8, 0.55], [-0.8, 0.55]])
    return [Polygons([[x, y] + scale * corners], ink) for scale, ink in ((1.35, PEAK_HALO), (1.0, PEAK_INK))]


def find_peaks(terrain: Terrain, samples: MapSamples, interval: float) -> list[Points]:
    """Return the summits x, y, z (m) with a prominence of about a contour interval."""
    cell = max(round(CELL / (samples.spacing[0] * samples.frame.mm_per_metre)), 1)
    rows, columns = (length // cell for length in samples.smooth.shape)
    cut = samples.smooth[: rows * cell, : columns * cell].reshape(rows, cell, columns, cell)
    blocks = cut.transpose(0, 2, 1, 3).reshape(rows, columns, cell * cell)
    peaks: list[Points] = []
    for prominence, row, column in prominences(blocks.max(axis=-1)):
        if prominence < LEAST * interval or len(peaks) == MOST:
            break
        inner = divmod(int(blocks[row, column].argmax()), cell)
        x, y = samples.metres(row * cell + inner[0], column * cell + inner[1])
        if all(
            np.hypot(x - peak[0], y - peak[1]) >= PEAKS_APART / samples.frame.mm_per_metre for peak in peaks
        ):
            # The highest point of full detail nearby.
            off = np.linspace(-samples.cell_size, samples.cell_size, 9)
            near = np.clip(np.stack(np.meshgrid(x + off, y + off), axis=-1).reshape(-1, 2), 0.0, terrain.size)
            heights = terrain.heights(*near.T)
            if terrain.sea_level is not None and heights.max() <= terrain.sea_level:
                continue
            peaks.append(np.append(near[heights.argmax()], heights.max()))
    return peaks


def prominences(heights: npt.NDArray[np.floating]) -> list[tuple[float, int, int]]:
    """Return (prominence, row, column) of all summits in a grid, the most prominent first.

    Union-find over cells by descending height: where two islands of a falling sea meet, the prominence of the
    lower summit is its height above the sea.
    """
    rows, columns = heights.shape
    flat = heights.ravel().tolist()
    order = np.argsort(-heights.ravel(), kind="stable").tolist()
    island = [-1] * len(flat)  # parents towards each cell's summit
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
        highest, *lower = sorted(summits, key=lambda place: (-flat[place], place)) or [place]
        island[place] = highest
        for low in lower:
            island[low] = highest
            found.append((flat[low] - flat[place], low))
    found.append((max(flat) - min(flat), order[0]))
    found = sorted((peak for peak in found if peak[0] > 0.0), key=lambda peak: (-peak[0], peak[1]))
    return [(prominence, *divmod(place, columns)) for prominence, place in found]
