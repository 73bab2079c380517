"""What an export beside the window is asked for: a value that travels to its process."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from sketchterrain.export.target import ExportOptions
    from sketchterrain.world.options import WorldOptions


@dataclass(frozen=True)
class ExportRequest:
    """What shall be exported, as `generate` writes it."""

    folder: Path
    size: int = 1025  # Vertices along the longer side
    foliage: str = "csv"
    grass: bool = False
    preview: bool = True
    view: str = "auto"  # auto, ground, hill, air: Of the preview
    map: str | None = None
    device: str | None = None


@dataclass(frozen=True)
class TargetRequest:
    """What shall be exported to a target."""

    folder: Path
    target: str  # One of `sketchterrain.export.targets.TARGET_NAMES`
    options: ExportOptions
    device: str | None = None


@dataclass(frozen=True)
class WorldRequest:
    """What world shall be written, or gone on with."""

    output: Path  # Its ending says the form
    options: WorldOptions
    workers: int = 0  # Processes that share it; 0: one does it
    device: str | None = None
    only_estimate: bool = False  # Nothing is written: it is asked what it will take
