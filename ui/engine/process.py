"""The process behind the window: opens what there is to compute and to draw with, and runs the engine."""

from __future__ import annotations

import json
import os
import sys
from typing import TYPE_CHECKING, Any

from sketchterrain.errors import DeviceError, one_line
from sketchterrain.system import lower_priority, resident_memory
from sketchterrain.ui.engine.channel import Channel
from sketchterrain.ui.engine.protocol import EngineFacts, Working

if TYPE_CHECKING:
    from sketchterrain.ui.engine.stage import Stage

_NICE = 2
"""Of the system's priorities, 0 to 19: where all want the processors, the window and the placer go first."""


def held_bytes(processes: list[int]) -> int:
    """Return how many bytes of memory processes hold; one that ended holds none."""
    return sum(resident_memory(process) or 0 for process in processes)


def _main(options: dict[str, Any]) -> None:
    """Run the engine."""
    lower_priority(_NICE)
    window = Channel.of(options["window"], patient=False)
    window.send(Working("Opening the device"))
    from sketchterrain.compute import ComputeContext
    from sketchterrain.ui.engine.background import JobQueue
    from sketchterrain.ui.engine.engine import Engine
    from sketchterrain.ui.engine.frames import FrameMemory, FramePacer
    from sketchterrain.ui.engine.land import TerrainSession

    stage, no_picture = _stage() if options["draws"] else (None, "OpenGL failed twice: start it again")
    land = TerrainSession(stage.open_device if stage else ComputeContext, device=options["device"])
    jobs, own = JobQueue(), [os.getpid(), options["placer_id"]]
    device = land.device
    facts = EngineFacts(
        device=device.name if device else "",
        platform=device.platform if device else "",
        renderer=stage.name if stage else "",
        no_device=land.lacks,
        no_picture=no_picture,
    )
    show = None
    if stage is not None:
        memory = FrameMemory(options["frames"])
        show = FramePacer(stage, memory, held=lambda: held_bytes(own + ([jobs.pid] if jobs.pid else [])))
    Engine(window, Channel.of(options["placer"]), land=land, show=show, jobs=jobs, facts=facts).run()
    window.close()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)  # drivers take their time to take themselves down, and some crash at it


def _stage() -> tuple[Stage | None, str]:
    """Open OpenGL; else return a line that says what is missing."""
    from sketchterrain.ui.engine.stage import Stage

    try:
        return Stage(), ""
    except DeviceError as error:
        return None, one_line(error)


if __name__ == "__main__":
    _main(json.loads(sys.argv[1]))
