"""A terrain as a glTF scene: ground in its baked materials, water, plants; x east, y up, z south, metres."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Final

import numpy as np
from PIL import Image

from sketchterrain.export.baked_ground import baked_colour, baked_roughness, material_looks
from sketchterrain.export.engine_axes import EngineAxes
from sketchterrain.export.mesh_vertices import mesh_normals, mesh_places, mesh_texels, texel_step
from sketchterrain.export.water_mesh import waters

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.export.glb import Glb
    from sketchterrain.export.grid import Grid
    from sketchterrain.export.mesh import Mesh
    from sketchterrain.export.target import Export

__all__ = ["AXES", "add_ground", "add_water", "centre_of", "png_bytes"]

AXES: Final = EngineAxes("east", "up", "south")
"""Of glTF; the origin is the sketch's south-west corner at height 0."""

_WATER: Final = {
    "baseColorFactor": [0.035, 0.085, 0.095, 0.8],
    "metallicFactor": 0.0,
    "roughnessFactor": 0.06,
}
_PNG_LEVEL: Final = 3


def centre_of(grid: Grid) -> npt.NDArray[np.float64]:
    """Return the middle of a grid at height 0, (3,), along the scene's axes.

    Vertices are counted from there, a node's translation is in float64: float32 holds them twice as finely,
    and heights to the bit.
    """
    middle = np.array([0.5 * (grid.west + grid.east)]), np.array([0.5 * (grid.south + grid.north)])
    centre: npt.NDArray[np.float64] = AXES.places(*middle, np.zeros(1))[0] + 0.0
    return centre


def add_ground(glb: Glb, mesh: Mesh, export: Export) -> None:
    """Add the ground, its materials baked into two textures."""
    grid, sampled = export.grid, export.sampled
    step = texel_step(grid)
    looks = material_looks(export.terrain)
    weights = sampled.weights[::step, ::step]
    colour = glb.texture(png_bytes(baked_colour(weights, looks)), "ground colour")
    rough = glb.texture(png_bytes(baked_roughness(weights, looks)), "ground roughness")
    material = glb.material(
        "ground",
        pbrMetallicRoughness={
            "baseColorTexture": {"index": colour},
            "metallicRoughnessTexture": {"index": rough},
            "metallicFactor": 0.0,
        },
    )
    attributes = {
        "POSITION": glb.attribute(mesh_places(mesh, sampled, _about(grid)), bounds=True),
        "NORMAL": glb.attribute(mesh_normals(mesh, sampled, AXES)),
        "TEXCOORD_0": glb.attribute(mesh_texels(mesh, grid)),
    }
    ground = glb.mesh("ground", attributes, indices=glb.indices(mesh.triangles), material=material)
    glb.node("ground", mesh=ground, translation=centre_of(grid).tolist())


def add_water(glb: Glb, export: Export) -> None:
    """Add rivers and lakes, a node each."""
    grid = export.grid
    material = None
    for water in waters(export.terrain.features, grid):
        if material is None:
            material = glb.material("water", alphaMode="BLEND", pbrMetallicRoughness=_WATER)
        place = _about(grid).places(*water.place.T).astype(np.float32)
        up = np.zeros_like(place)
        up[:, 1] = 1.0
        attributes = {"POSITION": glb.attribute(place, bounds=True), "NORMAL": glb.attribute(up)}
        number = glb.mesh(water.name, attributes, indices=glb.indices(water.triangles), material=material)
        glb.node(water.name, mesh=number, translation=centre_of(grid).tolist())


def png_bytes(pixels: npt.NDArray[np.uint8]) -> bytes:
    """Return an RGB image as PNG."""
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, format="PNG", compress_level=_PNG_LEVEL)
    return stream.getvalue()


def _about(grid: Grid) -> EngineAxes:
    east, _, south = centre_of(grid).tolist()
    return EngineAxes("east", "up", "south", origin=(east, -south, 0.0))
