"""Instances scattered around the eye."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, NamedTuple

import moderngl
import numpy as np

from sketchterrain.render.programs import set_uniforms
from sketchterrain.render.vertex_memory import COMMAND

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import numpy.typing as npt

    from sketchterrain.array_types import Float64Array
    from sketchterrain.render.camera import Camera


BAND: Final = 0.3
"""Over this share of the number of places shown at a distance the last ones come up; as in scatter.glsl."""
STEEPEST: Final = 1.5
"""Rise over run of the ground between an eye and what stands near it."""
HIGHEST: Final = 1.0
"""m that what stands in a cell is high."""
BEST_REACH: Final = 110.0
"""m, of the grass at the best quality; all other distances go with it."""
SEED: Final = np.dtype([("corner", "<f4", 2), ("seed", "<u4"), ("rank", "<u4")])
"""A place: its cell's corner from the eye (m), its cell's hash, and its place in the cell's order."""


@dataclass(frozen=True)
class Strewing:
    """How densely something is strewn.

    Attributes
    ----------
    salt : int
        Sets its places apart from those of other things.
    density : float
        Places a m², near the eye.
    full : float
        m from the eye up to which all places are taken; beyond, as many as the distance's inverse asks for.
    reach : float
        m from the eye at which the last are gone.
    cell : float
        m, side of a cell.
    details : tuple of float
        m from the eye at which each coarser mesh takes over, nearest first.
    """

    salt: int
    density: float
    full: float
    reach: float
    cell: float
    details: tuple[float, ...]

    @property
    def room(self) -> int:
        """Places a cell has at most."""
        return max(round(self.density * self.cell**2), 1)

    def as_far(self, grass: float, *, share: float) -> Strewing:
        """Return a share of it, scaled to where grass reaches so far (m) instead of `BEST_REACH`."""
        scale = grass / BEST_REACH
        return replace(
            self,
            density=self.density * share,
            reach=self.reach * scale,
            details=tuple(scale * each for each in self.details),
        )


class Places(NamedTuple):
    """Places of some cells, by the detail in which they are drawn.

    Attributes
    ----------
    rows : (n,) of SEED
        Nearest cells first.
    counts : (details,) int64
        How many of them belong to each detail, in this order.
    """

    rows: npt.NDArray[np.void]
    counts: npt.NDArray[np.int64]


def hashed(x: npt.ArrayLike) -> npt.NDArray[np.uint32]:
    """Scramble 32 bits (Wellons' lowbias32); the same in kernels/render/scatter.glsl."""
    h = np.asarray(x, dtype=np.uint32)
    for shift, factor in ((16, 0x7FEB352D), (15, 0x846CA68B), (16, 1)):
        h = (h ^ (h >> np.uint32(shift))) * np.uint32(factor)
    return np.asarray(h, dtype=np.uint32)


def cells_within(eye: Sequence[float], reach: float, cell: float) -> npt.NDArray[np.int64]:
    """Return (n, 2) columns and rows of the cells that lie within a distance (m) of an eye, nearest first."""
    low, high = (np.floor((np.asarray(eye[:2]) + side * reach) / cell) for side in (-1.0, 1.0))
    cols, rows = np.meshgrid(*(np.arange(low[k], high[k] + 1) for k in range(2)))
    cells = np.stack([cols.ravel(), rows.ravel()], axis=1).astype(np.int64)
    away = away_from(eye, cells, cell)
    order = np.argsort(away, kind="stable")
    return cells[order[away[order] < reach]]


def away_from(eye: Sequence[float], cells: npt.NDArray[np.int64], cell: float) -> Float64Array:
    """Return the horizontal distance (m) of cells' nearest points from an eye."""
    beside = np.maximum(np.abs(cell * (cells + 0.5) - np.asarray(eye[:2])) - 0.5 * cell, 0.0)
    return np.asarray(np.hypot(beside[:, 0], beside[:, 1]))


def in_sight(
    planes: Float64Array, cells: npt.NDArray[np.int64], cell: float, eye: Sequence[float], above: float
) -> npt.NDArray[np.bool_]:
    """Tell which cells a view may show, where the ground is no steeper than `STEEPEST` on the way there.

    Parameters
    ----------
    planes
        (k, 4) of the view, see `Camera.frustum`.
    cells
        (n, 2) columns and rows.
    cell
        m, their side.
    eye
        m.
    above
        m of the eye over the ground.
    """
    off = STEEPEST * (away_from(eye, cells, cell) + 1.5 * cell)
    foot = eye[2] - above
    low = np.column_stack([cells * cell, foot - off])
    high = np.column_stack([(cells + 1) * cell, foot + off + HIGHEST])
    seen = np.ones(len(cells), np.bool_)
    for plane in planes:
        seen &= np.where(plane[:3] >= 0.0, high, low) @ plane[:3] + plane[3] >= 0.0
    return seen


def places_of(strewing: Strewing, cells: npt.NDArray[np.int64], eye: Sequence[float], above: float) -> Places:
    """Return the places of some cells that an eye may need.

    Parameters
    ----------
    strewing
        What is strewn.
    cells
        (n, 2) columns and rows, nearest first.
    eye
        m.
    above
        m of the eye over the ground: nothing is nearer than that.
    """
    away = np.hypot(away_from(eye, cells, strewing.cell), above)
    shown = strewing.room * np.minimum((1.0 + BAND) * strewing.full / np.maximum(away, strewing.full), 1.0)
    many = np.where(away < strewing.reach, np.ceil(shown), 0.0).astype(np.int64)
    detail = np.searchsorted(strewing.details, away, side="right")
    counts = np.bincount(detail, many, minlength=len(strewing.details) + 1).astype(np.int64)
    ends = np.cumsum(many)
    rows = np.empty(int(ends[-1]) if len(ends) else 0, SEED)
    corner = strewing.cell * cells - np.asarray(eye[:2])
    salted = hashed(cells[:, 1].astype(np.uint32) ^ np.uint32(strewing.salt))
    seeds = hashed(cells[:, 0].astype(np.uint32) ^ salted)
    rows["corner"] = np.repeat(corner, many, axis=0)
    rows["seed"] = np.repeat(seeds, many)
    rows["rank"] = np.arange(len(rows)) - np.repeat(ends - many, many)
    return Places(rows, counts)


class Nearby:
    """The places of a strewing that a view needs: found anew only where it is not the view before.

    Parameters
    ----------
    strewing
        What is strewn.
    sort
        Puts its places into the order in which they are drawn.
    """

    def __init__(self, strewing: Strewing, *, sort: Callable[[Places], Places] | None = None) -> None:
        self._strewing, self._sort = strewing, sort
        self._view: tuple[Camera, float, float] | None = None
        self._places = Places(np.zeros(0, SEED), np.zeros(len(strewing.details) + 1, np.int64))

    def seen(self, camera: Camera, aspect: float, above: float) -> Places:
        """Return the places in a picture of this width over height, by an eye so high (m) over the ground."""
        if self._view != (camera, aspect, above):
            self._view = (camera, aspect, above)
            strewing, eye = self._strewing, camera.eye
            cells = cells_within(eye, strewing.reach, strewing.cell)
            cells = cells[in_sight(camera.frustum(aspect), cells, strewing.cell, eye, above)]
            places = places_of(strewing, cells, eye, above)
            self._places = self._sort(places) if self._sort else places
        return self._places


VECTOR: Final = 4 * 4
"""Bytes of each vector that is captured."""


class Mesh(NamedTuple):
    """Vertices and triangles.

    Attributes
    ----------
    vertices : (n,) structured
        Of vectors of float32.
    triangles : (m, 3) uint32
    """

    vertices: npt.NDArray[np.void]
    triangles: npt.NDArray[np.uint32]


class Strewn:
    """Meshes, the things that stand at places now, and the programs that find them out and draw them.

    Parameters
    ----------
    context
        Where they are drawn.
    meshes
        With vertices of one type.
    finding
        Asks what is at a place, from ``corner`` and ``seed`` (`SEED`).
    found
        Names of its outputs, each of four floats.
    drawing
        Draws a mesh's vertices by them.

    Attributes
    ----------
    found : moderngl.Buffer
        What was found last, a thing after the other.
    """

    def __init__(
        self,
        context: moderngl.Context,
        meshes: Sequence[Mesh],
        *,
        finding: moderngl.Program,
        found: Sequence[str],
        drawing: moderngl.Program,
    ) -> None:
        self._sizes = np.array([mesh.triangles.size for mesh in meshes])
        many = np.array([len(mesh.vertices) for mesh in meshes])
        self._commands = np.zeros(len(meshes), COMMAND)
        self._commands["count"], self._commands["first"] = self._sizes, np.cumsum(self._sizes) - self._sizes
        self._commands["base_vertex"] = np.cumsum(many) - many
        self._finding, self._drawing = finding, drawing
        self._bytes = VECTOR * len(found)
        self._seeds = context.buffer(reserve=SEED.itemsize, dynamic=True)
        self.found = context.buffer(reserve=self._bytes, dynamic=True)
        self._orders = context.buffer(reserve=self._commands.nbytes, dynamic=True)
        self._asked = context.vertex_array(finding, [(self._seeds, "2f4 2u4", "corner", "seed")])
        vertices = np.concatenate([mesh.vertices for mesh in meshes])
        names = vertices.dtype.names or ()
        form = " ".join(f"{vertices.dtype[name].shape[0]}f4" for name in names)
        self._array = context.vertex_array(
            drawing,
            [
                (context.buffer(vertices.tobytes()), form, *names),
                (self.found, " ".join(["4f4"] * len(found)) + "/i", *found),
            ],
            index_buffer=context.buffer(
                np.concatenate([mesh.triangles.ravel() for mesh in meshes]).tobytes()
            ),
        )

    def find_out(self, places: Places, uniforms: Mapping[str, object]) -> None:
        """Ask what is at some places, at least one, in the order of their meshes."""
        many = len(places.rows)
        for buffer, size in ((self._seeds, SEED.itemsize), (self.found, self._bytes)):
            if buffer.size < size * many:
                buffer.orphan(size * max(many, 2 * (buffer.size // size)))
        self._seeds.write(places.rows.tobytes())
        set_uniforms(self._finding, uniforms)
        self._asked.transform(self.found, moderngl.POINTS, vertices=many)

    def draw(self, places: Places, uniforms: Mapping[str, object]) -> None:
        """Draw what was found at them."""
        commands = self._commands.copy()
        commands["instances"] = places.counts
        commands["base_instance"] = np.cumsum(places.counts) - places.counts
        commands = commands[commands["instances"] > 0]
        self._orders.write(commands.tobytes())
        set_uniforms(self._drawing, uniforms)
        self._array.render_indirect(self._orders, moderngl.TRIANGLES, count=len(commands))

    def triangles(self, places: Places) -> int:
        """Return how many triangles are drawn at places."""
        return int((places.counts * self._sizes).sum()) // 3
