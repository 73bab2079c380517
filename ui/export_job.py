"""Export in a process of its own: start, progress, result and cancellation."""

import json
import pickle

from PyQt6.QtCore import QObject, QProcess, pyqtSignal

from sketchterrain.document.sketch import Sketch
from sketchterrain.io.system import module_command
from sketchterrain.ui.engine.protocol import Request, WorldRequest
from sketchterrain.ui.models.background import BackgroundReader, single_shot

_GRACE = 5000  # ms from SIGTERM to SIGKILL
_WORLD_GRACE = 60_000  # a world's pending shards are finished


class ExportJob(QObject):
    """Exports one sketch; emits `finished` or `failed` once."""

    stage_changed = pyqtSignal(str)
    share_changed = pyqtSignal(float)  # Progress of the stage, 0 … 1
    noted = pyqtSignal(str)
    finished = pyqtSignal(object)  # Summary, a dict: see `export_process`
    failed = pyqtSignal(str)  # Empty if cancelled

    def __init__(self, request: Request, sketch: Sketch, parent: QObject) -> None:
        super().__init__(parent)
        self._request, self._sketch = request, sketch
        self._reading = BackgroundReader(self)
        self._cancelled = self._is_over = False
        self._buffer = b""
        self._process = QProcess(self)
        program, *arguments = module_command("sketchterrain.ui.export_process")
        self._process.setProgram(program)
        self._process.setArguments(arguments)
        self._process.setProcessChannelMode(QProcess.ProcessChannelMode.ForwardedErrorChannel)
        self._process.readyReadStandardOutput.connect(self._read)
        self._process.finished.connect(self._report_end)
        self._process.errorOccurred.connect(self._report_start_error)
        resumes = isinstance(request, WorldRequest) and not request.only_estimate
        self._kill = single_shot(self, _WORLD_GRACE if resumes else _GRACE, self._process.kill)
        self._outcome = "finished shards remain" if resumes else "nothing was written"

    @property
    def is_running(self) -> bool:
        return self._process.state() != QProcess.ProcessState.NotRunning

    def start(self) -> None:
        self.stage_changed.emit("Starting")
        self._process.start()
        self._reading.read(lambda: pickle.dumps((self._request, self._sketch), protocol=5), self._send)

    def cancel(self) -> None:
        """Ask the process to end; no files are written, but a world can be resumed."""
        self._cancelled = True
        if self.is_running:
            self._process.terminate()
            self._kill.start()
        else:
            self._fail("")

    def stop(self) -> None:
        """Cancel a running process and wait for its end."""
        if self.is_running:
            self.cancel()
            if not self._process.waitForFinished(_GRACE):
                self._process.kill()
                self._process.waitForFinished(_GRACE)

    def _send(self, pickled: bytes) -> None:
        self._process.write(pickled)
        self._process.closeWriteChannel()

    def _read(self) -> None:
        self._buffer += self._process.readAllStandardOutput().data()
        *lines, self._buffer = self._buffer.split(b"\n")
        for line in lines:
            event = json.loads(line)
            if "stage" in event:
                self.stage_changed.emit(event["stage"])
            elif "share" in event:
                self.share_changed.emit(float(event["share"]))
            elif "note" in event:
                self.noted.emit(str(event["note"]))
            elif "failed" in event:
                self._fail(str(event["failed"]))
            elif not self._is_over:
                self._is_over = True
                self.finished.emit(event)

    def _report_end(self, code: int, status: QProcess.ExitStatus) -> None:
        self._kill.stop()
        self._read()
        what = "signal" if status == QProcess.ExitStatus.CrashExit else "exit code"
        line = f"The export ended unexpectedly ({what} {code}); {self._outcome}."
        self._fail("" if self._cancelled else line)

    def _report_start_error(self, error: QProcess.ProcessError) -> None:
        if error == QProcess.ProcessError.FailedToStart:
            self._fail(f"The export cannot be started: {self._process.errorString()}.")

    def _fail(self, line: str) -> None:
        if not self._is_over:
            self._is_over = True
            self.failed.emit(line)
