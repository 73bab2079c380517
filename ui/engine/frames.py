"""Frames of the 3-D view: shared memory for them, and when the next one is drawn."""

from __future__ import annotations

import contextlib
import mmap
import os
import sys
import tempfile
import time
from typing import TYPE_CHECKING, Final

from sketchterrain.ui.engine.protocol import FrameFacts, FrameReady, ViewState

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.render.scene import TerrainSource
    from sketchterrain.terrain.changes import Box
    from sketchterrain.ui.engine.eye import CameraController
    from sketchterrain.ui.engine.stage import ViewRenderer

PLACES: Final = 2
"""Pictures that the memory holds."""
_GRAIN: Final = 1 << 20  # bytes; sizes are rounded up to it, so that a window that is resized asks rarely


class FrameMemory:
    """A nameless file in memory, mapped; it is gone with the last process that has it open."""

    def __init__(self, number: int | None = None) -> None:
        self.number = _nameless() if number is None else number
        self._map: mmap.mmap | None = None

    def place(self, index: int, nbytes: int) -> tuple[int, int]:
        """Make room for pictures of a size (bytes); return where the place begins, and bytes in all."""
        each = -(-nbytes // _GRAIN) * _GRAIN
        capacity = PLACES * each
        if os.fstat(self.number).st_size < capacity:
            os.ftruncate(self.number, capacity)
        return index * each, os.fstat(self.number).st_size

    def view(self, start: int, nbytes: int, capacity: int) -> memoryview:
        """Return bytes of the memory, of which there are `capacity`; it must be released after use."""
        if self._map is None or len(self._map) < capacity:
            self._unmap()
            self._map = mmap.mmap(self.number, capacity)
        return memoryview(self._map)[start : start + nbytes]

    def close(self) -> None:
        """Give it back; nothing of it may be in use."""
        self._unmap()
        os.close(self.number)

    def _unmap(self) -> None:
        if self._map is not None:
            self._map.close()
            self._map = None


def _nameless() -> int:
    if sys.platform == "linux":
        return os.memfd_create("frames")
    else:  # noqa: RET505 # mypy knows only branches to belong to a platform
        with tempfile.TemporaryFile() as file:
            return os.dup(file.fileno())


_QUICKEST: Final = 1.0 / 60.0
"""s from frame to frame at least."""
_PLAYING: Final = 0.1
"""s from frame to frame where the CPU draws, and only water, plants and clouds move."""
_SHARE: Final = 2.0
"""Times what the last frame took, for these: half of the time the CPU is free for other things."""
_LONGEST: Final = 0.1
"""s that pass for the eye and the clock in a frame at most: after a pause nothing jumps."""
_HOLD: Final = (0.12, 0.6)
"""s for which a picture that only gets better, or only plays, waits for a terrain that is being placed."""


class FramePacer:
    """Draws frames when something moves or is missing, and hands them to the window."""

    def __init__(self, stage: ViewRenderer, memory: FrameMemory, *, held: Callable[[], int]) -> None:
        self.stage = stage
        self.broken = False
        self._memory, self._held = memory, held
        self._view = ViewState()
        self._version = -1
        self._on_their_way = 0
        self._place, self._size = 0, (0, 0)
        self._drawn = 0.0
        self._took = 0.0
        self._clock = 0.0
        self._stale = True
        self._settled = False
        self._coming: float | None = None

    @property
    def view(self) -> ViewState:
        """What is shown."""
        return self._view

    def look(self, view: ViewState) -> None:
        """Show things otherwise from now on."""
        self.stage.look(view)
        self._view, self._stale, self.broken = view, True, False

    def show(self, terrain: TerrainSource, version: int, areas: list[Box], eye: CameraController) -> str:
        """Draw a terrain from now on, which differs from the one before in areas (m)."""
        self.broken = False
        self._stale, self._version = True, version
        return self.stage.show(terrain, areas, eye.camera())

    def expect(self, *, coming: bool) -> None:
        """Be told whether another terrain is on its way."""
        self._coming = time.monotonic() if coming else None

    def taken(self) -> None:
        """Be told that the window has shown a frame."""
        self._on_their_way = max(self._on_their_way - 1, 0)

    def stop(self) -> None:
        """Draw nothing until there is another terrain or view: it failed, and then all is made anew."""
        self.broken = True
        with contextlib.suppress(Exception):  # what failed may fail at being given back, too
            self.stage.clear()

    def due(self, *, moving: bool) -> float | None:
        """Return in how many s a frame is to be drawn, from now; None if there is nothing to draw."""
        visible = self._view.width > 0 and self._view.height > 0
        if self.broken or not visible or self._on_their_way >= PLACES or self._version < 0:
            return None
        now = time.monotonic()
        since = now - self._drawn
        if moving:
            return max(_QUICKEST - since, 0.0)
        half = _SHARE * self._took if self.stage.is_software else _QUICKEST
        if self._stale:  # where another one is on its way, placing it goes before drawing
            return max((_QUICKEST if self._coming is None else half) - since, 0.0)
        waited = _HOLD[1] if self._coming is None else now - self._coming
        if not self._settled:
            return max(_QUICKEST - since, _HOLD[0] - waited, 0.0)
        if not self._view.plays:
            return None
        often = max(_PLAYING, half) if self.stage.is_software else _QUICKEST
        return max(often - since, _HOLD[1] - waited, 0.0)

    def frame(self, eye: CameraController) -> FrameReady | None:
        """Draw a frame, if anything of it is another one than in the last; return where it lies."""
        now = time.monotonic()
        elapsed = min(now - self._drawn, _LONGEST)
        moved = eye.advance(elapsed)
        plays = self._view.plays
        if not (moved or self._stale or plays or not self._settled):
            return None
        size = (self._view.width, self._view.height)
        if size != self._size and self._on_their_way:
            return None  # the places are laid out anew: what lies there must have been shown
        self._drawn, self._stale = now, False
        self._clock += elapsed if plays else 0.0
        camera = eye.camera()
        stats = self.stage.frame(camera, elapsed=elapsed, clock=self._clock)
        self._settled, self._size = stats.settled, size
        self._place = (self._place + 1) % PLACES
        nbytes = 4 * size[0] * size[1]
        start, capacity = self._memory.place(self._place, nbytes)
        with self._memory.view(start, nbytes, capacity) as pixels:
            self.stage.pixels(pixels)
        self._on_their_way += 1
        self._took = time.monotonic() - now
        facts = FrameFacts(
            width=size[0],
            height=size[1],
            version=self._version,
            pose=eye.pose(),
            to_clip=tuple(camera.to_clip(size[0] / size[1]).ravel().tolist()),
            seconds=self._took,
            generation_seconds=stats.generation_seconds,
            tiles=stats.tiles_drawn,
            triangles=stats.triangles,
            settled=stats.settled,
            memory=self._held(),
        )
        return FrameReady(facts, start, capacity)
