"""What goes on behind the window: the newest terrain, frames of it, answers. One thread, one loop."""

from __future__ import annotations

import time
import traceback
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from sketchterrain.errors import DeviceFailedError, SketchterrainError, one_line
from sketchterrain.render import Camera, find_view
from sketchterrain.render.weather import Weather
from sketchterrain.ui.engine.channel import Channel, ready
from sketchterrain.ui.engine.eye import CameraController
from sketchterrain.ui.engine.protocol import (
    Activity,
    ErrorReport,
    Fly,
    FrameAcknowledged,
    GoTo,
    Look,
    MeasureAdherence,
    MeasureJob,
    Pan,
    Pick,
    PickResult,
    PictureJob,
    Plan,
    Quit,
    ReliefUnchanged,
    RenderPicture,
    TerrainUpdated,
    Turn,
    UpdatePending,
    ViewState,
    Zoom,
)
from sketchterrain.ui.engine.relief import ReliefBuilder

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.terrain import Terrain
    from sketchterrain.ui.engine.background import JobQueue
    from sketchterrain.ui.engine.frames import FramePacer
    from sketchterrain.ui.engine.protocol import EngineFacts
    from sketchterrain.ui.engine.terrain_session import TerrainSession

_SLICE: Final = 0.008  # s that the relief gets between two frames
_IDLE_SLICE: Final = 0.03  # s that it gets at a time while there is nothing to draw
_EVERYWHERE: Final = (float("-inf"), float("-inf"), float("inf"), float("inf"))


class Engine:
    """Listens to the window and to the placer, draws, and answers; until the window wants no more.

    Without a placer it shows a stored world; without a pacer, that is without OpenGL, it draws nothing.
    """

    def __init__(
        self,
        window: Channel,
        placer: Channel | None,
        *,
        session: TerrainSession,
        pacer: FramePacer | None,
        jobs: JobQueue,
        facts: EngineFacts,
    ) -> None:
        self._window, self._placer = window, placer
        self._session, self._pacer, self._jobs = session, pacer, jobs
        self._facts = facts
        self._relief = ReliefBuilder()
        self._eye: CameraController | None = None
        self._view = ViewState()
        self._expected, self._fresh = -1, -1
        self._wanted: Look | None = None
        self._busy_with = ""
        self._goes_on = True
        self._does: dict[type, Callable[[Any], None]] = {
            Quit: self._quit,
            ViewState: self._look,
            FrameAcknowledged: self._taken,
            Look: self._be_at,
            Pick: self._pick,
            MeasureAdherence: self._measure,
            RenderPicture: self._take_picture,
            UpdatePending: self._expect,
            **dict.fromkeys((Turn, Pan, Zoom, Fly, GoTo), self._move),
        }

    def run(self) -> None:
        """Work until `Quit`, or until one of the others is gone."""
        try:
            self._window.send(self._facts)
            while self._goes_on:
                self._turn()
        except EOFError:
            return
        finally:
            self._jobs.close()

    def _turn(self) -> None:
        """Wait until there is something to do, and do it."""
        plans: list[Plan] = []
        lasting = [each for each in (self._window, self._placer) if each is not None]
        jobs = self._jobs.channel
        waiting = ready(lasting if jobs is None else [*lasting, jobs], self._pause())
        while waiting:  # all that is there: the newest terrain and the newest eye count
            for channel in waiting:
                if channel is self._placer:
                    plans.append(channel.receive())
                elif channel is self._window:
                    self._do(channel.receive())
                else:
                    self._window.send(self._jobs.receive())
            waiting = ready(lasting, 0.0)
        if plans:
            self._guarded("view", lambda: self._follow(plans))
        due = self._frame_due()
        if due is not None and due <= 0.0:
            self._guarded("view", self._draw)
        if self._relief_due() == 0.0:
            self._guarded("engine", self._make_relief)
        self._say("")

    def _pause(self) -> float | None:
        """Return how long to wait for messages, s; None: until there is one."""
        waits = (self._frame_due(), self._relief_due())
        return min((each for each in waits if each is not None), default=None)

    def _frame_due(self) -> float | None:
        """Return in how many s the next frame is due; None: none is."""
        if self._pacer is None:
            return None
        if self._eye is None:  # a stored world is there from the start, and waits for the view's size
            waits = self._session.terrain is not None and self._view.width and not self._pacer.broken
            return 0.0 if waits else None
        return self._pacer.due(moving=self._eye.restless)

    def _relief_due(self) -> float | None:
        """Return in how many s the relief goes on; None: there is nothing to make."""
        if self._session.terrain is None:
            return None
        return self._relief.due(coming=self._expected > self._session.version)

    def _do(self, message: Any) -> None:
        self._guarded("engine", lambda: self._does[type(message)](message))

    def _guarded(self, what: str, work: Callable[[], None]) -> None:
        """Do something; what fails becomes a message, and the last good terrain stays."""
        try:
            work()
        except EOFError:
            raise
        except DeviceFailedError as error:
            self._leave_device(error)
        except SketchterrainError as error:
            self._fail(what, one_line(error))
        except Exception as error:  # noqa: BLE001 # a defect must not end the view
            traceback.print_exc()
            self._fail(what, one_line(f"{type(error).__name__}: {error}"))

    def _fail(self, what: str, line: str) -> None:
        if what == "view" and self._pacer is not None:
            self._pacer.stop()
        self._window.send(ErrorReport(what, line))

    def _leave_device(self, error: DeviceFailedError) -> None:
        self._window.send(ErrorReport("engine", one_line(f"{error}; {self._session.switch_device()}")))
        if self._pacer is not None:
            self._pacer.stage.clear()
        device = self._session.device
        name, platform = ("", "") if device is None else (device.name, device.platform)
        self._tell_facts(device=name, platform=platform, no_device=self._session.lacks)
        self._session.dirty_areas = [_EVERYWHERE]
        self._guarded("view", self._show_terrain)

    def _follow(self, plans: list[Plan]) -> None:
        """Go over to the newest terrain."""
        received = time.monotonic()
        self._session.take(plans)
        self._show_terrain()
        placed = next((plan for plan in reversed(plans) if plan.recipe is not None), plans[-1])
        self._window.send(
            TerrainUpdated(
                self._session.version, placed.begun, placed.placed, placed.ready, received, time.monotonic()
            )
        )

    def _show_terrain(self) -> None:
        terrain, version, areas = self._session.terrain, self._session.version, self._session.dirty_areas
        if terrain is None:
            return
        if self._eye is None or self._eye.size != terrain.size or self._fresh >= 0 <= version - self._fresh:
            self._eye, self._fresh = CameraController(terrain, aspect=self._view.aspect), -1
            self._eye.use(self._view.mode)
            if self._wanted is not None:
                self._be_at(self._wanted)
        else:
            self._eye.follow(terrain)
        if self._session.sketch is not None:
            self._relief.follow(terrain, version, areas)
            if not self._relief.busy:
                self._window.send(ReliefUnchanged(version))
        if self._pacer is not None:
            self._draw_from_now_on(self._pacer, terrain, self._eye)
        self._session.dirty_areas = []

    def _draw_from_now_on(self, pacer: FramePacer, terrain: Terrain, eye: CameraController) -> None:
        pacer.expect(coming=self._expected > self._session.version)
        if pacer.stage.is_empty:
            self._say("Preparing the picture")
        line = pacer.show(terrain, self._session.version, self._session.dirty_areas, eye)
        if line:
            self._window.send(ErrorReport("view", line))
        self._tell_facts(sharing=pacer.stage.sharing)

    def _draw(self) -> None:
        assert self._pacer is not None  # noqa: S101 # a frame is due
        if self._eye is None or self._pacer.stage.is_empty:
            self._show_terrain()
        there = None if self._eye is None else self._pacer.frame(self._eye)
        if there is not None:
            self._window.send(there)

    def _make_relief(self) -> None:
        idle = self._pacer is None or self._pacer.due(moving=False) is None
        made = self._relief.work(_IDLE_SLICE if idle else _SLICE)
        if made is not None:
            self._window.send(made)

    def _quit(self, _: Quit) -> None:
        self._goes_on = False

    def _look(self, view: ViewState) -> None:
        self._view = view
        if self._eye is not None:
            self._eye.use(view.mode)
        if self._pacer is not None:
            self._pacer.look(view)

    def _taken(self, _: FrameAcknowledged) -> None:
        if self._pacer is not None:
            self._pacer.taken()

    def _expect(self, coming: UpdatePending) -> None:
        # From the first one on that is not there: who paints on and on must see a picture that gets better.
        if self._pacer is not None and self._expected <= self._session.version:
            self._pacer.expect(coming=True)
        self._expected = coming.version
        if coming.fresh:
            self._fresh = coming.version

    def _move(self, motion: Any) -> None:
        if self._eye is not None:
            self._eye.take(motion, aspect=self._view.aspect)

    def _be_at(self, look: Look) -> None:
        terrain = self._session.terrain
        self._wanted = look if self._eye is None else None
        if self._eye is None or terrain is None:
            return
        if look.pose is not None:
            self._eye.be_at(Camera(look.pose.eye, look.pose.target, fov=look.pose.fov))
            return
        self._say("Looking for a view")
        self._eye.be_at(find_view(terrain, weather=Weather.from_sketch(terrain.sketch)))

    def _pick(self, pick: Pick) -> None:
        place = None if self._eye is None else self._eye.seen(pick.x, pick.y, aspect=self._view.aspect)
        self._window.send(PickResult(pick.token, place))

    def _measure(self, _: MeasureAdherence) -> None:
        if self._session.sketch is None or self._session.terrain is None:
            raise SketchterrainError(self._session.lacks or "there is no terrain yet")
        self._jobs.add(MeasureJob(self._session.version, self._session.sketch, self._session.recipe))

    def _take_picture(self, wanted: RenderPicture) -> None:
        sun = None if self._pacer is None else self._pacer.stage.sun
        if sun is None or self._eye is None or self._session.sketch is None:
            lacks = self._facts.no_picture or self._facts.no_device
            self._window.send(ErrorReport("picture", lacks or "there is no picture yet"))
            return
        self._jobs.add(
            PictureJob(
                sketch=self._session.sketch,
                recipe=self._session.recipe,
                path=wanted.path,
                size=(wanted.width, wanted.height),
                pose=self._eye.pose(),
                sun=(sun.azimuth, sun.elevation),
                overlays=tuple(self._view.overlays),
            )
        )

    def _tell_facts(self, **changes: str) -> None:
        facts = replace(self._facts, **changes)
        if facts != self._facts:
            self._facts = facts
            self._window.send(facts)

    def _say(self, what: str) -> None:
        """Tell the window what it is busy with."""
        what = what or self._jobs.doing
        if what != self._busy_with:
            self._busy_with = what
            self._window.send(Activity(what))
