"""Rivers as strips of water, lakes as sheets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sketchterrain.render.programs import build_program, set_uniforms

if TYPE_CHECKING:
    from collections.abc import Mapping

    import moderngl
    import numpy.typing as npt

    from sketchterrain.render.scene import Features, Field

    Floats = npt.NDArray[np.float64]

__all__ = ["Surface", "Water", "sheet", "strip"]

ACROSS: Final = 9
"""Vertices from bank to bank."""
OVERLAP: Final = 1.7
"""Width of the strip in widths of the water, so that it ends inside the banks."""
SHEET_CELLS: Final = 400
"""Quads along a lake's longer side, at most."""
WIND: Final = (0.6, 0.8)
"""Unit vector in which waves run on lakes."""


class Surface(NamedTuple):
    """A water's surface as triangles.

    Attributes
    ----------
    place : (n, 3) float64
        World coordinates, m.
    course : (n, 4) float64
        m across and along, unit vector downstream.
    inside : (n,) float64
        m from the shore, negative in the bank.
    triangles : (k,) uint32
        Indices, three a triangle, counter-clockwise from above.
    """

    place: Floats
    course: Floats
    inside: Floats
    triangles: npt.NDArray[np.uint32]


class Water:
    """The surfaces of all rivers and lakes, as one list of triangles."""

    def __init__(
        self, context: moderngl.Context, features: Features, *, defines: Mapping[str, int] | None = None
    ) -> None:
        parts = [
            strip(river.centreline, river.centreline_width)
            for river in features.rivers
            if len(river.centreline) > 1
        ]
        parts += [sheet(lake.shape, lake.level) for lake in features.lakes]
        self._array = None
        if not parts:
            return
        self._anchor = parts[0].place[0].copy()
        vertices, indices, base = [], [], 0
        for place, course, inside, triangles in parts:
            shore = np.stack([inside, np.full(len(inside), max(-inside.min(), 0.0))], axis=1)
            vertices.append(np.concatenate([place - self._anchor, course, shore], axis=1).astype(np.float32))
            indices.append(triangles + np.uint32(base))
            base += len(place)
        buffer = context.buffer(np.concatenate(vertices).tobytes())
        program = build_program(context, "water.vert.glsl", "water.frag.glsl", defines=defines)
        self._array = context.vertex_array(
            program,
            [(buffer, "3f4 4f4 2f4", "place", "course", "shore")],
            index_buffer=context.buffer(np.concatenate(indices).tobytes()),
        )

    def __bool__(self) -> bool:
        return self._array is not None

    def draw(self, eye: tuple[float, float, float], uniforms: Mapping[str, object]) -> None:
        """Draw the water as seen from `eye`; uniform ``scene`` must hold what was drawn before."""
        if self._array is not None:
            anchor = tuple(self._anchor - np.asarray(eye))
            set_uniforms(self._array.program, {**uniforms, "anchor": anchor})
            self._array.render()


def strip(centreline: Floats, width: npt.NDArray[np.float32]) -> Surface:
    """Widen a centreline to a strip of triangles.

    Parameters
    ----------
    centreline
        (m, 3) x, y, z in m, downstream, m ≥ 2.
    width
        (m,) of the water, m.

    Returns
    -------
    Surface
        With m · ACROSS vertices.
    """
    flat = centreline[:, :2]
    gone = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(flat, axis=0).T))])
    downstream = np.gradient(flat, axis=0)
    downstream /= np.maximum(np.linalg.norm(downstream, axis=1, keepdims=True), 1e-9)
    to_right = np.stack([downstream[:, 1], -downstream[:, 0]], axis=1)
    across = np.linspace(-0.5, 0.5, ACROSS)[None, :] * (OVERLAP * width.astype(np.float64) + 1.0)[:, None]
    place = np.empty((len(flat), ACROSS, 3))
    place[..., :2] = flat[:, None, :] + across[..., None] * to_right[:, None, :]
    place[..., 2] = centreline[:, 2:3]
    course = np.empty((len(flat), ACROSS, 4))
    course[..., 0] = across
    course[..., 1] = gone[:, None]
    course[..., 2:] = downstream[:, None, :]
    index = np.arange(len(flat) * ACROSS, dtype=np.uint32).reshape(len(flat), ACROSS)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    triangles = np.stack([a, b, d, a, d, c], axis=-1).reshape(-1)
    inside = 0.5 * width.astype(np.float64)[:, None] - np.abs(across)
    return Surface(place.reshape(-1, 3), course.reshape(-1, 4), inside.ravel(), triangles)


def sheet(shape: Field, level: float) -> Surface:
    """Cover a lake with a flat grid that ends inside its banks.

    Parameters
    ----------
    shape
        Where the lake is.
    level
        Height of the water, m.

    Returns
    -------
    Surface
        Across and along are those of the wind.
    """
    rows, columns = shape.inside.shape
    step = -(-max(rows, columns) // SHEET_CELLS)
    # The last row and column once more, so that a coarse grid reaches the rim.
    row = np.minimum(np.arange(0, rows + step - 1, step), rows - 1)
    column = np.minimum(np.arange(0, columns + step - 1, step), columns - 1)
    inside = shape.inside[np.ix_(row, column)]
    x, y = np.meshgrid(column * shape.spacing, row * shape.spacing)
    place = np.stack([x + shape.west, y + shape.south, np.full(x.shape, level)], axis=-1)
    course = np.empty((*x.shape, 4))
    course[..., 0] = x * WIND[1] - y * WIND[0]
    course[..., 1] = x * WIND[0] + y * WIND[1]
    course[..., 2:] = WIND
    index = np.arange(x.size, dtype=np.uint32).reshape(x.shape)
    sw, se, nw, ne = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    wet = np.maximum.reduce([inside[:-1, :-1], inside[:-1, 1:], inside[1:, :-1], inside[1:, 1:]])
    quads = np.stack([sw, se, ne, sw, ne, nw], axis=-1)[wet > -0.25 * shape.spacing]
    used, triangles = np.unique(quads, return_inverse=True)
    return Surface(
        place.reshape(-1, 3)[used],
        course.reshape(-1, 4)[used],
        inside.ravel()[used].astype(np.float64),
        triangles.ravel().astype(np.uint32),
    )
