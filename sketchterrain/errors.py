"""The errors a person can meet, each with the exit code the command line gives it."""

from __future__ import annotations


class SketchterrainError(Exception):
    """Something went wrong that one clear line can tell (exit code 1)."""

    exit_code = 1


class InputError(SketchterrainError):
    """What was given is not valid: a sketch, a layer, a parameter (exit code 3)."""

    exit_code = 3


class DeviceError(SketchterrainError):
    """No device can do the work (exit code 4)."""

    exit_code = 4


class DeviceFailedError(DeviceError):
    """A device gave up, or computed what is no number, amid work that another one may do (exit code 4)."""


class DeviceMemoryError(DeviceError):
    """A device has no room for what was asked at once; less may fit (exit code 4)."""


class BuildError(SketchterrainError):
    """An OpenCL or GLSL program did not build: a defect of ours or of the driver (exit code 1)."""


def one_line(text: object) -> str:
    """Return `text` with a replacement mark for each character that one line cannot show."""
    return "".join(char if char.isprintable() else "\ufffd" for char in str(text))
