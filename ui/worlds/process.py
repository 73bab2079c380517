"""The process behind a world's window: opens the world, and what there is to compute and to draw with."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sketchterrain.errors import SketchterrainError, one_line
from sketchterrain.system import lower_priority
from sketchterrain.ui.engine.channel import Channel
from sketchterrain.ui.engine.protocol import EngineFacts, Trouble, Working
from sketchterrain.ui.worlds.messages import WorldFacts

if TYPE_CHECKING:
    from sketchterrain.ui.worlds.engine import WorldEngine

_NICE = 2


def _main(options: dict[str, Any]) -> None:
    """Show a world.

    Parameters
    ----------
    options
        ``window``, ``frames``: numbers of file descriptors. ``world``: a path. ``device``: selector, or None.
    """
    lower_priority(_NICE)
    window = Channel.of(options["window"], patient=False)
    window.send(Working("Opening the world"))
    try:
        _opened(window, Path(options["world"]), options["device"], options["frames"]).run()
    except SketchterrainError as error:
        window.send(Trouble("engine", one_line(error)))
    window.close(timeout=2.0)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)  # drivers take their time to take themselves down, and some crash at it


def _opened(window: Channel, path: Path, selector: str | None, frames: int) -> WorldEngine:
    from sketchterrain.compute import choose_device
    from sketchterrain.terrain import build
    from sketchterrain.ui.engine.frames import FrameMemory, FramePacer
    from sketchterrain.ui.engine.process import held_bytes
    from sketchterrain.ui.engine.stage import Stage
    from sketchterrain.ui.worlds.engine import WorldEngine
    from sketchterrain.world.opening import open_world
    from sketchterrain.world.viewed import ViewedWorld

    stored = open_world(path)
    sketch = stored.sketch()
    window.send(Working("Opening the device"))
    stage = Stage()
    context = stage.open_device(choose_device(selector))
    window.send(Working("Placing features"))
    terrain = None if sketch is None else build(sketch, device=context)
    world = ViewedWorld(stored, context, terrain, told=lambda line: window.send(Trouble("world", line)))
    west, south, east, north = world.bounds
    middle = float(world.heights((west + east) / 2, (south + north) / 2))
    window.send(
        EngineFacts(device=context.device.name, platform=context.device.platform, renderer=stage.name)
    )
    window.send(WorldFacts(world.corner, world.size, world.finest_cell, middle, tuple(world.lacks)))
    return WorldEngine(
        window, world, FramePacer(stage, FrameMemory(frames), held=lambda: held_bytes([os.getpid()]))
    )


if __name__ == "__main__":
    _main(json.loads(sys.argv[1]))
