"""What a frame, or a change of what is drawn, took and showed."""

from __future__ import annotations

from dataclasses import dataclass


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


@dataclass(frozen=True)
class StreamStats:
    """What a frame's tiles took.

    Attributes
    ----------
    generation_seconds : float
        s, waiting for the device included.
    tiles_generated, tiles_drawn, triangles, resident_tiles : int
        Of this frame; the last, tiles that are held.
    settled : bool
        Whether the picture is as good as it gets: nothing is missing, nothing moves.
    leapt : bool
        Whether the eye was put elsewhere, and the frame was given more time.
    """

    generation_seconds: float
    tiles_generated: int
    tiles_drawn: int
    triangles: int
    resident_tiles: int
    settled: bool
    leapt: bool


@dataclass(frozen=True)
class TileUpdateStats:
    """What a change of the ground took.

    Attributes
    ----------
    seconds : float
        s, waiting for the device included.
    tiles_rewritten, tiles_dropped : int
        Written anew at once, and forgotten.
    """

    seconds: float
    tiles_rewritten: int
    tiles_dropped: int


@dataclass(frozen=True)
class Change:
    """What a change of the terrain took.

    Attributes
    ----------
    tile_seconds : float
        s until the view's tiles held the new heights.
    seconds : float
        s of all that was done at once.
    tiles_rewritten, tiles_dropped : int
        Written anew at once, and forgotten.
    """

    tile_seconds: float
    seconds: float
    tiles_rewritten: int
    tiles_dropped: int
