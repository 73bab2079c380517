"""FastNoise2 (github.com/Auburn/FastNoise2, MIT licence) through its C interface, version 1.x.

Its simplex fBm with as many octaves as ours on the same grid; its own hash, gradients and scale. The library
is looked for where ``SKETCHTERRAIN_FASTNOISE2`` says, then by the system's loader. docs/kernels/noise.md says
how it is built.
"""

import ctypes
import os
from ctypes.util import find_library
from typing import Any

import numpy as np

from sketchterrain.benchmarks.baselines.problem import Absent, NoiseProblem, Rival, in_threads

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


def rival(problem: NoiseProblem) -> Rival | Absent:
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
    """Return a node that sums so many octaves of simplex noise; LookupError where there is none."""
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
    """Return a variable's place among those of a kind of node; LookupError where there is none."""
    names = [
        library.fnGetMetadataVariableName(kind, i).decode()
        for i in range(library.fnGetMetadataVariableCount(kind))
    ]
    if name not in names:
        raise LookupError(name)
    return names.index(name)
