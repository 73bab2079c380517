"""Compilation of loops and kernels, and textures, before the tests: ``python tests/warm_up.py``.

Two workers would otherwise both compile all of it.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from hashlib import sha256
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
CACHES: Final = ROOT / "build" / "test-cache"
SOURCES: Final = {".py", ".cl", ".clh", ".glsl", ".c", ".h", ".json", ".txt"}
WARM: Final = "warm"
JOBS: Final = (
    ("generate", "valley_river", "--size", "65"),
    ("generate", "mountain_pass", "--size", "65", "--no-preview"),
)


def cache_of_sources() -> Path | None:
    """Return the cache folder of this state of the sources; None where the checkout cannot be written."""
    digest = sha256()
    for folder in ("sketchterrain", "kernels", "ui", "benchmarks", ".ci"):
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in SOURCES:
                digest.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    folder = CACHES / digest.hexdigest()[:16]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in ("pyopencl", "pocl"):  # keyed by source themselves
            (CACHES / name).mkdir(exist_ok=True)
            if not (folder / name).exists():
                (folder / name).symlink_to(CACHES / name)
        folder.touch()
    except OSError:
        return None
    for stale in sorted(CACHES.glob("[0-9a-f]*[0-9a-f]"), key=lambda path: path.stat().st_mtime)[:-3]:
        shutil.rmtree(stale, ignore_errors=True)
    return folder


def warm_up(cache: Path) -> None:
    """Run the program once for each of `JOBS`, side by side, unless that was done with these sources."""
    if (cache / WARM).exists():
        return
    sys.stderr.write("Compiling loops and kernels for the tests: one or two minutes\n")
    with tempfile.TemporaryDirectory() as folder:
        runs = [
            subprocess.Popen(
                [sys.executable, "-m", "sketchterrain", *job, "-o", f"{folder}/{number}"],
                env=os.environ | {"XDG_CACHE_HOME": str(cache)},
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            for number, job in enumerate(JOBS)
        ]
        failures = [run.wait() for run in runs]
        if not any(failures):  # else the tests tell why
            (cache / WARM).touch()


if __name__ == "__main__" and (found := cache_of_sources()):
    warm_up(found)
