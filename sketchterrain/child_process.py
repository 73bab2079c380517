"""Work in a child process, for drivers that crash, hang or exit: each failure becomes one line."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from sketchterrain.errors import SketchterrainError, one_line

_LONGEST: Final = 200  # characters of the line that the child wrote last
# Words that a driver writes to stderr before it aborts, and what helps.
_LINKER: Final = ("linker", "'ld'", '"ld"')
_INSTALL_LINKER: Final = "install a linker: apt install gcc libc6-dev"
_INSTALL_DRIVER: Final = "update or reinstall the driver"


class ChildFailedError(SketchterrainError):
    """A child process crashed, hung, did not start or exited with an error; the message is one line."""


class ChildTimedOutError(ChildFailedError):
    """A child process did not answer in time; the load of the machine may be why."""


def run_child(
    command: Sequence[str], *, name: str, timeout: float, environment: Mapping[str, str] | None = None
) -> None:
    """Run a command and wait for it."""
    try:
        child = subprocess.run(  # noqa: S603
            command,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=timeout,
            check=False,
            env=environment,
        )
    except subprocess.TimeoutExpired:
        raise ChildTimedOutError(f"{name} did not answer within {timeout:g} s") from None
    except OSError as error:
        raise ChildFailedError(f"{name} did not start: {error}") from error
    if child.returncode:
        raise ChildFailedError(_failure(name, child.returncode, child.stderr))


def module_result(
    module: str, *arguments: str, name: str, timeout: float, environment: Mapping[str, str] | None = None
) -> bytes:
    """Run a module of the program in a child, and return the bytes that it wrote into the file given last.

    Its stdout and stderr are left to drivers.
    """
    with TemporaryDirectory(prefix="sketchterrain-child-") as folder:
        file = Path(folder) / "result"
        command = [sys.executable, "-m", module, *arguments, str(file)]
        run_child(command, name=name, timeout=timeout, environment=environment)
        try:
            return file.read_bytes()
        except FileNotFoundError:  # a driver that exits the process with code 0
            raise ChildFailedError(f"{name} exited early") from None


def _failure(name: str, code: int, errors: str) -> str:
    lines = [one_line(line.strip()[:_LONGEST]) for line in errors.splitlines() if line.strip()]
    if code > 0:
        return lines[-1] if lines else f"{name} failed with code {code}"
    reason = next((line for line in lines if "error" in line.lower()), lines[-1] if lines else "")
    remedy = _INSTALL_LINKER if any(word in errors for word in _LINKER) else _INSTALL_DRIVER
    return "; ".join([f"{name} crashed ({_signal(-code)})" + (f": {reason}" if reason else ""), remedy])


def _signal(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
