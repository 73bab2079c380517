"""The process behind the window: opens the device, OpenGL and a stored world if any, and runs the engine."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sketchterrain.errors import DeviceError, SketchterrainError, one_line
from sketchterrain.system import lower_priority, resident_memory
from sketchterrain.ui.engine.channel import Channel
from sketchterrain.ui.engine.protocol import Activity, EngineFacts, ErrorReport, WorldFacts

if TYPE_CHECKING:
    from sketchterrain.ui.engine.engine import Engine
    from sketchterrain.ui.engine.stage import ViewRenderer
    from sketchterrain.ui.engine.terrain_session import TerrainSession

_NICE = 2
"""Of the system's priorities, 0 to 19: where all want the processors, the window and the placer go first."""


def _main(options: dict[str, Any]) -> None:
    """Run the engine.

    Options: ``window``, ``placer`` (None: there is none), ``frames`` are numbers of file descriptors,
    ``placer_id`` is a process, ``world`` the path of a stored world or None, ``device`` a selector or None,
    ``draws`` says whether to open OpenGL.
    """
    lower_priority(_NICE)
    window = Channel.of(options["window"], patient=False)
    window.send(Activity("Opening the world" if options["world"] else "Opening the device"))
    try:
        engine = _engine(window, options)
    except SketchterrainError as error:
        window.send(ErrorReport("engine", one_line(error)))
        window.has_message(None)  # the window ends this process, or is gone
    else:
        engine.run()
    window.close()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)  # drivers take their time to take themselves down, and some crash at it


def _engine(window: Channel, options: dict[str, Any]) -> Engine:
    from sketchterrain.compute import ComputeContext
    from sketchterrain.ui.engine.background import JobQueue
    from sketchterrain.ui.engine.engine import Engine
    from sketchterrain.ui.engine.frames import FrameMemory, FramePacer
    from sketchterrain.ui.engine.terrain_session import TerrainSession

    stage, no_picture = _stage() if options["draws"] else (None, "OpenGL failed twice: start it again")
    open_device, selector = stage.open_device if stage else ComputeContext, options["device"]
    session: TerrainSession
    if options["world"]:
        session = _world(window, Path(options["world"]), open_device, selector)
    else:
        session = TerrainSession(open_device, device=selector)
    device, jobs, pacer = session.device, JobQueue(), None
    facts = EngineFacts(
        device=device.name if device else "",
        platform=device.platform if device else "",
        renderer=stage.name if stage else "",
        no_device=session.lacks,
        no_picture=no_picture,
    )
    if stage is not None:
        processes = [os.getpid(), *([options["placer_id"]] if options["placer_id"] else [])]
        memory = FrameMemory(options["frames"])
        pacer = FramePacer(
            stage, memory, held=lambda: _held_bytes([*processes, *([jobs.pid] if jobs.pid else [])])
        )
    placer = None if options["placer"] is None else Channel.of(options["placer"])
    return Engine(window, placer, session=session, pacer=pacer, jobs=jobs, facts=facts)


def _world(window: Channel, path: Path, open_device: Any, selector: str | None) -> TerrainSession:
    """Open a stored world; the window is told of what it lacks, and of parts that cannot be read."""
    from sketchterrain.ui.engine.terrain_session import WorldSession

    session = WorldSession(
        path, lambda line: window.send(ErrorReport("world", line)), open_device, device=selector
    )
    world = session.world
    if world is not None:
        west, south, east, north = world.bounds
        middle = float(world.heights((west + east) / 2, (south + north) / 2))
        window.send(WorldFacts(world.corner, world.bounds, world.finest_cell, middle, tuple(world.lacks)))
    return session


def _held_bytes(processes: list[int]) -> int:
    """Return how many bytes of memory processes hold; one that ended holds none."""
    return sum(resident_memory(process) or 0 for process in processes)


def _stage() -> tuple[ViewRenderer | None, str]:
    """Open OpenGL; else return a line that says what is missing."""
    from sketchterrain.ui.engine.stage import ViewRenderer

    try:
        return ViewRenderer(), ""
    except DeviceError as error:
        return None, one_line(error)


if __name__ == "__main__":
    _main(json.loads(sys.argv[1]))
