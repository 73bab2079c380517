"""Exports of a terrain, and jobs that restart on another device when one fails."""

from __future__ import annotations

import os
import re
import unicodedata
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any, TypeVar

from sketchterrain.compute.context import ComputeContext
from sketchterrain.compute.device import Device, choose_device, fallback_device
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import DeviceFailedError
from sketchterrain.export.drapes import draped_shapes, write_drapes
from sketchterrain.export.engines import requested_storeys
from sketchterrain.export.files import move_files, prepare_folder, staging, stale_files
from sketchterrain.export.planning import ExportPlan, checked_plan
from sketchterrain.export.sampled import sample_terrain
from sketchterrain.export.target import (
    SIDECAR,
    Export,
    ExportOptions,
    SceneView,
    check_sidecar,
    write_sidecar,
)
from sketchterrain.generation.building import TERRAIN_KERNELS, build, build_kernels, stored_results
from sketchterrain.generation.self_test import self_test
from sketchterrain.generation.terrain import Terrain
from sketchterrain.io.console import Stages, print_note
from sketchterrain.io.files import check_disk, wrap_os_errors
from sketchterrain.stages.runner import Results

if TYPE_CHECKING:
    from sketchterrain.drape.drapes import Drapes
    from sketchterrain.render.scene import TerrainSource

T = TypeVar("T")


class DeviceFallback:
    """The device of jobs, which may be concurrent; once it fails a CPU device replaces it for good."""

    def __init__(self, device: str | None, *, fast: bool = False) -> None:
        self.fast = fast
        self._device = choose_device(device)
        self._failed: list[Device] = []
        self._reported: set[Device] = set()
        self._lock = Lock()

    def run(self, work: Callable[[ComputeContext, tuple[str, ...]], T], *, stages: Stages) -> T:
        """Run work on the device, and all of it again on a CPU device if the device fails.

        `work` gets an open device and a line for each device that failed; it must have no effect before it
        returns. Raise DeviceFailedError if no device remains.
        """
        restarts: list[str] = []
        while True:
            device = self._device
            try:
                with stages.stage("device", "Opening the device"):
                    if not self.fast:
                        self._check_bits(device)
                    context = ComputeContext(device, fast=self.fast)
                return work(context, tuple(restarts))
            except DeviceFailedError as error:
                spare = self._replacement(device, error)
                restarts.append(f"{error}; restarted on {spare.name} ({spare.platform})")
            print_note(restarts[-1])

    def _replacement(self, failed: Device, error: DeviceFailedError) -> Device:
        """Return the device to use after a failure, which several jobs may report at once."""
        with self._lock:
            if failed not in self._failed:
                self._failed.append(failed)
            if self._device in self._failed:
                spare = fallback_device(self._failed)
                if spare is None:
                    raise DeviceFailedError(f"{error}; there is no other device to restart on") from error
                self._device = spare
            return self._device

    def _check_bits(self, device: Device) -> None:
        # Comparing terrain takes longer than opening, so drivers whose bits the tests hold are exempt.
        with self._lock:
            verdict = self_test(device, compare=not device.known)
            reported = device in self._reported
            self._reported.add(device)
        if verdict.bits == "failed":
            raise DeviceFailedError(f"{device.name} ({device.platform}) failed: {verdict.detail}")
        if verdict.bits != "same" and not reported:
            print_note(f"self-test of {device.name} ({device.platform}): {verdict.line}")


def build_terrain(
    sketch: Sketch,
    context: ComputeContext,
    stages: Stages,
    memory: Results | None = None,
    *,
    kernels: Sequence[str] = TERRAIN_KERNELS,
) -> Terrain:
    """Return the terrain of a sketch, built as a stage of a job; by default with the results on disk.

    `kernels` are the files of those that the job uses, which are built meanwhile.
    """
    build_kernels(context, sketch.material_table, kernels)
    memory = stored_results() if memory is None else memory
    with stages.stage("features", "Placing features") as progress:
        return build(sketch, device=context, memory=memory, progress=progress)


# Reserved file names on Windows, with any suffix.
_RESERVED = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)")


@dataclass(frozen=True)
class JobResult:
    """The content of the report or sidecar, the written files (it last), and why the preview is missing."""

    report: dict[str, Any]
    files: tuple[Path, ...]
    problem: str | None = None


def export(
    sketch: Sketch,
    folder: Path,
    target: str,
    options: ExportOptions,
    *,
    device: str | None,
    fast: bool,
    stages: Stages,
) -> JobResult:
    """Write a sketch's terrain as a target's files, and a sidecar of import settings.

    Files are moved into the folder when all are complete, and stale ones of an earlier export of the sketch
    to the target removed. A folder with the export of another is refused (`check_sidecar`). After a failure
    of the device everything is computed again on a CPU device.
    """
    plan = checked_plan(sketch, target, options)
    check_sidecar(folder, sketch.name, target)

    def work(context: ComputeContext, restarts: tuple[str, ...]) -> JobResult:
        with _prepared(folder), staging(folder) as hidden:
            terrain = build_terrain(sketch, context, stages)
            done = write_export(plan, terrain, hidden, stages=stages)
            report = done.report | {"restarts": list(restarts)} if restarts else done.report
            # As tiles of another layout, which an import must not find.
            stale = stale_files(folder / SIDECAR, report, ("format", "target", "sketch"))
            return JobResult(report, move_files(folder, done.files, stale=stale))

    return DeviceFallback(device, fast=fast).run(work, stages=stages)


def write_export(plan: ExportPlan, terrain: Terrain, folder: Path, *, stages: Stages) -> JobResult:
    """Sample a terrain and write a target's files and the sidecar into a hidden folder."""
    _check_disk(plan, terrain, folder)
    with stages.stage("ground", "Heights and materials") as progress:
        sampled = sample_terrain(terrain, plan.grid, progress=progress)
    name = file_name(terrain.sketch.name)
    found = noted_drapes(terrain) if terrain.sketch.drapes else None
    drapes = draped_shapes(found, terrain, plan.grid.bounds, max(plan.grid.spacing))
    view = None
    if plan.target.scene:
        with stages.stage("view", "Choosing a view"):
            view = scene_view(terrain)
    job = Export(terrain, name, plan.options, plan.grid, plan.tiling, sampled, folder, stages, drapes, view)
    written = plan.target.write(job)
    options = plan.options
    for path in write_drapes(folder / f"{name}_drapes.gpkg", drapes, terrain, options.crs, options.origin):
        written.files[path] = "draped vector layers on the ground, with their properties"
    for file in written.files:  # not all libraries flush to disk
        with wrap_os_errors(file), file.open("rb") as stream:
            os.fsync(stream.fileno())
    path, report = write_sidecar(job, written, plan.target.name)
    return JobResult(report, (*written.files, path))


def scene_view(terrain: TerrainSource) -> SceneView:
    """Return the camera that `find_view` chooses and the light of the sketch's hour and weather."""
    from sketchterrain.render.atmosphere import AEROSOL_HEIGHT, RAYLEIGH_HEIGHT
    from sketchterrain.render.sky import SkyLight, Weather, sun_for_view
    from sketchterrain.render.views import find_view

    weather = Weather.from_sketch(terrain.sketch)
    camera = find_view(terrain, weather=weather)
    sun = sun_for_view(terrain, camera, weather)
    light = SkyLight(sun, weather, extent=terrain.extent)
    return SceneView(
        eye=camera.eye,
        target=camera.target,
        fov=camera.fov,
        sun_azimuth=sun.azimuth,
        sun_elevation=sun.elevation,
        sunlight=light.sunlight,
        harmonics=light.harmonics,
        sky=light.table(camera.eye[2]),
        haze=light.haze,
        haze_height=AEROSOL_HEIGHT,
        air=light.rayleigh,
        air_height=RAYLEIGH_HEIGHT,
        exposure=light.exposure(camera.heading),
        weather=asdict(weather),
    )


def noted_drapes(terrain: TerrainSource) -> Drapes | None:
    """Return the draped layers of a terrain's sketch, None without any; print a note of unreadable ones."""
    from sketchterrain.render.offscreen import open_drapes  # loads OpenGL

    drapes = open_drapes(terrain)
    print_note(*(() if drapes is None else (*drapes.problems, *drapes.notes)))
    return drapes


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
    storeys = requested_storeys(options)
    plants = sum(terrain.foliage_estimate(*plan.grid.bounds, storey=storey)[0] for storey in storeys)
    columns, rows = plan.tile_side
    needed = target.disk * columns * rows * plan.tiling.count + target.bytes_per_plant * plants
    check_disk(folder.parent, needed, f"{plan.vertices:.3g} vertices and up to {plants:.3g} plants")
