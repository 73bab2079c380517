"""Plants of a glTF scene: instances of low-poly models (EXT_mesh_gpu_instancing), or points."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array
from sketchterrain.errors import InputError
from sketchterrain.export.engines import EngineAxes, requested_storeys
from sketchterrain.export.foliage_files import plant_chunks
from sketchterrain.export.gltf import GlbWriter
from sketchterrain.export.sampled import interpolate_heights
from sketchterrain.export.target import Export
from sketchterrain.look.tree_levels import (
    DETAILS,
    MASKED_DETAILS,
    VARIANTS,
    level,
    plant_chances,
    plant_variants,
)
from sketchterrain.look.tree_species import HEIGHTS, SPECIES
from sketchterrain.vegetation.plants import STOREYS

INSTANCING: Final = "EXT_mesh_gpu_instancing"
LEVELS: Final = "MSFT_lod"
BYTES_PER_PLANT: Final = 40 + 24  # as an instance and as a point
MAX_PLANTS: Final = 10_000_000  # of a scene, about 130 bytes of memory each

_MAX_TRIANGLES: Final = 20_000_000  # of all plants together; with more, models are coarser
FINEST: Final = MASKED_DETAILS  # first level of detail whose leaves are triangles, not alpha-tested sheets
COARSEST: Final = DETAILS - 1
_SHADE: Final = 0.45  # share of the light that reaches the inside of a crown
_STEPS: Final = 65535


class ScenePlants(NamedTuple):
    """Plants of a scene, sorted by model."""

    position: npt.NDArray[np.float64]  # (n, 3): feet in the scene's coordinates
    scale: npt.NDArray[np.float32]  # 1 is grown
    rotation: npt.NDArray[np.float32]  # radians about the vertical axis
    model: npt.NDArray[np.int64]  # species · `VARIANTS` + variant
    species: tuple[str, ...]

    def groups(self, width: int = 1) -> Iterator[tuple[int, slice]]:
        """Return each model, or group of `width` consecutive models, with the slice of its plants."""
        kinds = self.model // width
        for kind in np.unique(kinds).tolist():
            first, last = np.searchsorted(kinds, [kind, kind + 1])
            yield kind, slice(int(first), int(last))


def collect_plants(export: Export, axes: EngineAxes) -> ScenePlants:
    """Return the plants of an export, at the interpolated heights of the grid."""
    terrain, samples = export.terrain, export.samples
    storeys = requested_storeys(export.options)
    count = sum(terrain.foliage_estimate(*samples.grid.bounds, storey=storey)[0] for storey in storeys)
    if count > MAX_PLANTS:
        raise InputError(
            f"up to {count:.3g} plants: a GLB holds {MAX_PLANTS:.3g}: expected no grass, or a smaller extent"
        )
    parts: list[tuple[npt.NDArray[Any], ...]] = [
        (np.zeros((0, 3)), np.zeros(0, np.float32), np.zeros(0, np.float32), np.zeros(0, np.int64))
    ]
    for storey in storeys:
        for plants in plant_chunks(terrain.foliage_pieces(*samples.grid.bounds, storey=storey)):
            height = interpolate_heights(samples, plants["x"], plants["y"])
            position = axes.points(plants["x"], plants["y"], height).astype(np.float64)
            model = plants["species"].astype(np.int64) * VARIANTS
            if storey == "woody":
                model += plant_variants(plant_chances(plants)[1]).astype(np.int64)
            parts.append((position, plants["scale"].copy(), plants["rotation"].copy(), model))
    position, scale, rotation, model = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(model, kind="stable")
    return ScenePlants(position[order], scale[order], rotation[order], model[order], terrain.species_names)


def add_instances(glb: GlbWriter, plants: ScenePlants, coarser: tuple[int, ...] = ()) -> int:
    """Add plants as instances of models, and return the models' level of detail.

    A node is at its first plant, which programs without the extension show. With `coarser` levels the first
    is the finest, and models of woody plants at these levels are nodes outside the scene (MSFT_lod).
    """
    detail = FINEST if coarser else _level_of_detail(plants)
    if len(plants.model):
        glb.scene.extensionsUsed += [INSTANCING, *([LEVELS] if coarser else [])]
        material = glb.material(
            "plants",
            doubleSided=True,
            pbrMetallicRoughness={"metallicFactor": 0.0, "roughnessFactor": 0.9},
        )
    for kind, some in plants.groups():
        species, is_woody = plants.species[kind // VARIANTS], plants.species[kind // VARIANTS] in SPECIES
        name = f"{species} {kind % VARIANTS + 1}" if is_woody else species
        number, *others = (
            _add_model(glb, name, model_mesh(plants, kind, each), material)
            for each in (detail, *(coarser if is_woody else ()))
        )
        position, half = plants.position[some], 0.5 * plants.rotation[some].astype(np.float64)
        quaternion = np.zeros((len(position), 4), np.float32)
        quaternion[:, 1], quaternion[:, 3] = np.sin(half), np.cos(half)
        instances = {
            "TRANSLATION": glb.attribute((position - position[0]).astype(np.float32), vertex=False),
            "ROTATION": glb.attribute(quaternion, vertex=False),
            "SCALE": glb.attribute(np.repeat(plants.scale[some][:, None], 3, axis=1), vertex=False),
        }
        extensions: dict[str, Any] = {INSTANCING: {"attributes": instances}}
        if others:
            extensions[LEVELS] = {"ids": [glb.node(name, in_scene=False, mesh=each) for each in others]}
        glb.node(name, mesh=number, translation=position[0].tolist(), extensions=extensions)
    return detail


def _add_model(glb: GlbWriter, name: str, model: PlantModel, material: int) -> int:
    attributes = {
        "POSITION": glb.attribute(model.position, bounds=True),
        "NORMAL": glb.attribute(model.normal),
        "COLOR_0": glb.attribute(model.colour, normalized=True),
    }
    return glb.mesh(name, attributes, material=material)


def add_points(glb: GlbWriter, plants: ScenePlants, centre: npt.NDArray[np.float64]) -> None:
    """Add plants as points in their species' colour, a node a species, with ``_SCALE`` and ``_ROTATION``."""
    material = glb.material("plants", pbrMetallicRoughness={"metallicFactor": 0.0, "roughnessFactor": 1.0})
    for kind, some in plants.groups(VARIANTS):
        name = plants.species[kind]
        position = (plants.position[some] - centre).astype(np.float32)
        colour = np.full((len(position), 4), 65535, np.uint16)
        colour[:, :3] = np.rint(65535.0 * np.array(plant_colour(name)))
        attributes = {
            "POSITION": glb.attribute(position, bounds=True),
            "COLOR_0": glb.attribute(colour, normalized=True),
            "_SCALE": glb.attribute(plants.scale[some]),
            "_ROTATION": glb.attribute(plants.rotation[some]),
        }
        points = glb.mesh(name, attributes, material=material, mode=0)
        glb.node(name, mesh=points, translation=centre.tolist())


def _level_of_detail(plants: ScenePlants) -> int:
    """Return the finest level of detail within the budget of triangles."""
    for detail in range(FINEST, COARSEST):
        triangles = sum(
            len(model_mesh(plants, kind, detail).position) // 3 * (some.stop - some.start)
            for kind, some in plants.groups()
        )
        if triangles <= _MAX_TRIANGLES:
            return detail
    return COARSEST


def model_mesh(plants: ScenePlants, kind: int, detail: int) -> PlantModel:
    """Return the model of a group of plants."""
    species = plants.species[kind // VARIANTS]
    if species in STOREYS["woody"]:
        return woody_model(species, kind % VARIANTS, detail)
    return herb_model(species)


class PlantModel(NamedTuple):
    """Triangles of a grown plant, three corners each; x east, y up, z south, m from its foot."""

    position: npt.NDArray[np.float32]  # (3 · triangles, 3)
    normal: npt.NDArray[np.float32]  # (3 · triangles, 3)
    colour: npt.NDArray[np.uint16]  # (3 · triangles, 4): linear albedo, darker inside the crown; opaque


@cache
def woody_model(species: str, variant: int, detail: int) -> PlantModel:
    """Return a tree or shrub."""
    plant = level(species, variant, detail)
    position = HEIGHTS[SPECIES.index(species)] * plant.position
    light = _SHADE + (1.0 - _SHADE) * plant.openness[..., None]
    return _model(position, plant.normal, plant.albedo * light)


class _Herb(NamedTuple):
    """Leaves around a foot, with linear albedos of leaves and flower head."""

    leaves: int
    height: float  # m
    width: float  # m
    lean: float  # of the height
    albedo: tuple[float, float, float]
    head: tuple[float, float, float] | None = None


_HERBS: Final = {
    "grass": _Herb(7, 0.35, 0.012, 0.35, (0.090, 0.130, 0.035)),
    "flower": _Herb(4, 0.30, 0.016, 0.30, (0.080, 0.125, 0.035), (0.62, 0.52, 0.10)),
    "fern": _Herb(8, 0.55, 0.080, 0.85, (0.055, 0.105, 0.025)),
}


@cache
def herb_model(species: str) -> PlantModel:
    """Return a tuft of grass, a flower or a fern."""
    herb = _HERBS[species]
    angle = 2.0 * np.pi * (np.arange(herb.leaves) + 0.31 * (np.arange(herb.leaves) % 3)) / herb.leaves
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros(herb.leaves)], axis=-1)
    side = 0.5 * herb.width * np.stack([-np.sin(angle), np.cos(angle), np.zeros(herb.leaves)], axis=-1)
    up = np.array([0.0, 0.0, 1.0])
    tip = herb.lean * herb.height * out + herb.height * up
    position = np.stack([-side, side, tip], axis=1)
    outward = np.broadcast_to((0.35 * out + 0.94 * up)[:, None, :], position.shape)
    albedo = np.broadcast_to(np.array(herb.albedo), position.shape)
    if herb.head is not None:
        size = 0.035
        ring = np.stack([np.cos(angle[:3]), np.sin(angle[:3]), np.zeros(3)], axis=-1)
        position = np.concatenate([position, (size * ring + herb.height * up)[None]])
        outward = np.concatenate([outward, np.broadcast_to(up, (1, 3, 3))])
        albedo = np.concatenate([albedo, np.broadcast_to(np.array(herb.head), (1, 3, 3))])
    return _model(position, outward, albedo)


@cache
def plant_colour(species: str) -> tuple[float, float, float]:
    """Return the linear albedo of a species as a point."""
    if species in SPECIES:
        mean = woody_model(species, 0, COARSEST).colour[:, :3].mean(axis=0) / _STEPS
        return float(mean[0]), float(mean[1]), float(mean[2])
    herb = _HERBS[species]
    return herb.head or herb.albedo


def _model(position: Float64Array, outward: Float64Array, albedo: Float64Array) -> PlantModel:
    """Orient triangles (k, 3, 3) by their normals, and turn them from z up to y up."""
    facing = np.cross(position[:, 1] - position[:, 0], position[:, 2] - position[:, 0])
    back = (facing * outward.mean(axis=1)).sum(axis=-1) < 0.0
    order = np.where(back[:, None], [0, 2, 1], [0, 1, 2])[..., None]
    position, outward, albedo = (
        np.take_along_axis(values, order, axis=1) for values in (position, outward, albedo)
    )
    colour = np.full((position.shape[0] * 3, 4), _STEPS, np.uint16)
    colour[:, :3] = np.rint(_STEPS * np.clip(albedo.reshape(-1, 3), 0.0, 1.0))
    unit = outward / np.linalg.norm(outward, axis=-1, keepdims=True)
    return PlantModel(_y_up(position), _y_up(unit), colour)


def _y_up(vectors: Float64Array) -> npt.NDArray[np.float32]:
    east, north, up = vectors.reshape(-1, 3).T
    return np.stack([east, up, -north], axis=-1).astype(np.float32)
