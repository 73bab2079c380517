"""What takes long is done in a process aside, one thing after the other."""

from __future__ import annotations

import socket
import subprocess
import sys
from typing import TYPE_CHECKING, Any, Final

from sketchterrain.ui.engine.channel import Channel
from sketchterrain.ui.engine.messages import Trouble
from sketchterrain.ui.engine.plan import MeasureJob, PictureJob

if TYPE_CHECKING:
    from sketchterrain.ui.engine.messages import Adherence
    from sketchterrain.ui.engine.plan import PictureWritten

__all__ = ["Jobs"]

_MODULE: Final = "sketchterrain.ui.engine.aside"
_NAMES: Final = {MeasureJob: "Comparing with the sketch", PictureJob: "Rendering the picture"}


class Jobs:
    """Jobs for a process of their own, which is started when it is needed first.

    Of measurements that wait only the newest is done.
    """

    def __init__(self) -> None:
        self._child: subprocess.Popen[bytes] | None = None
        self._channel: Channel | None = None
        self._waiting: list[Any] = []
        self._doing: Any = None

    @property
    def channel(self) -> Channel | None:
        """Where answers come from, while there is a process."""
        return self._channel

    @property
    def pid(self) -> int | None:
        """Of the process, if there is one."""
        return None if self._child is None else self._child.pid

    @property
    def doing(self) -> str:
        """What it is busy with, for a person; empty: nothing."""
        return "" if self._doing is None else _NAMES[type(self._doing)]

    def add(self, job: MeasureJob | PictureJob) -> None:
        """Do a job as soon as can be."""
        if isinstance(job, MeasureJob):
            self._waiting = [each for each in self._waiting if not isinstance(each, MeasureJob)]
        self._waiting.append(job)
        self._go_on()

    def receive(self) -> Adherence | PictureWritten | Trouble:
        """Return an answer that is there, and begin the next job."""
        assert self._channel is not None  # noqa: S101 # who asks saw that it has something to say
        try:
            answer: Adherence | PictureWritten | Trouble = self._channel.receive()
        except EOFError:
            what = "picture" if isinstance(self._doing, PictureJob) else "engine"
            answer = Trouble(what, f"{self.doing or 'what takes long'}: the process that does it ended")
            self.close()
        self._doing = None
        self._go_on()
        return answer

    def close(self) -> None:
        """End the process, whatever it is doing."""
        if self._channel is not None:
            self._channel.close()
        if self._child is not None:
            self._child.kill()
            self._child.wait()
        self._channel, self._child = None, None

    def _go_on(self) -> None:
        if self._doing is not None or not self._waiting:
            return
        if self._channel is None:
            mine, its = socket.socketpair()
            command = [sys.executable, "-m", _MODULE, str(its.fileno())]
            self._child = subprocess.Popen(command, pass_fds=[its.fileno()], stdin=subprocess.DEVNULL)  # noqa: S603
            its.close()
            self._channel = Channel(mine, patient=False)
        self._doing = self._waiting.pop(0)
        self._channel.send(self._doing)
