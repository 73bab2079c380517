"""The background process for adherence and pictures of the highest quality, and its job queue."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from sketchterrain.errors import InputError, SketchterrainError, one_line
from sketchterrain.io.system import lower_priority
from sketchterrain.ui.engine.channel import Channel, ContentChannel, start_process
from sketchterrain.ui.engine.protocol import Agreement, ErrorReport, MeasureJob, PictureJob, PictureWritten

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch
    from sketchterrain.generation.terrain import Terrain
    from sketchterrain.terrain.recipe import TerrainRecipe

_Job: TypeAlias = MeasureJob | PictureJob
_Answer: TypeAlias = Agreement | PictureWritten | ErrorReport

_TITLES: Final = {MeasureJob: "Comparing with the sketch", PictureJob: "Rendering the picture"}
_SOURCES: Final = {MeasureJob: "engine", PictureJob: "picture"}


class JobQueue:
    """Jobs for a process that starts with the first one; a newer measurement replaces a pending one."""

    def __init__(self) -> None:
        self._child: subprocess.Popen[bytes] | None = None
        self._pending: list[_Job] = []
        self._running: _Job | None = None
        self.channel: Channel | None = None  # answers, while the process runs

    @property
    def pid(self) -> int | None:
        """Process id; None while it does not run."""
        return None if self._child is None else self._child.pid

    @property
    def activity(self) -> str:
        """Title of the running job; empty: idle."""
        return "" if self._running is None else _TITLES[type(self._running)]

    def add(self, job: _Job) -> None:
        if isinstance(job, MeasureJob):
            self._pending = [each for each in self._pending if not isinstance(each, MeasureJob)]
        self._pending.append(job)
        self._send_next()

    def receive(self) -> _Answer:
        """Return the available answer, and start the next job."""
        assert self.channel is not None  # noqa: S101 # the caller saw that it is ready
        try:
            answer: _Answer = self.channel.receive()
        except EOFError:
            source = "engine" if self._running is None else _SOURCES[type(self._running)]
            answer = ErrorReport(source, f"{self.activity or 'background work'}: its process ended")
            self.close()
        self._running = None
        self._send_next()
        return answer

    def close(self) -> None:
        if self.channel is not None:
            self.channel.close()
        if self._child is not None:
            self._child.kill()
            self._child.wait()
        self.channel, self._child = None, None

    def _send_next(self) -> None:
        if self._running is not None or not self._pending:
            return
        if self.channel is None:
            ours, theirs = socket.socketpair()
            self._child = start_process("background", [str(theirs.fileno())], [theirs])
            self.channel = ContentChannel(ours, patient=False)
        self._running = self._pending.pop(0)
        self.channel.send(self._running)


def run_job(job: _Job) -> _Answer:
    """Run a job; an exception becomes an `ErrorReport`."""
    try:
        return _measure(job) if isinstance(job, MeasureJob) else _render(job)
    except SketchterrainError as error:
        line = one_line(error)
    except Exception as error:  # noqa: BLE001 # later jobs must still run
        line = one_line(f"{type(error).__name__}: {error}")
    return ErrorReport(_SOURCES[type(job)], line)


def _measure(job: MeasureJob) -> Agreement:
    from sketchterrain.measure.adherence import measure_adherence, pixel_centres
    from sketchterrain.measure.realism import measure_terrain_realism

    terrain = _terrain(job.sketch, job.recipe)
    found = measure_adherence(terrain)
    images = {name: (each.painted, each.affected) for name, each in found.images.items()}
    try:
        realism = measure_terrain_realism(terrain)
    except InputError:  # as of open sea
        return Agreement(job.version, found.as_dict(), images)
    faults = realism.faults_at(*pixel_centres(job.sketch))
    return Agreement(job.version, found.as_dict(), images, realism.as_dict(), faults)


def _render(job: PictureJob) -> PictureWritten:
    from sketchterrain.document.store import reject_sketch_folder
    from sketchterrain.export.rasters import write_picture
    from sketchterrain.render.offscreen import render_picture
    from sketchterrain.render.sky import Sun, Weather

    reject_sketch_folder(Path(job.path).parent)
    picture = render_picture(
        _terrain(job.sketch, job.recipe),
        size=job.size,
        camera=job.pose,
        sun=Sun(*job.sun),
        weather=Weather.from_sketch(job.sketch),
        clock=job.clock,
        overlays=job.overlays,
    )
    write_picture(Path(job.path), picture)
    return PictureWritten(job.path)


def _terrain(sketch: Sketch, recipe: TerrainRecipe) -> Terrain:
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.generation.terrain import Terrain

    return Terrain(sketch, recipe, ComputeContext())


def _main(number: int) -> None:
    channel, jobs = Channel.from_descriptor(number), list[Any]()
    available = threading.Semaphore(0)

    def read() -> None:
        # Jobs take long: end at once when the engine is gone, nobody wants the answer.
        while True:
            try:
                jobs.append(channel.receive())
            except EOFError:
                os._exit(0)
            available.release()

    threading.Thread(target=read, daemon=True).start()
    while True:
        available.acquire()
        channel.send(run_job(jobs.pop(0)))


if __name__ == "__main__":
    lower_priority(5)
    _main(int(sys.argv[1]))
