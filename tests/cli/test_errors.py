"""Every failure is one line on stderr with its exit code, and nothing is written."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import psutil
from PIL import Image

import sketchterrain.document.store
import sketchterrain.jobs.export


def test_invalid_sketches_are_refused_and_nothing_is_written(call, tmp_path):
    out = tmp_path / "out.png"
    for name, settings in (("layer", "format = 1"), ("value", "format = 1\nextent = nan"), ("missing", None)):
        folder = tmp_path / name
        folder.mkdir()
        if settings is not None:
            (folder / "sketch.toml").write_text(settings, encoding="utf-8")
        if name == "layer":
            Image.fromarray(np.full((8, 8, 3), (1, 2, 3), np.uint8)).save(folder / "mountain.png")
        for command in ("generate", "render"):
            done = call(command, folder, "-o", out)
            assert (done.code, done.out) == (3, ""), (name, done.err)
            assert done.error, name
            assert not out.exists(), name


def test_size_beyond_the_memory_is_refused(call, sketch, tmp_path, monkeypatch):
    monkeypatch.setattr(psutil, "virtual_memory", lambda: SimpleNamespace(total=1 << 30))
    done = call("generate", sketch, "-o", tmp_path / "out", "--size", 8193)
    assert done.code == 3
    assert "this machine has 1.0 GiB" in done.error
    assert not (tmp_path / "out").exists()


def test_invalid_output_folders_are_refused(call, sketch, tmp_path, monkeypatch):
    (tmp_path / "out").write_text("mine")
    commands = [("generate", sketch), ("export", sketch, "--to", "raw")]
    for command in commands:
        for place, code, part in (("out", 3, "expected a folder"), ("out/deeper", 1, "cannot be written")):
            done = call(*command, "-o", tmp_path / place)
            assert (done.code, f"{tmp_path / place}: {part}" in done.error) == (code, True)
    assert (tmp_path / "out").read_text() == "mine"

    def refused(self: Path, *_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "mkdir", refused)
    for command in commands:
        done = call(*command, "-o", tmp_path / "new")
        assert (done.code, done.error) == (1, f"{tmp_path / 'new'}: cannot be written (Permission denied)")


def fails_with(error: BaseException) -> Callable[..., None]:
    def fail(*_: object, **__: object) -> None:
        raise error

    return fail


def test_exceptions_are_reported_and_tracebacks_optional(call, sketch, tmp_path, monkeypatch):
    monkeypatch.delenv("SKETCHTERRAIN_DEBUG", raising=False)
    for error, code, line in (
        (KeyboardInterrupt(), 130, "interrupted"),
        (MemoryError(), 1, "out of memory"),
        (OSError(5, "Input/output error", "a.bin"), 1, "a.bin: Input/output error"),
        (OSError("odd"), 1, "odd"),
        (
            UnicodeEncodeError("utf-8", "o\udce9", 1, 2, "surrogates not allowed"),
            3,
            "o\ufffd: expected a name in",
        ),
        (ZeroDivisionError("division\nby\x1b"), 1, "unexpected ZeroDivisionError: division by\ufffd; "),
    ):
        monkeypatch.setattr(sketchterrain.jobs.export, "build", fails_with(error))
        done = call("generate", sketch, "-o", tmp_path, "--size", 9)
        assert (done.code, done.error.startswith(line)) == (code, True), line
        assert list(tmp_path.iterdir()) == []
    monkeypatch.setenv("SKETCHTERRAIN_DEBUG", "1")
    done = call("generate", sketch, "-o", tmp_path)
    assert (done.code, "Traceback" in done.err) == (1, True)
