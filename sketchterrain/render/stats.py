"""What a frame took and showed."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["FrameStats"]


@dataclass(frozen=True)
class FrameStats:
    """Of one frame of a moving picture.

    Attributes
    ----------
    generation_seconds : float
        s for new tiles, waiting for the device included.
    light_seconds, plant_seconds : float
        s for parts of the light maps, and of plants and their shadows.
    draw_seconds : float
        s until the picture was drawn.
    tiles_generated, tiles_drawn, resident_tiles : int
        Tiles of this frame; the last, those that are held.
    triangles : int
        Of the ground and the plants.
    size : (int, int)
        Of the internal picture (px); smaller than the framebuffer while the eye moves.
    settled : bool
        Whether the picture is as good as it gets: nothing is missing, nothing moves but water.
    """

    generation_seconds: float
    light_seconds: float
    plant_seconds: float
    draw_seconds: float
    tiles_generated: int
    tiles_drawn: int
    resident_tiles: int
    triangles: int
    size: tuple[int, int]
    settled: bool
