"""Kernel and shader sources, and presets."""

from __future__ import annotations

import re
from functools import cache
from hashlib import sha256
from importlib.resources import files
from importlib.resources.abc import Traversable

from sketchterrain.errors import InputError

_BASELINES = "baselines/"
_INCLUDE = re.compile(r'^[ \t]*#include[ \t]+"([^"]+)"[ \t]*$', re.MULTILINE)


@cache
def source(name: str) -> str:
    """Return a source of ``kernels/`` with each ``#include "…"`` expanded once, for OpenCL and GLSL alike.

    ``#line`` preserves line numbers; ``baselines/…`` are sources of the benchmarks.
    """
    return _inline(name, set())


@cache
def kernels_digest() -> str:
    """Return the SHA-256 of all OpenCL sources of ``kernels/``."""
    digest = sha256()
    for file in sorted(files("sketchterrain.kernels").iterdir(), key=lambda file: file.name):
        if file.name.endswith((".cl", ".clh")):
            digest.update(f"{file.name}\n".encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()


def _inline(name: str, seen: set[str]) -> str:
    seen.add(name)
    package = "sketchterrain.benchmarks" if name.startswith(_BASELINES) else "sketchterrain.kernels"
    text = files(package).joinpath(name).read_text(encoding="utf-8")

    def expand(match: re.Match[str]) -> str:
        included = match.group(1)
        next_line = text.count("\n", 0, match.start()) + 2
        body = "" if included in seen else f"#line 1\n{_inline(included, seen)}\n"
        return f"{body}#line {next_line}"

    return _INCLUDE.sub(expand, text)


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
