"""A world whose workers are killed at random moments, and whether it ends with the same files.

``python -m sketchterrain.benchmarks.world_kills DIR`` kills 20 workers of a preset of 8,193² vertices.
"""

from __future__ import annotations

import argparse
import random
import subprocess
import sys
import time
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence


class Killed(NamedTuple):
    """What became of a run whose workers were killed.

    Attributes
    ----------
    moments : tuple of float
        When each of them was, s since the run began.
    seconds : float
        The run took.
    told : str
        It wrote on stderr.
    """

    moments: tuple[float, ...]
    seconds: float
    told: str


def with_kills(
    words: Sequence[str], *, kills: int, shortest: float, longest: float, chance: random.Random
) -> Killed:
    """Write a world while its workers are killed, one after another.

    Parameters
    ----------
    words
        Of the command line, after ``world``.
    kills
        How many at most: it ends when the world is written.
    shortest, longest
        Seconds between two kills; a random time between.
    chance
        Where times and victims come from.

    Raises
    ------
    RuntimeError
        If the run does not end well.
    """
    start = time.perf_counter()
    command = [sys.executable, "-m", "sketchterrain", "world", *words]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    moments: list[float] = []
    while len(moments) < kills and process.poll() is None:
        time.sleep(chance.uniform(shortest, longest))
        victims = _workers(process.pid)
        if victims:
            chance.choice(victims).kill()
            moments.append(time.perf_counter() - start)
    _, told = process.communicate()
    if process.returncode != 0:
        raise RuntimeError(f"world ended with {process.returncode}: {told}")
    return Killed(tuple(moments), time.perf_counter() - start, told)


def differences(one: Path, other: Path) -> list[str]:
    """Return which files of two folders are not the same."""
    found = [
        {
            path.relative_to(folder).as_posix(): sha256(path.read_bytes()).digest()
            for path in folder.rglob("*")
            if path.is_file()
        }
        for folder in (one, other)
    ]
    names = sorted(found[0].keys() | found[1].keys())
    return [name for name in names if found[0].get(name) != found[1].get(name)]


def _workers(pid: int) -> list[Any]:
    """Return the processes that a run has started to work for it."""
    import psutil

    try:
        children = psutil.Process(pid).children()
        found = [child for child in children if "multiprocessing.spawn" in " ".join(child.cmdline())]
    except psutil.Error:  # one ended meanwhile
        return []
    return sorted(found, key=lambda each: each.pid)


def _main() -> None:
    parser = argparse.ArgumentParser(
        description="Kill workers of a world at random moments and compare what it ends with."
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--sketch", default="valley_river")
    parser.add_argument("--side", type=float, default=8192.0, help="m, at a cell of 1 m")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--shortest", type=float, default=1.0, help="seconds between two kills at least")
    parser.add_argument("--longest", type=float, default=12.0, help="seconds between two kills at most")
    given = parser.parse_args()
    words = [given.sketch, "--bounds", f"0,0,{given.side:g},{given.side:g}", "--cell", "1"]
    whole, killed = given.folder / "whole.zarr", given.folder / "killed.zarr"
    start = time.perf_counter()
    subprocess.run([sys.executable, "-m", "sketchterrain", "world", *words, "-o", str(whole)], check=True)
    alone = time.perf_counter() - start
    found = with_kills(
        [*words, "-o", str(killed), "--workers", str(given.workers)],
        kills=given.kills,
        shortest=given.shortest,
        longest=given.longest,
        chance=random.Random(1),  # noqa: S311 - moments, no secrets
    )
    different = differences(whole, killed)
    lines = [
        f"alone: {alone:.1f} s; {given.workers} workers, {len(found.moments)} killed: {found.seconds:.1f} s",
        f"killed at {', '.join(f'{moment:.1f}' for moment in found.moments)} s",
        *(line for line in found.told.splitlines() if "note:" in line),
        f"{len(different)} files differ {' '.join(different[:10])}",
    ]
    sys.stdout.write("".join(f"{line}\n" for line in lines))
    sys.exit(1 if different else 0)


if __name__ == "__main__":
    _main()
