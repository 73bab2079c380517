"""Draping by lists of parts that each pixel of the ground reads: a rival of the ways in `render.draped`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Int64Array
from sketchterrain.drape.drapes import Drapes
from sketchterrain.io.resources import source
from sketchterrain.render.draped import SCREEN_METHODS
from sketchterrain.render.draped_buffer import DrapedBuffer
from sketchterrain.render.draped_cutting import IS_FILL, Pieces, cells_met
from sketchterrain.render.draped_geometry import DrapedView, hatch_angles, reaches, style_table
from sketchterrain.render.programs import FRAME_BINDING, set_uniforms
from sketchterrain.render.targets import RenderTargets

if TYPE_CHECKING:
    from collections.abc import Sequence

NAME: Final = "lookup"
LEVELS: Final = 10
CELLS: Final = 32  # along the side of a level's grid
LEAST: Final = 2.0  # m, width of the finest cells
SNAP: Final = 4  # cells by which grids move
GRAZING: Final = 5.0  # lengths of a pixel's ground over its width, for which lists have room


class _Lists(NamedTuple):
    """Pieces of a level, and lists of its cells."""

    pieces: npt.NDArray[np.float32]  # (n, 8)
    parts: npt.NDArray[np.void]
    cell: Int64Array  # (k,) ascending
    number: Int64Array  # (k,) of pieces


class LookupDraping:
    """Draws vectors by per-pixel lists on grids around the eye, each twice as wide as the one inside it."""

    def __init__(self, context: Any, *, samples: int) -> None:
        macros = (("LEVELS", LEVELS), ("CELLS", CELLS), ("SAMPLES", samples))
        program = context.program(
            vertex_shader=source("render/screen.vert.glsl"),
            fragment_shader=source("baselines/draped_lookup.frag.glsl", macros),
        )
        program["Frame"].binding = FRAME_BINDING
        self._pass = context.vertex_array(program, [])
        self._context = context
        self._levels: dict[int, tuple[object, _Lists]] = {}
        self._buffers: list[Any] = []
        self._state: object = None
        self.is_loaded = True

    @property
    def nbytes(self) -> int:
        """Bytes of buffers and lists."""
        lists = sum(each.nbytes for _, found in self._levels.values() for each in found)
        return lists + sum(int(buffer.size) for buffer in self._buffers)

    def draw(
        self, drapes: Drapes, view: DrapedView, targets: RenderTargets, buffer: DrapedBuffer, *, moving: bool
    ) -> None:
        """Draw all vectors."""
        corners = [self._update(level, drapes, view) for level in range(LEVELS)]
        state = tuple(id(found) for _, found in self._levels.values())
        if state != self._state:
            self._upload([found for _, found in self._levels.values()], drapes)
            self._state = state
        for binding, each in zip((2, 3, 4, 5, 6), self._buffers, strict=True):
            each.bind_to_storage_buffer(binding)
        targets.depth.use(1)
        targets.textures["gbuffer_normal"].use(2)  # type: ignore[union-attr] # one texture
        rows = [(x - view.camera.eye[0], y - view.camera.eye[1], cell) for x, y, cell in corners]
        set_uniforms(self._pass.program, {"ground_depth": 1, "ground_normal": 2, "levels": rows})
        self._pass.render(vertices=3)

    def _update(self, level: int, drapes: Drapes, view: DrapedView) -> tuple[float, float, float]:
        """List the pieces of a level's cells where the eye has left its place; return corner and cell (m)."""
        cell = LEAST * 2.0**level
        step = SNAP * cell
        x, y = (float(np.floor(axis / step) * step - 0.5 * CELLS * cell) for axis in view.camera.eye[:2])
        texel = 2.0 ** np.ceil(np.log2(view.pixel * max(CELLS * cell, abs(view.camera.eye[2]))))
        state = (drapes, x, y, texel)
        if level not in self._levels or self._levels[level][0] != state:
            self._levels[level] = state, _lists_of(drapes, (x, y, cell), texel)
        return x, y, cell

    def _upload(self, levels: Sequence[_Lists], drapes: Drapes) -> None:
        first = np.cumsum([0, *(len(each.parts) for each in levels)])
        cell = np.concatenate([each.cell + k * CELLS**2 for k, each in enumerate(levels)])
        listed = np.concatenate([each.number + first[k] for k, each in enumerate(levels)])
        ends = np.searchsorted(cell, np.arange(LEVELS * CELLS**2 + 1)).astype(np.uint32)
        ranges = np.stack([ends[:-1], np.diff(ends)], axis=1)
        content = (
            np.concatenate([each.parts for each in levels]),
            style_table(drapes.styles),
            ranges,
            listed.astype(np.uint32),
            np.concatenate([each.pieces for each in levels]),
        )
        self._buffers = [self._context.buffer(each.tobytes() or bytes(16)) for each in content]


def _lists_of(drapes: Drapes, place: tuple[float, float, float], texel: float) -> _Lists:
    west, south, cell = place
    box = (west, south, west + CELLS * cell, south + CELLS * cell)
    items = drapes.items(box, 0.25 * texel)
    styles = drapes.styles
    found = Pieces.of_items(items, reaches(styles, texel, GRAZING * texel), hatch_angles(styles))
    corners = found.corners - [west, south]
    is_fill = (found.parts["flags"].astype(np.int64) & IS_FILL) > 0
    pieces = np.zeros((len(is_fill), 8), np.float32)
    pieces[:, :4] = np.where(
        is_fill[:, None], corners[:, :2].reshape(-1, 4), found.frame - [west, south, 0.0, 0.0]
    )
    pieces[:, 4:6] = corners[:, 2]
    parts = found.parts
    goes_on = (np.diff(parts["style"]) == 0) & (np.diff(is_fill) == 0)
    goes_on &= is_fill[1:] | (np.abs(parts["along"][:-1] + parts["length"][:-1] - parts["along"][1:]) < 1e-3)
    pieces[:, 6] = np.cumsum(np.append(True, ~goes_on))[: len(pieces)]
    border = np.where(is_fill, GRAZING * texel, 0.0) / cell
    cells, number = cells_met(corners / cell, found.counts, border, CELLS)
    order = np.argsort(cells, kind="stable")
    return _Lists(pieces, parts, cells[order], number[order])


def register() -> None:
    """Make the method known to the renderer."""
    SCREEN_METHODS[NAME] = lambda context, _stream, _lit, quality: LookupDraping(
        context, samples=quality.samples
    )
