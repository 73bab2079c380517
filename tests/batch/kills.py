"""A batch that is killed at random moments and resumed, and comparison of its files."""

from __future__ import annotations

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
    """One kill: seconds after its process started, terrains that were done, hidden files that it left."""

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
    """Make a batch in processes that are killed, each as a group, and resumed; the last one is not."""
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
