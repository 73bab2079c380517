"""Rivers, lakes and forests on a map."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter, label, maximum_position
from skimage.measure import find_contours

from sketchterrain.export.map_contours import sampled, simplified
from sketchterrain.export.map_frame import round_number
from sketchterrain.export.map_labels import discs_of
from sketchterrain.export.map_sheet import Areas, Lines, Words

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from sketchterrain.export.map_frame import Frame
    from sketchterrain.export.map_ground import MapGround
    from sketchterrain.export.map_labels import Room
    from sketchterrain.export.map_sheet import Shape
    from sketchterrain.terrain import Terrain

    Floats = npt.NDArray[np.float64]

__all__ = ["BANK", "FOREST", "FOREST_EDGE", "WATER", "forests", "lake_labels", "lakes", "rivers", "shore_of"]

WATER: Final = (166, 206, 230)
DEEP: Final = (92, 150, 196)
BANK: Final = (48, 110, 160)
LEVEL: Final = (16, 58, 104)
"""Of the figures on lakes."""
FOREST: Final = (128, 172, 108)
FOREST_EDGE: Final = (84, 130, 76)
FOREST_SHARE: Final = 0.52
"""Opacity of a forest's colour: the relief shows through it."""
NARROWEST: Final = 0.24
"""mm of the smallest rivers."""
CASED: Final = 0.42
"""mm from which on a river has banks on both sides."""
BANK_WIDTH: Final = 0.14
SHORE_WIDTH: Final = 0.2
WIDTH_STEP: Final = 0.04
"""mm between the widths that a river is drawn in."""
ARROWS: Final = (14.0, 48.0)
"""mm along a river to its first arrow, and from one to the next."""
ARROW: Final = (2.6, 1.1, 0.8)
"""mm: its length, its head's length and width."""
SMALLEST_FOREST: Final = 1.2
"""mm²."""
DEPTH_STEPS: Final = 3
"""About so many tints of depth has the deepest lake."""


def rivers(terrain: Terrain, ground: MapGround, frame: Frame, room: Room) -> list[Shape]:
    """Return rivers in their widths, and arrows in the direction they flow."""
    banks: dict[int, list[Floats]] = {}
    water: dict[int, list[Floats]] = {}
    arrows: list[Shape] = []
    for river in terrain.features.rivers:
        path = frame.place(river.centreline)
        width = np.maximum(river.centreline_width * frame.metre, NARROWEST)
        # On a lake there is no river to be seen: no step there.
        dry = sampled(ground.depth, ground, river.centreline) <= 0.0
        step = np.where(dry, np.rint(width / WIDTH_STEP), 0).astype(int)
        cuts = (np.flatnonzero(np.diff(step)) + 1).tolist()
        for start, end in zip([0, *cuts], [*cuts, len(path)], strict=True):
            wide = int(step[start])
            piece = path[start : end + 1]  # up to where the next begins
            if len(piece) > 1 and wide:
                (water if wide * WIDTH_STEP >= CASED else banks).setdefault(wide, []).append(
                    simplified(piece)
                )
        arrows += _arrows(path, width, dry, room)
    shapes: list[Shape] = [Lines(paths, BANK, wide * WIDTH_STEP) for wide, paths in sorted(banks.items())]
    shapes += [
        Lines(paths, BANK, wide * WIDTH_STEP + 2 * BANK_WIDTH) for wide, paths in sorted(water.items())
    ]
    shapes += [Lines(paths, WATER, wide * WIDTH_STEP) for wide, paths in sorted(water.items())]
    return shapes + arrows


def _arrows(path: Floats, width: Floats, dry: npt.NDArray[np.bool_], room: Room) -> list[Shape]:
    """Return arrows beside a river, none where it is not `dry`."""
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    shapes: list[Shape] = []
    for middle in np.arange(ARROWS[0], arc[-1], ARROWS[1]):
        ends = [
            np.array([np.interp(at, arc, path[:, axis]) for axis in (0, 1)])
            for at in (middle - 1, middle + 1)
        ]
        along = (ends[1] - ends[0]) / max(float(np.hypot(*(ends[1] - ends[0]))), 1e-9)
        aside = np.array([-along[1], along[0]])
        off = float(np.interp(middle, arc, width)) / 2 + 1.0
        at = (ends[0] + ends[1]) / 2 + off * aside
        length, head, wide = ARROW
        tail, tip = at - along * length / 2, at + along * length / 2
        discs = np.stack([[*place, 0.6] for place in (tail, at, tip)])
        if not room.free(discs) or np.interp(middle, arc, dry) < 1.0:
            continue
        room.take(discs)
        neck = tip - along * head
        shapes.append(Lines([np.stack([tail, neck])], BANK, 0.18))
        shapes.append(Areas([np.stack([tip, neck + aside * wide / 2, neck - aside * wide / 2])], BANK))
    return shapes


def shore_of(ground: MapGround, frame: Frame, depth: float = 0.0) -> list[Floats]:
    """Return the rings (mm) around the water of lakes that is deeper than that (m)."""
    return _rings(ground.depth - depth, ground, frame)


def lakes(ground: MapGround, frame: Frame) -> list[Shape]:
    """Return lakes, darker where they are deeper, with their shores."""
    shores = shore_of(ground, frame)
    if not shores:
        return []
    shapes: list[Shape] = [Areas(shores, WATER)]
    deepest = float(ground.depth.max())
    step = round_number(deepest / DEPTH_STEPS, steps=(1.0, 2.0, 5.0))
    for depth in np.arange(step, deepest, step):
        rings = shore_of(ground, frame, float(depth))
        if rings:
            shapes += [Areas(rings, DEEP, 0.3), Lines(_closed(rings), BANK, 0.08, 0.7)]
    return [*shapes, Lines(_closed(shores), BANK, SHORE_WIDTH)]


def lake_labels(terrain: Terrain, ground: MapGround, frame: Frame, room: Room) -> list[Words]:
    """Return the height of each lake's water, written where the shore is farthest."""
    pieces, count = label(ground.depth > 0.0)
    words = []
    inland = distance_transform_edt(np.pad(ground.depth > 0.0, 1))[1:-1, 1:-1]
    for number in range(1, count + 1):
        row, column = maximum_position(inland, pieces, number)
        place = ground.metres(np.array([[row, column]], np.float64))
        x, y = frame.place(place)[0].tolist()
        level = float(ground.even[row, column] + ground.depth[row, column])
        levels = [lake.level for lake in terrain.features.lakes]
        level = min(levels, key=lambda each: abs(each - level))
        text = Words(f"{level:.0f}", x, y, 2.0, LEVEL, "middle", halo=WATER)
        wide = float(inland[row, column]) * ground.spacing[0] * frame.metre
        if wide > 1.3 and room.free(discs_of(text, air=0.4)):
            room.take(discs_of(text, air=0.8))
            words.append(text)
    return words


def forests(ground: MapGround, frame: Frame) -> list[Shape]:
    """Return the forests as areas of colour, with their edges."""
    share = gaussian_filter(ground.share("forest_floor"), 1.0)
    rings = [ring for ring in _rings(share - 0.5, ground, frame) if abs(_area(ring)) >= SMALLEST_FOREST]
    if not rings:
        return []
    return [Areas(rings, FOREST, FOREST_SHARE), Lines(_closed(rings), FOREST_EDGE, 0.14, 0.8)]


def _rings(field: npt.NDArray[np.floating], ground: MapGround, frame: Frame) -> list[Floats]:
    """Return closed rings (mm) around where a field is above 0; the map's border closes them."""
    low = -max(float(np.abs(field).max()), 1.0)
    padded = np.pad(np.maximum(field, -50.0), 1, constant_values=max(low, -50.0))
    rings = [frame.place(ground.metres(line - 1.0)) for line in find_contours(padded, 0.0)]
    return [simplified(ring) for ring in rings if len(ring) > 3]


def _closed(rings: Sequence[Floats]) -> list[Floats]:
    return [np.concatenate([ring, ring[:1]]) for ring in rings]


def _area(ring: Floats) -> float:
    """Return the area within a ring, negative where it runs the other way."""
    x, y = ring.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
