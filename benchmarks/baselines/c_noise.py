"""The noise as a plain loop in C (``noise.c``), compiled on the spot with clang or the system's compiler."""

import ctypes
import shutil
import subprocess
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np

from sketchterrain.benchmarks.baselines.problem import Absent, NoiseProblem, Rival, in_threads

OPTIONS = ("-O3", "-march=native", "-ffp-contract=off", "-shared", "-fPIC")
"""No contraction, as in the kernels."""
_COMPILERS = ("clang", "cc", "gcc")


def rival(problem: NoiseProblem) -> Rival | Absent:
    """Return the compiled loop, or say that there is no compiler."""
    compiler = next((found for name in _COMPILERS if (found := shutil.which(name))), None)
    if compiler is None:
        return Absent("C, a plain loop", "no clang and no cc on the path")
    try:
        library = _compiled(compiler)
    except (OSError, subprocess.CalledProcessError):
        return Absent("C, a plain loop", f"{Path(compiler).name} did not compile noise.c")
    side = problem.side
    out = np.empty((side, side), np.float32)
    given = [np.ascontiguousarray(part) for part in (problem.corner, problem.turned, problem.amplitude)]
    addresses = [ctypes.c_void_p(array.ctypes.data) for array in (*given, out)]
    octaves = len(given[2])

    def run() -> np.ndarray[Any, np.dtype[np.float32]]:
        in_threads(
            lambda first, last: library.fbm_rows(first, last, side, octaves, *addresses),
            side=side,
            threads=problem.threads,
        )
        return out

    # `given` must outlive the addresses of its arrays.
    run.__dict__["arrays"] = given
    return Rival(f"C, a plain loop ({_version(compiler)})", problem.threads, run)


@cache
def _compiled(compiler: str) -> ctypes.CDLL:
    folder = Path(mkdtemp(prefix="sketchterrain-bench-"))
    try:
        with as_file(files("sketchterrain.benchmarks.baselines").joinpath("noise.c")) as source:
            target = folder / "noise.so"
            command = [compiler, *OPTIONS, "-o", str(target), str(source)]
            subprocess.run(command, check=True, capture_output=True)
        return ctypes.CDLL(str(target))
    finally:
        shutil.rmtree(folder, ignore_errors=True)  # a loaded library stays where it is mapped


def _version(compiler: str) -> str:
    shown = subprocess.run([compiler, "--version"], check=False, capture_output=True, text=True).stdout
    words = shown.splitlines()[0].split() if shown else []
    numbers = [word.rstrip(")") for word in words if word[:1].isdigit()]
    return " ".join([Path(compiler).name, *numbers[:1]])
