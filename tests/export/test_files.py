from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from sketchterrain.errors import InputError, SketchterrainError
from sketchterrain.export import prepare_folder, write_json
from sketchterrain.whole_files import write_whole

if TYPE_CHECKING:
    from pathlib import Path


def test_a_new_and_an_old_file_get_the_content(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    assert write_whole(path, b"old") == path
    write_whole(path, b"new")
    assert path.read_bytes() == b"new"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.bin"]


def test_a_failing_write_leaves_the_old_file_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.bin"
    write_whole(path, b"old")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(SketchterrainError, match=r"a\.bin: cannot be written \(No space left on device\)$"):
        write_whole(path, b"new")
    assert path.read_bytes() == b"old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.bin"]


def test_an_interrupted_write_leaves_the_old_file_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.bin"
    write_whole(path, b"old")

    def interrupted(_: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_whole(path, b"new")
    assert path.read_bytes() == b"old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.bin"]


def test_a_killed_process_leaves_the_old_file_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    write_whole(path, b"old")
    code = (
        "import os, pathlib, signal, sys\n"
        "from sketchterrain.whole_files import write_whole\n"
        "os.fsync = lambda _: os.kill(os.getpid(), signal.SIGKILL)\n"
        "write_whole(pathlib.Path(sys.argv[1]), b'new')\n"
    )
    killed = subprocess.run([sys.executable, "-c", code, str(path)], check=False)
    assert killed.returncode == -signal.SIGKILL
    assert path.read_bytes() == b"old"


def test_a_missing_folder_is_told_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(SketchterrainError, match="cannot be written") as caught:
        write_whole(tmp_path / "no" / "a.bin", b"")
    assert "\n" not in str(caught.value)
    assert ".tmp" not in str(caught.value)


def test_a_folder_is_made_with_its_parents(tmp_path: Path) -> None:
    prepare_folder(tmp_path / "a" / "b")
    prepare_folder(tmp_path / "a" / "b")
    assert list((tmp_path / "a" / "b").iterdir()) == []


def test_a_file_in_the_folder_s_place_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"mine")
    with pytest.raises(InputError, match="expected a folder"):
        prepare_folder(tmp_path / "a")
    with pytest.raises(SketchterrainError, match="cannot be written"):
        prepare_folder(tmp_path / "a" / "b")
    assert (tmp_path / "a").read_bytes() == b"mine"


def test_json_keeps_order_and_letters_and_refuses_nan(tmp_path: Path) -> None:
    text = write_json(tmp_path / "a.json", {"z": 1, "a": "Höhe"}).read_text(encoding="utf-8")
    assert list(json.loads(text)) == ["z", "a"]
    assert "Höhe" in text
    with pytest.raises(ValueError, match="JSON"):
        write_json(tmp_path / "b.json", {"z": float("nan")})
    assert not (tmp_path / "b.json").exists()
