"""Probe of OpenCL–OpenGL buffer sharing, in a child process because drivers crash and hang here."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Final, TypeVar

import numpy as np

from sketchterrain.compute.device import Device
from sketchterrain.errors import SketchterrainError
from sketchterrain.io.system import ChildFailedError, module_command, run_child

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext

T = TypeVar("T")

_MODULE: Final = "sketchterrain.render.sharing_probe"
_WORDS: Final = 1 << 18
_ROUNDS: Final = 3
_TIMEOUT: Final = 60.0  # s, with the first build of a kernel


@dataclass(frozen=True)
class Sharing:
    """Working method of sharing vertices with OpenGL ('none' without OpenGL), and why no better one works."""

    kind: str
    reason: str = ""


@cache
def probe_sharing(device: Device, *, timeout: float = _TIMEOUT) -> Sharing:
    """Return the best working sharing method of a device, probed once a process.

    Each method is tried in a child, the best first: a kernel writes OpenGL's buffer three times and its
    content is compared. Methods that crash, time out or differ are rejected.
    """
    reasons: list[str] = []
    offered = [device.gl_sharing, "mapped", "copy"] if device.type == "CPU" else [device.gl_sharing, "copy"]
    for kind in dict.fromkeys(offered):
        try:
            run_child(_command(device, kind), name="the probe", timeout=timeout)
        except ChildFailedError as error:
            reasons.append(f"{kind}: {error}")
        else:
            return Sharing(kind, "; ".join(reasons))
    return Sharing("none", "; ".join(reasons))


def open_device(device: Device, *, real: str = "float", fast: bool = False) -> ComputeContext:
    """Open a device that shares buffers with the current OpenGL context if that works."""
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.compute.gl_interop import current_handles

    shared = device.gl_sharing == "extension" and probe_sharing(device).kind == "extension"
    return ComputeContext(device, real=real, fast=fast, gl=current_handles() if shared else None)


def shared_with_gl(terrain: T) -> T:
    """Return a terrain in a context that shares buffers with the current OpenGL context, with equal bits.

    The argument is returned if buffers cannot be shared, are shared already, or it is not a `Terrain`.
    """
    from sketchterrain.generation.terrain import Terrain

    if not isinstance(terrain, Terrain) or terrain.context.gl is not None:
        return terrain
    before = terrain.context
    context = open_device(before.device, real=before.real, fast=before.fast)
    return terrain if context.gl is None else moved_to_context(terrain, context)


def moved_to_context(terrain: T, context: ComputeContext) -> T:
    """Return a `Terrain` in another compute context; anything else is returned unchanged."""
    from sketchterrain.generation.terrain import Terrain

    if not isinstance(terrain, Terrain) or terrain.context is context:
        return terrain
    return type(terrain)(terrain.sketch, terrain.recipe, context, memory=terrain.memory)


def _command(device: Device, kind: str) -> list[str]:
    return module_command(_MODULE, str(device.index), kind)


def _probe(index: int, kind: str) -> None:
    """Test a sharing method in this process; raise SketchterrainError if OpenGL's content differs."""
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.compute.device import list_devices
    from sketchterrain.compute.gl_interop import current_handles
    from sketchterrain.render.programs import open_context
    from sketchterrain.render.vertex_memory import open_vertex_memory

    gl = open_context()
    handles = current_handles() if kind == "extension" else None
    if kind == "extension" and handles is None:
        raise SketchterrainError("the current OpenGL context has no handles for OpenCL")
    context = ComputeContext(list_devices()[index], gl=handles)
    memory = open_vertex_memory(gl, context, 4 * _WORDS, kind=kind)
    for turn in range(_ROUNDS):
        memory.acquire()
        context.launch("sharing_probe.cl", "probe", (_WORDS,), np.uint32(turn), memory.buffer)
        memory.release([(0, memory.nbytes)])
        words = (np.arange(_WORDS, dtype=np.uint32) + np.uint32(1)) * np.uint32(0x9E3779B1) + np.uint32(turn)
        different = int(np.count_nonzero(np.frombuffer(memory.read(), np.uint32) != words))
        if different:
            raise SketchterrainError(
                f"OpenGL holds other words than the kernel wrote, {different} of {_WORDS}"
            )
    memory.close()


if __name__ == "__main__":
    try:
        _probe(int(sys.argv[1]), sys.argv[2])
    except SketchterrainError as found:
        sys.exit(str(found))
