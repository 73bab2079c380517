"""Frames of the 3-D view: shared memory for their pixels, and the schedule of drawing them."""

from __future__ import annotations

import contextlib
import mmap
import os
import sys
import tempfile
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from sketchterrain.ui.engine.protocol import FrameFacts, FrameReady, SetDrapes, ViewState

if TYPE_CHECKING:
    from sketchterrain.array_types import Bounds
    from sketchterrain.render.quality import FrameStats
    from sketchterrain.render.scene import TerrainSource
    from sketchterrain.ui.engine.camera_controller import CameraController
    from sketchterrain.ui.engine.view_renderer import ViewRenderer

SLOTS: Final = 2  # frames that the shared memory holds
_GRAIN: Final = 1 << 20  # bytes; sizes are rounded up to it, so that resizing the window rarely reallocates


class FrameMemory:
    """An anonymous shared-memory file, freed with the last process that has it open."""

    def __init__(self, number: int | None = None) -> None:
        self.number = _anonymous_file() if number is None else number  # file descriptor
        self._map: mmap.mmap | None = None

    def allocate(self, slot: int, nbytes: int) -> tuple[int, int]:
        """Ensure room for frames of a size; return the slot's first byte, and the memory's size."""
        each = -(-nbytes // _GRAIN) * _GRAIN
        capacity = SLOTS * each
        if os.fstat(self.number).st_size < capacity:
            os.ftruncate(self.number, capacity)
        return slot * each, os.fstat(self.number).st_size

    def view(self, start: int, nbytes: int, capacity: int) -> memoryview:
        """Map the memory (`capacity` bytes) and return a part of it; it must be released after use."""
        if self._map is None or len(self._map) < capacity:
            self._unmap()
            self._map = mmap.mmap(self.number, capacity)
        return memoryview(self._map)[start : start + nbytes]

    def close(self) -> None:
        """Free the memory; no view may be in use."""
        self._unmap()
        os.close(self.number)

    def _unmap(self) -> None:
        if self._map is not None:
            self._map.close()
            self._map = None


def _anonymous_file() -> int:
    if sys.platform == "linux":
        return os.memfd_create("frames")
    else:  # noqa: RET505 # mypy narrows platforms only by branches
        with tempfile.TemporaryFile() as file:
            return os.dup(file.fileno())


_FRAME_TIME: Final = 1.0 / 60.0  # least s between frames
_ANIMATION_TIME: Final = 0.1  # … with a software renderer, while only water, plants and clouds move
_SOFTWARE_FACTOR: Final = 2.0  # … and at least this times the last frame's duration: half the CPU is free
_LONGEST_STEP: Final = 0.1  # s by which a frame advances camera and clock at most: no jump after a pause
# Longer than `renderer.REST`, so that the second frame has full size.
_REST_INTERVAL: Final = 0.26  # s between frames at rest, while a software renderer loads what they lack …
_LOAD: Final = 0.035  # … for so many s at a time
_JUMP: Final = 0.3  # s for what the first frame of another place shows
_PROGRESS: Final = 1.0  # s at rest for which frames show what is loaded, before the still starts
_HASTE: Final = 1.0  # s for which frames are small lest they delay a pending terrain
_HOLD: Final = (0.3, 0.6)  # s for which refinement, and animation, wait for a pending terrain


class FramePacer:
    """Draws frames while something moves or is out of date, and hands them to the window."""

    def __init__(self, renderer: ViewRenderer, memory: FrameMemory, *, used_bytes: Callable[[], int]) -> None:
        self.renderer = renderer
        self.failed = False
        self._memory, self._used_bytes = memory, used_bytes
        self._view = ViewState()
        self._version = -1
        self._in_flight = 0
        self._slot, self._size = 0, (0, 0)
        self._drawn_at = self._advanced_at = self._moved_at = 0.0
        self._budget: float | None = None  # s of the next frame for what it shows; None: the quality's
        self._duration = 0.0
        self.clock = 0.0  # s that water, plants and clouds have moved
        self._stale = True
        self._converged = False
        self._loaded = False  # nothing that a view at rest shows is missing …
        self._shows_all = False  # … and the last frame shows it
        self._settled = False  # the last frame is a still of the best quality
        self._stats: FrameStats | None = None  # of the last frame in motion
        self._pending_since: float | None = None

    def set_view(self, view: ViewState) -> None:
        self.renderer.set_view(view)
        self._view, self._stale, self.failed = view, True, False

    def set_terrain(
        self, terrain: TerrainSource, version: int, areas: list[Bounds], camera: CameraController
    ) -> str:
        """Display a terrain that differs from the previous one in areas (m); return a warning or nothing."""
        self.failed = False
        self._stale, self._version = True, version
        return self.renderer.set_terrain(terrain, areas, camera.camera())

    def set_drapes(self, drapes: SetDrapes) -> None:
        """Display other draped layers from the next frame on."""
        self._stale = True
        self.renderer.set_drapes(drapes)

    def set_update_pending(self, pending: bool) -> None:
        """Note whether another terrain is being placed."""
        self._pending_since = time.monotonic() if pending else None

    def jump(self) -> None:
        """Take longer for the next frame, since it shows another place."""
        self._budget = _JUMP

    def acknowledge_frame(self) -> None:
        """Free the slot of a frame that the window has displayed."""
        self._in_flight = max(self._in_flight - 1, 0)

    def stop(self) -> None:
        """Free the renderer after an error; the next terrain or view starts it again."""
        self.failed = True
        with contextlib.suppress(Exception):  # after an error releasing may fail too
            self.renderer.clear()

    @property
    def _refines(self) -> bool:
        """Whether a view at rest is drawn again at the best quality, and then stands still."""
        still = self.renderer.is_software or not self._view.plays
        return still and self._view.refines and self.renderer.can_refine

    @property
    def _draws_still(self) -> bool:
        """Whether the still is due, or loading what the next motion shows once the still is there."""
        shows_shape = self._stats is not None and self._stats.complete
        rests = self.renderer.is_software and time.monotonic() - self._moved_at > _PROGRESS
        return self._refines and (self._converged or self._shows_all or (shows_shape and rests))

    def due(self, *, moving: bool) -> float | None:
        """Return the s until the next frame; None: nothing to draw."""
        visible = self._view.width > 0 and self._view.height > 0
        if self.failed or not visible or self._in_flight >= SLOTS or self._version < 0:
            return None
        now = time.monotonic()
        since = now - self._drawn_at
        if moving:
            return max(_FRAME_TIME - since, 0.0)
        polite = _SOFTWARE_FACTOR * self._duration if self.renderer.is_software else _FRAME_TIME
        if self._stale:  # placing a pending terrain goes before drawing
            return max((_FRAME_TIME if self._pending_since is None else polite) - since, 0.0)
        waited = _HOLD[1] if self._pending_since is None else now - self._pending_since
        if self._draws_still:
            finished = self._settled and (self._loaded or self._converged)
            return None if finished else max(_HOLD[0] - waited, 0.0)
        if not self._converged:
            return max(0.0 if self._loads else _FRAME_TIME - since, _HOLD[0] - waited, 0.0)
        if not self._view.plays:
            return None
        interval = max(_ANIMATION_TIME, polite) if self.renderer.is_software else _FRAME_TIME
        return max(interval - since, _HOLD[1] - waited, 0.0)

    @property
    def _loads(self) -> bool:
        """Whether a view at rest loads what it lacks instead of drawing the next frame."""
        recent = time.monotonic() - self._drawn_at < _REST_INTERVAL
        return recent and self.renderer.is_software and not (self._converged or self._loaded)

    def draw(self, controller: CameraController) -> FrameReady | None:
        """Draw a frame unless it would equal the last one; return its place in shared memory."""
        now = time.monotonic()
        elapsed = min(now - self._advanced_at, _LONGEST_STEP)
        self._advanced_at = now
        moved = controller.advance(elapsed)
        plays, at_rest = self._view.plays, not (moved or self._stale)
        if at_rest and self._converged and (self._settled or not (plays or self._refines)):
            return None
        draws_still = at_rest and self._draws_still
        size = (self._view.width, self._view.height)
        if size != self._size and self._in_flight:
            return None  # slots move with the size: earlier frames must have been displayed
        camera = controller.camera()
        if draws_still and not self._settled:
            self._settled = self.renderer.refine(camera, clock=self.clock)
            if not self._settled:
                return None
        elif draws_still or (at_rest and self._loads):
            self._loaded = self.renderer.load(camera, elapsed=elapsed, budget=_LOAD)
            return None
        else:
            if at_rest:  # not since the last load: the density of plants follows frames
                elapsed = min(now - self._drawn_at, _REST_INTERVAL)
            self._loaded = self._shows_all = at_rest and self._loaded
            self._drawn_at, self._stale, self._settled = now, False, False
            self.clock += elapsed if plays else 0.0
            pending = self._pending_since
            hasty = pending is not None and now - pending < _HASTE
            self._stats = self.renderer.draw(
                camera, elapsed=elapsed, clock=self.clock, budget=self._budget, hasty=hasty
            )
            self._budget = None
            self._moved_at = self._moved_at if at_rest else time.monotonic()
            self._converged, self._size = self._stats.converged, size
        stats = self._stats
        assert stats is not None  # noqa: S101 # the first frame is stale
        self._slot = (self._slot + 1) % SLOTS
        nbytes = 4 * size[0] * size[1]
        start, capacity = self._memory.allocate(self._slot, nbytes)
        with self._memory.view(start, nbytes, capacity) as pixels:
            self.renderer.read_pixels(pixels)
        self._in_flight += 1
        self._duration = time.monotonic() - now
        facts = FrameFacts(
            width=size[0],
            height=size[1],
            version=self._version,
            pose=camera,
            seconds=self._duration,
            generation_seconds=stats.generation_seconds,
            tiles=stats.tiles_drawn,
            triangles=stats.triangles,
            converged=self._settled or (stats.converged and not self._refines),
            memory=self._used_bytes(),
        )
        return FrameReady(facts, start, capacity)
