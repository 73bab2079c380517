"""Every failure is one line on stderr, the right exit code, and nothing written."""

from __future__ import annotations

import os
import signal
import struct
import zipfile
import zlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

import sketchterrain.generate
import sketchterrain.sketch

if TYPE_CHECKING:
    from collections.abc import Callable


def save(path: Path, pixels: object, dtype: type = np.uint8) -> None:
    Image.fromarray(np.asarray(pixels, dtype)).save(path)


def rgb(folder: Path) -> None:
    save(folder / "mountain.png", np.zeros((8, 8, 3)))


def sixteen_bit(folder: Path) -> None:
    save(folder / "mountain.png", np.zeros((8, 8)), np.uint16)


def antialiased(folder: Path) -> None:
    save(folder / "mountain.png", np.arange(64).reshape(8, 8))


def other_size(folder: Path) -> None:
    save(folder / "mountain.png", np.zeros((8, 8)))
    save(folder / "hill.png", np.zeros((8, 9)))


def truncated(folder: Path) -> None:
    save(folder / "mountain.png", np.eye(64))
    content = (folder / "mountain.png").read_bytes()
    (folder / "mountain.png").write_bytes(content[: len(content) // 2])


def settings(text: str) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        (folder / "sketch.toml").write_text(f"format = 1\n{text}\n", encoding="utf-8")

    return write


BAD_FOLDERS = {
    "an RGB layer": rgb,
    "a 16-bit layer": sixteen_bit,
    "an antialiased layer": antialiased,
    "layers of two sizes": other_size,
    "a truncated layer": truncated,
    "an unknown key": settings("colour = 3"),
    "a wrong type": settings('extent = "wide"'),
    "a number that is none": settings("extent = nan"),
    "no extent": settings("extent = 0"),
    "a value out of range": settings("fidelity = 1.5"),
    "no TOML": settings("extent = = 3"),
    "another format": lambda folder: (folder / "sketch.toml").write_text("format = 99\n") and None,
    "no settings": lambda folder: (folder / "sketch.toml").unlink(),
}


def test_a_bad_sketch_is_one_line_and_writes_nothing(call: Callable[..., Any], tmp_path: Path) -> None:
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


def test_a_zip_that_climbs_out(call: Callable[..., Any], tmp_path: Path) -> None:
    path = tmp_path / "deep" / "bad.sketch"
    path.parent.mkdir()
    zipped(path, "../escaped.png", b"")
    done = call("generate", path, "-o", tmp_path / "out")
    assert done.code == 3
    assert "../escaped.png" in done.error
    assert not (tmp_path / "escaped.png").exists()
    assert not (tmp_path / "out").exists()


def test_a_zip_bomb(call: Callable[..., Any], tmp_path: Path) -> None:
    zipped(tmp_path / "bad.sketch", "mountain.png", bytes(300 << 20))
    done = call("generate", tmp_path / "bad.sketch", "-o", tmp_path / "out")
    assert done.code == 3
    assert done.error


def test_a_png_that_claims_to_be_huge(call: Callable[..., Any], tmp_path: Path) -> None:
    header = b"IHDR" + struct.pack(">IIBBBBB", 2**31 - 1, 2**31 - 1, 8, 0, 0, 0, 0)
    chunk = struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header))
    (tmp_path / "sketch.toml").write_text("format = 1\n")
    (tmp_path / "mountain.png").write_bytes(b"\x89PNG\r\n\x1a\n" + chunk)
    done = call("generate", tmp_path, "-o", tmp_path / "out")
    assert done.code == 3
    assert done.error


def test_a_size_for_which_there_is_no_memory(
    call: Callable[..., Any], sketch: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = {"SC_PAGE_SIZE": 4096, "SC_PHYS_PAGES": 1 << 18}
    monkeypatch.setattr(os, "sysconf", there.__getitem__)
    done = call("generate", sketch, "-o", tmp_path / "out", "--size", 8193)
    assert done.code == 3
    assert "this machine has 1.0 GiB" in done.error
    assert not (tmp_path / "out").exists()


def test_a_file_where_the_folder_should_be(call: Callable[..., Any], sketch: Path, tmp_path: Path) -> None:
    (tmp_path / "out").write_text("mine")
    done = call("generate", sketch, "-o", tmp_path / "out")
    assert done.code == 3
    assert f"{tmp_path / 'out'}: expected a folder" in done.error
    done = call("generate", sketch, "-o", tmp_path / "out" / "deeper")
    assert done.code == 1
    assert "cannot be written" in done.error
    assert (tmp_path / "out").read_text() == "mine"


def test_a_folder_that_cannot_be_written_into(
    call: Callable[..., Any], sketch: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(self: Path, *_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "mkdir", refused)
    done = call("generate", sketch, "-o", tmp_path / "out")
    assert (done.code, done.error) == (1, f"{tmp_path / 'out'}: cannot be written (Permission denied)")


def fails_with(error: BaseException) -> Callable[..., None]:
    def fail(*_: object, **__: object) -> None:
        raise error

    return fail


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (KeyboardInterrupt(), 130, "interrupted"),
        (MemoryError(), 1, "out of memory"),
        (OSError(5, "Input/output error", "a.bin"), 1, "a.bin: Input/output error"),
        (OSError("odd"), 1, "odd"),
        (
            ZeroDivisionError("division\nby zero\x1b"),
            1,
            "unexpected ZeroDivisionError: division by zero\ufffd; ",
        ),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, BaseException) else "",
)
def test_whatever_happens_is_one_line(
    call: Callable[..., Any],
    sketch: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
    code: int,
    line: str,
) -> None:
    monkeypatch.delenv("SKETCHTERRAIN_DEBUG", raising=False)
    monkeypatch.setattr(sketchterrain.generate, "build", fails_with(error))
    done = call("generate", sketch, "-o", tmp_path, "--size", 9)
    assert done.code == code
    assert done.error.startswith(line)
    assert list(tmp_path.iterdir()) == []


def test_a_traceback_for_those_who_ask(
    call: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, sketch: Path, tmp_path: Path
) -> None:
    monkeypatch.setenv("SKETCHTERRAIN_DEBUG", "1")
    monkeypatch.setattr(sketchterrain.generate, "build", fails_with(ZeroDivisionError("here")))
    done = call("generate", sketch, "-o", tmp_path)
    assert done.code == 1
    assert "Traceback" in done.err


def test_control_c_in_the_middle_of_the_work(
    call: Callable[..., Any], sketch: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = sketchterrain.generate.build

    def build(*given: Any, **options: Any) -> Any:
        signal.raise_signal(signal.SIGINT)
        return real(*given, **options)

    monkeypatch.setattr(sketchterrain.generate, "build", build)
    # A job in the background is started with the signal ignored, and would not be interrupted by it.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        done = call("generate", sketch, "-o", tmp_path, "--size", 9)
    finally:
        signal.signal(signal.SIGINT, before)
    assert (done.code, done.error) == (130, "interrupted")
    assert not list(tmp_path.glob(".*"))
