"""A sketch's terrain taken to a program: checked, built, sampled and written in that program's own files."""

from __future__ import annotations

import os
import re
import unicodedata
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sketchterrain.app.jobs import run_with_fallback
from sketchterrain.export.files import move_files, prepare_folder, staging
from sketchterrain.export.planning import checked_plan, memory_needed
from sketchterrain.export.sampled import sample_terrain
from sketchterrain.export.sidecar import stale_export_files, write_sidecar
from sketchterrain.export.target import Export
from sketchterrain.io.files import check_disk, wrap_os_errors
from sketchterrain.terrain.building import build

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from sketchterrain.app.progress import Stages
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.document.sketch import Sketch
    from sketchterrain.export.planning import ExportPlan
    from sketchterrain.export.target import ExportOptions, ProgressStages
    from sketchterrain.terrain.terrain import Terrain

__all__ = ["ExportResult", "checked_plan", "export", "file_name", "memory_needed", "write_export"]

# No file may be named so on Windows, whatever its ending.
_RESERVED = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)")


@dataclass(frozen=True)
class ExportResult:
    """What was written."""

    report: dict[str, Any]
    files: tuple[Path, ...]


def export(
    sketch: Sketch,
    folder: Path,
    target: str,
    options: ExportOptions,
    *,
    device: str | None,
    fast: bool,
    stages: Stages,
) -> ExportResult:
    """Write a sketch's terrain as a target's files, with a sidecar that says what to type in.

    All files come into the folder together, when all of them are there; files of an earlier export of the
    sketch to the target that this one does not have are taken away. Where a device fails everything is done
    again on a CPU device.
    """
    wanted = checked_plan(sketch, target, options)

    def work(context: ComputeContext, restarts: tuple[str, ...]) -> ExportResult:
        with _prepared(folder), staging(folder) as hidden:
            with stages.stage("features", "Placing features"):
                terrain = build(sketch, device=context)
            done = write_export(wanted, terrain, hidden, stages=stages)
            report = done.report | {"restarts": list(restarts)} if restarts else done.report
            outdated = stale_export_files(folder, report)
            # Tiles of another cut go, say: an import of all files must find these alone.
            return ExportResult(report, move_files(folder, done.files, stale=outdated))

    return run_with_fallback(work, device=device, fast=fast, stages=stages)


def write_export(
    wanted: ExportPlan, terrain: Terrain, folder: Path, *, stages: ProgressStages
) -> ExportResult:
    """Sample a terrain and write a target's files and the sidecar."""
    _check_room(wanted, terrain, folder)
    with stages.stage("ground", "Heights and materials") as tell:
        sampled = sample_terrain(terrain, wanted.grid, progress=tell)
    name = file_name(terrain.sketch.name)
    job = Export(terrain, name, wanted.options, wanted.grid, wanted.tiling, sampled, folder, stages)
    written = wanted.target.write(job)
    for file in written.files:  # some libraries leave that to the system
        _flush(file)
    path, told = write_sidecar(job, written, wanted.target.name)
    return ExportResult(told, (*written.files, path))


def file_name(title: str) -> str:
    """Return a sketch's name as the name of a file on any system; ``terrain`` if nothing is left of it.

    >>> file_name("Valley with a river")
    'valley_with_a_river'
    """
    plain = unicodedata.normalize("NFKD", title).encode("ascii", "ignore").decode()
    name = re.sub(r"[^a-z0-9]+", "_", plain.lower()).strip("_")[:64].strip("_")
    return f"terrain_{name}" if _RESERVED.fullmatch(name) else name or "terrain"


@contextmanager
def _prepared(folder: Path) -> Iterator[None]:
    """Make the folder; one that was not there does not stay, empty, after a failure."""
    new = not folder.exists()
    prepare_folder(folder)
    try:
        yield
    except BaseException:
        if new:
            with suppress(OSError):
                folder.rmdir()
        raise


def _flush(file: Path) -> None:
    with wrap_os_errors(file), file.open("rb") as stream:
        os.fsync(stream.fileno())


def _check_room(wanted: ExportPlan, terrain: Terrain, folder: Path) -> None:
    """Refuse what the folder's disk may have no room for, before it is computed."""
    options, target = wanted.options, wanted.target
    storeys = (("woody",) if options.plants else ()) + (("grass",) if options.grass else ())
    plants = sum(terrain.foliage_estimate(*wanted.grid.bounds, storey=each)[0] for each in storeys)
    columns, rows = wanted.tile_side
    needed = target.disk * columns * rows * wanted.tiling.count + target.bytes_per_plant * plants
    check_disk(folder.parent, needed, f"{wanted.vertices:.3g} vertices and up to {plants:.3g} plants")
