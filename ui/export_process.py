"""Exports a terrain in a process of its own, so that the window goes on and can end it at any moment.

Reads one pickled wish and sketch on stdin; writes a line of JSON on stdout for each thing that happens.
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import sys
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any, TextIO

from sketchterrain.errors import one_line
from sketchterrain.ui.export_wish import TargetWish, Wish, WorldWish

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sketchterrain.progress import Stages
    from sketchterrain.sketch import Sketch


def main() -> int:
    """Export what stdin asks for; 0 if all went well."""
    # Whatever a driver prints must not get between the lines that the window reads.
    told = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    signal.signal(signal.SIGTERM, _end)  # what is half-written is taken away
    try:
        # From the window that started this process, and nobody else.
        wish, sketch = pickle.load(sys.stdin.buffer)  # noqa: S301
        done = _export(wish, sketch, told)
    except (KeyboardInterrupt, BrokenPipeError):  # cancelled, or the window is gone
        return 130
    except Exception as error:  # noqa: BLE001 - whatever it is, a person gets one line
        from sketchterrain.exit_codes import told as words_for

        _tell(told, {"failed": one_line(words_for(error)[0])})
        return 1
    _tell(told, done)
    return 0


def _export(wish: Wish | TargetWish | WorldWish, sketch: Sketch, told: TextIO) -> dict[str, Any]:
    from sketchterrain.progress import Stages

    with Stages(_shown_on(told)) as stages:
        if isinstance(wish, WorldWish):
            return _world(wish, sketch, stages, told)
        if isinstance(wish, TargetWish):
            return _take(wish, sketch, stages)
        return _generate(wish, sketch, stages)


def _world(wish: WorldWish, sketch: Sketch, stages: Stages, told: TextIO) -> dict[str, Any]:
    from sketchterrain.ui.world_work import estimate_world, write_world

    if wish.only_estimate:
        return estimate_world(wish, sketch, stages)
    return write_world(wish, sketch, stages, partial(_tell, told))


def _take(wish: TargetWish, sketch: Sketch, stages: Stages) -> dict[str, Any]:
    with stages.stage("program", "Loading the program"):
        from sketchterrain.exporting import export
    done = export(
        sketch, wish.folder, wish.target, wish.options, device=wish.device, fast=False, stages=stages
    )
    return {
        "files": [str(path) for path in done.files],
        "seconds": stages.elapsed,
        "heights": done.report["heights"],
        "settings": done.report["import"],
        "restarts": done.report.get("restarts", []),
    }


def _generate(wish: Wish, sketch: Sketch, stages: Stages) -> dict[str, Any]:
    with stages.stage("program", "Loading the program"):
        from sketchterrain.generate import Extras, FoliageFiles, check_size, generate

        check_size(sketch, wish.size)
    done = generate(
        sketch,
        wish.folder,
        device=wish.device,
        fast=False,
        size=wish.size,
        foliage=FoliageFiles(wish.foliage, wish.grass),
        extras=Extras(wish.preview, wish.view, map=wish.map),
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


if __name__ == "__main__":
    sys.exit(main())
