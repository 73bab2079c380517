"""Files that are replaced as a whole, folders of them, and partial files of killed processes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from sketchterrain.errors import InputError, SketchterrainError
from sketchterrain.export import move_into, prepare_folder, staging, write_json
from sketchterrain.export.files import files_without_successor
from sketchterrain.export.sidecar import SIDECAR, replaced_files
from sketchterrain.whole_files import write_whole

if TYPE_CHECKING:
    from pathlib import Path


def test_new_content_replaces_the_old_and_a_missing_folder_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    assert write_whole(path, b"old") == path
    write_whole(path, b"new")
    assert path.read_bytes() == b"new"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.bin"]

    with pytest.raises(SketchterrainError, match="cannot be written") as caught:
        write_whole(tmp_path / "no" / "a.bin", b"")
    assert "\n" not in str(caught.value)
    assert ".tmp" not in str(caught.value)


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


def test_a_folder_is_made_with_its_parents_or_refused(tmp_path: Path) -> None:
    prepare_folder(tmp_path / "a" / "b")
    prepare_folder(tmp_path / "a" / "b")
    assert list((tmp_path / "a" / "b").iterdir()) == []

    (tmp_path / "c").write_bytes(b"mine")
    with pytest.raises(InputError, match="expected a folder"):
        prepare_folder(tmp_path / "c")
    with pytest.raises(SketchterrainError, match="cannot be written"):
        prepare_folder(tmp_path / "c" / "b")
    assert (tmp_path / "c").read_bytes() == b"mine"


def test_json_keeps_order_and_letters_and_refuses_nan(tmp_path: Path) -> None:
    text = write_json(tmp_path / "a.json", {"z": 1, "a": "Höhe"}).read_text(encoding="utf-8")
    assert list(json.loads(text)) == ["z", "a"]
    assert "Höhe" in text
    with pytest.raises(ValueError, match="JSON"):
        write_json(tmp_path / "b.json", {"z": float("nan")})
    assert not (tmp_path / "b.json").exists()


def test_staged_files_are_moved_together(tmp_path: Path) -> None:
    (tmp_path / "old").write_bytes(b"old")
    with staging(tmp_path) as hidden:
        assert hidden.parent == tmp_path
        (hidden / "a").write_bytes(b"a")
        (hidden / "unwanted").write_bytes(b"")
        assert move_into(tmp_path, [hidden / "a"], outdated=[tmp_path / "old"]) == (tmp_path / "a",)
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_folders_of_killed_processes_are_removed_and_folders_in_use_kept(tmp_path: Path) -> None:
    code = (
        "import os, pathlib, signal, sys\n"
        "from sketchterrain.export import staging\n"
        "with staging(pathlib.Path(sys.argv[1])) as hidden:\n"
        "    (hidden / 'half').write_bytes(b'half')\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    killed = subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=False)
    assert killed.returncode == -signal.SIGKILL
    (left,) = tmp_path.iterdir()
    assert [path.name for path in left.iterdir()] == ["half"]
    with staging(tmp_path) as first:
        assert not left.exists()
        with staging(tmp_path) as second:
            assert first.is_dir()
            assert second != first
        assert [*tmp_path.iterdir()] == [first]
    assert [*tmp_path.iterdir()] == []


def test_errors_name_the_final_folder(tmp_path: Path) -> None:
    with pytest.raises(SketchterrainError, match="cannot be written") as caught, staging(tmp_path) as hidden:
        raise SketchterrainError(f"{hidden / 'a'}: cannot be written")
    assert str(caught.value).startswith(f"{tmp_path / 'a'}: ")
    with pytest.raises(SketchterrainError, match="cannot be written"), staging(tmp_path / "none"):
        pass


def test_only_files_of_the_folder_itself_have_no_successor(tmp_path: Path) -> None:
    for name in ("a", "b", "c"):
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "d").write_bytes(b"")
    before = ["a", "b", "gone", "inner", "inner/d", "../" + tmp_path.name + "/c", "", "."]
    assert files_without_successor(tmp_path, before, ["b", "new"]) == [tmp_path / "a"]


def test_only_an_earlier_export_of_the_same_sketch_and_target_is_replaced(tmp_path: Path) -> None:
    def sidecar(*names: str, target: str = "raw") -> dict[str, object]:
        files = [{"file": name} for name in names]
        return {"format": 1, "target": target, "sketch": "a", "files": files}

    (tmp_path / "old").write_bytes(b"")
    (tmp_path / "kept").write_bytes(b"")
    told = sidecar("kept", "new")
    assert replaced_files(tmp_path, told) == []
    for content in ("[]", "{", json.dumps(sidecar("old", "kept", target="png16"))):
        (tmp_path / SIDECAR).write_text(content)
        assert replaced_files(tmp_path, told) == [], content
    (tmp_path / SIDECAR).write_text(json.dumps(sidecar("old", "kept")))
    assert replaced_files(tmp_path, told) == [tmp_path / "old"]
