"""The compiled loops of ``kernels/host/``: loading, prototypes as the headers give them, checked calls."""

from __future__ import annotations

import ctypes
import re
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final, NamedTuple

import numpy as np

from sketchterrain.errors import BuildError
from sketchterrain.host import compiling
from sketchterrain.io.files import cache_folder
from sketchterrain.io.system import lock_file

SOURCES: Final = Path(str(files("sketchterrain.kernels"))) / "host"
_PROTOTYPE: Final = re.compile(r"^HOST (\w+) (\w+)\(([^;]*)\);", re.MULTILINE)
_PARAMETER: Final = re.compile(r"(const )?(\w+) (\*?)(\w+)((?:\[[^\]]*\])*)")
_STRUCTURE: Final = re.compile(r"^typedef struct \{([^}]*)\} (\w+);", re.MULTILINE)
_MEMBER: Final = re.compile(r"^ *((?:const )?\w+ )(\*?)(\w+);(?: */\* ((?:\[[^\]]*\])+))?", re.MULTILINE)
_COMMENT: Final = re.compile(r"/\*.*?\*/|//[^\n]*", re.DOTALL)
_SCALARS: Final = {"int64_t": ctypes.c_int64, "uint64_t": ctypes.c_uint64, "double": ctypes.c_double}
_RETURNS: Final = {**_SCALARS, "bool": ctypes.c_bool, "void": None}
_ELEMENTS: Final = {
    **{f"{kind}{bits}_t": np.dtype(f"{kind}{bits}") for kind in ("int", "uint") for bits in (8, 16, 32, 64)},
    "float": np.dtype(np.float32),
    "double": np.dtype(np.float64),
    "bool": np.dtype(np.bool_),
}


class _Parameter(NamedTuple):
    name: str
    kind: str  # C's type
    is_input: bool  # const, or a number
    sizes: tuple[str, ...]  # of an array, as they stand in the header; none of others
    structure: _Structure | None = None


class _Signature:
    """Parameters, or members of a structure; numbers that are sizes of arrays are read, not given."""

    def __init__(self, name: str, parameters: tuple[_Parameter, ...]) -> None:
        self.name = name
        sizes = {size for parameter in parameters for size in parameter.sizes}
        inferred = {each.name for each in parameters if not each.sizes and each.name in sizes}
        self.given = tuple(each for each in parameters if each.name not in inferred)
        place = {each.name: number for number, each in enumerate(parameters)}
        arrays = [(number, each) for number, each in enumerate(self.given) if each.sizes]
        self._arrays = [
            (number, place[each.name], each, _ELEMENTS[each.kind], len(each.sizes)) for number, each in arrays
        ]
        self._others = [
            (number, place[each.name], each.name, each.structure)
            for number, each in enumerate(self.given)
            if not each.sizes
        ]
        first = {
            size: (size, number, axis, place[size])
            for number, each in reversed(arrays)
            for axis, size in enumerate(each.sizes)
            if size in inferred
        }
        self._lengths = list(first.values())
        shapes = ", ".join(f"({', '.join(each.sizes)},)" for _, each in arrays).replace("->", ".")
        self._shapes = compile(f"[{shapes}]", name, "eval")
        self.types = [
            ctypes.c_void_p if each.sizes or each.structure else _SCALARS[each.kind] for each in parameters
        ]

    def passed(self, arguments: Sequence[Any]) -> tuple[list[Any], dict[str, Any]]:
        """Check arguments; return what C is passed, and the numbers among them by name."""
        passed: list[Any] = [None] * len(self.types)
        values, shapes = {}, []
        for number, place, parameter, dtype, axes in self._arrays:
            value = arguments[number]
            if not isinstance(value, np.ndarray) or value.dtype != dtype or value.ndim != axes:
                raise self._refusal(parameter, value)
            flags = value.flags
            writeable = flags.writeable
            if not (flags.c_contiguous and (writeable or parameter.is_input)):
                raise self._refusal(parameter, value)
            shapes.append(value.shape)
            if writeable and value.size:  # several times as fast as the other
                passed[place] = ctypes.addressof(ctypes.c_char.from_buffer(value))  # type: ignore[arg-type]
            else:
                passed[place] = value.ctypes.data
        for name, number, axis, place in self._lengths:
            passed[place] = values[name] = arguments[number].shape[axis]
        for number, place, name, structure in self._others:
            passed[place] = values[name] = arguments[number]
            if structure:
                passed[place], values[name] = structure.packed(arguments[number])
        expected = eval(self._shapes, {}, values)  # noqa: S307 # of a header
        for (*_, parameter, _, _), shape, lengths in zip(self._arrays, shapes, expected, strict=True):
            if shape != lengths:
                wrong = next(axis for axis, length in enumerate(lengths) if shape[axis] != length)
                raise ValueError(
                    f"{self.name}: expected {parameter.sizes[wrong]} = {lengths[wrong]} in the shape of "
                    f"{parameter.name}, got {shape}"
                )
        return passed, values

    def _refusal(self, parameter: _Parameter, value: Any) -> ValueError:
        expected, got = f"as {_ELEMENTS[parameter.kind]} ({', '.join(parameter.sizes)})", type(value).__name__
        if isinstance(value, np.ndarray):
            got = f"{value.dtype} {value.shape}"
            if value.dtype == _ELEMENTS[parameter.kind] and value.ndim == len(parameter.sizes):
                expected, got = "writable", "a read-only array"
                if not value.flags.c_contiguous:
                    expected, got = "in C order", f"strides {value.strides}"
        return ValueError(f"{self.name}: expected {parameter.name} {expected}, got {got}")


class _Structure:
    """A structure of the headers, given as a named tuple of its members; those with sizes are arrays."""

    def __init__(self, name: str, members: tuple[_Parameter, ...]) -> None:
        self._signature = _Signature(name, members)
        fields = [(member.name, kind) for member, kind in zip(members, self._signature.types, strict=True)]
        self._type: Any = type(name, (ctypes.Structure,), {"_fields_": fields})

    def packed(self, value: Any) -> tuple[Any, SimpleNamespace]:
        """Return a reference to the structure, and its numbers."""
        passed, values = self._signature.passed([getattr(value, each.name) for each in self._signature.given])
        return ctypes.byref(self._type(*passed)), SimpleNamespace(**values)


class HostFunction:
    """A function of the library; numbers that are sizes of its arrays are not passed but read from these."""

    def __init__(self, name: str, result: str, parameters: tuple[_Parameter, ...]) -> None:
        self._result, self._signature = result, _Signature(name, parameters)
        self._call: Any = None

    def __call__(self, *arguments: Any) -> Any:
        """Call it; raise ValueError on an array of another type, shape or order, or one it may not write."""
        signature = self._signature
        if len(arguments) != len(signature.given):
            names = ", ".join(parameter.name for parameter in signature.given)
            raise ValueError(f"{signature.name}: expected ({names}), got {len(arguments)} arguments")
        passed, _ = signature.passed(arguments)
        if self._call is None:
            call = getattr(_library(), signature.name)
            call.restype, call.argtypes = _RETURNS[self._result], signature.types
            self._call = call
        return self._call(*passed)


def host_function(name: str) -> HostFunction:
    """Return a function of the library by its name, as the headers declare it."""
    return _prototypes()[name]


@cache
def _prototypes() -> Mapping[str, HostFunction]:
    texts = [path.read_text(encoding="utf-8") for path in sorted(SOURCES.glob("*.h"))]
    bodies = {name: body for text in texts for body, name in _STRUCTURE.findall(text)}
    found = {}
    for whole in texts:
        for result, name, text in _PROTOTYPE.findall(_COMMENT.sub("", whole)):
            parts = re.split(r",(?![^\[]*\])", " ".join(text.split()))
            parameters = tuple(_parameter(part.strip(), bodies) for part in parts if part.strip() != "void")
            found[name] = HostFunction(name, result, parameters)
    return found


def _parameter(text: str, bodies: Mapping[str, str]) -> _Parameter:
    match = _PARAMETER.fullmatch(text)
    if match is None or (match[3] and match[2] not in bodies):
        raise BuildError(
            f"expected a parameter such as 'const double height[restrict rows][columns]', got {text!r}"
        )
    const, kind, pointer, name, shape = match.groups()
    sizes = tuple(size.removeprefix("restrict ") for size in re.findall(r"\[([^\]]*)\]", shape))
    structure = None
    if pointer:  # to a structure, where sizes of arrays stand in comments
        members = (
            f"{kind}{'' if sizes else star}{name}{sizes}"
            for kind, star, name, sizes in _MEMBER.findall(bodies[kind])
        )
        structure = _Structure(kind, tuple(_parameter(member, {}) for member in members))
    return _Parameter(name, kind, bool(const) or not sizes, sizes, structure)


@cache
def _level() -> int:
    """Return the level of vector instructions that this processor has, as NumPy found it."""
    features = np.show_config(mode="dicts")["SIMD Extensions"]
    known = {*features["baseline"], *features["found"]}
    names = {3: {"AVX2", "X86_V3"}, 4: {"AVX512_SKX", "X86_V4"}}  # before and after NumPy 2.4
    levels = compiling.LEVELS.get(compiling.architecture(), (0,))
    return max(level for level in levels if level < 3 or names[level] & known)


@cache
def _library() -> ctypes.CDLL:
    """Load the library, which a wheel brings along and a checkout compiles when its sources have changed."""
    name = compiling.library_name(SOURCES, _level())
    folders = Path(__file__).parent, cache_folder() / "host"
    for folder in folders:
        if (folder / name).is_file():
            return ctypes.CDLL(str(folder / name))
    compiler = compiling.find_compiler()
    if compiler is None:
        raise BuildError(
            "no C compiler for kernels/host: sudo apt install gcc libc6-dev, or pip install ziglang"
        )
    for folder in folders:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with (folder / ".lock").open("wb") as lock:
                lock_file(lock.fileno(), wait=True)
                if not (folder / name).is_file():
                    compiling.compile_library(SOURCES, folder / name, _level(), compiler)
                    compiling.delete_stale(folder, name)
            return ctypes.CDLL(str(folder / name))
        except OSError as error:
            problem = error
        except RuntimeError as error:
            raise BuildError(str(error)) from None
    raise BuildError(f"the loops of kernels/host could not be stored in {folders[-1]}: {problem}")
