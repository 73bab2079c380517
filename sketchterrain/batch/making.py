"""One terrain of a batch: its files, and what the manifest says of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sketchterrain import export
from sketchterrain.batch.room import DEFAULT_SIZE
from sketchterrain.export.target import ExportOptions
from sketchterrain.exporting import plan_of, write_export
from sketchterrain.generate import Extras, FoliageFiles, Generated, generate, preview_of
from sketchterrain.render import check_view
from sketchterrain.report import REPORT, replaced_files, said_of, work_of
from sketchterrain.still import weather_at
from sketchterrain.terrain import build, measure_adherence

if TYPE_CHECKING:
    from pathlib import Path

    from sketchterrain.batch.output import Output
    from sketchterrain.compute import ComputeContext
    from sketchterrain.generate import Shared
    from sketchterrain.progress import Stages
    from sketchterrain.sketch import Sketch

__all__ = ["make"]


def make(sketch: Sketch, folder: Path, output: Output, *, shared: Shared, stages: Stages) -> Generated:
    """Write a terrain's files; they come into the folder together, when all of them are there.

    Parameters
    ----------
    sketch
        With the seed and the settings that count.
    folder
        Made if it is not there.
    output
        What is written.
    shared
        With the other terrains of the batch.
    stages
        Told and timed.

    Raises
    ------
    SketchterrainError
        As :func:`~sketchterrain.generate.generate` and :func:`~sketchterrain.exporting.export` do.
    """
    if output.target is not None:
        return _exported(sketch, folder, output, shared, stages)
    return generate(
        sketch,
        folder,
        size=output.size or DEFAULT_SIZE,
        foliage=FoliageFiles(output.foliage, output.grass),
        extras=Extras(output.preview, output.view, map=output.map),
        stages=stages,
        shared=shared,
    )


def _exported(sketch: Sketch, folder: Path, output: Output, shared: Shared, stages: Stages) -> Generated:
    check_view(output.view)
    weather = weather_at(sketch, None, None)
    wanted = plan_of(sketch, output.target or "", output.options or ExportOptions())

    def work(context: ComputeContext, restarts: tuple[str, ...]) -> Generated:
        export.prepare_folder(folder)
        with export.staging(folder) as hidden:
            with stages.stage("features", "Placing features"):
                terrain = build(sketch, device=context, memory=shared.memory)
            done = write_export(wanted, terrain, hidden, stages=stages)
            with stages.stage("adherence", "Comparing with the sketch"):
                adherence = measure_adherence(terrain)
            files, problem, rendering = list(done.files), None, dict[str, float]()
            if output.preview:
                with stages.stage("preview", "Preview"):
                    picture, problem = preview_of(terrain, output.view, weather, shared, rendering)
                    if picture is not None:
                        files += export.write_picture(hidden / "preview.png", picture)
            told = said_of(terrain) | work_of(stages, rendering, files)
            told |= {"target": output.target, "adherence": adherence.as_dict(), "restarts": list(restarts)}
            report = export.write_json(hidden / REPORT, told)
            outdated = replaced_files(folder, told)
            return Generated(told, export.move_into(folder, (*files, report), outdated=outdated), problem)

    return shared.devices.run(work, stages=stages)
