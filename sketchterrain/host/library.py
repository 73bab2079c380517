"""The compiled loops of ``kernels/host/``: loading, prototypes as the headers give them, checked calls."""

import ctypes
import re
from collections.abc import Callable, Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from sketchterrain.errors import BuildError
from sketchterrain.host import compiling
from sketchterrain.io.files import cache_folder
from sketchterrain.io.system import lock_file

SOURCES: Final = Path(str(files("sketchterrain.kernels"))) / "host"
_PROTOTYPE: Final = re.compile(r"^HOST (\w+) (\w+)\(([^;]*)\);", re.MULTILINE)
_PARAMETER: Final = re.compile(r"(const )?(\w+) (\w+)((?:\[[^\]]*\])*)")
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
    sizes: tuple[Any, ...]  # of an array: a name, or an expression compiled; none of a number
    texts: tuple[str, ...]  # the same as they stand in the header


class HostFunction:
    """A function of the library; numbers that are sizes of its arrays are not passed but read from these."""

    def __init__(self, name: str, result: str, parameters: tuple[_Parameter, ...]) -> None:
        self._name, self._result, self._parameters = name, result, parameters
        sizes = {text for parameter in parameters for text in parameter.texts}
        self._inferred = frozenset(
            parameter.name for parameter in parameters if not parameter.sizes and parameter.name in sizes
        )
        self._given = tuple(parameter for parameter in parameters if parameter.name not in self._inferred)
        self._call: Any = None

    def __call__(self, *arguments: Any) -> Any:
        """Call it; raise ValueError on an array of another type, shape or order, or one it may not write."""
        if len(arguments) != len(self._given):
            names = ", ".join(parameter.name for parameter in self._given)
            raise ValueError(f"{self._name}: expected ({names}), got {len(arguments)} arguments")
        values: dict[str, Any] = {}
        for parameter, value in zip(self._given, arguments, strict=True):
            if parameter.sizes:
                self._check(parameter, value, values)
            else:
                values[parameter.name] = value
        passed = []
        given = {parameter.name: value for parameter, value in zip(self._given, arguments, strict=True)}
        for parameter in self._parameters:
            if not parameter.sizes:
                passed.append(values[parameter.name])
                continue
            value = given[parameter.name]
            for length, size, text in zip(value.shape, parameter.sizes, parameter.texts, strict=True):
                expected = values[size] if isinstance(size, str) else eval(size, {}, values)  # noqa: S307 # of a header
                if length != expected:
                    raise ValueError(
                        f"{self._name}: expected {text} = {expected} in the shape of {parameter.name}, "
                        f"got {value.shape}"
                    )
            passed.append(value.ctypes.data)
        if self._call is None:
            self._call = self._bind()
        return self._call(*passed)

    def _check(self, parameter: _Parameter, value: Any, values: dict[str, Any]) -> None:
        """Check an array but for its sizes; those that it gives first are added to the values."""
        expected = _ELEMENTS[parameter.kind]
        if not isinstance(value, np.ndarray) or value.dtype != expected or value.ndim != len(parameter.sizes):
            got = f"{value.dtype} {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__
            shape = ", ".join(parameter.texts)
            raise ValueError(f"{self._name}: expected {parameter.name} as {expected} ({shape}), got {got}")
        if not value.flags.c_contiguous:
            raise ValueError(
                f"{self._name}: expected {parameter.name} in C order, got strides {value.strides}"
            )
        if not (parameter.is_input or value.flags.writeable):
            raise ValueError(f"{self._name}: expected {parameter.name} writable, got a read-only array")
        for length, size in zip(value.shape, parameter.sizes, strict=True):
            if isinstance(size, str) and size in self._inferred:
                values.setdefault(size, length)

    def _bind(self) -> Callable[..., Any]:
        function = getattr(_library(), self._name)
        function.restype = _RETURNS[self._result]
        function.argtypes = [
            ctypes.c_void_p if parameter.sizes else _SCALARS[parameter.kind] for parameter in self._parameters
        ]
        return function  # type: ignore[no-any-return]


def host_function(name: str) -> HostFunction:
    """Return a function of the library by its name, as the headers declare it."""
    return _prototypes()[name]


@cache
def _prototypes() -> Mapping[str, HostFunction]:
    found = {}
    for path in sorted(SOURCES.glob("*.h")):
        for result, name, text in _PROTOTYPE.findall(_COMMENT.sub("", path.read_text(encoding="utf-8"))):
            parts = re.split(r",(?![^\[]*\])", " ".join(text.split()))
            parameters = tuple(_parameter(part.strip()) for part in parts if part.strip() != "void")
            found[name] = HostFunction(name, result, parameters)
    return found


def _parameter(text: str) -> _Parameter:
    match = _PARAMETER.fullmatch(text)
    if match is None:
        raise BuildError(
            f"expected a parameter such as 'const double height[restrict rows][columns]', got {text!r}"
        )
    const, kind, name, shape = match.groups()
    texts = tuple(size.removeprefix("restrict ") for size in re.findall(r"\[([^\]]*)\]", shape))
    sizes = tuple(size if size.isidentifier() else compile(size, name, "eval") for size in texts)
    return _Parameter(name, kind, bool(const) or not texts, sizes, texts)


@cache
def _level() -> int:
    """Return the level of vector instructions that this processor has, as NumPy found it."""
    levels = compiling.LEVELS.get(compiling.architecture(), (0,))
    features = np.show_config(mode="dicts")["SIMD Extensions"]
    known = {*features["baseline"], *features["found"]}
    # NumPy's names before and after 2.4.
    has = {2: True, 3: {"AVX2", "FMA3"} <= known or "X86_V3" in known, 4: known & {"AVX512_SKX", "X86_V4"}}
    return max(level for level in levels if has.get(level, True))


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
    raise BuildError(f"the loops of kernels/host could not be stored in {folders[-1]}: {problem}")
