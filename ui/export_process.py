"""Export process of the window, which can be ended at any moment.

Reads one pickled request and sketch on stdin; writes events as lines of JSON on stdout.
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError, one_line
from sketchterrain.io.console import Stages
from sketchterrain.ui.engine.protocol import ExportRequest, Request, TargetRequest, WorldRequest

if TYPE_CHECKING:
    from sketchterrain.world.job import Job

Emit = Callable[[dict[str, Any]], None]


def main() -> int:
    """Export what stdin requests; return 0 on success, 130 if cancelled, else 1."""
    # Messages that a driver prints must not mix with the events.
    events = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)

    def emit(event: dict[str, Any]) -> None:
        if _cancelled:  # an interruption that fell into a callback of Python's was lost
            raise KeyboardInterrupt
        events.write(json.dumps(event) + "\n")
        events.flush()

    signal.signal(signal.SIGTERM, _cancel)  # partial files are removed
    try:
        # From the window that started this process.
        request, sketch = pickle.load(sys.stdin.buffer)  # noqa: S301
        emit(_export(request, sketch, emit))
    except (KeyboardInterrupt, BrokenPipeError):  # cancelled, or the window is gone
        return 130
    except Exception as error:  # noqa: BLE001 - any failure is reported in one line
        from sketchterrain.io.console import describe_error

        emit({"failed": one_line(describe_error(error)[0])})
        return 1
    return 0


_cancelled: list[object] = []


def _cancel(*_: object) -> None:
    _cancelled.append(True)
    raise KeyboardInterrupt


def _export(request: Request, sketch: Sketch, emit: Emit) -> dict[str, Any]:
    @contextmanager
    def show(title: str) -> Iterator[Callable[[float], None]]:
        emit({"stage": title})
        yield lambda share: emit({"share": share})

    with Stages(show) as stages:
        if isinstance(request, TargetRequest):
            return _export_target(request, sketch, stages)
        if isinstance(request, ExportRequest):
            return _generate(request, sketch, stages)
        if request.only_estimate:
            return estimate_world(request, sketch, stages)
        return write_world(request, sketch, stages, emit)


def _export_target(request: TargetRequest, sketch: Sketch, stages: Stages) -> dict[str, Any]:
    with stages.stage("program", "Loading the program"):
        from sketchterrain.jobs.export import export
    done = export(
        sketch,
        request.folder,
        request.target,
        request.options,
        device=request.device,
        fast=False,
        stages=stages,
    )
    return {
        "files": [str(path) for path in done.files],
        "seconds": stages.elapsed,
        "heights": done.report["heights"],
        "settings": done.report["import"],
        "restarts": done.report.get("restarts", []),
    }


def _generate(request: ExportRequest, sketch: Sketch, stages: Stages) -> dict[str, Any]:
    with stages.stage("program", "Loading the program"):
        from sketchterrain.export.foliage_files import FoliageOptions
        from sketchterrain.jobs.estimates import check_size
        from sketchterrain.jobs.generate import GenerateOptions, generate

        check_size(sketch, request.size)
    foliage = FoliageOptions(request.foliage, request.grass)
    options = GenerateOptions(request.size, foliage, request.preview, request.view, map=request.map)
    done = generate(sketch, request.folder, options, device=request.device, stages=stages)
    return {
        "files": [str(path) for path in done.files],
        "problem": done.problem,
        "seconds": stages.elapsed,
        "heights": done.report["heights"],
        "plants": done.report["foliage"]["plants"],
    }


def estimate_world(request: WorldRequest, sketch: Sketch, stages: Stages) -> dict[str, Any]:
    """Return what writing a world takes."""
    job = _world_job(request, sketch, stages)
    from sketchterrain.world import options

    estimate = options.estimate_world(job, workers=request.workers)
    problem = ""
    try:
        estimate.check_resources()
    except InputError as error:
        problem = str(error)
    return {
        "lines": estimate.lines(),
        "problem": problem,
        "tasks": estimate.tasks,
        "done": estimate.done,
    }


def write_world(request: WorldRequest, sketch: Sketch, stages: Stages, emit: Emit) -> dict[str, Any]:
    """Write or resume a world; emit ``stage``, ``share`` and ``note`` events."""
    job = _world_job(request, sketch, stages)
    from sketchterrain.world.run import ProgressReporter, run_world

    def show(text: str, share: float, left: str) -> None:
        emit({"stage": f"{text}, {left}" if left else text})
        emit({"share": share})

    emit({"stage": "Opening the device"})
    workers = request.workers or None
    with ProgressReporter(show=show, echo=lambda line: emit({"note": line})) as reporter:
        done = run_world(job, device=request.device, workers=workers, resume=True, reporter=reporter)
    return {
        "tasks": done.tasks,
        "made": done.computed,
        "files": done.files,
        "bytes": done.bytes,
        "seconds": done.seconds,
    }


def _world_job(request: WorldRequest, sketch: Sketch, stages: Stages) -> Job:
    with stages.stage("program", "Loading the program"):
        from sketchterrain.generation.building import make_recipe
        from sketchterrain.world.journal import check_output_unused
        from sketchterrain.world.options import output_form

        request.options.check(sketch)
    with stages.stage("features", "Placing features") as progress:
        recipe = make_recipe(sketch, progress=progress)
        job = request.options.job(sketch, recipe, request.output, output_form(str(request.output)))
    check_output_unused(job, resume=True)
    return job


if __name__ == "__main__":
    sys.exit(main())
