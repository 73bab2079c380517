"""A person before the program: sees its window on a screen of its own, has a mouse and a keyboard."""

import itertools
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import ImageGrab

_DRIVEN = Path(__file__).with_name("driven.py")
_PATIENCE = 300.0  # s; machines are shared


class Person:
    """Starts the program and uses it through X's own events; all that the program keeps is in ``home``."""

    def __init__(self, display: str, home: Path) -> None:
        self.display, self.home = display, home
        folders = ("XDG_CONFIG_HOME", "XDG_STATE_HOME", "XDG_DATA_HOME")
        kept = {name: str(home / name.lower()) for name in folders}
        self._environment = {**os.environ, **kept, "DISPLAY": display, "QT_QPA_PLATFORM": "xcb"}
        self._program: subprocess.Popen[str] | None = None

    def start(self, *arguments: str) -> None:
        """Start ``sketchterrain edit`` and wait until its window is there."""
        self._program = subprocess.Popen(
            [sys.executable, "-X", "faulthandler", str(_DRIVEN), "edit", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=self._environment,
        )
        self.wait("window is not None and window.isVisible()")
        self.focus("window")

    def focus(self, widget: str) -> None:
        """Give the keyboard to a window, as a window manager does where there is one."""
        self.x("windowfocus", "--sync", str(self.ask(f"int({widget}.winId())")))

    def ask(self, question: str) -> Any:
        self._program.stdin.write(question.replace("\n", " ") + "\n")
        self._program.stdin.flush()
        line = self._program.stdout.readline()
        assert line, f"the program ended with code {self._program.wait(timeout=10)}"
        told = json.loads(line)
        assert "error" not in told, f"{question}: {told['error']}"
        return told["value"]

    def wait(self, question: str, *, seconds: float = _PATIENCE) -> None:
        self.until(lambda: self.ask(question), question, seconds=seconds)

    def until(self, holds: Callable[[], object], what: str, *, seconds: float = _PATIENCE) -> None:
        """Wait until something holds beside the program."""
        end = time.monotonic() + seconds
        while not holds():
            assert time.monotonic() < end, f"waited {seconds:g} s for {what}"
            time.sleep(0.05)

    def x(self, *arguments: str) -> None:
        """Pass words to xdotool: move the mouse, press buttons and keys."""
        subprocess.run(["xdotool", *arguments], check=True, env=self._environment, stdout=subprocess.DEVNULL)

    def key(self, *keys: str) -> None:
        """Press keys one after another, ``ctrl+z`` together."""
        for each in keys:
            self.x("key", "--clearmodifiers", each)
            time.sleep(0.05)

    def write(self, text: str) -> None:
        self.x("type", "--delay", "15", text)

    def click(self, x: float, y: float, *, button: int = 1, times: int = 1) -> None:
        self.x("mousemove", str(round(x)), str(round(y)))
        self.x("click", "--repeat", str(times), "--delay", "60", str(button))

    def drag(self, *places: tuple[float, float], button: int = 1, steps: int = 12) -> None:
        """Press at the first place, go through the others and let go at the last."""
        words = ["mousemove", *map(str, map(round, places[0])), "mousedown", str(button), "sleep", "0.05"]
        for (x0, y0), (x1, y1) in itertools.pairwise(places):
            for step in range(1, steps + 1):
                share = step / steps
                x, y = round(x0 + share * (x1 - x0)), round(y0 + share * (y1 - y0))
                words += ["mousemove", str(x), str(y), "sleep", "0.012"]
        self.x(*words, "sleep", "0.05", "mouseup", str(button))

    def see(self, path: Path | None = None) -> np.ndarray:
        """Return the screen, (height, width, 3) uint8; keep it as a picture if a path is given."""
        picture = ImageGrab.grab(xdisplay=self.display).convert("RGB")
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            picture.save(path)
        return np.asarray(picture)

    def kill(self) -> None:
        """End the program as the system does it: at once."""
        self._program.send_signal(signal.SIGKILL)
        self._end()

    def leave(self) -> int:
        """Quit without saving; return the exit code."""
        document = "window._document"
        saved = f"{document}.mark_saved({document}.sketch, {document}.path)"
        self.ask(f"{saved}, QTimer.singleShot(0, window.close)")
        code = self._program.wait(timeout=30)
        self._end()
        return code

    def close(self) -> None:
        if self._program is not None and self._program.poll() is None:
            self._program.kill()
        self._end()

    def _end(self) -> None:
        if self._program is not None:
            self._program.stdin.close()
            self._program.stdout.close()
            self._program.wait(timeout=30)
            self._program = None
