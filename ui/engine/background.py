"""The process for long jobs (adherence, pictures of the best quality), and the queue of jobs for it."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from sketchterrain.errors import SketchterrainError, one_line
from sketchterrain.system import lower_priority
from sketchterrain.ui.engine.channel import Channel, unpickled
from sketchterrain.ui.engine.protocol import Adherence, ErrorReport, MeasureJob, PictureJob, PictureWritten

if TYPE_CHECKING:
    from sketchterrain.sketch import Sketch
    from sketchterrain.terrain import Terrain

_MODULE: Final = "sketchterrain.ui.engine.background"
_NAMES: Final = {MeasureJob: "Comparing with the sketch", PictureJob: "Rendering the picture"}


class JobQueue:
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

    def receive(self) -> Adherence | PictureWritten | ErrorReport:
        """Return an answer that is there, and begin the next job."""
        assert self._channel is not None  # noqa: S101 # who asks saw that it has something to say
        try:
            answer: Adherence | PictureWritten | ErrorReport = self._channel.receive()
        except EOFError:
            what = "picture" if isinstance(self._doing, PictureJob) else "engine"
            answer = ErrorReport(what, f"{self.doing or 'what takes long'}: the process that does it ended")
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


def answer_to(job: MeasureJob | PictureJob) -> Adherence | PictureWritten | ErrorReport:
    """Do a job; what goes wrong is an answer too."""
    what = "picture" if isinstance(job, PictureJob) else "engine"
    try:
        return _measured(job) if isinstance(job, MeasureJob) else _pictured(job)
    except SketchterrainError as error:
        return ErrorReport(what, one_line(error))
    except Exception as error:  # noqa: BLE001 # one job that fails must not take the next with it
        return ErrorReport(what, one_line(f"{type(error).__name__}: {error}"))


def _measured(job: MeasureJob) -> Adherence:
    from sketchterrain.terrain import measure_adherence

    found = measure_adherence(_terrain(job.sketch, job.recipe))
    images = {name: (each.painted, each.shown) for name, each in found.images.items()}
    return Adherence(job.version, found.as_dict(), images)


def _pictured(job: PictureJob) -> PictureWritten:
    from sketchterrain.export import write_picture
    from sketchterrain.render import Camera, Sun, Weather, render_picture

    terrain = _terrain(job.sketch, job.recipe)
    picture = render_picture(
        terrain,
        size=job.size,
        camera=Camera(job.pose.eye, job.pose.target, fov=job.pose.fov),
        sun=Sun(*job.sun),
        weather=Weather.from_sketch(job.sketch),
        overlays=job.overlays,
    )
    write_picture(Path(job.path), picture)
    return PictureWritten(job.path)


def _terrain(sketch: Sketch, recipe: bytes) -> Terrain:
    from sketchterrain.compute import ComputeContext
    from sketchterrain.terrain import Terrain

    return Terrain(sketch, unpickled(recipe, but=sketch), ComputeContext())


def _main(number: int) -> None:
    channel, jobs = Channel.of(number), list[Any]()
    there = threading.Semaphore(0)

    def read() -> None:
        # A job may take long: if whoever asked is gone meanwhile, nobody wants the answer.
        while True:
            try:
                jobs.append(channel.receive())
            except EOFError:
                os._exit(0)
            there.release()

    threading.Thread(target=read, daemon=True).start()
    while True:
        there.acquire()
        channel.send(answer_to(jobs.pop(0)))


if __name__ == "__main__":
    lower_priority(5)
    _main(int(sys.argv[1]))
