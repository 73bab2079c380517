"""What the process beside the window does for a world: the estimate, and the writing."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from sketchterrain.errors import InputError
from sketchterrain.progress import Stages
from sketchterrain.sketch import Sketch
from sketchterrain.ui.export_request import WorldRequest

if TYPE_CHECKING:  # loaded in a stage of its own
    from sketchterrain.world.job import Job

Tell = Callable[[dict[str, Any]], None]


def estimate_world(request: WorldRequest, sketch: Sketch, stages: Stages) -> dict[str, Any]:
    """Return what a world takes; nothing is written where it will be."""
    job = _placed(request, sketch, stages)
    from sketchterrain.world import estimate

    found = estimate.estimate_world(job, workers=request.workers)
    problem = ""
    try:
        found.refuse_impossible()
    except InputError as error:
        problem = str(error)
    return {"lines": found.lines(), "problem": problem, "tasks": found.tasks, "done": found.done}


def write_world(request: WorldRequest, sketch: Sketch, stages: Stages, tell: Tell) -> dict[str, Any]:
    """Write or resume a world; `tell` takes ``stage``, ``share`` and ``note`` as it goes on."""
    job = _placed(request, sketch, stages)
    from sketchterrain.world.progress import ProgressReporter
    from sketchterrain.world.run import run_world

    def show(text: str, share: float, left: str) -> None:
        tell({"stage": f"{text}, {left}" if left else text})
        tell({"share": share})

    tell({"stage": "Opening the device"})
    with ProgressReporter(show=show, echo=lambda line: tell({"note": line})) as watcher:
        done = run_world(
            job, device=request.device, workers=request.workers or None, resume=True, watcher=watcher
        )
    return {
        "tasks": done.tasks,
        "made": done.made,
        "files": done.files,
        "bytes": done.bytes,
        "seconds": done.seconds,
    }


def _placed(request: WorldRequest, sketch: Sketch, stages: Stages) -> Job:
    with stages.stage("program", "Loading the program"):
        from sketchterrain.terrain import make_recipe
        from sketchterrain.world.journal import OutputLayout
        from sketchterrain.world.options import form_of
        from sketchterrain.world.resume import check_output_unused

        request.options.check(sketch)
    with stages.stage("features", "Placing features"):
        job = request.options.job(sketch, make_recipe(sketch), request.output, form_of(str(request.output)))
    OutputLayout.of(job)  # a missing library is reported before any work
    check_output_unused(job, resume=True)
    return job
