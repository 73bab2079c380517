"""Simplex fBm by other programs: a C loop, FastNoise2 and NumPy."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from ctypes.util import find_library
from dataclasses import dataclass
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float32Array
from sketchterrain.terrain.noise import SKEW_OTHER, SKEW_SAME, STRIDES

if TYPE_CHECKING:
    Words = npt.NDArray[np.uint32]

_BANDS = 4  # a thread: where one is held up, the others do more


@dataclass(frozen=True, eq=False)
class NoiseProblem:
    """fBm on a square grid, as ``bench_fbm`` in ``kernels/bench.cl`` sums it."""

    corner: npt.NDArray[np.uint32]
    turned: npt.NDArray[np.uint32]
    amplitude: npt.NDArray[np.float32]
    side: int
    threads: int


@dataclass(frozen=True)
class Rival:
    """A way to compute the problem: its name with version, its threads, and the work of one lap."""

    name: str
    threads: int
    run: Callable[[], npt.NDArray[np.float32]]


@dataclass(frozen=True)
class Absent:
    """A rival that is not on this machine, and how to get it."""

    name: str
    reason: str


def in_threads(rows: Callable[[int, int], object], *, side: int, threads: int) -> None:
    """Call ``rows(first, last)`` for bands of rows, four a thread; threads are kept for the next call."""
    bands = min(_BANDS * threads, side)
    bounds = [side * i // bands for i in range(bands + 1)]
    list(_pool(threads).map(rows, bounds[:-1], bounds[1:]))


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads)


OPTIONS = ("-O3", "-march=native", "-ffp-contract=off", "-shared", "-fPIC")
"""No contraction, as in the kernels."""
_COMPILERS = ("clang", "cc", "gcc")


def in_c(problem: NoiseProblem) -> Rival | Absent:
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


VARIABLE = "SKETCHTERRAIN_FASTNOISE2"
"""Names the shared library."""

_NAME = "FastNoise2"
_BEST_SET = 0xFFFFFFFF  # the most of the processor that it knows how to use
_CYCLES = 1.0 / 1024  # of the first octave, a step
_SEED = 7
_POINTER, _INT, _FLOAT, _TEXT = ctypes.c_void_p, ctypes.c_int, ctypes.c_float, ctypes.c_char_p
_SIGNATURES: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "fnGetMetadataCount": (_INT, ()),
    "fnGetMetadataName": (_TEXT, (_INT,)),
    "fnNewFromMetadata": (_POINTER, (_INT, ctypes.c_uint)),
    "fnDeleteNodeRef": (None, (_POINTER,)),
    "fnGetMetadataVariableCount": (_INT, (_INT,)),
    "fnGetMetadataVariableName": (_TEXT, (_INT, _INT)),
    "fnSetVariableIntEnum": (ctypes.c_bool, (_POINTER, _INT, _INT)),
    "fnSetVariableFloat": (ctypes.c_bool, (_POINTER, _INT, _FLOAT)),
    "fnSetNodeLookup": (ctypes.c_bool, (_POINTER, _INT, _POINTER)),
    "fnGenUniformGrid2D": (
        None,
        (_POINTER, _POINTER, _FLOAT, _FLOAT, _INT, _INT, _FLOAT, _FLOAT, _INT, _POINTER),
    ),
}


def in_fastnoise2(problem: NoiseProblem) -> Rival | Absent:
    """Return FastNoise2's sum, or say that its library is not there."""
    path = os.environ.get(VARIABLE) or find_library("FastNoise")
    if path is None:
        return Absent(_NAME, f"no library: set {VARIABLE}, see docs/kernels/noise.md")
    try:
        library = _opened(path)
        node = _fractal(library, len(problem.amplitude))
    except (OSError, AttributeError, LookupError) as error:
        return Absent(_NAME, f"the library of {VARIABLE} does not work: {type(error).__name__}")
    side = problem.side
    out = np.empty((side, side), np.float32)

    def rows(first: int, last: int) -> None:
        start = (0.0, first * _CYCLES)
        size = (side, last - first)
        target = _POINTER(out[first:].ctypes.data)
        library.fnGenUniformGrid2D(node, target, *start, *size, _CYCLES, _CYCLES, _SEED, None)

    def run() -> np.ndarray[Any, np.dtype[np.float32]]:
        in_threads(rows, side=side, threads=problem.threads)
        return out

    return Rival(_NAME, problem.threads, run)


def _opened(path: str) -> ctypes.CDLL:
    library = ctypes.CDLL(path)
    for name, (result, arguments) in _SIGNATURES.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


def _fractal(library: ctypes.CDLL, octaves: int) -> int:
    """Return a node that sums so many octaves of simplex noise; raise LookupError if it is missing."""
    kinds = {
        library.fnGetMetadataName(i).decode().replace(" ", ""): i for i in range(library.fnGetMetadataCount())
    }
    simplex, fractal = kinds["Simplex"], kinds["FractalFBm"]
    source, node = (library.fnNewFromMetadata(kind, _BEST_SET) for kind in (simplex, fractal))
    done = library.fnSetVariableFloat(source, _variable(library, simplex, "Feature Scale"), 1.0)
    done = done and library.fnSetNodeLookup(node, 0, source)
    done = done and library.fnSetVariableIntEnum(node, _variable(library, fractal, "Octaves"), octaves)
    if not done:
        raise LookupError("a node takes no source, no scale or no octaves")
    library.fnDeleteNodeRef(source)  # the sum holds it now
    return int(node)


def _variable(library: ctypes.CDLL, kind: int, name: str) -> int:
    """Return a variable's place among those of a kind of node; raise LookupError if it is missing."""
    names = [
        library.fnGetMetadataVariableName(kind, i).decode()
        for i in range(library.fnGetMetadataVariableCount(kind))
    ]
    if name not in names:
        raise LookupError(name)
    return names.index(name)


_UNSKEW = np.float32(0.21138669673055244)
_SCALE = np.float32(3.259629011154175e-08)
_STRIDE_U, _STRIDE_V = (np.uint32(stride) for stride in STRIDES)
_BOTH = np.uint32((STRIDES[0] + STRIDES[1]) & 0xFFFFFFFF)
_ONE = np.float32(1)
_MIX = np.uint32(15)


def in_numpy(problem: NoiseProblem) -> Rival:
    """Return the sum over whole arrays; NumPy uses one thread for it."""
    return Rival(f"NumPy {np.__version__}, float32", 1, lambda: _fbm(problem))


def _fbm(problem: NoiseProblem) -> Float32Array:
    step = np.arange(problem.side, dtype=np.int32)
    column, row = step[None, :], step[:, None]
    total = np.zeros((problem.side, problem.side), np.float32)
    for corner, turned, amplitude in zip(problem.corner, problem.turned, problem.amplitude, strict=True):
        x, y = (row, -column) if turned else (column, row)
        u = SKEW_SAME * x + SKEW_OTHER * y + np.int32(corner[0])
        v = SKEW_OTHER * x + SKEW_SAME * y + np.int32(corner[1])
        total += amplitude * _simplex(u, v, corner[2], int(corner[3]))
    return total


def _simplex(u: npt.NDArray[np.int32], v: npt.NDArray[np.int32], seed: np.uint32, bits: int) -> Float32Array:
    h = seed + (u >> bits).astype(np.uint32) * _STRIDE_U + (v >> bits).astype(np.uint32) * _STRIDE_V
    fu, fv = _fraction(u, bits), _fraction(v, bits)
    lower = fu > fv
    unskewed = (fu + fv) * _UNSKEW
    x, y = fu - unskewed, fv - unskewed
    near, far = _UNSKEW, _UNSKEW - _ONE
    total = _corner(h, x, y)
    middle = h + np.where(lower, _STRIDE_U, _STRIDE_V)
    total += _corner(middle, x + np.where(lower, far, near), y + np.where(lower, near, far))
    total += _corner(h + _BOTH, x + (near + far), y + (near + far))
    return total * _SCALE


def _fraction(u: npt.NDArray[Any], bits: int) -> Float32Array:
    return (((u << (32 - bits)).view(np.uint32)) >> 8).astype(np.float32) * np.float32(2.0**-24)


def _corner(h: Words, dx: Float32Array, dy: Float32Array) -> Float32Array:
    h = h ^ (h >> _MIX)
    h *= np.uint32(0x735A2D97)
    h ^= h >> _MIX
    fade = np.maximum(np.float32(0.5) - (dx * dx + dy * dy), np.float32(0))
    fade *= fade
    ramp = h.view(np.int32).astype(np.float32) * dx
    ramp += (h << 16).view(np.int32).astype(np.float32) * dy
    fade *= fade
    fade *= ramp
    return fade
