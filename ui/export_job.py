"""An export that runs beside the window: begun, followed, cancelled."""

from __future__ import annotations

import json
import pickle
import sys
from typing import cast

from PyQt6.QtCore import QObject, QProcess, QTimer, pyqtSignal

from sketchterrain.sketch import Sketch
from sketchterrain.ui.export_request import ExportRequest, TargetRequest, WorldRequest
from sketchterrain.ui.models.background import Reading

_PATIENCE = 5000  # ms until a process that was asked to end is ended
_WORLDS_PATIENCE = 60_000  # it ends what it has begun


class ExportJob(QObject):
    """Exports one sketch."""

    stage_changed = pyqtSignal(str)
    """What is being done."""
    share_changed = pyqtSignal(float)
    """How much of the stage is done, 0 … 1."""
    noted = pyqtSignal(str)
    """Something that a person should know, one line."""
    finished = pyqtSignal(object)
    """All files are there: a dict, see `export_process`."""
    failed = pyqtSignal(str)
    """Why there are no files; empty if it was cancelled."""

    def __init__(
        self,
        request: ExportRequest | TargetRequest | WorldRequest,
        sketch: Sketch,
        parent: QObject | None = None,
    ) -> None:
        super().__init__(parent)
        self._request, self._sketch = request, sketch
        self._reading = Reading(self)
        self._cancelled = False
        self._over = False
        self._buffer = b""
        self._process = QProcess(self)
        self._process.setProgram(sys.executable)
        self._process.setArguments(["-P", "-m", "sketchterrain.ui.export_process"])
        self._process.setProcessChannelMode(QProcess.ProcessChannelMode.ForwardedErrorChannel)
        self._process.readyReadStandardOutput.connect(self._read)
        self._process.finished.connect(self._ended)
        self._process.errorOccurred.connect(self._not_started)
        self._kill = QTimer(self)
        self._kill.setSingleShot(True)
        goes_on = isinstance(request, WorldRequest) and not request.only_estimate
        self._kill.setInterval(_WORLDS_PATIENCE if goes_on else _PATIENCE)
        self._left = "what is written stays" if goes_on else "nothing was written"
        self._kill.timeout.connect(self._process.kill)

    @property
    def is_running(self) -> bool:
        """Whether the process is there."""
        return self._process.state() != QProcess.ProcessState.NotRunning

    def start(self) -> None:
        """Begin."""
        self.stage_changed.emit("Starting")
        self._process.start()
        self._reading.read(lambda: pickle.dumps((self._request, self._sketch), protocol=5), self._send)

    def cancel(self) -> None:
        """End it; no files come into the folder, but for a world's: that can be gone on with."""
        self._cancelled = True
        if self.is_running:
            self._process.terminate()
            self._kill.start()
        else:
            self._fail("")

    def wait(self) -> None:
        """Wait until a process that was asked to end has ended."""
        if self.is_running and not self._process.waitForFinished(_PATIENCE):
            self._process.kill()
            self._process.waitForFinished(_PATIENCE)

    def stop(self) -> None:
        """Cancel it where it runs, and wait until it has ended."""
        if self.is_running:
            self.cancel()
            self.wait()

    def _send(self, pickled: object) -> None:
        self._process.write(cast(bytes, pickled))
        self._process.closeWriteChannel()

    def _read(self) -> None:
        self._buffer += self._process.readAllStandardOutput().data()
        *lines, self._buffer = self._buffer.split(b"\n")
        for line in lines:
            told = json.loads(line)
            if "stage" in told:
                self.stage_changed.emit(told["stage"])
            elif "share" in told:
                self.share_changed.emit(float(told["share"]))
            elif "note" in told:
                self.noted.emit(str(told["note"]))
            elif "failed" in told:
                self._fail(str(told["failed"]))
            elif not self._over:
                self._over = True
                self.finished.emit(told)

    def _ended(self, code: int, status: QProcess.ExitStatus) -> None:
        self._kill.stop()
        self._read()
        if self._cancelled:
            self._fail("")
        elif status == QProcess.ExitStatus.CrashExit:
            self._fail(f"The export ended unexpectedly (signal {code}); {self._left}.")
        else:
            self._fail(f"The export ended unexpectedly (exit code {code}); {self._left}.")

    def _not_started(self, error: QProcess.ProcessError) -> None:
        if error == QProcess.ProcessError.FailedToStart:
            self._fail(f"The export cannot be started: {self._process.errorString()}.")

    def _fail(self, line: str) -> None:
        if not self._over:
            self._over = True
            self.failed.emit(line)
