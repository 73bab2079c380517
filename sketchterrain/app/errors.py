"""Error lines and exit codes of the command line."""

from __future__ import annotations

import sys
from typing import Any

import typer

from sketchterrain.errors import SketchterrainError, one_line

FAILED = 1
PARTIAL = 5
INTERRUPTED = 130
DEBUG = "SKETCHTERRAIN_DEBUG"
"""Environment variable that enables tracebacks."""
USAGE_ERROR: Any = typer.BadParameter.__base__
"""Base of all usage errors, in every version of typer and click."""


def describe_error(error: Exception) -> tuple[str, int]:
    """Return the message of an error and its exit code."""
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
    return f"unexpected {kind}: {error}; please report it, with the traceback of {DEBUG}=1", FAILED


def fail(message: str, code: int) -> int:
    """Write one line to stderr and return the exit code."""
    sys.stderr.write(f"sketchterrain: error: {one_line(' '.join(message.split()))}\n")
    return code
