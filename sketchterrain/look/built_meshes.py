"""Meshes of built things: their materials, swept and extruded shapes, houses, what stands along lines."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array, FloatArray
from sketchterrain.geometry.splines import arc_length, at_lengths
from sketchterrain.roads.road_types import LineObject, Pad
from sketchterrain.schema.layers import feature_name


class BuiltMaterial(NamedTuple):
    """Appearance of a material that is no ground: the relief of a ground's texture, and a colour."""

    texture: str  # material of the ground
    colour: tuple[float, float, float]  # mean albedo, linear


MOUTH: Final = "mouth"
"""Material of a tunnel's opening, through which a renderer shows its inside."""
BUILT: Final = {
    "concrete": BuiltMaterial("asphalt", (0.40, 0.385, 0.36)),
    "stone": BuiltMaterial("rock", (0.27, 0.255, 0.235)),
    "plaster": BuiltMaterial("asphalt", (0.58, 0.53, 0.45)),
    "roof": BuiltMaterial("asphalt", (0.26, 0.105, 0.065)),
    "hedge": BuiltMaterial("grass", (0.040, 0.062, 0.022)),
    "wood": BuiltMaterial("asphalt", (0.13, 0.075, 0.042)),
    "steel": BuiltMaterial("asphalt", (0.30, 0.31, 0.32)),
    "glass": BuiltMaterial("asphalt", (0.020, 0.024, 0.030)),
    MOUTH: BuiltMaterial("asphalt", (0.002, 0.002, 0.002)),
}
"""Materials beside those of the ground."""

_BURIED: Final = 0.6  # m that things reach into the ground
_EAVES: Final = 0.5  # m by which a roof overhangs
_ROOF_SLOPE: Final = 0.7
_WINDOW: Final = (1.0, 1.3)  # m, width and height
_BAY, _STOREY, _SILL = 2.6, 2.8, 0.95  # m
_FINE, _BOARDS = 0.08, 0.25  # m, sizes of windows, and of boards and plinths
_CABLE, _SAG = 0.1, 0.03  # m, width of cables; sag over their span
_TOWER: Final = ((-0.02, 0.1), (0.22, 0.07), (0.42, 0.045), (0.6, 0.025), (0.8, 0.02), (1.0, 0.004))
"""Heights of the joints of a tower, and half its width there, over its height."""
_ARMS: Final = (((0.93, 0.11),), ((0.66, 0.2), (0.78, 0.25), (0.9, 0.16)))
"""Height and length of each pair of arms of poles and of towers, over their height."""
_BEAMS: Final = ((0.012, 0.012, 0.03), (0.006, 0.006, 0.008, 0.004, 0.004))
"""Widths of their arms, and of a pole, or of a tower's legs and braces, over their height."""
_HEDGE_STEP, _WALL_STEP = 0.8, 2.0  # m between the cross-sections of a hedge, and of a wall


class BuiltPart(NamedTuple):
    """Triangles of one material."""

    material: str  # of `BUILT` or of the ground
    position: Float64Array  # (n, 3) m
    normal: Float64Array  # (n, 3) unit vectors, outward
    uv: Float64Array  # (n, 2) m along and across
    tone: Float64Array  # (n,) factor of its light
    triangles: npt.NDArray[np.uint32]  # (k, 3), counter-clockwise from outside
    # m between the middles of railway tracks on it; 0: none; below -1: -1 - width of a marked carriageway
    track: float = 0.0
    size: float = 0.0  # m, of its details, which nobody sees from afar; 0: its own


@dataclass(frozen=True, eq=False)
class BuiltObject:
    """A bridge, tunnel, house, wall, hedge, or a part of a road."""

    name: str  # of its node in exports: "road 7"
    key: Hashable  # equal for equal objects on equal ground
    places: Float64Array  # (k, 2) m, where it depends on the ground's height
    parts: Callable[[Float64Array], list[BuiltPart]]  # by the heights (k,; m) there


def swept(
    material: str,
    lines: Sequence[Float64Array],
    along: Float64Array,
    *,
    tone: Float64Array | float = 1.0,
    track: float = 0.0,
) -> BuiltPart:
    """Return the strips between successive lines (n, 3), smooth along and flat across.

    Their outsides face a viewer for whom the lines run ahead, the next one to the right. `along` and
    `tone` are given for the points of a line.
    """
    left, right = np.stack(lines[:-1]), np.stack(lines[1:])
    step = right - left
    normal = _unit(_cross(step, np.gradient(left + right, axis=1)))
    strips, count = left.shape[:2]
    width = np.linalg.norm(step, axis=-1).mean(axis=1)
    v = np.concatenate([[0.0], np.cumsum(width)])
    uv = np.empty((strips, count, 2, 2))
    uv[..., 0] = along[:, None]
    uv[:, :, 0, 1], uv[:, :, 1, 1] = v[:-1, None], v[1:, None]
    index = np.arange(strips * count * 2, dtype=np.uint32).reshape(strips, count, 2)
    a, b, c, d = index[:, :-1, 0], index[:, :-1, 1], index[:, 1:, 1], index[:, 1:, 0]
    return BuiltPart(
        material,
        np.stack([left, right], axis=2).reshape(-1, 3),
        np.repeat(normal, 2, axis=1).reshape(-1, 3),
        uv.reshape(-1, 2),
        np.broadcast_to(np.reshape(tone, (1, -1, 1)), (strips, count, 2)).ravel(),
        np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3),
        track,
    )


def joined_parts(parts: Sequence[BuiltPart]) -> list[BuiltPart]:
    """Return one part a material."""
    joined = []
    for material in dict.fromkeys(part.material for part in parts):
        own = [part for part in parts if part.material == material]
        base = np.cumsum([0, *(len(part.position) for part in own)])
        position, normal, uv = (np.concatenate([part[k] for part in own]) for k in (1, 2, 3))
        tone = np.concatenate([part.tone for part in own])
        triangles = [part.triangles + first for part, first in zip(own, base[:-1], strict=True)]
        joined.append(
            BuiltPart(material, position, normal, uv, tone, np.concatenate(triangles).astype(np.uint32))
        )
    return joined


def _cross(a: Float64Array, b: Float64Array) -> Float64Array:
    """Return cross products of (…, 3) vectors, for few of them faster than NumPy."""
    (ax, ay, az), (bx, by, bz) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def _unit(vectors: Float64Array) -> Float64Array:
    length = np.sqrt(np.einsum("...i,...i->...", vectors, vectors))
    return np.asarray(vectors / np.maximum(length, 1e-12)[..., None])


def flat_quads(material: str, corners: npt.ArrayLike, *, tone: float = 1.0, size: float = 0.0) -> BuiltPart:
    """Return plane quads (m, 4, 3), counter-clockwise from outside; a triangle's last corner is repeated."""
    corner = np.asarray(corners, np.float64).reshape(-1, 4, 3)
    normal = _unit(_cross(corner[:, 2] - corner[:, 0], corner[:, 3] - corner[:, 1]))
    along = _unit(corner[:, 1] - corner[:, 0])
    axes = np.stack([along, _cross(normal, along)], axis=1)
    uv = np.einsum("mki,mci->mkc", corner - corner[:, :1], axes)
    first = 4 * np.arange(len(corner))[:, None]
    triangles = np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])])
    return BuiltPart(
        material,
        corner.reshape(-1, 3),
        np.repeat(normal, 4, axis=0),
        uv.reshape(-1, 2),
        np.full(4 * len(corner), tone),
        triangles.astype(np.uint32),
        size=size,
    )


def extruded(material: str, outline: Float64Array, low: float, high: float) -> BuiltPart:
    """Return a prism over a counter-clockwise outline (n, 2)."""
    corner = triangulated(outline)[:, [0, 1, 2, 2]]
    top, bottom = (np.column_stack([outline, np.full(len(outline), z)]) for z in (high, low))
    return flat_quads(
        material, np.concatenate([prism_quads(outline, low, high), top[corner], bottom[corner[:, ::-1]]])
    )


def prism_quads(outline: Float64Array, low: float, high: float) -> Float64Array:
    """Return the sides (n, 4, 3) of a prism over a counter-clockwise outline (n, 2)."""
    sides = np.empty((len(outline), 4, 3))
    sides[:, 0, :2] = sides[:, 3, :2] = outline
    sides[:, 1, :2] = sides[:, 2, :2] = np.roll(outline, -1, axis=0)
    sides[:, :2, 2], sides[:, 2:, 2] = low, high
    return sides


def rectangle(middle: Float64Array, ahead: Float64Array, length: float, width: float) -> Float64Array:
    """Return the counter-clockwise outline (4, 2) of a rectangle, its length along a unit vector."""
    left = np.array([-ahead[1], ahead[0]])
    ends = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
    return np.array([middle + a * length * ahead + b * width * left for a, b in ends])


def triangulated(outline: Float64Array) -> npt.NDArray[np.intp]:
    """Return the triangles (n − 2, 3) of a counter-clockwise polygon (n, 2), by clipping ears."""
    left = list(range(len(outline)))
    triangles = []
    while len(left) > 3:
        for k in range(len(left)):
            a, b, c = left[k - 1], left[k], left[(k + 1) % len(left)]
            others = outline[[i for i in left if i not in (a, b, c)]]
            corners = outline[[a, b, c]]
            sides = [_turn(corners[i], corners[(i + 1) % 3], others) for i in range(3)]
            if (
                _turn(corners[0], corners[1], corners[2]) > 0.0
                and not np.all(np.array(sides) >= 0.0, 0).any()
            ):
                break
        else:
            k = 0  # degenerate: any corner will do
        triangles.append((left[k - 1], left[k], left[(k + 1) % len(left)]))
        del left[k]
    return np.array([*triangles, left], np.intp)


def _turn(a: Float64Array, b: Float64Array, c: Float64Array) -> Float64Array:
    """Return twice the signed area of a, b, c; c may be many."""
    return np.asarray((b[0] - a[0]) * (c[..., 1] - a[1]) - (b[1] - a[1]) * (c[..., 0] - a[0]))


def house(pad: Pad) -> BuiltObject:
    """Return the building on a pad: with a gabled or hipped roof over a rectangle, else a flat one."""
    key = (pad.id, pad.level, pad.building, pad.outline.tobytes())
    return BuiltObject(feature_name(pad.id), key, np.zeros((0, 2)), lambda _: _house_parts(pad))


def _house_parts(pad: Pad) -> list[BuiltPart]:
    chance = np.random.default_rng(pad.id & 0xFFFFFFFF).random(3)
    plaster, tiles = 0.72 + 0.4 * chance[0], 0.75 + 0.45 * chance[1]
    low, top, outline = pad.level - _BURIED, pad.level + pad.building, pad.outline
    sides = np.roll(outline, -1, axis=0) - outline
    lengths = np.sqrt((sides * sides).sum(axis=1))
    units = sides / np.maximum(lengths, 1e-9)[:, None]
    turns = np.abs((units * np.roll(units, -1, axis=0)).sum(axis=1))
    if len(outline) != 4 or turns.max() > 0.1:
        walls = flat_quads("plaster", prism_quads(outline, low, top), tone=plaster)
        return [
            walls,
            extruded("concrete", outline, top - 0.4, top - 0.3),
            *_windows(outline, pad.level, top),
        ]
    if lengths[1] + lengths[3] > lengths[0] + lengths[2]:
        outline, units, lengths = (np.roll(each, -1, axis=0) for each in (outline, units, lengths))
    half = 0.25 * float(lengths[1] + lengths[3])
    rise = min(_ROOF_SLOPE * half, 0.5 * pad.building)
    eaves = top - rise
    is_hipped = chance[2] < 0.4
    middles = 0.5 * (outline[[1, 3]] + outline[[2, 0]])
    axis = (middles[0] - middles[1]) / max(float(np.hypot(*(middles[0] - middles[1]))), 1e-9)
    out = -0.9 * half if is_hipped else _EAVES
    ridge = np.column_stack([middles + out * np.stack([axis, -axis]), [top, top]])
    corners = np.column_stack([_offset(outline, units, _EAVES), np.full(4, eaves - rise / half * _EAVES)])
    slopes = np.array([[corners[0], corners[1], *ridge], [corners[2], corners[3], *ridge[::-1]]])
    faces = prism_quads(outline, low, eaves)
    if is_hipped:
        ends = [[corners[1], corners[2], ridge[0], ridge[0]], [corners[3], corners[0], ridge[1], ridge[1]]]
        slopes, edge = np.concatenate([slopes, ends]), corners
    else:
        gables = np.empty((2, 4, 3))
        gables[:, 0, :2], gables[:, 1, :2], gables[:, 2:, :2] = (
            outline[[1, 3]],
            outline[[2, 0]],
            middles[:, None],
        )
        gables[:, :2, 2], gables[:, 2:, 2] = eaves, top
        faces = np.concatenate([faces, gables])
        edge = np.concatenate([corners[:2], ridge[:1], corners[2:], ridge[1:]])
    thick = np.array([0.0, 0.0, 0.2])
    following = np.roll(edge, -1, axis=0)
    boards = np.stack([edge - thick, following - thick, following, edge], axis=1)
    plinth = _offset(outline, units, 0.06)
    return [
        flat_quads("plaster", faces, tone=plaster),
        flat_quads("roof", slopes, tone=tiles),
        flat_quads("wood", np.concatenate([slopes[:, ::-1] - thick, boards]), size=_BOARDS),
        flat_quads("stone", prism_quads(plinth, low, pad.level + 0.45), size=_BOARDS),
        flat_quads("stone", [[[*corner, pad.level + 0.45] for corner in plinth]], size=_BOARDS),
        *_windows(outline, pad.level, eaves),
    ]


def _offset(outline: Float64Array, units: Float64Array, out: float) -> Float64Array:
    """Return the outline of a rectangle moved outward."""
    return np.asarray(outline + out * (np.roll(units, 1, axis=0) - units))


def _windows(outline: Float64Array, level: float, eaves: float) -> list[BuiltPart]:
    """Return windows in rows, and a door in the middle of the first side."""
    width, height = _WINDOW
    storeys = max(int((eaves - level - _SILL - height) / _STOREY) + 1, 0)
    glass, wood = [np.zeros((0, 4, 3))], [np.zeros((0, 4, 3))]
    for number, (start, end) in enumerate(zip(outline, np.roll(outline, -1, axis=0), strict=True)):
        length = float(np.hypot(*(end - start)))
        bays = int((length - 0.6) / _BAY)
        if not bays or not storeys:
            continue
        unit = (end - start) / length
        out = np.array([unit[1], -unit[0]])
        bay, storey = (axis.ravel() for axis in np.meshgrid(np.arange(bays), np.arange(storeys)))
        middle = start + (length * (bay + 0.5) / bays)[:, None] * unit
        sill = level + _SILL + _STOREY * storey
        is_door = (bay == bays // 2) & (storey == 0) & (number == 0)
        low, high = (
            np.where(is_door, level + 0.05, sill - 0.1),
            np.where(is_door, level + 2.1, sill + height + 0.1),
        )
        wood.append(_upright(middle + 0.02 * out, (0.5 * width + 0.1) * unit, low, high))
        glass.append(_upright(middle + 0.05 * out, 0.5 * width * unit, sill, sill + height)[~is_door])
    kinds = (("wood", np.concatenate(wood)), ("glass", np.concatenate(glass)))
    return [flat_quads(material, quads, size=_FINE) for material, quads in kinds if len(quads)]


def _upright(middle: Float64Array, half: Float64Array, low: FloatArray, high: FloatArray) -> Float64Array:
    """Return upright quads (n, 4, 3) about places (n, 2), by half their width as a vector."""
    quads = np.empty((len(middle), 4, 3))
    quads[:, [0, 3], :2], quads[:, [1, 2], :2] = (middle - half)[:, None], (middle + half)[:, None]
    quads[:, :2, 2], quads[:, 2:, 2] = low[:, None], high[:, None]
    return quads


def standing(given: LineObject) -> BuiltObject:
    """Return what stands along a line on the ground, as its layer says."""
    step, parts = STANDING[given.layer]
    line = _densified(given.line, step(given.values))
    key = (given.id, given.line.tobytes(), *given.values.items())
    return BuiltObject(feature_name(given.id), key, line, partial(parts, given, line))


def _wall_parts(given: LineObject, line: Float64Array, ground: Float64Array) -> list[BuiltPart]:
    ahead = np.gradient(line, axis=0)
    left = np.column_stack([-ahead[:, 1], ahead[:, 0]]) / np.maximum(np.hypot(*ahead.T), 1e-9)[:, None]
    half, height, material = 0.5 * given.values["width"], given.values["height"], given.values["material"]
    if material == "hedge":
        section = [
            (1.0, -0.3),
            (1.1, 0.3),
            (0.95, 0.8),
            (0.55, 1.0),
            (-0.55, 1.0),
            (-0.95, 0.8),
            (-1.1, 0.3),
            (-1.0, -0.3),
        ]
        jitter = 1.0 + 0.2 * (
            np.random.default_rng(given.id & 0xFFFFFFFF).random((len(section), len(line))) - 0.5
        )
    else:
        section = [(1.0, -_BURIED / height), (1.0, 1.0), (-1.0, 1.0), (-1.0, -_BURIED / height)]
        jitter = np.ones((len(section), len(line)))
    lines = [
        np.column_stack([line + (a * half * more)[:, None] * left, ground + up * height * more])
        for (a, up), more in zip(section, jitter, strict=True)
    ]
    along = arc_length(line)
    last = len(section) - 1
    ends = []
    for k in range(len(section) // 2 - 1):
        ends.append([lines[i][0] for i in (k, last - k, last - k - 1, k + 1)])
        ends.append([lines[i][-1] for i in (last - k, k, k + 1, last - k - 1)])
    return [swept(material, lines, along), flat_quads(material, ends)]


def beam_quads(
    material: str, ends: Float64Array, width: Float64Array | float, *, size: float = 0.0
) -> BuiltPart:
    """Return square beams between ends (m, 2, 3), of a width (m) each, open at their ends."""
    axis = _unit(ends[:, 1] - ends[:, 0])
    across = _unit(_cross(axis, np.where(np.abs(axis[:, 2:]) > 0.9, (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))))
    over = _cross(axis, across)
    half = 0.5 * np.broadcast_to(width, len(ends))[:, None, None]
    ring = half * np.stack([across + over, over - across, -across - over, across - over], axis=1)
    low, high = ends[:, :1] + ring, ends[:, 1:] + ring
    sides = np.stack([low, np.roll(low, -1, axis=1), np.roll(high, -1, axis=1), high], axis=2)
    return flat_quads(material, sides, size=size)


@lru_cache(maxsize=2)
def _tower(material: str) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return beams (k, 2, 3), their widths (k,) and where cables hang (n, 3): ahead, left, up over height."""
    is_steel = material == "steel"
    tips = [(0.0, side * reach, up) for up, reach in _ARMS[is_steel] for side in (-1.0, 1.0)]
    roots = np.array(tips) * (0.0, 0.0, 1.0)
    beams = [np.stack([roots + np.array([0.0, 0.0, rise]), tips], axis=1) for rise in (0.0, 0.05)]
    if is_steel:
        up, half = np.array(_TOWER).T[..., None]
        corners = zip((1.0, -1.0, -1.0, 1.0), (1.0, 1.0, -1.0, -1.0), strict=True)
        frame = np.stack([np.hstack([x * half, y * half, up]) for x, y in corners], axis=1)
        low, high = frame[:-1], frame[1:]
        for start, end in ((low, high), (low, np.roll(high, 1, axis=1)), (np.roll(low, 1, axis=1), high)):
            beams.append(np.stack([start, end], axis=2).reshape(-1, 2, 3))
    else:
        beams.append(np.array([[(0.0, 0.0, -0.06), (0.0, 0.0, 1.0)]]))
    widths = np.repeat(_BEAMS[is_steel], [len(each) for each in beams])
    return np.concatenate(beams), widths, np.array([*tips, (0.0, 0.0, 1.0)])


def _power_line_parts(given: LineObject, line: Float64Array, ground: Float64Array) -> list[BuiltPart]:
    """Return lattice towers with three pairs of arms, or poles with one, and the cables between."""
    height, material = float(given.values["height"]), str(given.values["material"])
    beams, widths, tips = _tower(material)
    ahead = np.gradient(line, axis=0)
    ahead /= np.maximum(np.hypot(*ahead.T), 1e-9)[:, None]
    axes = np.zeros((len(line), 3, 3))
    axes[:, 0, :2], axes[:, 1, 0], axes[:, 1, 1], axes[:, 2, 2] = ahead, -ahead[:, 1], ahead[:, 0], 1.0
    foot = np.column_stack([line, ground])[:, None]
    ends, span = foot + height * tips @ axes, np.hypot(*np.diff(line, axis=0).T)[:, None]
    share = np.linspace(0.0, 1.0, 9)[:, None, None]
    cable = ends[:-1] + share[..., None] * np.diff(ends, axis=0)
    cable[..., 2] -= 4.0 * _SAG * share * (1.0 - share) * span
    wires = np.stack([cable[:-1], cable[1:]], axis=-2).reshape(-1, 2, 3)
    framed = (foot + height * beams.reshape(-1, 3) @ axes).reshape(-1, 2, 3)
    return [
        beam_quads(material, framed, np.tile(height * widths, len(line))),
        beam_quads("steel", wires, _CABLE, size=2.0 * _CABLE),
    ]


STANDING: Final[dict[str, tuple[Callable[[Mapping[str, Any]], float], Callable[..., list[BuiltPart]]]]] = {
    "wall": (
        lambda values: _HEDGE_STEP if values["material"] == "hedge" else _WALL_STEP,
        _wall_parts,
    ),
    "powerline": (lambda values: float(values["spacing"]), _power_line_parts),
}
"""What stands along lines, by layer: the distance (m) of its cross-sections, and its parts on ground."""


def _densified(line: Float64Array, step: float) -> Float64Array:
    """Return a line (m, 2) with points at most `step` m apart."""
    lengths = np.hypot(*np.diff(line, axis=0).T)
    line = line[np.concatenate([[True], lengths > 1e-6])]
    along = np.concatenate([[0.0], np.cumsum(lengths[lengths > 1e-6])])
    pieces = np.maximum(np.ceil(np.diff(along) / step), 1).astype(int)
    inner = [
        np.linspace(a, b, n, endpoint=False) for a, b, n in zip(along[:-1], along[1:], pieces, strict=True)
    ]
    at = np.concatenate([*inner, along[-1:]])
    return at_lengths(line, along, at)
