"""`edit` without a display or a library."""

import os
import subprocess
import sys

import pytest

from sketchterrain.errors import SketchterrainError


def edit(*arguments: str, code: str = "", **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own, with no screen but what is given."""
    dropped = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")
    rest = {key: value for key, value in os.environ.items() if key not in dropped}
    program = f"{code}\nimport sys\nfrom sketchterrain.app.cli import main\n"
    program += f"sys.exit(main({['edit', *arguments]!r}))"
    return subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, env=rest | environment, timeout=60
    )


def test_missing_displays_and_libraries_are_errors(tmp_path):
    offscreen = {"QT_QPA_PLATFORM": "offscreen"}
    home = {"XDG_CONFIG_HOME": str(tmp_path), "XDG_STATE_HOME": str(tmp_path)}
    wayland = {"QT_QPA_PLATFORM": "wayland", "WAYLAND_DISPLAY": "wayland-7", "XDG_RUNTIME_DIR": str(tmp_path)}
    no_qt = "import sys\nsys.modules['PyQt6'] = None"
    for name, code, environment, status, part in (
        ("valley_river", "", {}, 1, "no display: neither DISPLAY nor WAYLAND_DISPLAY is set"),
        ("valley_river", "", {"DISPLAY": ":4099"}, 1, "the X server at DISPLAY=:4099 does not answer\n"),
        ("valley_river", "", wayland, 1, "expected WAYLAND_DISPLAY to name a running compositor"),
        ("no_such_sketch", "", offscreen | home, 3, "no_such_sketch"),
        ("/dev/null", "", offscreen | home, 3, "/dev/null"),
        ("valley_river", no_qt, offscreen, 1, "the desktop program needs Qt: pip install PyQt6\n"),
    ):
        done = edit(name, code=code, **environment)
        assert done.returncode == status, done.stderr
        assert done.stderr.startswith("sketchterrain: error: ")
        assert part in done.stderr
        assert done.stderr.count("\n") == 1
        assert not list(tmp_path.iterdir())


def test_missing_system_library_names_its_package(monkeypatch):
    import ctypes

    from sketchterrain.ui.app import check_screen

    def refuse(name: str) -> None:
        raise OSError("libxcb-cursor.so.0: cannot open shared object file: No such file or directory")

    monkeypatch.setattr(ctypes, "CDLL", refuse)
    with pytest.raises(SketchterrainError, match="apt install libxcb-cursor0"):
        check_screen({"DISPLAY": ":0"})
