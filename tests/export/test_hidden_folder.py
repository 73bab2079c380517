"""Files that come into a folder together, and what a process that was killed leaves there."""

from __future__ import annotations

import signal
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from sketchterrain.errors import SketchterrainError
from sketchterrain.export import move_into, staging
from sketchterrain.export.files import files_without_successor

if TYPE_CHECKING:
    from pathlib import Path


def test_files_come_together_and_nothing_else_stays(tmp_path: Path) -> None:
    (tmp_path / "old").write_bytes(b"old")
    with staging(tmp_path) as hidden:
        assert hidden.parent == tmp_path
        (hidden / "a").write_bytes(b"a")
        (hidden / "unwanted").write_bytes(b"")
        assert move_into(tmp_path, [hidden / "a"], outdated=[tmp_path / "old"]) == (tmp_path / "a",)
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_what_a_killed_process_left_goes_and_what_another_is_at_stays(tmp_path: Path) -> None:
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


def test_a_failure_names_the_folder_that_one_knows(tmp_path: Path) -> None:
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
