"""`export`: the files of an export target, with a sidecar of import settings."""

import os
import re
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sketchterrain.app.console import Stages
from sketchterrain.app.jobs import run_with_fallback
from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.sketch import Sketch
from sketchterrain.export.files import move_files, prepare_folder, staging
from sketchterrain.export.planning import ExportPlan, checked_plan
from sketchterrain.export.sampled import sample_terrain
from sketchterrain.export.sidecar import stale_export_files, write_sidecar
from sketchterrain.export.target import Export, ExportOptions, ProgressStages
from sketchterrain.io.files import check_disk, wrap_os_errors
from sketchterrain.terrain.building import build
from sketchterrain.terrain.terrain import Terrain

# Reserved file names on Windows, with any suffix.
_RESERVED = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)")


@dataclass(frozen=True)
class ExportResult:
    """The content of the sidecar, and the written files, the sidecar last."""

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
    """Write a sketch's terrain as a target's files, and a sidecar of import settings.

    Files are moved into the folder when all are complete, and stale ones of an earlier export of the sketch
    to the target removed. After a failure of the device everything is computed again on a CPU device.
    """
    plan = checked_plan(sketch, target, options)

    def work(context: ComputeContext, restarts: tuple[str, ...]) -> ExportResult:
        with _prepared(folder), staging(folder) as hidden:
            with stages.stage("features", "Placing features"):
                terrain = build(sketch, device=context)
            done = write_export(plan, terrain, hidden, stages=stages)
            report = done.report | {"restarts": list(restarts)} if restarts else done.report
            stale = stale_export_files(
                folder, report
            )  # as tiles of another layout, which an import must not find
            return ExportResult(report, move_files(folder, done.files, stale=stale))

    return run_with_fallback(work, device=device, fast=fast, stages=stages)


def write_export(plan: ExportPlan, terrain: Terrain, folder: Path, *, stages: ProgressStages) -> ExportResult:
    """Sample a terrain and write a target's files and the sidecar into a hidden folder."""
    _check_disk(plan, terrain, folder)
    with stages.stage("ground", "Heights and materials") as progress:
        sampled = sample_terrain(terrain, plan.grid, progress=progress)
    name = file_name(terrain.sketch.name)
    job = Export(terrain, name, plan.options, plan.grid, plan.tiling, sampled, folder, stages)
    written = plan.target.write(job)
    for file in written.files:  # not all libraries flush to disk
        with wrap_os_errors(file), file.open("rb") as stream:
            os.fsync(stream.fileno())
    path, report = write_sidecar(job, written, plan.target.name)
    return ExportResult(report, (*written.files, path))


def file_name(title: str) -> str:
    """Return a sketch's name as a file name for any system, ``terrain`` if no letter remains.

    >>> file_name("Valley with a river")
    'valley_with_a_river'
    """
    plain = unicodedata.normalize("NFKD", title).encode("ascii", "ignore").decode()
    name = re.sub(r"[^a-z0-9]+", "_", plain.lower()).strip("_")[:64].strip("_")
    return f"terrain_{name}" if _RESERVED.fullmatch(name) else name or "terrain"


@contextmanager
def _prepared(folder: Path) -> Iterator[None]:
    """Create the folder; remove a new one after a failure."""
    new = not folder.exists()
    prepare_folder(folder)
    try:
        yield
    except BaseException:
        if new:
            with suppress(OSError):
                folder.rmdir()
        raise


def _check_disk(plan: ExportPlan, terrain: Terrain, folder: Path) -> None:
    options, target = plan.options, plan.target
    storeys = (("woody",) if options.plants else ()) + (("grass",) if options.grass else ())
    plants = sum(terrain.foliage_estimate(*plan.grid.bounds, storey=storey)[0] for storey in storeys)
    columns, rows = plan.tile_side
    needed = target.disk * columns * rows * plan.tiling.count + target.bytes_per_plant * plants
    check_disk(folder.parent, needed, f"{plan.vertices:.3g} vertices and up to {plants:.3g} plants")
