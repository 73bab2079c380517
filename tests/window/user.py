"""A user of the real program: mouse, keyboard and screen of a virtual X display, and widget positions."""

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

_PROGRAM = Path(__file__).with_name("program.py")
_TIMEOUT = 300.0  # s; machines are shared


class User:
    """Starts the program and operates it by X events; its settings and state are in `home`."""

    def __init__(self, display: str, home: Path) -> None:
        self.display, self.home = display, home
        folders = ("XDG_CONFIG_HOME", "XDG_STATE_HOME", "XDG_DATA_HOME")
        state = {name: str(home / name.lower()) for name in folders}
        self._environment = {**os.environ, **state, "DISPLAY": display, "QT_QPA_PLATFORM": "xcb"}
        self._program: subprocess.Popen[str] | None = None

    def start(self, *arguments: str) -> None:
        """Start `sketchterrain edit` and wait for its window."""
        self._program = subprocess.Popen(
            [sys.executable, "-X", "faulthandler", str(_PROGRAM), "edit", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=self._environment,
        )
        self.wait("window is not None and window.isVisible()")
        self.focus("window")

    def focus(self, widget: str) -> None:
        """Give a window the keyboard focus: no window manager runs."""
        self.xdotool("windowfocus", "--sync", str(self.evaluate(f"int({widget}.winId())")))

    def evaluate(self, expression: str) -> Any:
        """Return the value of an expression in the program."""
        self._program.stdin.write(expression.replace("\n", " ") + "\n")
        self._program.stdin.flush()
        line = self._program.stdout.readline()
        assert line, f"the program ended with code {self._program.wait(timeout=300)}"
        answer = json.loads(line)
        assert "error" not in answer, f"{expression}: {answer['error']}"
        return answer["value"]

    def wait(self, condition: str, *, seconds: float = _TIMEOUT) -> None:
        self.until(lambda: self.evaluate(condition), condition, seconds=seconds)

    def until(self, holds: Callable[[], object], what: str, *, seconds: float = _TIMEOUT) -> None:
        """Wait until a condition outside the program holds."""
        end = time.monotonic() + seconds
        while not holds():
            assert time.monotonic() < end, f"waited {seconds:g} s for {what}"
            time.sleep(0.05)

    def xdotool(self, *arguments: str) -> None:
        """Run xdotool: move the mouse, press buttons and keys."""
        subprocess.run(["xdotool", *arguments], check=True, env=self._environment, stdout=subprocess.DEVNULL)

    def key(self, *keys: str) -> None:
        """Press keys one after another; `ctrl+z` is one."""
        for each in keys:
            self.xdotool("key", "--clearmodifiers", each)
            time.sleep(0.05)

    def write(self, text: str) -> None:
        self.xdotool("type", "--delay", "15", text)

    def click(self, x: float, y: float, *, button: int = 1, times: int = 1) -> None:
        self.xdotool("mousemove", str(round(x)), str(round(y)))
        self.xdotool("click", "--repeat", str(times), "--delay", "60", str(button))

    def drag(self, *places: tuple[float, float], button: int = 1, steps: int = 12) -> None:
        """Drag with a button from the first position through the others."""
        words = ["mousemove", *map(str, map(round, places[0])), "mousedown", str(button), "sleep", "0.05"]
        for (x0, y0), (x1, y1) in itertools.pairwise(places):
            for step in range(1, steps + 1):
                share = step / steps
                x, y = round(x0 + share * (x1 - x0)), round(y0 + share * (y1 - y0))
                words += ["mousemove", str(x), str(y), "sleep", "0.012"]
        self.xdotool(*words, "sleep", "0.05", "mouseup", str(button))

    def screenshot(self, path: Path | None = None) -> np.ndarray:
        """Return the screen, (height, width, 3) uint8; save it if a path is given."""
        picture = ImageGrab.grab(xdisplay=self.display).convert("RGB")
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            picture.save(path)
        return np.asarray(picture)

    def kill(self) -> None:
        """Kill the program (SIGKILL)."""
        self._program.send_signal(signal.SIGKILL)
        self._end()

    def leave(self) -> int:
        """Quit without saving; return the exit code."""
        document = "window._document"
        saved = f"{document}.mark_saved({document}.state, {document}.path)"
        self.evaluate(f"{saved}, QTimer.singleShot(0, window.close)")
        code = self._program.wait(timeout=300)
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
            self._program.wait(timeout=300)
            self._program = None


_IS_UP_TO_DATE = (
    "(lambda link: not link._timer.isActive() and None not in (link.frame, link.placed, link.relief) and "
    "link.frame.version == link.relief.version == link.placed.version == link._updates._version)"
    "(window._link)"
)


def on_canvas(user: User) -> Callable[[float, float], tuple[float, float]]:
    """Return a function from sketch pixels to screen positions."""
    left, top, scale, ratio, x, y = user.evaluate(
        "(lambda c, v, at: [v.left, v.top, v.scale, c.devicePixelRatioF(), at.x(), at.y()])"
        "(window.canvas, window.canvas.viewport, window.canvas.mapToGlobal(QPoint(0, 0)))"
    )
    return lambda column, row: (x + (left + column * scale) / ratio, y + (top + row * scale) / ratio)


def on_terrain(user: User) -> Callable[[float, float], tuple[float, float]]:
    """Return a function from metres east and north to screen positions of the canvas."""
    at = on_canvas(user)
    size, rows = user.evaluate("[window._document.sketch.pixel_size, window._document.sketch.height_px]")
    return lambda east, north: at(east / size, rows - north / size)


def centre_of(user: User, widget: str) -> tuple[float, float]:
    """Return the screen position of the centre of a widget."""
    centre = f"{widget}.mapToGlobal({widget}.rect().center())"
    return tuple(user.evaluate(f"[{centre}.x(), {centre}.y()]"))


def view_of(user: User, screen: np.ndarray) -> np.ndarray:
    """Return the pixels of the 3-D view in a screenshot."""
    x, y, width, height = user.evaluate(
        "[window.view.mapToGlobal(QPoint(0, 0)).x(), window.view.mapToGlobal(QPoint(0, 0)).y(), "
        "window.view.width(), window.view.height()]"
    )
    return screen[y : y + height, x : x + width].astype(int)


def wait_for_terrain(user: User) -> None:
    """Wait until the newest sketch is placed, rendered and shaded."""
    user.wait(_IS_UP_TO_DATE)
