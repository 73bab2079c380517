"""A window's end of the process that shows a world: signals for what it tells, methods to ask it."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import threading
from typing import TYPE_CHECKING, Any, Final

from PyQt6.QtCore import pyqtSignal

from sketchterrain.ui.engine.channel import Channel
from sketchterrain.ui.engine.frames import FrameMemory
from sketchterrain.ui.engine.link import PictureSource
from sketchterrain.ui.engine.protocol import (
    EngineFacts,
    FrameThere,
    Look,
    Picked,
    Quit,
    Trouble,
    ViewState,
    Working,
)
from sketchterrain.ui.worlds.messages import WorldFacts

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["WorldLink"]

_PATIENCE: Final = 1.0
"""s that the process has to end by itself."""


class WorldLink(PictureSource):
    """Draws a world in a process of its own.

    Its `trouble` is of the ``engine``, which has ended then, the ``view``, or a part of the ``world``.

    Parameters
    ----------
    path
        Of the world.
    device
        Selector of the OpenCL device; None: the best one.

    Attributes
    ----------
    path : Path
    world : WorldFacts or None
        What is shown; None until it is known.
    """

    world_known = pyqtSignal(object)
    """`WorldFacts`."""

    _came = pyqtSignal(int, object)
    """From a thread that reads: of which start, and what; None: the process is gone."""

    def __init__(self, path: Path, *, device: str | None = None) -> None:
        super().__init__(ViewState(mode="fly"))
        self.path, self._device = path, device
        self.world: WorldFacts | None = None
        self._child: _Child | None = None
        self._starts = 0
        self._failed = False
        self._came.connect(self._take)  # it is emitted by other threads, and taken on this one

    def start(self) -> None:
        """Start the process; anew while it runs."""
        self.stop()
        self._starts += 1
        self._failed = False
        self._child = _Child(self.path, self._device)
        threading.Thread(
            target=self._read, args=(self._starts, self._child.channel), name="world", daemon=True
        ).start()
        self.tell(self.view)
        self.tell(Look(None if self.frame is None else self.frame.pose))

    def stop(self) -> None:
        """End the process; waits for it for a short while."""
        child, self._child = self._child, None
        if child is not None:
            child.end()
        self._set_working("")

    def tell(self, message: Any) -> None:
        """Send a motion, `Look` and so on."""
        if self._child is not None:
            self._child.channel.send(message)

    def _read(self, start: int, channel: Channel) -> None:
        """Hand over what the process tells; on a thread of its own."""
        while True:
            try:
                message = channel.receive()
            except EOFError:
                self._came.emit(start, None)
                return
            self._came.emit(start, message)

    def _take(self, start: int, message: Any) -> None:
        """Take what the process told over, on the window's thread."""
        child = self._child
        if start != self._starts or child is None:
            return  # of one that was stopped
        if message is None:
            self._end(child)
        elif isinstance(message, FrameThere):
            self._take_frame(child.frames, message)
        elif isinstance(message, EngineFacts):
            self.facts = message
        elif isinstance(message, WorldFacts):
            self.world = message
            self.world_known.emit(message)
        elif isinstance(message, Picked):
            self.picked.emit(message)
        elif isinstance(message, Working):
            self._set_working(message.what)
        elif isinstance(message, Trouble):
            self._failed = self._failed or message.what == "engine"
            self.trouble.emit(message)

    def _end(self, child: _Child) -> None:
        line = child.ended()
        self.stop()
        if not self._failed:
            self._failed = True
            self.trouble.emit(Trouble("engine", line))


class _Child:
    """The process, which ends when this one does."""

    def __init__(self, path: Path, device: str | None) -> None:
        self.frames = FrameMemory()
        mine, its = socket.socketpair()
        options = {
            "window": its.fileno(),
            "frames": self.frames.number,
            "world": str(path),
            "device": device,
        }
        command = [sys.executable, "-m", "sketchterrain.ui.worlds.process", json.dumps(options)]
        self._process = subprocess.Popen(  # noqa: S603
            command, pass_fds=[its.fileno(), self.frames.number], stdin=subprocess.DEVNULL
        )
        its.close()
        self.channel = Channel(mine, patient=False)

    def ended(self) -> str:
        """Return how it ended, in one line."""
        try:
            code = self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            return "The process that draws closed its connection."
        how = f"crashed (signal {-code})" if code < 0 else f"ended (code {code})"
        return f"The process that draws {how}."

    def end(self) -> None:
        """End it, within a second."""
        self.channel.send(Quit())
        self.channel.close()
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self.frames.close()
