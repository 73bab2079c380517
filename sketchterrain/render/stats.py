"""Statistics of frames and of terrain updates."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FrameStats:
    """Statistics of one frame of a moving picture."""

    generation_seconds: float  # for new tiles, including waiting for the device
    light_seconds: float  # for parts of the light maps
    plant_seconds: float  # for plants and their shadow maps
    draw_seconds: float
    tiles_generated: int
    tiles_drawn: int
    resident_tiles: int
    triangles: int  # of terrain and plants
    size: tuple[int, int]  # of the internal picture (px); smaller than the framebuffer during motion
    settled: bool  # the picture is final: nothing is missing, only water and plants move


@dataclass(frozen=True)
class StreamStats:
    """Statistics of the tiles of one frame."""

    generation_seconds: float  # including waiting for the device
    tiles_generated: int
    tiles_drawn: int
    triangles: int
    resident_tiles: int
    settled: bool  # no tile is missing or morphing
    jumped: bool  # the eye jumped, and the frame got a larger budget


@dataclass(frozen=True)
class TileUpdateStats:
    """Cost of replacing the terrain of a tile stream."""

    seconds: float  # including waiting for the device
    tiles_rewritten: int
    tiles_dropped: int


@dataclass(frozen=True)
class TerrainUpdateStats:
    """Cost of replacing the terrain of a renderer."""

    tile_seconds: float  # until the visible tiles held the new heights
    seconds: float  # of all work done at once
    tiles_rewritten: int
    tiles_dropped: int
