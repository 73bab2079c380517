"""Exports a terrain or a world in a process of its own, so that the window can end it at any moment.

Reads one pickled request and sketch on stdin; writes a line of JSON on stdout for each thing that happens.
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any, TextIO

from sketchterrain.errors import InputError, one_line
from sketchterrain.progress import Stages
from sketchterrain.sketch import Sketch
from sketchterrain.ui.export_request import ExportRequest, TargetRequest, WorldRequest

if TYPE_CHECKING:
    from sketchterrain.world.job import Job


def main() -> int:
    """Export what stdin asks for; 0 if all went well."""
    # Whatever a driver prints must not get between the lines that the window reads.
    told = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    signal.signal(signal.SIGTERM, _end)  # what is half-written is taken away
    try:
        # From the window that started this process, and nobody else.
        request, sketch = pickle.load(sys.stdin.buffer)  # noqa: S301
        done = _export(request, sketch, told)
    except (KeyboardInterrupt, BrokenPipeError):  # cancelled, or the window is gone
        return 130
    except Exception as error:  # noqa: BLE001 - whatever it is, a person gets one line
        from sketchterrain.exit_codes import describe_error as words_for

        _tell(told, {"failed": one_line(words_for(error)[0])})
        return 1
    _tell(told, done)
    return 0


def _export(
    request: ExportRequest | TargetRequest | WorldRequest, sketch: Sketch, told: TextIO
) -> dict[str, Any]:
    from sketchterrain.progress import Stages

    with Stages(_shown_on(told)) as stages:
        if isinstance(request, WorldRequest):
            return _world(request, sketch, stages, told)
        if isinstance(request, TargetRequest):
            return _take(request, sketch, stages)
        return _generate(request, sketch, stages)


def _world(request: WorldRequest, sketch: Sketch, stages: Stages, told: TextIO) -> dict[str, Any]:
    from sketchterrain.ui.export_process import estimate_world, write_world

    if request.only_estimate:
        return estimate_world(request, sketch, stages)
    return write_world(request, sketch, stages, partial(_tell, told))


def _take(request: TargetRequest, sketch: Sketch, stages: Stages) -> dict[str, Any]:
    with stages.stage("program", "Loading the program"):
        from sketchterrain.exporting import export
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
        from sketchterrain.generate import FoliageFiles, PreviewOptions, check_size, generate

        check_size(sketch, request.size)
    done = generate(
        sketch,
        request.folder,
        device=request.device,
        fast=False,
        size=request.size,
        foliage=FoliageFiles(request.foliage, request.grass),
        extras=PreviewOptions(request.preview, request.view, map=request.map),
        stages=stages,
    )
    return {
        "files": [str(path) for path in done.files],
        "problem": done.problem,
        "seconds": stages.elapsed,
        "heights": done.report["heights"],
        "plants": done.report["foliage"]["plants"],
    }


def _shown_on(told: TextIO) -> Callable[[str], Any]:
    @contextmanager
    def show(title: str) -> Iterator[Callable[[float], None]]:
        _tell(told, {"stage": title})
        yield lambda share: _tell(told, {"share": share})

    return show


def _tell(told: TextIO, what: dict[str, Any]) -> None:
    told.write(json.dumps(what) + "\n")
    told.flush()


def _end(*_: object) -> None:
    raise KeyboardInterrupt


Tell = Callable[[dict[str, Any]], None]


def estimate_world(request: WorldRequest, sketch: Sketch, stages: Stages) -> dict[str, Any]:
    """Return what a world takes; nothing is written where it will be."""
    job = _placed(request, sketch, stages)
    from sketchterrain.world import options

    found = options.estimate_world(job, workers=request.workers)
    problem = ""
    try:
        found.refuse_impossible()
    except InputError as error:
        problem = str(error)
    return {"lines": found.lines(), "problem": problem, "tasks": found.tasks, "done": found.done}


def write_world(request: WorldRequest, sketch: Sketch, stages: Stages, tell: Tell) -> dict[str, Any]:
    """Write or resume a world; `tell` takes ``stage``, ``share`` and ``note`` as it goes on."""
    job = _placed(request, sketch, stages)
    from sketchterrain.world.run import ProgressReporter, run_world

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
        from sketchterrain.world.journal import OutputLayout, check_output_unused
        from sketchterrain.world.options import form_of

        request.options.check(sketch)
    with stages.stage("features", "Placing features"):
        job = request.options.job(sketch, make_recipe(sketch), request.output, form_of(str(request.output)))
    OutputLayout.of(job)  # a missing library is reported before any work
    check_output_unused(job, resume=True)
    return job


if __name__ == "__main__":
    sys.exit(main())
