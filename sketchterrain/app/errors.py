"""What the command line says of an error, in one line, and the exit code it ends with."""

from __future__ import annotations

import sys
from typing import Any

import typer

from sketchterrain.errors import SketchterrainError

FAILED = 1
PARTIAL = 5
INTERRUPTED = 130
DEBUG = "SKETCHTERRAIN_DEBUG"
"""The environment's variable that asks for a traceback."""
USAGE_ERROR: Any = typer.BadParameter.__base__
"""The base of every usage error of typer, whichever version of click it brings along."""


def describe_error(error: Exception) -> tuple[str, int]:
    """Return what to say of an error, and its exit code."""
    if isinstance(error, USAGE_ERROR):
        return error.format_message(), error.exit_code
    if isinstance(error, SketchterrainError):
        return str(error), error.exit_code
    if isinstance(error, OSError):
        reason = error.strerror or str(error)
        return (f"{error.filename}: {reason}" if error.filename else reason), FAILED
    if isinstance(error, MemoryError):
        return "out of memory", FAILED
    kind = type(error).__name__
    return f"unexpected {kind}: {error}; please report it, with what {DEBUG}=1 shows", FAILED


def fail(message: str, code: int) -> int:
    """Write one line on stderr and return the exit code."""
    line = "".join(char if char.isprintable() else "\ufffd" for char in " ".join(message.split()))
    sys.stderr.write(f"sketchterrain: error: {line}\n")
    return code
