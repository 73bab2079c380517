"""The engine process: follows the newest terrain, renders frames, answers requests of the window."""

from __future__ import annotations

import json
import os
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from sketchterrain.errors import DeviceError, DeviceFailedError, SketchterrainError, one_line
from sketchterrain.io.system import lower_priority, resident_memory
from sketchterrain.render.sky import Weather
from sketchterrain.render.views import find_view
from sketchterrain.ui.engine import protocol as msg
from sketchterrain.ui.engine.background import JobQueue
from sketchterrain.ui.engine.camera_controller import CameraController
from sketchterrain.ui.engine.channel import Channel, ready
from sketchterrain.ui.engine.frames import FrameMemory, FramePacer
from sketchterrain.ui.engine.terrain_session import ReliefBuilder, TerrainSession, WorldSession

if TYPE_CHECKING:
    from sketchterrain.document.drapes import DrapedLayer

_SLICE: Final = 0.008  # s of relief computation between two frames
_IDLE_SLICE: Final = 0.03  # s at a time while no frame is due
_NICENESS: Final = 2  # under load the window and the placer go first


class Engine:
    """Serves the window on one thread; without placer a stored world, without pacer (OpenGL) no frames."""

    def __init__(
        self,
        window: Channel,
        placer: Channel | None,
        *,
        session: TerrainSession,
        pacer: FramePacer | None,
        jobs: JobQueue,
        facts: msg.EngineFacts,
    ) -> None:
        self._window, self._placer = window, placer
        self._session, self._pacer, self._jobs = session, pacer, jobs
        self._facts = facts
        self._relief = ReliefBuilder()
        self._camera: CameraController | None = None
        self._view = msg.ViewState()
        self._pending_version, self._fresh_version = -1, -1
        self._requested_look: msg.Look | None = None
        self._drapes: tuple[DrapedLayer, ...] = ()
        self._activity = ""
        self._running = True
        self._handlers: dict[type, Callable[[Any], None]] = {
            msg.Quit: self._quit,
            msg.ViewState: self._set_view,
            msg.FrameAcknowledged: self._acknowledge_frame,
            msg.Look: self._look,
            msg.PickRequest: self._pick,
            msg.MeasureAdherence: self._measure,
            msg.RenderPicture: self._render_picture,
            msg.UpdatePending: self._expect_update,
            msg.SetDrapes: self._set_drapes,
            **dict.fromkeys((msg.Turn, msg.Pan, msg.Zoom, msg.Fly, msg.GoTo), self._move),
        }

    def run(self) -> None:
        """Serve until `Quit`, or until the window or the placer has ended."""
        try:
            self._window.send(self._facts)
            while self._running:
                self._step()
        except EOFError:
            return
        finally:
            self._jobs.close()

    def _step(self) -> None:
        """Wait for messages or the next deadline, and handle what is due."""
        updates: list[msg.RecipeUpdate] = []
        channels = [each for each in (self._window, self._placer) if each is not None]
        jobs = self._jobs.channel
        deadlines = [each for each in (self._frame_due(), self._relief_due()) if each is not None]
        pending = ready(channels if jobs is None else [*channels, jobs], min(deadlines, default=None))
        while pending:  # all of them: the newest terrain and the newest camera count
            for channel in pending:
                if channel is self._placer:
                    updates.append(channel.receive())
                elif channel is self._window:
                    message = channel.receive()
                    self._guarded("engine", partial(self._handlers[type(message)], message))
                else:
                    self._window.send(self._jobs.receive())
            pending = ready(channels, 0.0)
        if updates:
            self._guarded("view", lambda: self._follow(updates))
        due = self._frame_due()
        if due is not None and due <= 0.0:
            self._guarded("view", self._draw)
        if self._relief_due() == 0.0:
            self._guarded("engine", self._build_relief)
        self._report_activity("")

    def _frame_due(self) -> float | None:
        """Return the s until the next frame; None: none is due."""
        if self._pacer is None:
            return None
        if self._camera is None:  # a stored world is available from the start, the view's size is not
            waits = self._session.terrain is not None and self._view.width and not self._pacer.failed
            return 0.0 if waits else None
        return self._pacer.due(moving=self._camera.restless)

    def _relief_due(self) -> float | None:
        """Return the s until the relief is resumed; None: it is up to date."""
        if self._session.terrain is None:
            return None
        return self._relief.due(update_pending=self._pending_version > self._session.version)

    def _guarded(self, source: str, work: Callable[[], None]) -> None:
        """Run a step; an exception is reported, and the last good terrain stays."""
        try:
            work()
        except EOFError:
            raise
        except DeviceFailedError as error:
            self._switch_device(error)
        except SketchterrainError as error:
            self._report_error(source, one_line(error))
        except Exception as error:  # noqa: BLE001 # a defect must not end the view
            traceback.print_exc()
            self._report_error(source, one_line(f"{type(error).__name__}: {error}"))

    def _report_error(self, source: str, line: str) -> None:
        if source == "view" and self._pacer is not None:
            self._pacer.stop()
        self._window.send(msg.ErrorReport(source, line))

    def _switch_device(self, error: DeviceFailedError) -> None:
        self._window.send(msg.ErrorReport("engine", one_line(f"{error}; {self._session.switch_device()}")))
        if self._pacer is not None:
            self._pacer.renderer.clear()
        device = self._session.device
        name, platform = ("", "") if device is None else (device.name, device.platform)
        self._update_facts(device=name, platform=platform, device_error=self._session.device_error)
        self._guarded("view", self._show_terrain)

    def _follow(self, updates: list[msg.RecipeUpdate]) -> None:
        received = time.monotonic()
        self._session.apply(updates)
        self._show_terrain()
        placed = next((each for each in reversed(updates) if each.recipe is not None), updates[-1])
        times = placed.started, placed.placed, received, time.monotonic()
        self._window.send(msg.TerrainUpdated(updates[-1].version, *times, draft=updates[-1].draft))

    def _show_terrain(self) -> None:
        terrain, version, areas = self._session.terrain, self._session.version, self._session.dirty_areas
        if terrain is None:
            return
        fresh = self._fresh_version >= 0 <= version - self._fresh_version
        if self._camera is None or self._camera.size != terrain.size or fresh:
            self._camera, self._fresh_version = CameraController(terrain, aspect=self._view.aspect), -1
            self._camera.set_mode(self._view.mode)
            if self._pacer is not None:
                self._pacer.jump()
            sketch = self._session.sketch
            painted = sketch is not None and any(image.any() for image in sketch.layers.values())
            if self._requested_look is not None or painted:  # an empty sketch is seen as a whole
                self._look(self._requested_look or msg.Look())
        else:
            self._camera.set_terrain(terrain)
        if self._session.sketch is not None:
            self._relief.set_terrain(terrain, version, areas)
            if not self._relief.busy:
                self._window.send(msg.Unchanged("relief", version))
        pacer = self._pacer
        if pacer is not None:
            pacer.set_update_pending(self._pending_version > version)
            if pacer.renderer.is_empty:
                self._report_activity("Preparing the picture")
            line = pacer.set_terrain(terrain, version, areas, self._camera)
            if line:
                self._window.send(msg.ErrorReport("view", line))
            self._update_facts(sharing=pacer.renderer.sharing)
        self._session.dirty_areas = []

    def _draw(self) -> None:
        assert self._pacer is not None  # noqa: S101 # a frame is due
        if self._camera is None or self._pacer.renderer.is_empty:
            self._show_terrain()
        frame = None if self._camera is None else self._pacer.draw(self._camera)
        if frame is not None:
            self._window.send(frame)

    def _build_relief(self) -> None:
        idle = self._pacer is None or self._pacer.due(moving=False) is None
        relief = self._relief.work(_IDLE_SLICE if idle else _SLICE)
        if relief is not None:
            self._window.send(relief)

    def _quit(self, _: msg.Quit) -> None:
        self._running = False

    def _set_view(self, view: msg.ViewState) -> None:
        self._view = view
        if self._camera is not None:
            self._camera.set_mode(view.mode)
        if self._pacer is not None:
            self._pacer.set_view(view)

    def _set_drapes(self, drapes: msg.SetDrapes) -> None:
        self._drapes = drapes.layers
        if self._pacer is not None:
            self._pacer.set_drapes(drapes)

    def _acknowledge_frame(self, _: msg.FrameAcknowledged) -> None:
        if self._pacer is not None:
            self._pacer.acknowledge_frame()

    def _expect_update(self, pending: msg.UpdatePending) -> None:
        # Counted from the first pending version: during a long stroke the image must still refine.
        if self._pacer is not None and self._pending_version <= self._session.version:
            self._pacer.set_update_pending(True)
        self._pending_version = pending.version
        if pending.fresh:
            self._fresh_version = pending.version

    def _move(self, motion: Any) -> None:
        if self._camera is not None:
            self._camera.handle(motion, aspect=self._view.aspect)

    def _look(self, look: msg.Look) -> None:
        terrain = self._session.terrain
        self._requested_look = look if self._camera is None else None
        if self._camera is None or terrain is None:
            return
        if self._pacer is not None:
            self._pacer.jump()
        if look.pose is not None:
            self._camera.set_camera(look.pose)
            return
        self._report_activity("Looking for a view")
        self._camera.set_camera(find_view(terrain, weather=Weather.from_sketch(terrain.sketch)))

    def _pick(self, pick: msg.PickRequest) -> None:
        place = None if self._camera is None else self._camera.pick(pick.x, pick.y, aspect=self._view.aspect)
        self._window.send(msg.PickResult(pick.token, place))

    def _measure(self, _: msg.MeasureAdherence) -> None:
        session = self._session
        if session.sketch is None or session.recipe is None or session.terrain is None:
            raise SketchterrainError(session.device_error or "the terrain is not ready yet")
        self._jobs.add(msg.MeasureJob(session.version, session.sketch, session.recipe))

    def _render_picture(self, request: msg.RenderPicture) -> None:
        pacer, sketch, recipe = self._pacer, self._session.sketch, self._session.recipe
        sun = None if pacer is None else pacer.renderer.sun
        if pacer is None or sun is None or self._camera is None or sketch is None or recipe is None:
            error = self._facts.opengl_error or self._facts.device_error
            self._window.send(msg.ErrorReport("picture", error or "the 3-D view is not ready yet"))
            return
        self._jobs.add(
            msg.PictureJob(
                sketch=sketch.replace(drapes=self._drapes),
                recipe=recipe,
                path=request.path,
                size=(request.width, request.height),
                pose=self._camera.camera(),
                sun=(sun.azimuth, sun.elevation),
                clock=pacer.clock,
                overlays=tuple(self._view.overlays),
            )
        )

    def _update_facts(self, **changes: str) -> None:
        facts = replace(self._facts, **changes)
        if facts != self._facts:
            self._facts = facts
            self._window.send(facts)

    def _report_activity(self, text: str) -> None:
        text = text or self._jobs.activity
        if text != self._activity:
            self._activity = text
            self._window.send(msg.Activity(text))


def _main(options: dict[str, Any]) -> None:
    """Run the engine.

    Options: file descriptors ``window``, ``placer`` (None for a stored world) and ``frames``; process
    ``placer_id``; ``world``, a path or None; ``device``, a selector or None; ``draws``: open OpenGL.
    """
    lower_priority(_NICENESS)
    window = Channel.from_descriptor(options["window"], patient=False)
    window.send(msg.Activity("Opening the world" if options["world"] else "Opening the device"))
    try:
        parts = _open(window, options)
    except SketchterrainError as error:
        window.send(msg.ErrorReport("engine", one_line(error)))
        window.has_message(None)  # the window ends this process, or has ended
    else:
        placer = None if options["placer"] is None else Channel.from_descriptor(options["placer"])
        Engine(window, placer, **parts).run()
    window.close()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)  # some drivers are slow or crash when they are unloaded


def _open(window: Channel, options: dict[str, Any]) -> dict[str, Any]:
    """Return the engine's session, pacer, jobs and facts."""
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.render.sharing_probe import open_device
    from sketchterrain.ui.engine.view_renderer import ViewRenderer

    renderer, opengl_error = None, "OpenGL failed twice: start it again"
    if options["draws"]:
        try:
            renderer, opengl_error = ViewRenderer(), ""
        except DeviceError as error:
            opengl_error = one_line(error)
    open_context, selector = open_device if renderer else ComputeContext, options["device"]
    session: TerrainSession
    if options["world"]:

        def report(line: str) -> None:
            window.send(msg.ErrorReport("world", line))

        session = WorldSession(Path(options["world"]), report, open_context, device=selector)
        if session.world is not None:
            window.send(session.facts())
    else:
        session = TerrainSession(open_context, device=selector)
        session.build_kernels()  # while the placer places the first terrain
    device, jobs, pacer = session.device, JobQueue(), None
    facts = msg.EngineFacts(
        device=device.name if device else "",
        platform=device.platform if device else "",
        renderer=renderer.name if renderer else "",
        device_error=session.device_error,
        opengl_error=opengl_error,
    )
    if renderer is not None:

        def used_bytes() -> int:
            processes = [os.getpid(), options["placer_id"], jobs.pid]
            return sum(resident_memory(process) for process in processes if process)

        pacer = FramePacer(renderer, FrameMemory(options["frames"]), used_bytes=used_bytes)
    return {"session": session, "pacer": pacer, "jobs": jobs, "facts": facts}


if __name__ == "__main__":
    _main(json.loads(sys.argv[1]))
