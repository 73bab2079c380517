"""How much memory and disk a terrain of a batch takes, and who may begin when."""

from __future__ import annotations

from contextlib import contextmanager
from threading import Condition
from typing import TYPE_CHECKING, Final, NamedTuple

from sketchterrain.errors import SketchterrainError
from sketchterrain.export.target import ExportOptions
from sketchterrain.exporting import memory_needed as export_memory
from sketchterrain.exporting import plan_of
from sketchterrain.sizes import check_size, memory_needed
from sketchterrain.system import physical_memory, proc_memory

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sketchterrain.batch.output import Output
    from sketchterrain.batch.plan import Item
    from sketchterrain.sketch import Sketch

__all__ = [
    "DEFAULT_SIZE",
    "PREVIEW_MEMORY",
    "Memory",
    "Needs",
    "memory_left",
    "needs_of",
    "refuse_impossible",
]

DEFAULT_SIZE: Final = 1025
"""Vertices along the longer side, where there is no target."""
PREVIEW_MEMORY: Final = 1600 << 20
"""Bytes that the one who takes all previews needs; measured with OpenGL on a processor."""
_PREVIEW_DISK: Final = 3 << 20
_VERTEX_DISK: Final = 17  # bytes: heights twice, normals, two pictures of weights, if none could be packed
_PLANT_DISK: Final = 84  # a line of a table
_PLANTS: Final = 0.004  # for a square metre: twice what a preset's woods have
_SHARE: Final = 0.9  # of the memory that is left, which a batch may take


class Needs(NamedTuple):
    """What a terrain takes: vertices, bytes of memory but for its preview, about how many bytes of disk."""

    vertices: int
    memory: float
    disk: float


def needs_of(sketch: Sketch, output: Output) -> Needs:
    """Return what a terrain takes.

    Raises
    ------
    InputError
        If there is no such export or size, or this machine has not the memory for it.
    SketchterrainError
        If a library is not installed.
    """
    east, north = sketch.size
    plants = _PLANTS * east * north * _PLANT_DISK
    if output.target is None:
        size = output.size or DEFAULT_SIZE
        check_size(sketch, size)
        vertices = size * (round((size - 1) * min(east, north) / max(east, north)) + 1)
        memory, disk = memory_needed(sketch, size), _VERTEX_DISK * vertices + plants
    else:
        wanted = plan_of(sketch, output.target, output.options or ExportOptions())
        vertices = wanted.vertices
        memory, disk = export_memory(wanted), wanted.target.disk * vertices + plants
    return Needs(vertices, memory, disk + output.preview * _PREVIEW_DISK)


def refuse_impossible(items: Sequence[Item], output: Output) -> None:
    """Refuse a batch of which nothing can be made; what only some of its sketches lack is told with them.

    Raises
    ------
    SketchterrainError
        What the first one lacks: a size that a target takes, a library, memory.
    """
    problems = []
    for item in {item.source.name: item for item in reversed(items)}.values():
        try:
            needs_of(item.sketch, output)
        except SketchterrainError as error:
            problems.append(error)
        else:
            return
    if problems:
        raise problems[-1]


def memory_left() -> int:
    """Return how many bytes of memory this machine can spare; all that it has where it does not tell."""
    told = proc_memory("meminfo", "MemAvailable")
    return physical_memory() if told is None else told


class Memory:
    """Lets terrains begin while there is memory for them; one that is alone may always.

    Parameters
    ----------
    left
        Bytes that this machine can spare.
    """

    def __init__(self, left: float) -> None:
        self._most = _SHARE * left
        self._taken = 0.0
        self._within = 0
        self._change = Condition()

    @contextmanager
    def room(self, needed: float) -> Iterator[None]:
        """Wait until there are so many bytes, and keep them meanwhile."""
        with self._change:
            self._change.wait_for(lambda: not self._within or self._taken + needed <= self._most)
            self._taken += needed
            self._within += 1
        try:
            yield
        finally:
            with self._change:
                self._taken -= needed
                self._within -= 1
                self._change.notify_all()
