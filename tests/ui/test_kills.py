"""A program killed at any moment leaves readable files and loses nothing that was written."""

import importlib.util
import random
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from sketchterrain.document.store import JOURNAL, load_sketch
from sketchterrain.ui.models.background import read_recovery

PROGRAM = Path(__file__).with_name("paint_until_killed.py")
INTERVAL = 0.1
"""Time between autosaves (s), instead of 20."""
LINES = 200
"""Most lines that are logged before a kill."""


def program():
    spec = importlib.util.spec_from_file_location("paint_until_killed", PROGRAM)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@dataclass(frozen=True)
class Log:
    """The program's log: (event, fingerprint of the sketch)."""

    lines: tuple[tuple[str, str], ...]

    @classmethod
    def read(cls, path: Path) -> "Log":
        return cls(tuple((kind, digest) for kind, digest in map(str.split, path.read_text().splitlines())))

    def states(self) -> list[str]:
        return [digest for kind, digest in self.lines if kind == "state"]

    @property
    def saves(self) -> int:
        return sum(kind == "saved" for kind, _ in self.lines)

    def may_be_saved(self) -> set[str]:
        """Return the sketches the file may hold: the last saved one, or any whose save started later."""
        ends = [k for k, (kind, _) in enumerate(self.lines) if kind == "saved"]
        started = [digest for kind, digest in self.lines[ends[-1] if ends else 0 :] if kind == "saving"]
        return {*started, *(self.lines[k][1] for k in ends[-1:])}

    def written(self) -> int:
        """Return the number of the newest state that was saved or autosaved, 0 if none was."""
        newest, states = 0, []
        for kind, digest in self.lines:
            if kind == "state":
                states.append(digest)
            elif kind in ("saved", "autosaved") and digest in states:
                newest = max(newest, max(k for k, each in enumerate(states) if each == digest))
        return newest

    def lost(self, digest: str) -> int:
        """Return how many states are newer than a sketch."""
        return self.states()[::-1].index(digest)


def paint_and_kill(target: Path, folder: Path, log: Path, rng: random.Random) -> None:
    """Run the program until it has logged a random number of lines, and kill it."""
    command = [sys.executable, str(PROGRAM), str(target), str(folder), str(log), str(INTERVAL)]
    lines = rng.randint(1, LINES)
    with subprocess.Popen([*command, str(rng.randrange(10**9))], stderr=subprocess.PIPE) as child:
        while not log.exists() or log.read_bytes().count(b"\n") < lines:
            assert child.poll() is None, child.stderr.read().decode()
            time.sleep(0.005)
        child.kill()


SLOW = pytest.param("valley.sketch", 8, marks=pytest.mark.slow)
SOAK = [pytest.param(name, 100, marks=pytest.mark.soak) for name in ("valley", "valley.sketch")]


@pytest.mark.parametrize(("name", "kills"), [SLOW, *SOAK])
def test_a_kill_at_any_moment_loses_nothing_that_was_written(tmp_path: Path, name: str, kills: int):
    fingerprint = program().fingerprint
    rng = random.Random(name)
    target, folder = tmp_path / name, tmp_path / "recovery"
    on_file: set[str] = set()
    saves, recoveries, cut_off = 0, 0, 0
    lost: list[int] = []
    for number in range(kills):
        path = tmp_path / f"{number}.log"
        paint_and_kill(target, folder, path, rng)
        log = Log.read(path)
        survived = [log.states()[0]] if not number else []
        if log.saves or on_file:
            saved = fingerprint(load_sketch(target))
            assert saved in (log.may_be_saved() if log.saves else log.may_be_saved() | on_file)
            on_file = {saved}
        elif target.exists() and is_whole(target):
            on_file = {fingerprint(load_sketch(target))}
            assert on_file <= log.may_be_saved()
        recovered = [fingerprint(load_sketch(each)) for each in folder.glob("*.sketch")]
        assert all(read_recovery(each) is not None for each in folder.glob("*.sketch"))
        assert len(recovered) <= 2  # of the previous kill and of this one
        known = set(log.states())
        survived += [digest for digest in (*on_file, *recovered) if digest in known]
        assert survived, "everything is lost"
        lost.append(min(map(log.lost, survived)))
        assert lost[-1] <= len(log.states()) - 1 - log.written()
        saves += log.saves
        recoveries += bool(recovered)
        left = [*tmp_path.rglob(".*.tmp"), *tmp_path.rglob(JOURNAL)]
        cut_off += bool(left)
        for each in left:
            if each.name != JOURNAL:
                each.unlink()
    print(  # noqa: T201
        f"{kills} kills, {cut_off} of them in the middle of writing: {saves} saves, {recoveries} "
        f"recoveries, at most {max(lost)} states lost"
    )
    assert saves > kills // 4
    assert recoveries > kills // 4


def is_whole(folder: Path) -> bool:
    """Return whether a first save has written a readable sketch."""
    return folder.is_file() or any((folder / name).exists() for name in (JOURNAL, "sketch.toml"))
