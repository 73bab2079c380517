"""The process for what takes long: measuring adherence, pictures of the best quality. The view goes on."""

from __future__ import annotations

import os
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sketchterrain.errors import SketchterrainError, one_line
from sketchterrain.system import lower_priority
from sketchterrain.ui.engine.channel import Channel, unpickled
from sketchterrain.ui.engine.messages import Adherence, Trouble
from sketchterrain.ui.engine.plan import MeasureJob, PictureJob, PictureWritten

if TYPE_CHECKING:
    from sketchterrain.sketch import Sketch
    from sketchterrain.terrain import Terrain

__all__ = ["answer_to"]


def answer_to(job: MeasureJob | PictureJob) -> Adherence | PictureWritten | Trouble:
    """Do a job; what goes wrong is an answer too."""
    what = "picture" if isinstance(job, PictureJob) else "engine"
    try:
        return _measured(job) if isinstance(job, MeasureJob) else _pictured(job)
    except SketchterrainError as error:
        return Trouble(what, one_line(error))
    except Exception as error:  # noqa: BLE001 # one job that fails must not take the next with it
        return Trouble(what, one_line(f"{type(error).__name__}: {error}"))


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
        weather=Weather.of(job.sketch),
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
