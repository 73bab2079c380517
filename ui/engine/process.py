"""Entry point of the engine process: open the device, OpenGL and a stored world if any, run the engine."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

from sketchterrain.errors import DeviceError, SketchterrainError, one_line
from sketchterrain.io.system import lower_priority, resident_memory
from sketchterrain.ui.engine import protocol as msg
from sketchterrain.ui.engine.channel import Channel

_NICENESS = 2  # under load the window and the placer go first


def _main(options: dict[str, Any]) -> None:
    """Run the engine.

    Options: file descriptors ``window``, ``placer`` (None for a stored world) and ``frames``; process
    ``placer_id``; ``world``, a path or None; ``device``, a selector or None; ``draws``: open OpenGL.
    """
    from sketchterrain.ui.engine.engine import Engine

    lower_priority(_NICENESS)
    window = Channel.from_descriptor(options["window"], patient=False)
    window.send(msg.Activity("Opening the world" if options["world"] else "Opening the device"))
    try:
        parts = _open(window, options)
    except SketchterrainError as error:
        window.send(msg.ErrorReport("engine", one_line(error)))
        window.has_message(None)  # the window ends this process, or has ended
    else:
        placer = None if options["placer"] is None else Channel.from_descriptor(options["placer"])
        Engine(window, placer, **parts).run()
    window.close()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)  # some drivers are slow or crash when they are unloaded


def _open(window: Channel, options: dict[str, Any]) -> dict[str, Any]:
    """Return the engine's session, pacer, jobs and facts."""
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.ui.engine.background import JobQueue
    from sketchterrain.ui.engine.frames import FrameMemory, FramePacer
    from sketchterrain.ui.engine.terrain_session import TerrainSession, WorldSession
    from sketchterrain.ui.engine.view_renderer import ViewRenderer

    renderer, opengl_error = None, "OpenGL failed twice: start it again"
    if options["draws"]:
        try:
            renderer, opengl_error = ViewRenderer(), ""
        except DeviceError as error:
            opengl_error = one_line(error)
    open_device, selector = renderer.open_device if renderer else ComputeContext, options["device"]
    session: TerrainSession
    if options["world"]:

        def report(line: str) -> None:
            window.send(msg.ErrorReport("world", line))

        session = WorldSession(Path(options["world"]), report, open_device, device=selector)
        if session.world is not None:
            window.send(session.facts())
    else:
        session = TerrainSession(open_device, device=selector)
    device, jobs, pacer = session.device, JobQueue(), None
    facts = msg.EngineFacts(
        device=device.name if device else "",
        platform=device.platform if device else "",
        renderer=renderer.name if renderer else "",
        device_error=session.device_error,
        opengl_error=opengl_error,
    )
    if renderer is not None:

        def used_bytes() -> int:
            processes = [os.getpid(), options["placer_id"], jobs.pid]
            return sum(resident_memory(process) or 0 for process in processes if process)

        pacer = FramePacer(renderer, FrameMemory(options["frames"]), used_bytes=used_bytes)
    return {"session": session, "pacer": pacer, "jobs": jobs, "facts": facts}


if __name__ == "__main__":
    _main(json.loads(sys.argv[1]))
