"""Command `generate`: all files of a sketch's terrain with a report, moved into one folder once complete."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from sketchterrain.compute.context import ComputeContext
from sketchterrain.compute.device import device_entry
from sketchterrain.document.rasters import raster_problem
from sketchterrain.document.sketch import Sketch, sketch_notes
from sketchterrain.elevation.base import load_base
from sketchterrain.errors import DeviceFailedError, SketchterrainError
from sketchterrain.export.drapes import draped_shapes, write_drapes
from sketchterrain.export.files import move_files, prepare_folder, staging, stale_files, write_json
from sketchterrain.export.foliage_files import FoliageOptions, FoliageResult, check_disk_space, write_foliage
from sketchterrain.export.map.sheet import map_sheet, write_sheet
from sketchterrain.export.rasters import (
    write_appearance,
    write_drainage,
    write_height_png,
    write_height_tif,
    write_materials,
    write_normal_png,
    write_picture,
)
from sketchterrain.export.sampled import SampleGrid, sample_appearance
from sketchterrain.export.vectors import land_facts, write_features
from sketchterrain.generation.building import stored_results
from sketchterrain.generation.terrain import Terrain
from sketchterrain.io.console import Stages
from sketchterrain.io.system import peak_memory, release_freed_memory
from sketchterrain.jobs.export import DeviceFallback, JobResult, build_terrain, noted_drapes
from sketchterrain.jobs.pictures import sketch_weather
from sketchterrain.landforms.placement.feature_types import FEATURE_TYPES
from sketchterrain.measure.adherence import measure_adherence
from sketchterrain.measure.realism import realism_entry
from sketchterrain.render.sky import Weather
from sketchterrain.render.views import check_view
from sketchterrain.roads.network import road_facts
from sketchterrain.stages.runner import Results, Runner
from sketchterrain.terrain.surfaces import Raster

if TYPE_CHECKING:
    from sketchterrain.render.offscreen import SnapshotRenderer

REPORT = "report.json"
TakePicture = Callable[..., npt.NDArray[np.uint8]]
"""Takes a picture of a terrain, with the options of `SnapshotRenderer.picture`."""


def terrain_report(terrain: Terrain, facts: dict[str, Any], plants: FoliageResult) -> dict[str, Any]:
    """Return the report of a terrain and its files; `facts` are those of its raster."""
    features = terrain.features
    kinds = Counter(FEATURE_TYPES[code] for code in features.points["type"].tolist())
    plant_count = sum(plants.counts.values())
    return report_header(terrain) | {
        "extent": terrain.extent,
        **facts,
        **({} if terrain.sea_level is None else {"sea_level": terrain.sea_level}),
        "counts": {
            "features": {name: kinds[name] for name in FEATURE_TYPES},
            "rivers": sum(river.label > 0 for river in features.rivers),
            "streams": sum(river.label == 0 for river in features.rivers),
            "lakes": len(features.lakes),
            "plants": plants.counts,
        },
        "foliage": {
            "files": [path.name for path in plants.files],
            "plants": plant_count,
            "seconds": round(plants.seconds, 4),
            "plants_per_second": round(plant_count / plants.seconds),
        },
    }


def raster_facts(raster: Raster) -> dict[str, Any]:
    """Return the report's entries of a raster: its size, spacing (m) and range of heights (m)."""
    rows, columns = raster.height.shape
    return {
        "size": {"columns": columns, "rows": rows},
        "spacing": {"x": raster.spacing[0], "y": raster.spacing[1]},
        "heights": {"minimum": float(raster.height.min()), "maximum": float(raster.height.max())},
    }


def report_header(terrain: Terrain) -> dict[str, Any]:
    """Return the entries of every report of a terrain."""
    sketch, recipe, context = terrain.sketch, terrain.recipe, terrain.context
    network = recipe.network
    base = load_base(sketch, Runner(terrain.memory))
    return {
        "format": 1,
        "version": version("sketchterrain"),
        "sketch": sketch.name,
        "seed": sketch.seed,
        "device": device_entry(context.device),
        "fast": context.fast,
        "notes": [*sketch_notes(sketch), *filter(None, map(raster_problem, sketch.rasters))],
        "rasters": [source.values | {"found": not raster_problem(source)} for source in sketch.rasters],
        **({} if base is None else {"base": base.facts}),
        "resolutions": [resolution.line for resolution in recipe.resolutions],
        **({"roads": road_facts(network, sketch)} if any(network.lists.values()) else {}),
        **({"landuse": land_facts(sketch)} if len(sketch.vectors["landuse"]) else {}),
        "edits": {"count": len(sketch.edits), "orphans": list(recipe.orphans)},
    }


def run_statistics(stages: Stages, rendering: dict[str, float], files: Sequence[Path]) -> dict[str, Any]:
    """Return times (s), those of the preview's `rendering` too, memory (bytes) and the written files."""
    return {
        "timings": rounded(stages.seconds | {"total": stages.elapsed}),
        "rendering": rounded(rendering),
        "peak_memory": peak_memory(),
        "files": [path.name for path in files] + [REPORT],
    }


def rounded(seconds: dict[str, float]) -> dict[str, float]:
    """Return times rounded to 0.1 ms."""
    return {name: round(value, 4) for name, value in seconds.items()}


@dataclass(frozen=True)
class GenerateOptions:
    """Resolution, files of plants, and pictures."""

    size: int  # vertices along the longer side
    foliage: FoliageOptions = field(default_factory=FoliageOptions)
    preview: bool = True
    view: str = "auto"  # kind of view of the preview
    hour: float | None = None  # in place of the sketch's, as sky and clouds
    sky: str | None = None
    clouds: float | None = None
    map: str | None = None  # png or svg


@dataclass(frozen=True)
class SharedResources:
    """Resources shared by the terrains of one process."""

    devices: DeviceFallback
    memory: Results = field(default_factory=Results)
    take_picture: TakePicture | None = None  # by default that of a `SnapshotRenderer`


def generate(
    sketch: Sketch,
    folder: Path,
    options: GenerateOptions,
    *,
    device: str | None = None,
    fast: bool = False,
    stages: Stages,
    shared: SharedResources | None = None,
) -> JobResult:
    """Write a sketch's terrain: heights, normals, materials, plants, features, pictures and a report.

    Files are moved into the folder when all are complete, and stale ones of the previous run removed. After a
    failure of the device everything is computed again on a CPU device. `shared` replaces `device`, `fast`.
    """
    check_view(options.view)
    weather = sketch_weather(sketch, options.hour, options.sky, options.clouds)
    use = shared or SharedResources(DeviceFallback(device, fast=fast), stored_results())

    def write(context: ComputeContext, hidden: Path) -> JobResult:
        return _write_files(sketch, hidden, options, weather, context, use, stages)

    return write_together(folder, write, use.devices, stages)


def write_together(
    folder: Path,
    write: Callable[[ComputeContext, Path], JobResult],
    devices: DeviceFallback,
    stages: Stages,
) -> JobResult:
    """Write files and a report into a hidden folder, and move them into `folder` once all are complete."""

    def work(context: ComputeContext, restarts: tuple[str, ...]) -> JobResult:
        prepare_folder(folder)
        with staging(folder) as hidden:
            done = write(context, hidden)
            done.report["restarts"] = list(restarts)
            report = write_json(hidden / REPORT, done.report)
            stale = stale_files(folder / REPORT, done.report, ("format", "target"))
            return replace(done, files=move_files(folder, (*done.files, report), stale=stale))

    return devices.run(work, stages=stages)


def _write_files(
    sketch: Sketch,
    folder: Path,
    options: GenerateOptions,
    weather: Weather,
    context: ComputeContext,
    shared: SharedResources,
    stages: Stages,
) -> JobResult:
    with _BackgroundWriter() as writer, ExitStack() as stack:
        painter = ThreadPoolExecutor(1, "preview")
        stack.callback(painter.shutdown, wait=False)  # after an error nobody waits for the picture
        take_picture = None
        if options.preview:
            take_picture = shared.take_picture or _picture_taker(painter, sketch, context.device, stack)
        kernels = ["tiles.cl", "points.cl"]
        kernels += ["graded_poisson.cl"] if options.preview or options.foliage.formats else []
        kernels += ["terrain.cl"] if options.preview else []  # tiles from afar
        terrain = build_terrain(sketch, context, stages, shared.memory, kernels=kernels)
        area = (0.0, 0.0, *terrain.size)
        check_disk_space(folder, terrain, area, options.foliage)
        with stages.stage("ground", "Heights and materials") as progress:
            raster = terrain.raster(options.size, progress=progress)
        rendering = dict[str, float]()
        rendered = None
        if take_picture is not None:
            rendered = painter.submit(render_preview, terrain, options.view, weather, take_picture, rendering)
        writer.add("height.tif", write_height_tif, folder, raster)
        writer.add("height.png", write_height_png, folder, raster)
        writer.add("normal.png", write_normal_png, folder, raster)
        writer.add("materials", write_materials, folder, raster, terrain.material_names)
        rows, columns = raster.height.shape
        painted = sample_appearance(terrain, SampleGrid(0.0, 0.0, *terrain.size, columns, rows))
        if painted is not None:
            writer.add("appearance.png", write_appearance, folder, painted)
        drapes = noted_drapes(terrain)
        shapes = draped_shapes(drapes, terrain, area, max(raster.spacing))
        writer.add("drapes.gpkg", write_drapes, folder / "drapes.gpkg", shapes, terrain)
        facts = raster_facts(raster)
        del raster  # freed once written
        writer.add("drainage", write_drainage, folder, terrain.drainage())
        writer.add("features.json", write_features, folder, terrain.features)
        with stages.stage("plants", "Plants") as progress:
            plants = write_foliage(folder, terrain, area, options.foliage, progress=progress)
        terrain.release_buffers()
        report = terrain_report(terrain, facts, plants) | measure_terrain(terrain, stages)
        if shared.take_picture is None:  # no other terrain follows; drawing needs most
            shared.memory.clear()
            release_freed_memory()
        problem = None
        if options.map is not None:
            with stages.stage("map", "Drawing the map"):
                name = f"map.{options.map}"
                writer.add(name, write_sheet, folder / name, map_sheet(terrain, drapes))
        if rendered is not None:
            with stages.stage("preview", "Preview"):
                picture, problem = rendered.result()
                if picture is not None:
                    writer.add("preview.png", write_picture, folder / "preview.png", picture)
        with stages.stage("files", "Writing files"):
            files = writer.finish() + plants.files
    report["notes"] += () if drapes is None else (*drapes.problems, *drapes.notes)
    report |= run_statistics(stages, rendering, files) | {"writing": rounded(writer.seconds)}
    return JobResult(report, files, problem)


def measure_terrain(terrain: Terrain, stages: Stages) -> dict[str, Any]:
    """Return the entries of a report that compare a terrain with its sketch and with real land."""
    with stages.stage("adherence", "Comparing with the sketch"):
        adherence = measure_adherence(terrain).as_dict()
    with stages.stage("realism", "Comparing with real land"):
        return {"adherence": adherence, "realism": realism_entry(terrain)}


class _BackgroundWriter:
    """Encodes and writes files in order on a thread, while the device computes."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="writer")
        self._jobs: list[Future[tuple[Path, ...]]] = []

    def __enter__(self) -> _BackgroundWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self._thread.shutdown(wait=True, cancel_futures=True)

    def add(self, name: str, write: Callable[..., tuple[Path, ...]], *arguments: object) -> None:
        """Queue a file; raise the failure of an earlier one."""

        def timed() -> tuple[Path, ...]:
            start = time.perf_counter()
            paths = write(*arguments)
            self.seconds[name] = time.perf_counter() - start
            return paths

        for job in self._jobs:
            if job.done():
                job.result()
        self._jobs.append(self._thread.submit(timed))

    def finish(self) -> tuple[Path, ...]:
        """Wait for all files and return their paths, or raise the first failure."""
        return tuple(path for job in self._jobs for path in job.result())


def _picture_taker(
    painter: ThreadPoolExecutor, sketch: Sketch, device: object, stack: ExitStack
) -> TakePicture:
    """Return what takes pictures on a thread, with a renderer opened meanwhile and closed with `stack`."""

    def opened() -> SnapshotRenderer:
        from sketchterrain.render.offscreen import SnapshotRenderer

        renderer = SnapshotRenderer()
        renderer.load_textures(sketch, device)
        return renderer

    future = painter.submit(opened)
    stack.callback(painter.submit, lambda: future.result().close())
    return lambda terrain, **request: future.result().picture(terrain, **request)


def render_preview(
    terrain: Terrain,
    view: str,
    weather: Weather,
    take_picture: TakePicture,
    timings: dict[str, float],
) -> tuple[npt.NDArray[np.uint8] | None, str | None]:
    """Return a preview, (height, width, 3), or None and the reason, as on a machine without OpenGL."""
    try:
        return take_picture(terrain, view=view, weather=weather, timings=timings), None
    except DeviceFailedError:  # the compute device, whose other results are then not trustworthy either
        raise
    except SketchterrainError as error:
        return None, str(error)
