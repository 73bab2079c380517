"""Device self-test: IEEE 754 additions and products, shifts and hashes, compared with NumPy bit for bit.

Expected values are computed with NumPy in 32 bits. As a program it tests the device of a given index and
writes the names of failed operations to a file, as JSON.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float32Array
from sketchterrain.errors import SketchterrainError

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext

    Words = npt.NDArray[np.uint32]

_COUNT = 1 << 12
_SEED = 754
_STEPS = 32
_f = np.float32


def failed_operations(context: ComputeContext) -> tuple[str, ...]:
    """Return the names of the operations whose bits differ from IEEE 754; the context has 32-bit reals."""
    operands = _operands()
    expected = _expected(*operands)
    reals = sum(values.dtype == np.float32 for values in expected.values())
    shapes = ((reals, _COUNT), (len(expected) - reals, _COUNT))
    uploads = [context.upload(operand) for operand in operands]
    results = [context.empty(shape, "u4") for shape in shapes]
    context.launch("self_test.cl", "self_test", (_COUNT,), *uploads, np.int32(_COUNT), *results)
    downloads = [context.download(each, shape, "u4") for each, shape in zip(results, shapes, strict=True)]
    return tuple(
        name
        for (name, values), bits in zip(expected.items(), np.concatenate(downloads), strict=True)
        if not np.array_equal(bits, values.view(np.uint32))
    )


def _operands() -> tuple[
    Float32Array, Float32Array, Float32Array, Float32Array, Words, npt.NDArray[np.int64]
]:
    """Return the arguments of ``kernels/self_test.cl``, in order."""
    draw = np.random.default_rng(_SEED)
    a, b, c = draw.uniform(-2, 2, (3, _COUNT)).astype(_f)
    positive = (2.0 ** draw.uniform(-30, 30, _COUNT)).astype(_f)
    word = draw.integers(0, 1 << 32, _COUNT, dtype=np.uint32)
    return a, b, c, positive, word, draw.integers(-(1 << 47), 1 << 47, _COUNT)


def _expected(
    a: Float32Array,
    b: Float32Array,
    c: Float32Array,
    positive: Float32Array,
    word: Words,
    position: npt.NDArray[np.int64],
) -> dict[str, npt.NDArray[Any]]:
    root = _inverse_sqrt(positive)
    mixed = _mix(word)
    longs = (mixed.astype(np.uint64) * (word >> np.uint32(8)).astype(np.uint64)) >> np.uint64(32)
    return {
        "a product and a sum": a * b + c,
        "a chain of products and sums": _chain(a, b, c),
        "inverse_sqrt": root,
        "square_root": positive * root,
        "reciprocal": root * root,
        "cubic": _cubic(positive),
        "smooth_rise": _smooth_rise(a, b),
        "real_of": _real_of(position),
        "mixed": mixed,
        "scrambled": _scramble(word),
        "a shift": (position >> (word & np.uint32(31)).astype(np.int64)).astype(np.uint32),
        "a long product": longs.astype(np.uint32),
        "a conversion": (a * _f(1e6)).astype(np.int32),
    }


def _chain(a: Float32Array, b: Float32Array, c: Float32Array) -> Float32Array:
    x, y = a, b
    for _ in range(_STEPS):
        next_x = np.clip(x * y + c * _f(0.25) - x * x * _f(0.125), _f(-2), _f(2))
        y = np.clip(y * _f(0.75) + next_x * next_x * c, _f(-2), _f(2))
        x = next_x
    return np.asarray(x + y)


def _inverse_sqrt(x: Float32Array) -> Float32Array:
    y = (np.int32(0x5F375A86) - (x.view(np.int32) >> 1)).view(_f)
    half = _f(0.5) * x
    for _ in range(4):
        y = y * (_f(1.5) - half * y * y)
    return np.asarray(y)


def _cubic(t: Float32Array) -> Float32Array:
    s = np.minimum(t, _f(1))
    return np.asarray(s * s * (_f(2) * s - _f(3)) + _f(1))


def _smooth_rise(x: Float32Array, low: Float32Array) -> Float32Array:
    t = np.clip((x - low) * _f(0.5), _f(0), _f(1))
    return np.asarray(t * t * (_f(3) - _f(2) * t))


def _real_of(n: npt.NDArray[np.int64]) -> Float32Array:
    high, low = (n >> 24).astype(np.int32).astype(_f), (n & 0xFFFFFF).astype(np.int32).astype(_f)
    return np.asarray(high * _f(16777216) + low)


def _mix(h: Words) -> Words:
    h = (h ^ (h >> np.uint32(16))) * np.uint32(0x7FEB352D)
    h = (h ^ (h >> np.uint32(15))) * np.uint32(0x846CA68B)
    return h ^ (h >> np.uint32(16))


def _scramble(h: Words) -> Words:
    h = (h ^ (h >> np.uint32(15))) * np.uint32(0x735A2D97)
    return h ^ (h >> np.uint32(15))


def _main(index: str, file: str) -> None:
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.compute.device import list_devices

    wrong = failed_operations(ComputeContext(list_devices()[int(index)]))
    Path(file).write_text(json.dumps(wrong), encoding="utf-8")


if __name__ == "__main__":
    try:
        _main(*sys.argv[1:])
    except SketchterrainError as error:
        sys.exit(str(error))
