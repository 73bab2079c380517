"""What is sent to the workers of a cluster, and what they answer: plain values, light to import."""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from sketchterrain.world.code import code_digest

if TYPE_CHECKING:
    from sketchterrain.errors import SketchterrainError
    from sketchterrain.world.job import Job

__all__ = ["Failed", "Ready", "Refused", "called", "packed", "unpacked"]


@dataclass(frozen=True)
class Ready:
    """A worker that passed all checks.

    Attributes
    ----------
    worker : str
        Its name.
    device : str
        That it works on.
    bits : str
        SHA-256 of some of the job's ground, evaluated on that device.
    at_once : int
        How many tasks it takes at once: while one is evaluated, others are written.
    """

    worker: str
    device: str
    bits: str
    at_once: int


@dataclass(frozen=True)
class Refused:
    """A worker that gets no task, or no other one: its name, and why."""

    worker: str
    reason: str


@dataclass(frozen=True)
class Failed:
    """A task that no other worker could do either."""

    worker: str
    error: SketchterrainError


def called(name: object) -> str:
    """Return what people call a worker that a scheduler has a name or a number for."""
    return f"worker {name}" if str(name).isdigit() else str(name)


def packed(job: Job, *, token: str, text: str, device: str | None) -> dict[str, Any]:
    """Return what a scheduler keeps and each worker asks for once, of plain types.

    Parameters
    ----------
    job
    token, text
        A file in the output's folder, and what it holds: who sees it, sees the folder.
    device
        Selector as for :func:`~sketchterrain.compute.choose_device`; None: each worker takes its own.
    """
    return {
        "version": version("sketchterrain"),
        "code": code_digest(),
        "token": token,
        "text": text,
        "device": device,
        "job": pickle.dumps(job),
    }


def unpacked(order: dict[str, Any]) -> Job:
    """Return the job that was packed; the version must be the same."""
    job: Job = pickle.loads(order["job"])  # noqa: S301 - a cluster runs what its clients send anyway
    return job
