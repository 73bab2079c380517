"""Export requests that the window sends to the export process."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sketchterrain.export.target import ExportOptions
    from sketchterrain.world.options import WorldOptions


@dataclass(frozen=True)
class ExportRequest:
    """Files to write as `generate` does."""

    folder: Path
    size: int = 1025  # Vertices along the longer side
    foliage: str = "csv"
    grass: bool = False
    preview: bool = True
    view: str = "auto"  # Viewpoint of the preview: auto, ground, hill or air
    map: str | None = None
    device: str | None = None


@dataclass(frozen=True)
class TargetRequest:
    """Files to write for a target, one of `sketchterrain.export.targets.TARGET_NAMES`."""

    folder: Path
    target: str
    options: ExportOptions
    device: str | None = None


@dataclass(frozen=True)
class WorldRequest:
    """World to write or resume; its form follows from the output's suffix."""

    output: Path
    options: WorldOptions
    workers: int = 0  # Worker processes; 0: in this process
    device: str | None = None
    only_estimate: bool = False
