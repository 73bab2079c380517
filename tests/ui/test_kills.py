"""A program killed at any moment leaves readable files and loses at most the last seconds of work."""

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
INTERVAL = 0.5
"""Time between autosaves (s), instead of 20."""
SOON = 2 * INTERVAL
"""Bound (s) of the work lost in three quarters of the kills."""
MOST_LOST = INTERVAL + 4.0
"""Bound (s) of the work lost in any kill, with writing on a busy machine."""


def program():
    spec = importlib.util.spec_from_file_location("paint_until_killed", PROGRAM)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@dataclass(frozen=True)
class Log:
    """The program's log: (event, time, fingerprint of the sketch)."""

    lines: tuple[tuple[str, float, str], ...]

    @classmethod
    def read(cls, path: Path) -> "Log":
        rows = path.read_text().splitlines() if path.exists() else []
        return cls(tuple((kind, float(time_s), digest) for kind, time_s, digest in map(str.split, rows)))

    def states(self) -> list[tuple[float, str]]:
        return [(time_s, digest) for kind, time_s, digest in self.lines if kind == "state"]

    @property
    def saves(self) -> int:
        return sum(kind == "saved" for kind, _, _ in self.lines)

    def may_be_saved(self) -> set[str]:
        """Return the sketches the file may hold: the last saved one, or any whose save started later."""
        ends = [k for k, (kind, _, _) in enumerate(self.lines) if kind == "saved"]
        started = [digest for kind, _, digest in self.lines[ends[-1] if ends else 0 :] if kind == "saving"]
        return {*started, *(self.lines[k][2] for k in ends[-1:])}

    def lost(self, digest: str, killed: float) -> float:
        """Return the age (s) of the first step that a sketch lacks."""
        states = self.states()
        last = max(k for k, (_, each) in enumerate(states) if each == digest)
        return killed - states[last + 1][0] if last + 1 < len(states) else 0.0


def paint_and_kill(target: Path, folder: Path, log: Path, rng: random.Random) -> float:
    """Run the program for a random time and kill it; return the time (s, monotonic)."""
    command = [sys.executable, str(PROGRAM), str(target), str(folder), str(log), str(INTERVAL)]
    with subprocess.Popen([*command, str(rng.randrange(10**9))], stderr=subprocess.PIPE) as child:
        while not log.exists() or not log.stat().st_size:
            assert child.poll() is None, child.stderr.read().decode()
            time.sleep(0.005)
        time.sleep(rng.uniform(0.0, 4.0 * INTERVAL))
        assert child.poll() is None, child.stderr.read().decode()
        child.kill()
        return time.monotonic()


SLOW = pytest.param("valley.sketch", 8, marks=pytest.mark.slow)
SOAK = [pytest.param(name, 100, marks=pytest.mark.soak) for name in ("valley", "valley.sketch")]


@pytest.mark.parametrize(("name", "kills"), [SLOW, *SOAK])
def test_a_kill_at_any_moment_loses_at_most_the_last_seconds(tmp_path: Path, name: str, kills: int):
    fingerprint = program().fingerprint
    rng = random.Random(name)
    target, folder = tmp_path / name, tmp_path / "recovery"
    on_file: set[str] = set()
    saves, recoveries, cut_off = 0, 0, 0
    lost: list[float] = []
    for number in range(kills):
        path = tmp_path / f"{number}.log"
        killed = paint_and_kill(target, folder, path, rng)
        log = Log.read(path)
        survived = [log.states()[0][1]] if not number else []
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
        known = {digest for _, digest in log.states()}
        survived += [digest for digest in (*on_file, *recovered) if digest in known]
        assert survived, "everything is lost"
        lost.append(min(log.lost(digest, killed) for digest in survived))
        saves += log.saves
        recoveries += bool(recovered)
        left = [*tmp_path.rglob(".*.tmp"), *tmp_path.rglob(JOURNAL)]
        cut_off += bool(left)
        for each in left:
            if each.name != JOURNAL:
                each.unlink()
    print(  # noqa: T201
        f"{kills} kills, {cut_off} of them in the middle of writing: {saves} saves, {recoveries} "
        f"recoveries, at most {max(lost):.2f} s lost"
    )
    assert max(lost) <= MOST_LOST
    assert sum(each <= SOON for each in lost) >= 0.75 * len(lost)
    assert saves > kills // 4
    assert recoveries > kills // 4


def is_whole(folder: Path) -> bool:
    """Return whether a first save has written a readable sketch."""
    return folder.is_file() or any((folder / name).exists() for name in (JOURNAL, "sketch.toml"))
