"""Meshes of built things: their materials, swept and extruded shapes, houses, walls and hedges."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array
from sketchterrain.document.layers import layer_of, vector_of
from sketchterrain.roads.road_types import Pad, Wall


class BuiltMaterial(NamedTuple):
    """Appearance of a material that is no ground: the relief of a ground's texture, and a colour."""

    texture: str  # material of the ground
    colour: tuple[float, float, float]  # mean albedo, linear


BUILT: Final = {
    "concrete": BuiltMaterial("asphalt", (0.40, 0.385, 0.36)),
    "stone": BuiltMaterial("rock", (0.27, 0.255, 0.235)),
    "plaster": BuiltMaterial("asphalt", (0.58, 0.53, 0.45)),
    "roof": BuiltMaterial("asphalt", (0.26, 0.105, 0.065)),
    "hedge": BuiltMaterial("grass", (0.040, 0.062, 0.022)),
    "wood": BuiltMaterial("asphalt", (0.13, 0.075, 0.042)),
    "glass": BuiltMaterial("asphalt", (0.020, 0.024, 0.030)),
}
"""Materials beside those of the ground."""

_BURIED: Final = 0.6  # m that things reach into the ground
_EAVES: Final = 0.5  # m by which a roof overhangs
_ROOF_SLOPE: Final = 0.7
_WINDOW: Final = (1.0, 1.3)  # m, width and height
_BAY, _STOREY, _SILL = 2.6, 2.8, 0.95  # m
_HEDGE_STEP, _WALL_STEP = 0.8, 2.0  # m between the cross-sections of a hedge, and of a wall


class BuiltPart(NamedTuple):
    """Triangles of one material."""

    material: str  # of `BUILT` or of the ground
    position: Float64Array  # (n, 3) m
    normal: Float64Array  # (n, 3) unit vectors, outward
    uv: Float64Array  # (n, 2) m along and across
    tone: Float64Array  # (n,) factor of the albedo
    triangles: npt.NDArray[np.uint32]  # (k, 3), counter-clockwise from outside
    track: float = 0.0  # m between the middles of railway tracks on it; 0: none
    fine: bool = False  # too small to be seen from afar


@dataclass(frozen=True, eq=False)
class BuiltObject:
    """A bridge, tunnel, house, wall, hedge, or a part of a road."""

    name: str  # of its node in exports: "road 7"
    key: Hashable  # equal for equal objects on equal ground
    places: Float64Array  # (k, 2) m, where it depends on the ground's height
    parts: Callable[[Float64Array], list[BuiltPart]]  # by the heights (k,; m) there


def feature_name(feature: int) -> str:
    """Return the layer and number of a feature, such as "road 7"."""
    vector = vector_of(feature)
    return f"{layer_of(feature)} {feature if vector is None else vector}"


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
    normal = np.cross(step, np.gradient(left + right, axis=1))
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
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


def flat_quads(material: str, corners: npt.ArrayLike, *, tone: float = 1.0, fine: bool = False) -> BuiltPart:
    """Return plane quads (m, 4, 3), counter-clockwise from outside; a triangle's last corner is repeated."""
    corner = np.asarray(corners, np.float64).reshape(-1, 4, 3)
    normal = np.cross(corner[:, 2] - corner[:, 0], corner[:, 3] - corner[:, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    along = corner[:, 1] - corner[:, 0]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    axes = np.stack([along, np.cross(normal, along)], axis=1)
    uv = np.einsum("mki,mci->mkc", corner - corner[:, :1], axes)
    first = 4 * np.arange(len(corner))[:, None]
    triangles = np.concatenate([first + [0, 1, 2], first + [0, 2, 3]])
    return BuiltPart(
        material,
        corner.reshape(-1, 3),
        np.repeat(normal, 4, axis=0),
        uv.reshape(-1, 2),
        np.full(4 * len(corner), tone),
        triangles.astype(np.uint32),
        fine=fine,
    )


def extruded(
    material: str, outline: Float64Array, low: float, high: float, *, top: bool = True, tone: float = 1.0
) -> list[BuiltPart]:
    """Return the sides of a prism over a counter-clockwise outline (n, 2), and its top."""
    bottom, upper = (np.column_stack([outline, np.full(len(outline), z)]) for z in (low, high))
    following = np.roll(np.arange(len(outline)), -1)
    sides = np.stack([bottom, bottom[following], upper[following], upper], axis=1)
    parts = [flat_quads(material, sides, tone=tone)]
    if top:
        corners = upper[triangulated(outline)]
        parts.append(flat_quads(material, corners[:, [0, 1, 2, 2]], tone=tone))
    return parts


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
    lengths = np.hypot(*sides.T)
    units = sides / np.maximum(lengths, 1e-9)[:, None]
    is_rectangle = len(outline) == 4 and bool(
        np.abs(np.sum(units * np.roll(units, -1, axis=0), axis=1)).max() < 0.1
    )
    if not is_rectangle:
        walls = extruded("plaster", outline, low, top, top=False, tone=plaster)
        roof = extruded("concrete", outline, top - 0.4, top - 0.3)[1:]
        return [*walls, *roof, *_windows(outline, pad.level, top - 0.5)]
    if lengths[1] + lengths[3] > lengths[0] + lengths[2]:
        outline, units = np.roll(outline, -1, axis=0), np.roll(units, -1, axis=0)
    half = 0.25 * float(min(lengths[0] + lengths[2], lengths[1] + lengths[3]))
    rise = min(_ROOF_SLOPE * half, 0.5 * pad.building)
    eaves = top - rise
    hip = half * float(chance[2] < 0.4) * 0.9
    middles = [0.5 * (outline[1] + outline[2]), 0.5 * (outline[3] + outline[0])]
    axis = (middles[0] - middles[1]) / max(float(np.hypot(*(middles[0] - middles[1]))), 1e-9)
    parts = extruded("plaster", outline, low, eaves, top=False, tone=plaster)
    parts += extruded("stone", _offset(outline, units, 0.06), low, pad.level + 0.45)
    ground = np.column_stack([outline, np.full(4, eaves)])
    drop = rise / half * _EAVES
    q = np.column_stack([_offset(outline, units, _EAVES), np.full(4, eaves - drop)])
    out = _EAVES if hip == 0.0 else -hip
    ridge = [np.append(middles[0] + out * axis, top), np.append(middles[1] - out * axis, top)]
    slopes = [[q[0], q[1], ridge[0], ridge[1]], [q[2], q[3], ridge[1], ridge[0]]]
    if hip == 0.0:
        gables = [
            [ground[1], ground[2], np.append(middles[0], top)],
            [ground[3], ground[0], np.append(middles[1], top)],
        ]
        parts.append(flat_quads("plaster", [[*each, each[-1]] for each in gables], tone=plaster))
        edge = np.array([q[0], q[1], ridge[0], q[2], q[3], ridge[1]])
    else:
        slopes += [[q[1], q[2], ridge[0], ridge[0]], [q[3], q[0], ridge[1], ridge[1]]]
        edge = q
    thick = np.array([0.0, 0.0, 0.2])
    parts.append(flat_quads("roof", slopes, tone=tiles))
    parts.append(flat_quads("wood", [[p - thick for p in reversed(slope)] for slope in slopes]))
    following = np.roll(edge, -1, axis=0)
    parts.append(flat_quads("wood", np.stack([edge - thick, following - thick, following, edge], axis=1)))
    return [*parts, *_windows(outline, pad.level, eaves)]


def _offset(outline: Float64Array, units: Float64Array, out: float) -> Float64Array:
    """Return the outline of a rectangle moved outward."""
    return np.asarray(outline + out * (np.roll(units, 1, axis=0) - units))


def _windows(outline: Float64Array, level: float, eaves: float) -> list[BuiltPart]:
    """Return windows in rows, and a door in the middle of the first side."""
    width, height = _WINDOW
    glass, wood = [], []
    storeys = max(int((eaves - level - _SILL - height) / _STOREY) + 1, 0)
    for number, (start, end) in enumerate(zip(outline, np.roll(outline, -1, axis=0), strict=True)):
        length = float(np.hypot(*(end - start)))
        unit = (end - start) / max(length, 1e-9)
        out = np.array([unit[1], -unit[0]])
        bays = int((length - 0.6) / _BAY)
        for bay in range(bays):
            middle = start + unit * length * (bay + 0.5) / bays
            for storey in range(storeys):
                is_door = number == 0 and storey == 0 and bay == bays // 2
                low = level + (0.05 if is_door else _SILL + _STOREY * storey)
                high = level + 2.1 if is_door else low + height
                wood.append(_upright(middle + 0.02 * out, (0.5 * width + 0.1) * unit, low - 0.1, high + 0.1))
                if not is_door:
                    glass.append(_upright(middle + 0.05 * out, 0.5 * width * unit, low, high))
    kinds = (("wood", wood), ("glass", glass))
    return [flat_quads(material, quads, fine=True) for material, quads in kinds if quads]


def _upright(middle: Float64Array, half: Float64Array, low: float, high: float) -> list[Float64Array]:
    """Return an upright quad about a place (2,), by half its width as a vector."""
    a, b = middle - half, middle + half
    return [np.append(a, low), np.append(b, low), np.append(b, high), np.append(a, high)]


def wall(given: Wall) -> BuiltObject:
    """Return a wall or hedge along its line on the ground."""
    is_hedge = given.material == "hedge"
    line = _densified(given.line, _HEDGE_STEP if is_hedge else _WALL_STEP)
    key = (given.id, given.line.tobytes(), given.height, given.width, given.material)
    return BuiltObject(feature_name(given.id), key, line, partial(_wall_parts, given, line))


def _wall_parts(given: Wall, line: Float64Array, ground: Float64Array) -> list[BuiltPart]:
    ahead = np.gradient(line, axis=0)
    left = np.column_stack([-ahead[:, 1], ahead[:, 0]]) / np.maximum(np.hypot(*ahead.T), 1e-9)[:, None]
    half, height = 0.5 * given.width, given.height
    if given.material == "hedge":
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
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    last = len(section) - 1
    ends = []
    for k in range(len(section) // 2 - 1):
        ends.append([lines[i][0] for i in (k, last - k, last - k - 1, k + 1)])
        ends.append([lines[i][-1] for i in (last - k, k, k + 1, last - k - 1)])
    return [swept(given.material, lines, along), flat_quads(given.material, ends)]


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
    return np.column_stack([np.interp(at, along, axis) for axis in line.T])
