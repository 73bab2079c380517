"""`edit` without a display or a library."""

import subprocess
import sys

import pytest

from sketchterrain.errors import SketchterrainError


def test_missing_displays_libraries_and_sketches_are_errors(call, tmp_path, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"):
        monkeypatch.delenv(name, raising=False)
    for name in ("XDG_CONFIG_HOME", "XDG_STATE_HOME", "XDG_RUNTIME_DIR"):
        monkeypatch.setenv(name, str(tmp_path))
    offscreen = {"QT_QPA_PLATFORM": "offscreen"}
    for name, environment, code, part in (
        ("valley_river", {}, 1, "no display: neither DISPLAY nor WAYLAND_DISPLAY is set"),
        ("valley_river", {"DISPLAY": ":4099"}, 1, "the X server at DISPLAY=:4099 does not answer\n"),
        (
            "valley_river",
            {"QT_QPA_PLATFORM": "wayland", "WAYLAND_DISPLAY": "wayland-7"},
            1,
            "expected WAYLAND_DISPLAY to name a running compositor\n",
        ),
        ("no_such_sketch", offscreen, 3, "no_such_sketch"),
        ("/dev/null", offscreen, 3, "/dev/null"),
    ):
        with monkeypatch.context() as patch:
            for key, value in environment.items():
                patch.setenv(key, value)
            done = call("edit", name)
        assert (done.code, part in f"{done.error}\n") == (code, True), (name, done.err)
        assert not list(tmp_path.iterdir())


def test_missing_qt_is_an_error():
    code = "import sys\nsys.modules['PyQt6'] = None\nfrom sketchterrain.app.cli import main\n"
    done = subprocess.run(
        [sys.executable, "-c", f"{code}sys.exit(main(['edit', 'valley_river']))"],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    assert done.stderr == "sketchterrain: error: the desktop program needs Qt: pip install PyQt6\n"


def test_missing_system_library_names_its_package(monkeypatch):
    import ctypes

    from sketchterrain.ui.app import check_screen

    def refuse(name: str) -> None:
        raise OSError("libxcb-cursor.so.0: cannot open shared object file: No such file or directory")

    monkeypatch.setattr(ctypes, "CDLL", refuse)
    with pytest.raises(SketchterrainError, match="apt install libxcb-cursor0"):
        check_screen({"DISPLAY": ":0"})
