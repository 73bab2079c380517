"""What an export will be and whether this machine has the memory for it; loads nothing that computes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sketchterrain.disk import format_bytes
from sketchterrain.errors import InputError
from sketchterrain.export.planning import plan_export
from sketchterrain.export.sampled import BYTES_PER_VERTEX
from sketchterrain.export.targets import target_named
from sketchterrain.system import physical_memory

if TYPE_CHECKING:
    from sketchterrain.export.planning import ExportPlan
    from sketchterrain.export.target import ExportOptions
    from sketchterrain.sketch import Sketch

_BYTES_AT_LEAST = 500 << 20  # the program, what a device compiles, a band of rows


def checked_plan(sketch: Sketch, target: str, options: ExportOptions) -> ExportPlan:
    """Return what an export will be, refused where this machine has not the memory for it."""
    wanted = plan_export(sketch, target_named(target), options)
    needed, there = memory_needed(wanted), physical_memory()
    if needed > there:
        size = f"{wanted.grid.columns} × {wanted.grid.rows} vertices"
        raise InputError(
            f"{size} need about {format_bytes(needed)} of memory, this machine has {format_bytes(there)}"
        )
    return wanted


def memory_needed(wanted: ExportPlan) -> float:
    """Return about how many bytes of memory an export takes."""
    return _BYTES_AT_LEAST + wanted.vertices * (BYTES_PER_VERTEX + wanted.target.memory)
