"""The window's end of the engine: its processes, signals for what they report, methods for requests."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import threading
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from PyQt6.QtCore import QObject, Qt, QTimer, pyqtSignal
from PyQt6.QtGui import QImage

from sketchterrain.ui.engine.channel import Channel
from sketchterrain.ui.engine.frames import FrameMemory
from sketchterrain.ui.engine.protocol import (
    Activity,
    Adherence,
    EngineFacts,
    ErrorReport,
    FrameAcknowledged,
    FrameReady,
    Look,
    Pick,
    PickResult,
    PictureWritten,
    Placement,
    PlacementUnchanged,
    Quit,
    Relief,
    ReliefUnchanged,
    TerrainUpdated,
    UpdatePending,
    ViewState,
)
from sketchterrain.ui.engine.sketch_updates import UpdateBuilder

if TYPE_CHECKING:
    from pathlib import Path

    from sketchterrain.ui.engine.protocol import FrameFacts
    from sketchterrain.ui.models.document import Document

_PATIENCE: Final = 0.4
"""s that processes have to end by themselves."""


class EngineProcesses:
    """An engine and, unless it shows a stored world, a placer; connected to this process and each other.

    They see it when this process ends, even if it is killed, and end too.
    """

    def __init__(self, *, device: str | None = None, draws: bool = True, world: Path | None = None) -> None:
        self.frames = FrameMemory()
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self.channels: dict[str, Channel] = {}
        mine, its = socket.socketpair()
        options: dict[str, Any] = {
            "window": its.fileno(),
            "placer": None,
            "frames": self.frames.number,
            "placer_id": None,
            "device": device,
            "draws": draws,
            "world": None if world is None else str(world),
        }
        passed = [its]
        if world is None:
            my_placer, its_window = socket.socketpair()
            its_engine, engines_placer = socket.socketpair()
            placer = _started(
                "placer", [str(its_window.fileno()), str(its_engine.fileno())], [its_window, its_engine]
            )
            options |= {"placer": engines_placer.fileno(), "placer_id": placer.pid}
            passed.append(engines_placer)
            self._processes["placer"] = placer
            self.channels["placer"] = Channel(my_placer, patient=False)
        self._processes["engine"] = _started("process", [json.dumps(options)], passed, self.frames.number)
        self.channels["engine"] = Channel(mine, patient=False)

    def ended(self) -> str:
        """Wait a moment for what is ending, and say in one line how; empty: all run."""
        for name, child in self._processes.items():
            try:
                code = child.wait(_PATIENCE)
            except subprocess.TimeoutExpired:
                continue
            return f"the {name} crashed (signal {-code})" if code < 0 else f"the {name} ended (code {code})"
        return ""

    def end(self) -> None:
        """End them, within half a second."""
        for channel in self.channels.values():
            channel.send(Quit())
        for channel in self.channels.values():
            channel.close()
        until = time.monotonic() + _PATIENCE
        for child in self._processes.values():
            try:
                child.wait(max(until - time.monotonic(), 0.0))
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()
        self.frames.close()


def _started(
    module: str, arguments: list[str], ends: list[socket.socket], *others: int
) -> subprocess.Popen[bytes]:
    """Start a process that gets the ends of connections, which are closed here, and other descriptors."""
    command = [sys.executable, "-m", f"sketchterrain.ui.engine.{module}", *arguments]
    numbers = [*(end.fileno() for end in ends), *others]
    child = subprocess.Popen(command, pass_fds=numbers, stdin=subprocess.DEVNULL)  # noqa: S603
    for end in ends:
        end.close()
    return child


class ViewSource(QObject):
    """Draws for one view, in processes of its own. It says `FrameAcknowledged` by itself."""

    working_changed = pyqtSignal(str)
    facts_changed = pyqtSignal(object)
    frame_shown = pyqtSignal(object)
    """A new picture is there: its `FrameFacts`; see `picture`."""
    picked = pyqtSignal(object)
    placed_changed = pyqtSignal(object)
    relief_changed = pyqtSignal(object)
    view_changed = pyqtSignal(object)
    trouble = pyqtSignal(object)
    """`ErrorReport`."""

    _came = pyqtSignal(int, str, object)
    """From a thread that reads: of which start, from which process, and what."""

    without_view = ""
    """What a person can still do where there is no OpenGL."""

    def __init__(self, view: ViewState) -> None:
        super().__init__()
        self.device: str | None = None  # selector for the next `start`; None: the best one
        self.facts = EngineFacts()
        self.frame: FrameFacts | None = None
        self.picture: QImage | None = None
        self.placed: Placement | None = None
        self.relief: Relief | None = None
        self.view = view
        self.working = ""
        self._token = 0
        self._children: EngineProcesses | None = None
        self._threads: list[threading.Thread] = []
        self._starts = 0
        self._busy: dict[str, str] = {}
        self._came.connect(self._take)  # it is emitted by other threads, and taken on this one

    def area(self) -> tuple[tuple[float, float, float, float], float] | None:
        """Return west, south, east, north (m) of all that is shown, and the height of its middle if known."""
        raise NotImplementedError

    def start(self) -> None:
        """Start the processes; again after they ended, and anew while they run."""
        raise NotImplementedError

    def stop(self) -> None:
        """End the processes; waits for them for a short while."""
        self._end()

    def tell(self, message: Any) -> None:
        """Send one of the window's messages: a motion, `Look`, `Pick`, `RenderPicture` and so on."""
        if self._children is not None:
            self._children.channels["engine"].send(message)

    def show(self, view: ViewState) -> None:
        """Say what the view shall show."""
        if view != self.view:
            self.view = view
            self.view_changed.emit(view)
            self.tell(view)

    def pick(self, x: float, y: float) -> int:
        """Ask what ground is seen at a place of the picture; `picked` answers with the token returned."""
        self._token += 1
        self.tell(Pick(self._token, x, y))
        return self._token

    def _begin(self, children: EngineProcesses) -> None:
        self._end()
        self._starts += 1
        self._children = children
        for name, channel in children.channels.items():
            thread = threading.Thread(
                target=self._read, args=(self._starts, name, channel, children), name=name, daemon=True
            )
            thread.start()
            self._threads.append(thread)
        self.tell(self.view)
        if self.frame is not None:  # the eye stays where it was
            self.tell(Look(self.frame.pose))

    def _end(self) -> None:
        children, self._children = self._children, None
        if children is not None:
            children.end()
            for thread in self._threads:
                thread.join(1.0)
            self._threads.clear()
        self._busy.clear()
        self._set_working("")

    def _read(self, start: int, name: str, channel: Channel, children: EngineProcesses) -> None:
        """Hand over what a process tells; on a thread of its own."""
        while True:
            try:
                message = channel.receive()
            except EOFError:
                break
            self._came.emit(start, name, message)
        self._came.emit(start, name, _Gone(children.ended()))

    def _take(self, start: int, name: str, message: Any) -> None:
        """Take what a process told over, on the window's thread."""
        if start != self._starts or self._children is None:
            return  # of one that was stopped
        if isinstance(message, FrameReady):
            self.picture = _picture_of(self._children.frames, message)
            self.tell(FrameAcknowledged())
            self.frame = message.facts
            self.frame_shown.emit(message.facts)
        elif isinstance(message, PickResult):
            self.picked.emit(message)
        elif isinstance(message, EngineFacts):
            self.facts = message
            self.facts_changed.emit(message)
        elif isinstance(message, Activity):
            self._busy[name] = message.what
            self._set_working(self._busy.get("engine", "") or self._busy.get("placer", ""))
        elif isinstance(message, ErrorReport):
            self._complain(message.what, message.line)
        elif isinstance(message, _Gone):
            self._end()
            self._crashed(message.line or f"the {name} closed its connection")
        else:
            self._take_own(message)

    def _take_own(self, message: Any) -> None:
        """Take a message that only this kind of source knows."""

    def _crashed(self, line: str) -> None:
        """Do what is to be done when a process is gone."""
        self._complain("engine", line)

    def _complain(self, what: str, line: str) -> None:
        """Tell what failed, as a sentence."""
        line = line[:1].upper() + line[1:]
        self.trouble.emit(ErrorReport(what, line if line.endswith((".", "!", "?")) else f"{line}."))

    def _set_working(self, what: str) -> None:
        if what != self.working:
            self.working = what
            self.working_changed.emit(what)


class _Gone:
    """A process ended: how, in one line."""

    def __init__(self, line: str) -> None:
        self.line = line


def _picture_of(memory: FrameMemory, there: FrameReady) -> QImage:
    """Return a copy of a frame in shared memory; its place may be drawn into again."""
    width, height = there.facts.width, there.facts.height
    with memory.view(there.start, 4 * width * height, there.capacity) as pixels:
        shared = QImage(pixels, width, height, 4 * width, QImage.Format.Format_RGBX8888)  # type: ignore[call-overload]
        picture: QImage = shared.convertToFormat(QImage.Format.Format_RGB32)
        del shared
    return picture


_OFTEN: Final = 0.016
"""s between two sketches that are sent, at least."""
_CALM: Final = 60.0
"""s after which a crash is no more in a row with the one before."""


class EngineLink(ViewSource):
    """Works out the terrain of a document, and draws it, in processes of its own.

    If a process crashes, both are started again: the second time in a row without
    OpenGL, after the third only by `start`.
    """

    adherence_changed = pyqtSignal(object)
    sent = pyqtSignal(int, float)
    """A sketch is on its way: its version, and when it was made (s of the system's monotonic clock)."""
    followed = pyqtSignal(object)
    """The view's tiles hold the heights of another version: `TerrainUpdated`."""
    picture_written = pyqtSignal(str)

    without_view = "You can paint and export all the same."

    def __init__(self, document: Document) -> None:
        super().__init__(ViewState())
        self._document = document
        self.adherence: Adherence | None = None
        self._started = 0.0
        self._crashes = 0
        self._updates = UpdateBuilder(document)
        self._sent = 0.0
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self._send_sketch)

    def area(self) -> tuple[tuple[float, float, float, float], float] | None:
        """Return the rectangle (m) of the sketch; the relief knows heights."""
        return (0.0, 0.0, *self._document.sketch.size), 0.0

    def start(self) -> None:
        """Start the processes; again after they ended, and anew while they run."""
        self._crashes = 0
        self._restart(draws=True)

    def stop(self) -> None:
        """End the processes; waits for them for a short while."""
        self._timer.stop()
        self._updates.stop()
        self._end()

    def _restart(self, *, draws: bool) -> None:
        self._end()
        self._started = time.monotonic()
        self._begin(EngineProcesses(device=self.device, draws=draws))
        self._updates.start(self._schedule)
        self._send_sketch()

    def _schedule(self) -> None:
        if not self._timer.isActive() and self._children is not None:
            left = self._sent + _OFTEN - time.monotonic()
            self._timer.start(max(round(left * 1e3), 0))

    def _send_sketch(self) -> None:
        if self._children is None:
            return
        self._sent = time.monotonic()
        update, fresh = self._updates.next()
        self._children.channels["placer"].send(update)
        self.tell(UpdatePending(update.version, fresh=fresh))
        self.sent.emit(update.version, self._sent)

    def _take_own(self, message: Any) -> None:
        if isinstance(message, Placement):
            self.placed = message
            self.placed_changed.emit(message)
        elif isinstance(message, PlacementUnchanged):
            if self.placed is not None:
                self.placed = replace(self.placed, version=message.version)
                self.placed_changed.emit(self.placed)
        elif isinstance(message, Relief):
            self.relief = message
            self.relief_changed.emit(message)
        elif isinstance(message, ReliefUnchanged):
            if self.relief is not None:
                self.relief = replace(self.relief, version=message.version)
        elif isinstance(message, TerrainUpdated):
            self.followed.emit(message)
        elif isinstance(message, Adherence):
            self.adherence = message
            self.adherence_changed.emit(message)
        elif isinstance(message, PictureWritten):
            self.picture_written.emit(message.path)

    def _crashed(self, line: str) -> None:
        self._crashes = 1 if time.monotonic() - self._started > _CALM else self._crashes + 1
        if self._crashes == 1:
            self._complain("engine", f"{line}; it is started again")
            self._restart(draws=True)
        elif self._crashes == 2:  # see the class
            self._complain("engine", f"{line} once more; it goes on without the 3-D view")
            self._restart(draws=False)
        else:
            self._complain("engine", f"{line} again and again; save, and start the program again")
