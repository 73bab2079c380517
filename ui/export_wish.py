"""What an export beside the window is asked for: a value that travels to its process."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from sketchterrain.export.target import ExportOptions
    from sketchterrain.world.asked import Wishes

__all__ = ["TargetWish", "Wish", "WorldWish"]


@dataclass(frozen=True)
class Wish:
    """What shall be exported, as `generate` writes it.

    Attributes
    ----------
    folder : Path
    size : int
        Vertices along the longer side.
    foliage : {'csv', 'ply', 'both', 'none'}
    grass : bool
    preview : bool
    view : {'auto', 'ground', 'hill', 'air'}
        Of the preview.
    map : {'png', 'svg'} or None
    device : str or None
    """

    folder: Path
    size: int = 1025
    foliage: str = "csv"
    grass: bool = False
    preview: bool = True
    view: str = "auto"
    map: str | None = None
    device: str | None = None


@dataclass(frozen=True)
class TargetWish:
    """What shall be exported to a target.

    Attributes
    ----------
    folder : Path
    target : str
        One of `sketchterrain.export.targets.TARGET_NAMES`.
    options : ExportOptions
    device : str or None
    """

    folder: Path
    target: str
    options: ExportOptions
    device: str | None = None


@dataclass(frozen=True)
class WorldWish:
    """What world shall be written, or gone on with.

    Attributes
    ----------
    output : Path
        Its ending says the form.
    wishes : Wishes
    workers : int
        Processes that share it; 0: one does it.
    device : str or None
    only_estimate : bool
        Nothing is written: it is asked what it will take.
    """

    output: Path
    wishes: Wishes
    workers: int = 0
    device: str | None = None
    only_estimate: bool = False
