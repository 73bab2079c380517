"""`edit`: what it says where no window can be opened, and before one is."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from sketchterrain.errors import SketchterrainError

if TYPE_CHECKING:
    from pathlib import Path


def edit(*arguments: str, code: str = "", **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own, with no screen but what is given."""
    dropped = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")
    rest = {key: value for key, value in os.environ.items() if key not in dropped}
    program = (
        f"{code}\nimport sys\nfrom sketchterrain.cli import main\nsys.exit(main({['edit', *arguments]!r}))"
    )
    return subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, env=rest | environment, timeout=60
    )


def test_no_screen_is_one_line() -> None:
    done = edit("valley_river")
    assert done.returncode == 1
    assert done.stderr.startswith(
        "sketchterrain: error: no screen: neither DISPLAY nor WAYLAND_DISPLAY is set"
    )
    assert done.stderr.count("\n") == 1


def test_a_screen_that_does_not_answer_is_one_line() -> None:
    done = edit("valley_river", DISPLAY=":4099")
    assert done.returncode == 1
    assert done.stderr == ("sketchterrain: error: no screen: the X server at DISPLAY=:4099 does not answer\n")


def test_a_compositor_that_does_not_run_is_one_line(tmp_path: Path) -> None:
    done = edit(QT_QPA_PLATFORM="wayland", WAYLAND_DISPLAY="wayland-7", XDG_RUNTIME_DIR=str(tmp_path))
    assert done.returncode == 1
    assert "expected WAYLAND_DISPLAY to name a running compositor" in done.stderr


@pytest.mark.parametrize("name", ["no_such_sketch", "/dev/null"])
def test_a_sketch_that_is_none_is_told_before_any_window(name: str, tmp_path: Path) -> None:
    done = edit(
        name, QT_QPA_PLATFORM="offscreen", XDG_CONFIG_HOME=str(tmp_path), XDG_STATE_HOME=str(tmp_path)
    )
    assert done.returncode == 3
    assert done.stderr.startswith("sketchterrain: error: ")
    assert done.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_without_qt_it_says_what_to_install() -> None:
    done = edit("valley_river", code="import sys\nsys.modules['PyQt6'] = None", QT_QPA_PLATFORM="offscreen")
    assert done.returncode == 1
    assert done.stderr == "sketchterrain: error: the desktop program needs Qt: pip install PyQt6\n"


def test_a_library_that_lacks_is_told_with_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    import ctypes

    from sketchterrain.ui.screen import check_screen

    def refuse(name: str) -> None:
        raise OSError("libxcb-cursor.so.0: cannot open shared object file: No such file or directory")

    monkeypatch.setattr(ctypes, "CDLL", refuse)
    with pytest.raises(SketchterrainError, match="apt install libxcb-cursor0"):
        check_screen({"DISPLAY": ":0"})


def test_help_of_the_command_loads_no_qt() -> None:
    code = (
        "import sys\nfrom sketchterrain.cli import main\nmain(['edit', '--help'])\n"
        "sys.exit(any(name.startswith('PyQt6') for name in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True).returncode == 0
