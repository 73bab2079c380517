"""Terrains that tests share: built once a process, never changed.

A test that needs any terrain takes one of these; its own sketch is for what these lack.
"""

from functools import cache

import numpy as np

from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch
from sketchterrain.generation.building import build
from sketchterrain.generation.terrain import Terrain

EXTENT = 1024.0  # m
SIDE = 64  # px


@cache
def context() -> ComputeContext:
    """Return the context of the preferred device."""
    return ComputeContext()


@cache
def preset(name: str) -> Terrain:
    """Return the terrain of a preset."""
    return build(load_sketch(name), device=context())


@cache
def plain() -> Terrain:
    """Return 1024 m without anything painted."""
    return build(Sketch(name="Plain", extent=EXTENT, seed=3), device=context())


@cache
def painted() -> Terrain:
    """Return 1024 m with a mountain in the north-west, a hill, a river, a lake and a forest."""
    images = {
        name: np.zeros((SIDE, SIDE), np.uint8) for name in ("mountain", "hill", "river", "lake", "forest")
    }
    images["mountain"][6:26, 6:26] = 1
    images["hill"][8:20, 40:54] = 1
    images["river"][32:34] = 1
    images["lake"][42:54, 42:56] = 1
    images["forest"][40:60, 6:30] = 1
    return build(Sketch(name="Painted", extent=EXTENT, seed=5, layers=images), device=context())
