"""Rivers as strips of water, lakes as sheets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.render.programs import build_program, set_uniforms

if TYPE_CHECKING:
    import moderngl
    import numpy.typing as npt

    from sketchterrain.render.ground import DrawnGround
    from sketchterrain.render.scene import Features, Field

    Floats = npt.NDArray[np.float64]

__all__ = ["Water", "sheet", "strip"]

ACROSS: Final = 9
"""Vertices from bank to bank."""
OVERLAP: Final = 1.7
"""Width of the strip in widths of the water, so that it ends inside the banks."""
SHEET_CELLS: Final = 400
"""Quads along a lake's longer side, at most."""
WIND: Final = (0.6, 0.8)
"""Unit vector in which waves run on lakes."""


class Water:
    """The surfaces of all rivers and lakes, as one list of triangles."""

    def __init__(self, context: moderngl.Context, features: Features, ground: DrawnGround) -> None:
        parts = [
            strip(_on_ground(river.centreline, river.centreline_width, ground), river.centreline_width)
            for river in features.rivers
            if len(river.centreline) > 1
        ]
        for lake in features.lakes:
            place, course, triangles = sheet(lake.shape, lake.level)
            width = np.full(len(place), 2.0 * lake.shape.inside.max(), np.float32)
            parts.append((_on_ground(place, width, ground), course, triangles))
        self._array = None
        if not parts:
            return
        self._anchor = parts[0][0][0].copy()
        vertices, indices, base = [], [], 0
        for place, course, triangles in parts:
            vertices.append(np.concatenate([place - self._anchor, course], axis=1).astype(np.float32))
            indices.append(triangles + np.uint32(base))
            base += len(place)
        program = build_program(context, "water.vert.glsl", "water.frag.glsl")
        self._array = context.vertex_array(
            program,
            [(context.buffer(np.concatenate(vertices).tobytes()), "3f4 4f4", "place", "course")],
            index_buffer=context.buffer(np.concatenate(indices).tobytes()),
        )

    def __bool__(self) -> bool:
        return self._array is not None

    def set_uniforms(self, values: dict[str, object]) -> None:
        """Set uniforms of the water's program."""
        if self._array is not None:
            set_uniforms(self._array.program, values)

    def draw(self, eye: tuple[float, float, float]) -> None:
        """Draw the water as seen from `eye`; uniform ``scene`` must hold what was drawn before."""
        if self._array is not None:
            self.set_uniforms({"anchor": tuple(self._anchor - np.asarray(eye))})
            self._array.render()


def strip(
    centreline: Floats, width: npt.NDArray[np.float32]
) -> tuple[Floats, Floats, npt.NDArray[np.uint32]]:
    """Widen a centreline to a strip of triangles.

    Parameters
    ----------
    centreline
        (m, 3) x, y, z in m, downstream, m ≥ 2.
    width
        (m,) of the water, m.

    Returns
    -------
    place : (m · ACROSS, 3) float64
        World coordinates, m.
    course : (m · ACROSS, 4) float64
        m across and along, unit vector downstream.
    triangles : (k,) uint32
        Indices, three a triangle, counter-clockwise from above.
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
    return place.reshape(-1, 3), course.reshape(-1, 4), triangles


def sheet(shape: Field, level: float) -> tuple[Floats, Floats, npt.NDArray[np.uint32]]:
    """Cover a lake with a flat grid that ends inside its banks.

    Parameters
    ----------
    shape
        Where the lake is.
    level
        Height of the water, m.

    Returns
    -------
    place, course, triangles
        As of :func:`strip`; across and along are those of the wind.
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
    return place.reshape(-1, 3)[used], course.reshape(-1, 4)[used], triangles.ravel().astype(np.uint32)


def _on_ground(centreline: Floats, width: npt.NDArray[np.float32], ground: DrawnGround) -> Floats:
    """Lift the water onto the drawn ground where that is too coarse to show the river's bed."""
    height, cell = ground.surface(centreline[:, 0], centreline[:, 1])
    lifted = centreline.copy()
    coarse = np.isfinite(height) & (cell > width / 3.0)
    lifted[coarse, 2] = np.maximum(lifted[coarse, 2], height[coarse] + 0.04 * cell[coarse])
    return lifted
