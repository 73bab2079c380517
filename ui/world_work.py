"""What the process beside the window does for a world: it samples what it will take, and writes it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sketchterrain.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.progress import Stages
    from sketchterrain.sketch import Sketch
    from sketchterrain.ui.export_wish import WorldWish
    from sketchterrain.world.job import Job

    Tell = Callable[[dict[str, Any]], None]


def estimate_world(wish: WorldWish, sketch: Sketch, stages: Stages) -> dict[str, Any]:
    """Return what a world will take: nothing is written where it will be."""
    job = _placed(wish, sketch, stages)
    with stages.stage("samples", "Sampling the world") as tell:
        from sketchterrain.world.estimate import estimate

        told = estimate(job, device=wish.device, workers=wish.workers, progress=tell)
    problem = ""
    try:
        told.refuse_impossible()
    except InputError as error:
        problem = str(error)
    return {"lines": told.lines(), "problem": problem, "tasks": told.tasks, "done": told.done}


def write_world(wish: WorldWish, sketch: Sketch, stages: Stages, tell: Tell) -> dict[str, Any]:
    """Write a world, or go on with it, and return what came of it."""
    job = _placed(wish, sketch, stages)
    from sketchterrain.world.run import run_world
    from sketchterrain.world.telling import Telling

    def show(text: str, share: float, left: str) -> None:
        tell({"stage": f"{text}, {left}" if left else text})
        tell({"share": share})

    tell({"stage": "Opening the device"})
    with Telling(
        job.world, plants=job.plants != "none", show=show, say=lambda line: tell({"note": line})
    ) as watcher:
        done = run_world(job, device=wish.device, workers=wish.workers or None, resume=True, watcher=watcher)
    return {
        "tasks": done.tasks,
        "made": done.made,
        "files": done.files,
        "bytes": done.bytes,
        "seconds": done.seconds,
    }


def _placed(wish: WorldWish, sketch: Sketch, stages: Stages) -> Job:
    with stages.stage("program", "Loading the program"):
        from sketchterrain.terrain import make_recipe
        from sketchterrain.world.asked import form_of
        from sketchterrain.world.roots import Roots
        from sketchterrain.world.run import refuse_taken

        wish.wishes.check(sketch)
    with stages.stage("features", "Placing features"):
        job = wish.wishes.job(sketch, make_recipe(sketch), wish.output, form_of(str(wish.output)))
    Roots.of(job)  # a library that is missing is told before any work
    refuse_taken(job, resume=True)
    return job
