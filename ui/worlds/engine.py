"""What goes on behind a world's window: frames of it, and answers. One thread, one loop."""

from __future__ import annotations

import traceback
from functools import partial
from typing import TYPE_CHECKING, Any

from sketchterrain.errors import DeviceFailedError, SketchterrainError, one_line
from sketchterrain.render import Camera, Weather, find_view
from sketchterrain.ui.engine import protocol as orders
from sketchterrain.ui.engine.channel import Channel, ready
from sketchterrain.ui.engine.eye import Eye
from sketchterrain.ui.engine.protocol import Picked, Trouble, ViewState, Working

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.ui.engine.frames import FramePacer
    from sketchterrain.world.viewed import ViewedWorld

__all__ = ["WorldEngine"]


class WorldEngine:
    """Listens to a window, draws a world, and answers; until the window wants no more.

    Parameters
    ----------
    window
        Its channel.
    world
        What is shown; it tells of what cannot be read by itself.
    show
        Draws it.
    """

    def __init__(self, window: Channel, world: ViewedWorld, show: FramePacer) -> None:
        self._window, self._world, self._show = window, world, show
        self._eye = Eye(world)
        self._view = ViewState()
        self._is_new = True
        self._goes_on = True
        motions = (orders.Turn, orders.Pan, orders.Zoom, orders.Fly, orders.GoTo)
        self._does: dict[type, Callable[[Any], None]] = {
            orders.Quit: self._quit,
            ViewState: self._look,
            orders.FrameTaken: lambda _: self._show.taken(),
            orders.Look: self._be_at,
            orders.Pick: self._pick,
            **dict.fromkeys(motions, self._move),
        }

    def run(self) -> None:
        """Work until `Quit`, or until the window is gone."""
        try:
            while self._goes_on:
                self._turn()
        except EOFError:
            return

    def _turn(self) -> None:
        """Wait until there is something to do, and do it."""
        waiting = ready([self._window], self._due())
        while waiting:  # all that is there: the newest eye counts
            message = self._window.receive()
            self._guarded(partial(self._does[type(message)], message))
            waiting = ready([self._window], 0.0)
        due = self._due()
        if due is not None and due <= 0.0:
            self._guarded(self._draw)

    def _due(self) -> float | None:
        """Return in how many s the next frame is due; None: none is."""
        if self._is_new:
            return 0.0 if self._view.width and self._view.height else None
        return self._show.due(moving=self._eye.restless)

    def _guarded(self, work: Callable[[], None]) -> None:
        """Do something; what fails becomes a message."""
        try:
            work()
        except EOFError:
            raise
        except DeviceFailedError as error:
            self._show.stop()
            self._window.send(Trouble("engine", one_line(error)))
        except SketchterrainError as error:
            self._show.stop()
            self._window.send(Trouble("view", one_line(error)))
        except Exception as error:  # noqa: BLE001 # a defect must not end the view
            traceback.print_exc()
            self._show.stop()
            self._window.send(Trouble("view", one_line(f"{type(error).__name__}: {error}")))

    def _draw(self) -> None:
        if self._is_new or self._show.stage.is_empty:
            self._is_new = False
            self._window.send(Working("Preparing the picture"))
            line = self._show.show(self._world, 0, [], self._eye)
            if line:
                self._window.send(Trouble("view", line))
        there = self._show.frame(self._eye)
        if there is not None:
            self._window.send(there)
        self._window.send(Working(""))

    def _quit(self, _: orders.Quit) -> None:
        self._goes_on = False

    def _look(self, view: ViewState) -> None:
        self._view = view
        self._eye.use(view.mode)
        self._show.look(view)

    def _move(self, motion: Any) -> None:
        self._eye.take(motion, aspect=self._view.aspect)

    def _be_at(self, look: orders.Look) -> None:
        if look.pose is not None:
            self._eye.be_at(Camera(look.pose.eye, look.pose.target, fov=look.pose.fov))
            return
        self._window.send(Working("Looking for a view"))
        self._eye.be_at(find_view(self._world, weather=Weather.of(self._world.sketch)))
        self._window.send(Working(""))

    def _pick(self, pick: orders.Pick) -> None:
        self._window.send(Picked(pick.token, self._eye.seen(pick.x, pick.y, aspect=self._view.aspect)))
