"""Grass, flowers and ferns near the eye: meshes from a few rules and a fixed seed, scattered instances.

A mesh has its foot at the origin and is about one high; blades are strips about a middle line, and their
width is scaled when they are drawn.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sketchterrain.render.programs import build_program
from sketchterrain.render.scatter import (
    CoverLayer,
    CoverMesh,
    ScatteredInstances,
    ScatterLayer,
    VisiblePoints,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    import moderngl

    from sketchterrain.array_types import Float64Array, Int64Array
    from sketchterrain.render.quality import Quality


KINDS: Final = ("meadow", "tall", "flower", "fern")
DETAILS: Final = 3  # levels of detail, 0 the finest
LEAF, PETAL, STALK = 0.0, 1.0, 2.0  # paint of a vertex: kernels/render/grass.vert.glsl

VERTEX: Final = np.dtype([("local_position", "<f4", 3), ("side", "<f4", 3), ("blade", "<f4", 3)])
"""Vertex attributes of grass.vert.glsl."""


class _Blade(NamedTuple):
    """One strip: base, lean, taper and paint."""

    base: Float64Array  # (2,) heights
    lean: Float64Array  # (2,) heights that its tip is off its base
    tall: float  # heights
    twist: float  # rad between its lean and its edge's normal
    width: float  # half widths
    tone: float
    paint: float = LEAF
    narrow: float = 1.3  # power by which it narrows towards its tip
    low: float = 0.0  # heights at which it starts


def tuft_mesh(kind: str, detail: int) -> CoverMesh:
    """Return the mesh of one of `KINDS`; `detail` 0 is the finest."""
    rng = np.random.default_rng([7, KINDS.index(kind)])
    steps = ((0.0, 0.36, 0.7, 1.0), (0.0, 0.55, 1.0), (0.0, 1.0))[detail]
    if kind == "meadow":
        blades = _tuft(rng, count=10) + _low_leaves(rng, count=6)
        if detail == DETAILS - 1:
            blades = [blade._replace(width=3.0 * blade.width) for blade in blades[::3]]
        strips = [_strip(blade, steps) for blade in blades]
    elif kind == "tall":
        blades = _tuft(rng, count=8, spread=0.16, lean=0.34) + _ears(rng, count=3)
        strips = [_strip(blade, steps) for blade in blades]
    elif kind == "flower":
        strips = _flower(rng, steps, petals=(8, 5, 4)[detail])
    else:
        strips = _fern(rng, fronds=(8, 7, 5)[detail], leaflets=(9, 5, 0)[detail])
    return _joined(strips)


def _tuft(rng: np.random.Generator, *, count: int, spread: float = 0.55, lean: float = 0.75) -> list[_Blade]:
    """Return blades that lean more the farther out they are; the first ones are spread around."""
    around = 2.0 * np.pi * (np.arange(count) * 0.618 + rng.uniform(-0.1, 0.1, count))
    out = spread * np.sqrt((np.arange(count) + 0.5) / count)
    blades = []
    for angle, away in zip(around, out, strict=True):
        base = away * np.array([np.cos(angle), np.sin(angle)])
        direction = angle + rng.normal(0.0, 0.7)
        bend = lean * rng.uniform(0.35, 1.25)
        tall = rng.uniform(0.55, 1.0)
        blades.append(
            _Blade(
                base,
                bend * tall * np.array([np.cos(direction), np.sin(direction)]),
                tall * (1.0 - 0.25 * min(bend, 1.0)),
                rng.normal(0.0, 0.5),
                rng.uniform(0.75, 1.25),
                rng.uniform(0.0, 1.0),
            )
        )
    return blades


def _low_leaves(rng: np.random.Generator, *, count: int) -> list[_Blade]:
    """Return broad leaves close to the ground that close the gaps of a tuft."""
    leaves = []
    for angle in 2.0 * np.pi * (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count:
        direction = np.array([np.cos(angle), np.sin(angle)])
        base = rng.uniform(0.05, 0.5) * direction[::-1]
        width, tone = rng.uniform(1.5, 2.3), rng.uniform(0.2, 1.0)
        leaves.append(
            _Blade(
                base, rng.uniform(0.35, 0.7) * direction, rng.uniform(0.18, 0.4), 0.0, width, tone, LEAF, 2.0
            )
        )
    return leaves


def _ears(rng: np.random.Generator, *, count: int) -> list[_Blade]:
    """Return stalks with an ear each."""
    strips = []
    for _ in range(count):
        base, lean = rng.normal(0.0, 0.08, 2), rng.normal(0.0, 0.14, 2)
        tall, tone = rng.uniform(1.0, 1.3), rng.uniform(0.0, 1.0)
        strips.append(_Blade(base, lean, tall, rng.uniform(0.0, 3.0), 0.45, tone, STALK, 0.1))
        top = base + lean
        strips.append(
            _Blade(top, 0.3 * lean, 0.22, rng.uniform(0.0, 3.0), 1.3, tone, STALK, 0.9, low=tall - 0.06)
        )
    return strips


class _Strip(NamedTuple):
    position: Float64Array  # (n, 3)
    side: Float64Array  # (n, 3)
    params: Float64Array  # (n, 3)
    triangles: Int64Array  # (m, 3)


def _strip(blade: _Blade, steps: tuple[float, ...]) -> _Strip:
    """Triangulate a blade: two vertices a step, one at its tip; its area does not depend on their number."""
    t = np.array(steps)
    bow = 0.2 + 0.3 * min(float(np.hypot(*blade.lean)), 1.0)
    position = np.column_stack(
        [blade.base + np.outer(t**1.8, blade.lean), blade.low + blade.tall * (t - bow * t**3) / (1.0 - bow)]
    )
    across = np.arctan2(blade.lean[1], blade.lean[0]) + np.pi / 2 + blade.twist
    edge = np.array([np.cos(across), np.sin(across), 0.0])
    fine = np.linspace(0.0, 1.0, 65)
    width = _width(blade, t) * (np.trapezoid(_width(blade, fine), fine) / np.trapezoid(_width(blade, t), t))
    count = len(t)
    rows = np.repeat(np.arange(count), 2)[:-1]
    sign = np.where(np.arange(len(rows)) % 2 == 0, -1.0, 1.0)
    side = edge * (sign * width[rows])[:, None]
    params = np.column_stack([t[rows], np.full(len(rows), blade.tone), np.full(len(rows), blade.paint)])
    first = np.arange(0, len(rows) - 3, 2)
    quads = np.concatenate(
        [np.column_stack([first, first + 1, first + 3]), np.column_stack([first, first + 3, first + 2])]
    )
    tip = len(rows) - 1
    triangles = np.concatenate([quads, [[tip - 2, tip - 1, tip]]])
    return _Strip(position[rows], side, params, triangles)


def _width(blade: _Blade, t: Float64Array) -> Float64Array:
    """Return a blade's width (half widths) at shares of its way up; leaves are widest above their foot."""
    full = 0.7 + 0.6 * np.minimum(t / 0.3, 1.0) if blade.narrow > 1.0 else 1.0
    return np.asarray(blade.width * (1.0 - t**blade.narrow) * full)


def _flower(rng: np.random.Generator, steps: tuple[float, ...], *, petals: int) -> list[_Strip]:
    """Return stems, each with a head of petals that faces up, and a few leaves at the foot."""
    strips = [_strip(blade, steps) for blade in _tuft(rng, count=4, spread=0.15, lean=0.4)]
    for k in range(3):
        base, lean = rng.normal(0.0, 0.22, 2), rng.normal(0.0, 0.10, 2)
        tall = (1.0, 0.82, 0.66)[k]
        stem = _Blade(base, lean, tall, 0.0, 0.35, rng.uniform(), STALK, 0.1)
        strips.append(_strip(stem, steps))
        top = np.array([*(base + lean), tall])
        strips.append(_head(top, np.array([*(0.8 * lean), 0.35]), petals, rng.uniform()))
    return strips


def _head(top: Float64Array, up: Float64Array, petals: int, tone: float) -> _Strip:
    """Return a shallow cone of petals whose size scales with the half width."""
    up = up / np.linalg.norm(up)
    first = np.cross(up, [0.0, 1.0, 0.0])
    first /= np.linalg.norm(first)
    second = np.cross(up, first)
    angle = 2.0 * np.pi * np.arange(2 * petals) / (2 * petals)
    out = np.where(np.arange(2 * petals) % 2 == 0, 4.2, 2.6)
    rim = out[:, None] * (np.outer(np.cos(angle), first) + np.outer(np.sin(angle), second) + 0.25 * up)
    side = np.concatenate([[[0.0, 0.0, 0.0]], rim])
    along = np.concatenate([[0.0], np.where(np.arange(2 * petals) % 2 == 0, 1.0, 0.55)])
    params = np.column_stack([along, np.full(len(along), tone), np.full(len(along), PETAL)])
    k = np.arange(2 * petals)
    triangles = np.column_stack([np.zeros_like(k), 1 + k, 1 + (k + 1) % (2 * petals)])
    return _Strip(np.tile(top, (len(side), 1)), side, params, triangles)


def _fern(rng: np.random.Generator, *, fronds: int, leaflets: int) -> list[_Strip]:
    """Return arching fronds of paired leaflets that shorten towards the tip."""
    strips = []
    for k in range(fronds):
        angle = 2.0 * np.pi * (k + rng.uniform(-0.25, 0.25)) / fronds
        out = np.array([np.cos(angle), np.sin(angle), 0.0])
        across = np.array([-out[1], out[0], 0.0])
        span, tall, tone = rng.uniform(0.8, 1.15), rng.uniform(0.75, 1.0), rng.uniform()
        if not leaflets:
            t = np.array([0.0, 0.5, 0.5, 1.0])
            sign = np.array([0.0, -1.0, 1.0, 0.0])
            position = _arch(t, out, span, tall) + np.outer(0.4 * sign, across)
            params = np.column_stack([t, np.full(4, tone), np.zeros(4)])
            strips.append(_Strip(position, np.zeros((4, 3)), params, np.array([[0, 1, 2], [1, 3, 2]])))
            continue
        t = np.asarray((np.arange(leaflets) + 0.8) / (leaflets + 0.3), np.float64)
        length = 0.34 * np.sin(np.pi * np.clip(0.12 + 0.86 * t, 0.0, 1.0)) + 0.02
        step = 0.5 / leaflets
        for left in (-1.0, 1.0):
            root = _arch(t - step, out, span, tall)
            end = _arch(t + step, out, span, tall)
            tip = _arch(t + 0.9 * step, out, span, tall) + (left * length)[:, None] * across
            tip[:, 2] -= 0.25 * length
            position = np.stack([root, end, tip], axis=1).reshape(-1, 3)
            along = np.stack([0.75 * t, 0.75 * t, t * 0.75 + 0.25], axis=1).ravel()
            params = np.column_stack([along, np.full(len(along), tone), np.zeros(len(along))])
            triangles = np.arange(len(position)).reshape(-1, 3)
            strips.append(_Strip(position, np.zeros_like(position), params, triangles))
    return strips


def _arch(t: Float64Array, out: Float64Array, span: float, tall: float) -> Float64Array:
    """Return points of a frond's middle line."""
    up = tall * np.sin(0.62 * np.pi * t) * (1.0 - 0.25 * t)
    return np.asarray(np.outer(span * t, out) + np.outer(up, [0.0, 0.0, 1.0]))


def _joined(strips: list[_Strip]) -> CoverMesh:
    starts = np.cumsum([0] + [len(strip.position) for strip in strips])
    vertices = np.empty(starts[-1], VERTEX)
    for start, strip in zip(starts, strips, strict=False):
        part = vertices[start : start + len(strip.position)]
        part["local_position"], part["side"], part["blade"] = strip.position, strip.side, strip.params
    triangles = [strip.triangles + start for start, strip in zip(starts, strips, strict=False)]
    return CoverMesh(vertices, np.concatenate(triangles).astype(np.uint32))


LAYERS: Final = {
    "meadow": ScatterLayer(101, 83.5, 4.2, 110.0, 3.0, (4.5, 18.0)),
    "tall": ScatterLayer(202, 7.0, 12.0, 80.0, 6.0, (6.0, 22.0)),
    "flower": ScatterLayer(303, 4.5, 18.0, 80.0, 6.0, (5.0, 14.0)),
    "fern": ScatterLayer(404, 1.6, 22.0, 100.0, 8.0, (8.0, 26.0)),
}
"""At the best quality."""
CAPTURED: Final = ("foot_height", "turn", "albedo", "ground", "sky", "under", "veil")
"""Outputs of grass_plant.vert.glsl."""


def grass_layers(
    context: moderngl.Context, *, quality: Quality, defines: Mapping[str, int | str]
) -> Iterator[CoverLayer]:
    """Yield the ground plants around an eye, kind by kind."""
    for number, kind in enumerate(KINDS):
        own = {**defines, "KIND": number}
        layer = LAYERS[kind].scaled(quality.grass_distance, share=quality.ground_cover_density)
        yield CoverLayer(
            VisiblePoints(layer),
            ScatteredInstances(
                context,
                [tuft_mesh(kind, detail) for detail in range(DETAILS)],
                transform=build_program(context, "grass_plant.vert.glsl", captured=CAPTURED, defines=own),
                captured=CAPTURED,
                program=build_program(context, "grass.vert.glsl", "lit.frag.glsl", defines=own),
            ),
            {"scatter_layer": layer.uniform, "spread": 1.0 / quality.ground_cover_density},
        )
