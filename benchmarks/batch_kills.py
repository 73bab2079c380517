"""Batches that are killed at random moments and resumed, and whether they end with the same files.

``python -m sketchterrain.benchmarks.batch_kills DIR`` kills 100 seeds of a preset at 1025² fifty times.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence

_MEASURED = ("timings", "rendering", "writing", "peak_memory")


class Kill(NamedTuple):
    """One kill: seconds after its process began, terrains that were done, hidden files that it left."""

    after: float
    done: int
    leftovers: int


def killed(
    words: Sequence[str],
    folder: Path,
    *,
    kills: int,
    longest: float,
    chance: random.Random,
    timeout: float | None = None,
) -> list[Kill]:
    """Make a batch in processes that are killed, each as a group, and resumed; the last one is not.

    Parameters
    ----------
    words
        Of the command line, after ``batch``, without ``-o`` and ``--resume``.
    folder
        Of the batch.
    kills
        How many at most: it ends when the batch is done.
    longest
        Seconds: each process lives a random time up to that.
    chance
        Where the times come from.
    timeout
        Seconds that the last process may take.

    Raises
    ------
    RuntimeError
        If a process fails by itself.
    """
    found: list[Kill] = []
    command = [sys.executable, "-m", "sketchterrain", "batch", *words, "-o", str(folder), "--resume"]
    while True:
        start = time.perf_counter()
        process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True
        )
        try:
            _, told = process.communicate(
                timeout=chance.uniform(0.0, longest) if len(found) < kills else timeout
            )
        except subprocess.TimeoutExpired:
            _kill(process)
            process.communicate()
            if len(found) == kills:
                raise
            found.append(Kill(time.perf_counter() - start, _done(folder), _hidden(folder)))
            continue
        if process.returncode != 0:
            raise RuntimeError(f"batch ended with {process.returncode}: {told.decode(errors='replace')}")
        return found


def _kill(process: subprocess.Popen[bytes]) -> None:
    """Kill a process that leads a session, and on POSIX all that it started."""
    if sys.platform == "win32":
        process.kill()
    else:
        os.killpg(process.pid, signal.SIGKILL)


def differences(one: Path, other: Path) -> list[str]:
    """Return which files of two batches are not the same; times that were measured may differ."""
    names = [{str(path.relative_to(folder)) for path in folder.rglob("*")} for folder in (one, other)]
    lacking = sorted(names[0] ^ names[1])
    both = (name for name in sorted(names[0] & names[1]) if (one / name).is_file())
    return lacking + [name for name in both if _compared(one / name) != _compared(other / name)]


def _compared(path: Path) -> object:
    if path.name == "report.json":
        return _without_times(json.loads(path.read_bytes()))
    if path.name == "manifest.json":
        told = json.loads(path.read_bytes())
        for item in told["items"]:
            item["files"] = [each for each in item["files"] if each["file"] != "report.json"]
            del item["seconds"], item["timings"]
        return told
    return path.read_bytes()


def _without_times(report: dict[str, Any]) -> dict[str, Any]:
    for name in _MEASURED:
        report.pop(name, None)
    for name in ("seconds", "plants_per_second"):
        report.get("foliage", {}).pop(name, None)
    return report


def _done(folder: Path) -> int:
    path = folder / "manifest.json"
    if not path.exists():
        return 0
    return sum(item["state"] == "done" for item in json.loads(path.read_bytes())["items"])


def _hidden(folder: Path) -> int:
    return sum(path.name.startswith(".") for path in folder.rglob("*"))


def _main() -> None:
    parser = argparse.ArgumentParser(
        description="Kill a batch at random moments and compare what it ends with."
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--sketch", default="valley_river")
    parser.add_argument("--seeds", default="1-100")
    parser.add_argument("--size", default="1025")
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--longest", type=float, default=30.0, help="seconds that a process lives at most")
    parser.add_argument("--no-preview", action="store_true")
    given = parser.parse_args()
    words = [given.sketch, "--seeds", given.seeds, "--size", given.size]
    words += ["--no-preview"] if given.no_preview else []
    whole = given.folder / "whole"
    command = [sys.executable, "-m", "sketchterrain", "batch", *words, "-o", str(whole), "--resume"]
    subprocess.run(command, check=True)
    found = killed(
        words,
        given.folder / "killed",
        kills=given.kills,
        longest=given.longest,
        chance=random.Random(1),  # noqa: S311 - moments, no secrets
    )
    for number, kill in enumerate(found, start=1):
        told = f"kill {number} after {kill.after:.1f} s: {kill.done} done, {kill.leftovers} left half-written"
        sys.stdout.write(f"{told}\n")
    different = differences(whole, given.folder / "killed")
    sys.stdout.write(f"{len(found)} kills, {len(different)} files differ: {', '.join(different[:10])}\n")
    raise SystemExit(bool(different))


if __name__ == "__main__":
    _main()
