"""Every failure is one line on stderr, the right exit code, and nothing written."""

import os
import signal
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import sketchterrain.app.generate
import sketchterrain.document.store


def layer(shape: tuple[int, ...], dtype: type = np.uint8) -> Callable[[Path], None]:
    pixels = np.arange(np.prod(shape)).reshape(shape).astype(dtype)
    return lambda folder: Image.fromarray(pixels).save(folder / "mountain.png")


def settings(text: str) -> Callable[[Path], object]:
    return lambda folder: (folder / "sketch.toml").write_text(f"format = 1\n{text}\n", encoding="utf-8")


def two_sizes(folder: Path) -> None:
    for name, size in (("mountain.png", 8), ("hill.png", 9)):
        Image.fromarray(np.zeros((8, size), np.uint8)).save(folder / name)


def truncated(folder: Path) -> None:
    Image.fromarray(np.eye(64, dtype=np.uint8)).save(folder / "mountain.png")
    os.truncate(folder / "mountain.png", (folder / "mountain.png").stat().st_size // 2)


BAD_FOLDERS: dict[str, Callable[[Path], object]] = {
    "an RGB layer": layer((8, 8, 3)),
    "a 16-bit layer": layer((8, 8), np.uint16),
    "an antialiased layer": layer((8, 8)),
    "layers of two sizes": two_sizes,
    "a truncated layer": truncated,
    **{text: settings(text) for text in ("colour = 3", 'extent = "wide"', "extent = nan", "extent = 0")},
    **{text: settings(text) for text in ("fidelity = 1.5", "extent = = 3", "format = 99")},
    "no settings": lambda folder: (folder / "sketch.toml").unlink(),
}


def test_a_bad_sketch_is_one_line_and_writes_nothing(call, tmp_path):
    out = tmp_path / "out.png"
    for number, (name, spoil) in enumerate(BAD_FOLDERS.items()):
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / "sketch.toml").write_text("format = 1\n", encoding="utf-8")
        spoil(folder)
        for command in ("generate", "render"):
            done = call(command, folder, "-o", out)
            assert (done.code, done.out) == (3, ""), (name, done.err)
            assert done.error, name
            assert not out.exists(), name


def zipped(path: Path, name: str, content: bytes) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("sketch.toml", "format = 1\n")
        archive.writestr(name, content)


def test_hostile_archives_and_pictures_are_one_line_and_write_nothing(call, tmp_path):
    (tmp_path / "deep").mkdir()
    zipped(tmp_path / "deep" / "climbing.sketch", "../escaped.png", b"")
    zipped(tmp_path / "bomb.sketch", "mountain.png", bytes(300 << 20))
    header = b"IHDR" + struct.pack(">IIBBBBB", 2**31 - 1, 2**31 - 1, 8, 0, 0, 0, 0)
    chunk = struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header))
    (tmp_path / "huge").mkdir()
    (tmp_path / "huge" / "sketch.toml").write_text("format = 1\n")
    (tmp_path / "huge" / "mountain.png").write_bytes(b"\x89PNG\r\n\x1a\n" + chunk)
    for name, part in {"deep/climbing.sketch": "../escaped.png", "bomb.sketch": "", "huge": ""}.items():
        done = call("generate", tmp_path / name, "-o", tmp_path / "out")
        assert done.code == 3, name
        assert part in done.error, name
        assert not (tmp_path / "out").exists(), name
    assert not (tmp_path / "escaped.png").exists()


def test_a_size_for_which_there_is_no_memory(call, sketch, tmp_path, monkeypatch):
    there = {"SC_PAGE_SIZE": 4096, "SC_PHYS_PAGES": 1 << 18}
    monkeypatch.setattr(os, "sysconf", there.__getitem__)
    done = call("generate", sketch, "-o", tmp_path / "out", "--size", 8193)
    assert done.code == 3
    assert "this machine has 1.0 GiB" in done.error
    assert not (tmp_path / "out").exists()


def test_a_folder_that_is_a_file_or_cannot_be_written_into_is_one_line(call, sketch, tmp_path, monkeypatch):
    (tmp_path / "out").write_text("mine")
    for place, code, part in (("out", 3, "expected a folder"), ("out/deeper", 1, "cannot be written")):
        done = call("generate", sketch, "-o", tmp_path / place)
        assert (done.code, f"{tmp_path / place}: {part}" in done.error) == (code, True)
    assert (tmp_path / "out").read_text() == "mine"

    def refused(self: Path, *_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "mkdir", refused)
    done = call("generate", sketch, "-o", tmp_path / "new")
    assert (done.code, done.error) == (1, f"{tmp_path / 'new'}: cannot be written (Permission denied)")


def fails_with(error: BaseException) -> Callable[..., None]:
    def fail(*_: object, **__: object) -> None:
        raise error

    return fail


def test_whatever_happens_is_one_line_and_a_traceback_for_those_who_ask(call, sketch, tmp_path, monkeypatch):
    monkeypatch.delenv("SKETCHTERRAIN_DEBUG", raising=False)
    for error, code, line in (
        (KeyboardInterrupt(), 130, "interrupted"),
        (MemoryError(), 1, "out of memory"),
        (OSError(5, "Input/output error", "a.bin"), 1, "a.bin: Input/output error"),
        (OSError("odd"), 1, "odd"),
        (ZeroDivisionError("division\nby\x1b"), 1, "unexpected ZeroDivisionError: division by\ufffd; "),
    ):
        monkeypatch.setattr(sketchterrain.app.generate, "build", fails_with(error))
        done = call("generate", sketch, "-o", tmp_path, "--size", 9)
        assert (done.code, done.error.startswith(line)) == (code, True), line
        assert list(tmp_path.iterdir()) == []
    monkeypatch.setenv("SKETCHTERRAIN_DEBUG", "1")
    done = call("generate", sketch, "-o", tmp_path)
    assert (done.code, "Traceback" in done.err) == (1, True)


def test_control_c_in_the_middle_of_the_work(call, sketch, tmp_path, monkeypatch):
    real = sketchterrain.terrain.building.build

    def build(*given: Any, **options: Any) -> Any:
        signal.raise_signal(signal.SIGINT)
        return real(*given, **options)

    monkeypatch.setattr(sketchterrain.app.generate, "build", build)
    # A job in the background is started with the signal ignored, and would not be interrupted by it.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        done = call("generate", sketch, "-o", tmp_path, "--size", 9)
    finally:
        signal.signal(signal.SIGINT, before)
    assert (done.code, done.error) == (130, "interrupted")
    assert not list(tmp_path.glob(".*"))
