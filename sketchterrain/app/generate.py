"""Everything that a sketch's terrain is exported as, into one folder, once."""

from __future__ import annotations

import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

from sketchterrain.app.estimates import MAX_SIZE, check_size
from sketchterrain.app.jobs import DeviceFallback
from sketchterrain.app.report import REPORT, rounded, run_statistics, stale_report_files, terrain_report
from sketchterrain.app.stills import sketch_weather
from sketchterrain.errors import DeviceFailedError, SketchterrainError
from sketchterrain.export.files import move_files, prepare_folder, staging, write_json
from sketchterrain.export.foliage_files import FoliageOptions, check_disk_space, write_foliage
from sketchterrain.export.map.sheet import map_sheet, write_sheet
from sketchterrain.export.rasters import (
    write_height_png,
    write_height_tif,
    write_materials,
    write_normal_png,
    write_picture,
)
from sketchterrain.export.vectors import write_features
from sketchterrain.placement.cache import PlacementCache
from sketchterrain.render.views import check_view
from sketchterrain.terrain.adherence import measure_adherence
from sketchterrain.terrain.building import build

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import numpy as np
    import numpy.typing as npt

    from sketchterrain.app.progress import Stages
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.document.sketch import Sketch
    from sketchterrain.render.sky import Weather
    from sketchterrain.terrain.terrain import Terrain

    class TakePicture(Protocol):
        """Takes one picture, as :func:`~sketchterrain.render.snapshot.render_picture` does."""

        def __call__(
            self, terrain: Terrain, *, view: str, weather: Weather, timings: dict[str, float]
        ) -> npt.NDArray[np.uint8]: ...


__all__ = [
    "MAX_SIZE",
    "FoliageOptions",
    "GenerateResult",
    "PreviewOptions",
    "SharedResources",
    "check_size",
    "generate",
    "render_preview",
]


@dataclass(frozen=True)
class PreviewOptions:
    """Pictures besides the files."""

    preview: bool = True
    view: str = "auto"
    hour: float | None = None
    clouds: float | None = None
    map: str | None = None


@dataclass(frozen=True)
class GenerateResult:
    """What :func:`generate` did."""

    report: dict[str, Any]
    files: tuple[Path, ...]
    problem: str | None


@dataclass(frozen=True)
class SharedResources:
    """What several terrains that one process makes need only once."""

    devices: DeviceFallback
    memory: PlacementCache = field(default_factory=PlacementCache)
    take_picture: TakePicture | None = None


def generate(
    sketch: Sketch,
    folder: Path,
    *,
    device: str | None = None,
    fast: bool = False,
    size: int,
    foliage: FoliageOptions | None = None,
    extras: PreviewOptions,
    stages: Stages,
    shared: SharedResources | None = None,
) -> GenerateResult:
    """Write a sketch's terrain: heights, normals, materials, plants, features, a picture and a report.

    All files come into the folder together, when all of them are there; those of the last time that this time
    has none in place of are taken away. Where a device fails everything is
    done again on a CPU device: the files are never a mixture.
    """
    check_view(extras.view)
    weather = sketch_weather(sketch, extras.hour, extras.clouds)
    use = shared or SharedResources(DeviceFallback(device, fast=fast))

    def work(context: ComputeContext, restarts: tuple[str, ...]) -> GenerateResult:
        prepare_folder(folder)
        with staging(folder) as hidden:
            done = _generate(
                sketch,
                hidden,
                context=context,
                shared=use,
                size=size,
                foliage=foliage or FoliageOptions(),
                extras=extras,
                weather=weather,
                stages=stages,
            )
            done.report["restarts"] = list(restarts)
            report = write_json(hidden / REPORT, done.report)
            outdated = stale_report_files(folder, done.report)  # the preview of another terrain, say
            return replace(done, files=move_files(folder, (*done.files, report), stale=outdated))

    return use.devices.run(work, stages=stages)


def _generate(
    sketch: Sketch,
    folder: Path,
    *,
    context: ComputeContext,
    shared: SharedResources,
    size: int,
    foliage: FoliageOptions,
    extras: PreviewOptions,
    weather: Weather,
    stages: Stages,
) -> GenerateResult:
    """Write all files but the report."""
    with _Writer() as writer:
        with stages.stage("features", "Placing features"):
            terrain = build(sketch, device=context, memory=shared.memory)
            features = terrain.features
        area = (0.0, 0.0, *terrain.size)
        check_disk_space(folder, terrain, area, foliage)
        with stages.stage("ground", "Heights and materials") as tell:
            raster = terrain.raster(size, progress=tell)
        writer.add("height.tif", write_height_tif, folder, raster)
        writer.add("height.png", write_height_png, folder, raster)
        writer.add("normal.png", write_normal_png, folder, raster)
        writer.add("materials", write_materials, folder, raster, terrain.material_names)
        writer.add("features.json", write_features, folder, features)
        with stages.stage("plants", "Plants") as tell:
            plants = write_foliage(folder, terrain, area, foliage, progress=tell)
        with stages.stage("adherence", "Comparing with the sketch"):
            adherence = measure_adherence(terrain)
        problem, rendering = None, dict[str, float]()
        if extras.map is not None:
            with stages.stage("map", "Drawing the map"):
                name = f"map.{extras.map}"
                writer.add(name, write_sheet, folder / name, map_sheet(terrain))
        if extras.preview:
            with stages.stage("preview", "Preview"):
                picture, problem = render_preview(terrain, extras.view, weather, shared, rendering)
                if picture is not None:
                    writer.add("preview.png", write_picture, folder / "preview.png", picture)
        with stages.stage("files", "Writing files"):
            files = writer.finish() + plants.files
    told = terrain_report(terrain, raster, plants)
    told["adherence"] = adherence.as_dict()
    told |= run_statistics(stages, rendering, files)
    told["writing"] = rounded(writer.seconds)
    return GenerateResult(told, files, problem)


class _Writer:
    """Encodes and writes files on a thread of its own, in the order given, while the device works on."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="writer")
        self._jobs: list[Future[tuple[Path, ...]]] = []

    def __enter__(self) -> _Writer:
        return self

    def __exit__(self, *_: object) -> None:
        # A file that is being written is finished; after an error the ones that wait are not begun.
        self._thread.shutdown(wait=True, cancel_futures=True)

    def add(self, name: str, write: Callable[..., tuple[Path, ...]], *arguments: object) -> None:
        """Queue one writer; an earlier one's failure is raised now, before more work is done for nothing."""
        for job in self._jobs:
            if job.done():
                job.result()
        self._jobs.append(self._thread.submit(self._timed, name, write, *arguments))

    def finish(self) -> tuple[Path, ...]:
        """Wait for all files and return their paths; the first failure is raised."""
        return tuple(path for job in self._jobs for path in job.result())

    def _timed(
        self, name: str, write: Callable[..., tuple[Path, ...]], *arguments: object
    ) -> tuple[Path, ...]:
        start = time.perf_counter()
        paths = write(*arguments)
        self.seconds[name] = time.perf_counter() - start
        return paths


def render_preview(
    terrain: Terrain, view: str, weather: Weather, shared: SharedResources, timings: dict[str, float]
) -> tuple[npt.NDArray[np.uint8] | None, str | None]:
    """Render a preview; a machine without OpenGL still gets all the rest."""
    from sketchterrain.render.snapshot import render_picture

    take = shared.take_picture or render_picture
    try:
        return take(terrain, view=view, weather=weather, timings=timings), None
    except DeviceFailedError:  # not OpenGL's failure: what the device made before is not to be trusted either
        raise
    except SketchterrainError as error:
        return None, str(error)
