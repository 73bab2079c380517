"""The window's connection to the engine: its processes, Qt signals for its messages, methods for requests."""

import json
import socket
import subprocess
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from PyQt6.QtCore import QObject, Qt, pyqtBoundSignal, pyqtSignal
from PyQt6.QtGui import QImage

from sketchterrain.landforms.placement.feature_types import FEATURE
from sketchterrain.ui.engine import protocol as msg
from sketchterrain.ui.engine.channel import Channel, ContentChannel, UpdateBuilder, start_process
from sketchterrain.ui.engine.frames import FrameMemory
from sketchterrain.ui.models.background import single_shot
from sketchterrain.ui.models.document import Document

_EXIT_TIME: Final = 0.4  # s for processes to exit by themselves


NOT_PLACED: Final = msg.Placement(-1, np.zeros(0, FEATURE), (), ())
"""The placement of a view before its first one, and of a stored world."""


class EngineProcesses:
    """An engine and, unless it shows a stored world, a placer, connected to this process and to each other.

    They end by themselves when this process ends, even if it is killed.
    """

    def __init__(self, *, device: str | None = None, draws: bool = True, world: Path | None = None) -> None:
        self.frames = FrameMemory()
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self.channels: dict[str, Channel] = {}
        engine_end, window_end = socket.socketpair()
        options: dict[str, Any] = {
            "window": window_end.fileno(),
            "placer": None,
            "frames": self.frames.number,
            "placer_id": None,
            "device": device,
            "draws": draws,
            "world": None if world is None else str(world),
        }
        inherited = [window_end]
        if world is None:
            placer_end, window_of_placer = socket.socketpair()
            engine_of_placer, placer_of_engine = socket.socketpair()
            ends = [window_of_placer, engine_of_placer]
            placer = start_process("placer", [str(end.fileno()) for end in ends], ends)
            options |= {"placer": placer_of_engine.fileno(), "placer_id": placer.pid}
            inherited.append(placer_of_engine)
            self._processes["placer"] = placer
            self.channels["placer"] = ContentChannel(placer_end, patient=False)
        self._processes["engine"] = start_process(
            "engine", [json.dumps(options)], inherited, self.frames.number
        )
        self.channels["engine"] = Channel(engine_end, patient=False)

    def exit_status(self) -> str:
        """Wait briefly for exiting processes; return how one ended, or nothing while all run."""
        for name, child in self._processes.items():
            try:
                code = child.wait(_EXIT_TIME)
            except subprocess.TimeoutExpired:
                continue
            return f"the {name} crashed (signal {-code})" if code < 0 else f"the {name} ended (code {code})"
        return ""

    def close(self) -> None:
        """Terminate the processes within half a second."""
        for channel in self.channels.values():
            channel.send(msg.Quit())
        for channel in self.channels.values():
            channel.close()
        until = time.monotonic() + _EXIT_TIME
        for child in self._processes.values():
            try:
                child.wait(max(until - time.monotonic(), 0.0))
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()
        self.frames.close()


class ViewSource(QObject):
    """Renders one view in processes of its own; acknowledges frames by itself."""

    activity_changed = pyqtSignal(str)
    facts_changed = pyqtSignal(object)  # EngineFacts
    frame_shown = pyqtSignal(object)  # FrameFacts of the new `picture`
    picked = pyqtSignal(object)  # PickResult
    placed_changed = pyqtSignal(object)  # Placement
    relief_changed = pyqtSignal(object)  # Relief
    view_changed = pyqtSignal(object)  # ViewState
    error_reported = pyqtSignal(object)  # ErrorReport

    # from reader threads: start number, process name, message or how the process ended
    _received = pyqtSignal(int, str, object)

    without_view = ""  # what still works without OpenGL, for the user

    def __init__(self, view: msg.ViewState) -> None:
        super().__init__()
        self.device: str | None = None  # selector for the next `start`; None: automatic
        self.facts = msg.EngineFacts()
        self.frame: msg.FrameFacts | None = None
        self.picture: QImage | None = None
        self.placed = NOT_PLACED
        self.relief: msg.Relief | None = None
        self.view = view
        self.activity = ""
        self._token = 0
        self._processes: EngineProcesses | None = None
        self._threads: list[threading.Thread] = []
        self._starts = 0
        self._activities: dict[str, str] = {}
        self._received.connect(self._handle)  # emitted by other threads, handled on this one
        # by message: attribute that stores it, if any, and signal that announces it
        self._routes: dict[type, tuple[str, pyqtBoundSignal]] = {
            msg.PickResult: ("", self.picked),
            msg.EngineFacts: ("facts", self.facts_changed),
        }

    def area(self) -> tuple[tuple[float, float, float, float], float] | None:
        """Return west, south, east, north (m) of what is displayed, and its central elevation if known."""
        raise NotImplementedError

    def start(self) -> None:
        """Start or restart the processes."""
        raise NotImplementedError

    def stop(self) -> None:
        """Terminate the processes and wait for them briefly."""
        processes, self._processes = self._processes, None
        if processes is not None:
            processes.close()
            for thread in self._threads:
                thread.join(1.0)
            self._threads.clear()
        self._activities.clear()
        self._set_activity("")

    def send(self, message: Any) -> None:
        """Send a message to the engine: a motion, `Look`, `Pick`, `RenderPicture` and so on."""
        if self._processes is not None:
            self._processes.channels["engine"].send(message)

    def set_view(self, view: msg.ViewState) -> None:
        """Apply size, quality, mode and overlays of the view."""
        if view != self.view:
            self.view = view
            self.view_changed.emit(view)
            self.send(view)

    def change_view(self, **changes: Any) -> None:
        """Apply some fields of the view's state."""
        self.set_view(replace(self.view, **changes))

    def pick(self, x: float, y: float) -> int:
        """Request the terrain position at an image position; return the token of the answer, `picked`."""
        self._token += 1
        self.send(msg.PickRequest(self._token, x, y))
        return self._token

    def _run(self, processes: EngineProcesses) -> None:
        self.stop()
        self._starts += 1
        self._processes = processes
        for name, channel in processes.channels.items():
            arguments = (self._starts, name, channel, processes)
            thread = threading.Thread(target=self._read, args=arguments, name=name, daemon=True)
            thread.start()
            self._threads.append(thread)
        self.send(self.view)
        if self.frame is not None:  # the camera stays
            self.send(msg.Look(self.frame.pose))

    def _read(self, start: int, name: str, channel: Channel, processes: EngineProcesses) -> None:
        while True:
            try:
                message = channel.receive()
            except EOFError:
                break
            self._received.emit(start, name, message)
        self._received.emit(start, name, processes.exit_status())

    def _handle(self, start: int, name: str, message: Any) -> None:
        """Handle a message on the window's thread."""
        if start != self._starts or self._processes is None:
            return  # from stopped processes
        if isinstance(message, msg.FrameReady):
            self.picture = _copy_frame(self._processes.frames, message)
            self.send(msg.FrameAcknowledged())
            self.frame = message.facts
            self.frame_shown.emit(message.facts)
        elif isinstance(message, msg.Activity):
            self._activities[name] = message.text
            self._set_activity(self._activities.get("engine", "") or self._activities.get("placer", ""))
        elif isinstance(message, msg.ErrorReport):
            self._report_error(message.source, message.line)
        elif isinstance(message, str):
            self.stop()
            self._handle_crash(message or f"the {name} closed its connection")
        elif isinstance(message, msg.Unchanged):
            self._revalidate(message)
        else:
            name, signal = self._routes[type(message)]
            if name:
                setattr(self, name, message)
            signal.emit(message)

    def _revalidate(self, message: msg.Unchanged) -> None:
        """Apply a version to the last placement or relief."""
        if message.kind == "placement":
            self.placed = replace(self.placed, version=message.version)
            self.placed_changed.emit(self.placed)
        elif message.kind == "relief" and self.relief is not None:
            self.relief = replace(self.relief, version=message.version)

    def _handle_crash(self, line: str) -> None:
        self._report_error("engine", line)

    def _report_error(self, source: str, line: str) -> None:
        """Emit an error as a sentence."""
        line = line[:1].upper() + line[1:]
        line = line if line.endswith((".", "!", "?")) else f"{line}."
        self.error_reported.emit(msg.ErrorReport(source, line))

    def _set_activity(self, text: str) -> None:
        if text != self.activity:
            self.activity = text
            self.activity_changed.emit(text)


def _copy_frame(memory: FrameMemory, frame: msg.FrameReady) -> QImage:
    """Return a copy of a frame in shared memory; its slot may be overwritten afterwards."""
    width, height = frame.facts.width, frame.facts.height
    with memory.view(frame.start, 4 * width * height, frame.capacity) as pixels:
        shared = QImage(pixels, width, height, 4 * width, QImage.Format.Format_RGBX8888)  # type: ignore[call-overload]
        picture: QImage = shared.convertToFormat(QImage.Format.Format_RGB32)
        del shared
    return picture


_SEND_INTERVAL: Final = 0.016  # least s between sketch updates
_CRASH_WINDOW: Final = 60.0  # s within which crashes count as consecutive


class EngineLink(ViewSource):
    """Places and renders a document's terrain.

    After a crash both processes restart: the second time in a row without OpenGL, after the third only by
    `start`.
    """

    adherence_changed = pyqtSignal(object)  # Adherence
    sent = pyqtSignal(int, float)  # version of a sent sketch, s of the system's monotonic clock
    terrain_updated = pyqtSignal(object)  # TerrainUpdated
    picture_written = pyqtSignal(object)  # PictureWritten

    without_view = "You can paint and export all the same."

    def __init__(self, document: Document) -> None:
        super().__init__(msg.ViewState())
        self._document = document
        document.drapes.changed.connect(self._send_drapes)
        document.live_changed.connect(self._schedule)
        self.adherence: msg.Agreement | None = None
        self._started_at = 0.0
        self._crashes = 0
        self._updates = UpdateBuilder(document)
        self._sent_at = 0.0
        self._timer = single_shot(self, 0, self._send_sketch)
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._routes |= {
            msg.Placement: ("placed", self.placed_changed),
            msg.Relief: ("relief", self.relief_changed),
            msg.TerrainUpdated: ("", self.terrain_updated),
            msg.Agreement: ("adherence", self.adherence_changed),
            msg.PictureWritten: ("", self.picture_written),
        }

    def area(self) -> tuple[tuple[float, float, float, float], float] | None:
        """Return the rectangle (m) of the sketch; heights are in the relief."""
        return (0.0, 0.0, *self._document.sketch.size), 0.0

    def start(self) -> None:
        """Start or restart the processes."""
        self._crashes = 0
        self._restart(draws=True)

    def stop(self) -> None:
        self._timer.stop()
        super().stop()

    def _restart(self, *, draws: bool) -> None:
        self.stop()
        self._started_at = time.monotonic()
        self._run(EngineProcesses(device=self.device, draws=draws))
        self._updates.sent = b""
        if self._document.drapes.current is not None:
            self._send_drapes()
        self._send_sketch()

    def _send_drapes(self) -> None:
        """Send the draped layers as far as they are read."""
        sketch, current = self._document.sketch, self._document.drapes.current
        layers = () if current is None else current.layers
        held = self._document.drapes.held
        self.send(msg.SetDrapes(layers, sketch.frame, sketch.size, sketch.extent, held))

    def _schedule(self) -> None:
        if not self._timer.isActive() and self._processes is not None and not self._updates.is_empty:
            left = self._sent_at + _SEND_INTERVAL - time.monotonic()
            self._timer.start(max(round(left * 1e3), 0))

    def _send_sketch(self) -> None:
        if self._processes is None:
            return
        self._sent_at = time.monotonic()
        update, fresh = self._updates.next()
        self._processes.channels["placer"].send(update)
        self.send(msg.UpdatePending(update.version, fresh=fresh))
        self.sent.emit(update.version, self._sent_at)

    def _handle_crash(self, line: str) -> None:
        self._crashes = 1 if time.monotonic() - self._started_at > _CRASH_WINDOW else self._crashes + 1
        if self._crashes == 1:
            self._report_error("engine", f"{line}; restarting")
            self._restart(draws=True)
        elif self._crashes == 2:  # see the class
            self._report_error("engine", f"{line} again; restarting without the 3-D view")
            self._restart(draws=False)
        else:
            self._report_error("engine", f"{line} repeatedly; save, and start the program again")
