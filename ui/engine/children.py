"""The processes behind a window: how they are started, and that none is left behind."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from typing import Final

from sketchterrain.ui.engine.channel import Channel
from sketchterrain.ui.engine.frames import FrameMemory
from sketchterrain.ui.engine.orders import Quit

__all__ = ["Children"]

_PATIENCE: Final = 0.4
"""s that processes have to end by themselves."""


class Children:
    """An engine and a placer, connected to this process and to each other.

    They see it when this process ends, even if it is killed, and end too.

    Parameters
    ----------
    device
        Selector of the OpenCL device, None: the best one.
    draws
        Whether OpenGL may be opened.

    Attributes
    ----------
    engine, placer : Channel
        To be read by whoever made this.
    frames : FrameMemory
        Where pictures lie.
    """

    def __init__(self, *, device: str | None = None, draws: bool = True) -> None:
        self.frames = FrameMemory()
        mine, its = socket.socketpair()
        my_placer, its_window = socket.socketpair()
        its_engine, engines_placer = socket.socketpair()
        self._placer = _started(
            "placer", [str(its_window.fileno()), str(its_engine.fileno())], its_window, its_engine
        )
        options = {
            "window": its.fileno(),
            "placer": engines_placer.fileno(),
            "frames": self.frames.number,
            "placer_id": self._placer.pid,
            "device": device,
            "draws": draws,
        }
        self._engine = _started("process", [json.dumps(options)], its, engines_placer, self.frames)
        for end in (its, its_window, its_engine, engines_placer):
            end.close()
        self.engine, self.placer = Channel(mine, patient=False), Channel(my_placer, patient=False)

    def ended(self) -> str:
        """Wait a moment for what is ending, and say in one line how; empty: both run."""
        for name, child in (("engine", self._engine), ("placer", self._placer)):
            try:
                code = child.wait(_PATIENCE)
            except subprocess.TimeoutExpired:
                continue
            return f"the {name} crashed (signal {-code})" if code < 0 else f"the {name} ended (code {code})"
        return ""

    def end(self) -> None:
        """End both, within half a second."""
        for channel in (self.engine, self.placer):
            channel.send(Quit())
        for channel in (self.engine, self.placer):
            channel.close()
        until = time.monotonic() + _PATIENCE
        for child in (self._engine, self._placer):
            try:
                child.wait(max(until - time.monotonic(), 0.0))
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()
        self.frames.close()


def _started(
    module: str, arguments: list[str], *passed: socket.socket | FrameMemory
) -> subprocess.Popen[bytes]:
    numbers = [each.number if isinstance(each, FrameMemory) else each.fileno() for each in passed]
    command = [sys.executable, "-m", f"sketchterrain.ui.engine.{module}", *arguments]
    return subprocess.Popen(command, pass_fds=numbers, stdin=subprocess.DEVNULL)  # noqa: S603
