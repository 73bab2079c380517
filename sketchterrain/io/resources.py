"""Kernel and shader sources with the constants and layouts that they define, digests of code, and presets."""

import re
from ast import literal_eval
from collections.abc import Iterable, Mapping
from functools import cache
from hashlib import sha256
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

from sketchterrain.errors import InputError

_CONSTANT = re.compile(r"^#define[ \t]+(\w+)[ \t]+(?:R\()?(-?(?:0x[0-9A-F]+|[\d.e-]+))", re.MULTILINE)
_BASELINES, _HOST = "baselines/", "host/"  # C's headers are named from their folder
_INCLUDE = re.compile(r'^[ \t]*#include[ \t]+"([^"]+)"[ \t]*$', re.MULTILINE)
# The last three are of files that exports copy.
_SOURCES: Final = (".py", ".cl", ".clh", ".c", ".h", ".glsl", ".json", ".js", ".html", ".toml")
# No file that is written depends on the window or measurements; presets are inputs, as other sketches.
_WITHOUT_RESULTS: Final = frozenset({"benchmarks", "presets", "ui"})

Defines: TypeAlias = tuple[tuple[str, int | str], ...]
"""Macros and their values."""


@cache
def source(name: str, defines: Defines = ()) -> str:
    """Return a source of ``kernels/`` with each ``#include "…"`` expanded once, for OpenCL and GLSL alike.

    ``#line`` preserves line numbers; ``baselines/…`` are sources of the benchmarks. Macros come first,
    or after GLSL's ``#version``.
    """
    text = _inline(name, set())
    if not defines:
        return text
    head, rest = text.split("\n", 1) if text.startswith("#version") else ("", text)
    macros = "".join(f"#define {macro} {value}\n" for macro, value in defines)
    return f"{head}\n{macros}#line 2\n{rest}" if head else f"{macros}#line 1\n{rest}"


@cache
def kernels_digest() -> str:
    """Return the SHA-256 of all OpenCL sources of ``kernels/``."""
    return _digest(name for name in _sources() if name.endswith((".cl", ".clh")))


@cache
def code_digest() -> str:
    """Return the SHA-256 of all sources that results depend on, the same installed and in a checkout."""
    return _digest(_sources())


def _digest(names: Iterable[str]) -> str:
    digest = sha256()
    for name in names:
        digest.update(f"{name}\n".encode())
        digest.update(_sources()[name].read_bytes())
    return digest.hexdigest()


@cache
def _sources() -> dict[str, Path]:
    """Return the sources that results depend on, by name; a checkout has its kernels beside the package."""
    found = {}
    for package in ("sketchterrain", "sketchterrain.kernels"):
        root = Path(str(files(package)))
        for path in (path for path in root.rglob("*.*") if path.suffix in _SOURCES):
            parts = *package.split("."), *path.relative_to(root).parts
            if parts[1] not in _WITHOUT_RESULTS:
                found["/".join(parts)] = path
    return dict(sorted(found.items()))


def _inline(name: str, seen: set[str]) -> str:
    seen.add(name)
    package = "sketchterrain.benchmarks" if name.startswith(_BASELINES) else "sketchterrain.kernels"
    text = files(package).joinpath(name).read_text(encoding="utf-8")

    def expand(match: re.Match[str]) -> str:
        included = f"{_HOST if name.startswith(_HOST) else ''}{match.group(1)}"
        next_line = text.count("\n", 0, match.start()) + 2
        body = "" if included in seen else f"#line 1\n{_inline(included, seen)}\n"
        return f"{body}#line {next_line}"

    return _INCLUDE.sub(expand, text)


def kernel_constants(file: str, *names: str) -> tuple[float, ...]:
    """Return the values of ``#define NAME`` in a kernel source: integers, or reals written as ``R(…)``."""
    constants = _constants(file)
    return tuple(literal_eval(constants[name]) for name in names)


@cache
def _constants(file: str) -> dict[str, str]:
    return dict(_CONSTANT.findall(source(file)))


def kernel_columns(file: str, row: str) -> Mapping[str, int]:
    """Return the columns that ``COLUMN(row, name, member, component)`` names; a member has four."""
    text = source(file)
    (members,) = re.findall(rf"typedef struct {{\s*REAL4 ([^;]*);\s*}} {row};", text)
    first = {name: 4 * number for number, name in enumerate(members.split(", "))}
    columns = re.findall(rf"^COLUMN\({row}, (\w+), (\w+), s(\d)\)", text, re.MULTILINE)
    return {name: first[member] + int(component) for name, member, component in columns}


@cache
def kernel_arguments(file: str, macro: str) -> tuple[str, ...]:
    """Return the names in a list of arguments, ``#define NAME_ARGUMENTS …``, which may hold further lists."""
    (body,) = re.findall(rf"^#define {macro} ((?:.*\\\n)*.*)", source(file), re.MULTILINE)
    names: list[str] = []
    for argument in body.replace("\\\n", " ").split(","):
        name = argument.replace("*", " ").split()[-1]
        names += kernel_arguments(file, name) if name.endswith("_ARGUMENTS") else [name]
    return tuple(names)


def kernel_struct(file: str, name: str, real: npt.DTypeLike) -> np.dtype[np.void]:
    """Return the layout of a struct of ``REAL``, ``long`` and ``int`` members, with ``real`` for ``REAL``."""
    kinds = {"REAL": real, "long": np.int64, "int": np.int32}
    return np.dtype([(member, kinds[kind]) for kind, member in _members(file, name)], align=True)


@cache  # a struct is packed for every cell size
def _members(file: str, struct: str) -> tuple[tuple[str, str], ...]:
    """Return the type and the name of each member of a struct."""
    (body,) = re.findall(rf"typedef struct {{([^}}]*)}} {struct};", source(file))
    lines = re.findall(r"(REAL|long|int) ([\w, ]+);", body)
    return tuple((kind, member) for kind, members in lines for member in members.split(", "))


def preset_names() -> tuple[str, ...]:
    """Return the names of the built-in presets, sorted."""
    folder = files("sketchterrain.presets")
    return tuple(sorted(entry.name for entry in folder.iterdir() if entry.joinpath("sketch.toml").is_file()))


def preset(name: str) -> Traversable:
    """Return the folder of a preset."""
    if name not in preset_names():
        raise InputError(f"no preset {name!r}: expected {', '.join(preset_names())}")
    return files("sketchterrain.presets").joinpath(name)


def preset_picture(name: str) -> bytes:
    """Return a picture of a preset's terrain, a JPEG of 480 × 270 px."""
    return preset(name).joinpath("picture.jpg").read_bytes()
