"""Plants in a glTF scene: instances of models of a few triangles (EXT_mesh_gpu_instancing), or points."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.errors import InputError
from sketchterrain.export.engines import EngineAxes, plants_within, storeys_of
from sketchterrain.export.gltf import Glb
from sketchterrain.export.sampled import ground_at
from sketchterrain.export.target import Export
from sketchterrain.look.plant_variants import plant_chances, plant_variants
from sketchterrain.look.tree_levels import DETAILS, MASKED_DETAILS, VARIANTS, level
from sketchterrain.look.tree_species import HEIGHTS, SPECIES
from sketchterrain.terrain.plant import STOREYS

Floats = npt.NDArray[np.float64]
INSTANCING: Final = "EXT_mesh_gpu_instancing"
BYTES_PER_PLANT: Final = 40 + 24
"""As an instance and as a point."""

MAX_PLANTS: Final = 10_000_000
"""That a scene is made of; what it takes of memory is about 130 bytes each."""

_TRIANGLES: Final = 20_000_000  # of all plants together; beyond that models are coarser
FINEST: Final = MASKED_DETAILS
"""Of the levels of detail the first one whose leaves are triangles, not sheets that a shader cuts."""

COARSEST: Final = DETAILS - 1
_SHADE: Final = 0.45  # of the light in the open that reaches the inside of a crown
_STEPS: Final = 65535


class Planting(NamedTuple):
    """Plants of a scene, those of one model next to each other."""

    place: npt.NDArray[np.float64]  # (n, 3): feet along the axes of the scene
    scale: npt.NDArray[np.float32]  # 1 is grown
    turn: npt.NDArray[np.float32]  # radians about the vertical axis
    model: npt.NDArray[np.int64]  # species · `VARIANTS` + variant
    species: tuple[str, ...]

    def groups(self, width: int = 1) -> Iterator[tuple[int, slice]]:
        """Return each model that there is, or each `width` in a row, and its plants."""
        kinds = self.model // width
        for kind in np.unique(kinds).tolist():
            first, last = np.searchsorted(kinds, [kind, kind + 1])
            yield kind, slice(int(first), int(last))


def gathered_plants(export: Export, axes: EngineAxes) -> Planting:
    """Find the plants of an export: they stand on the ground between the grid's vertices."""
    terrain, sampled = export.terrain, export.sampled
    storeys = storeys_of(export.options)
    many = sum(terrain.foliage_estimate(*sampled.grid.area, storey=storey)[0] for storey in storeys)
    if many > MAX_PLANTS:
        raise InputError(
            f"up to {many:.3g} plants: a GLB takes {MAX_PLANTS:.3g}: expected no grass, or a smaller extent"
        )
    parts: list[tuple[npt.NDArray[Any], ...]] = [
        (np.zeros((0, 3)), np.zeros(0, np.float32), np.zeros(0, np.float32), np.zeros(0, np.int64))
    ]
    for storey in storeys:
        for plants in plants_within(terrain, sampled.grid.area, storey):
            ground = ground_at(sampled, plants["x"], plants["y"])
            place = axes.places(plants["x"], plants["y"], ground).astype(np.float64)
            model = plants["species"].astype(np.int64) * VARIANTS
            if storey == "woody":
                model += plant_variants(plant_chances(plants)[1]).astype(np.int64)
            parts.append((place, plants["scale"].copy(), plants["rotation"].copy(), model))
    place, scale, turn, model = (np.concatenate(each) for each in zip(*parts, strict=True))
    order = np.argsort(model, kind="stable")
    return Planting(place[order], scale[order], turn[order], model[order], terrain.species_names)


def add_instances(glb: Glb, planting: Planting) -> int:
    """Add plants as instances of models, and return the models' level of detail.

    A node stands where the first of its plants does, so a program without the extension shows that one.
    """
    detail = _detail(planting)
    if len(planting.model):
        glb.scene.extensionsUsed.append(INSTANCING)
        material = glb.material(
            "plants",
            doubleSided=True,
            pbrMetallicRoughness={"metallicFactor": 0.0, "roughnessFactor": 0.9},
        )
    for kind, some in planting.groups():
        name, mesh = _name(planting, kind), _mesh(planting, kind, detail)
        attributes = {
            "POSITION": glb.attribute(mesh.place, bounds=True),
            "NORMAL": glb.attribute(mesh.normal),
            "COLOR_0": glb.attribute(mesh.colour, normalized=True),
        }
        number = glb.mesh(name, attributes, material=material)
        place, half = planting.place[some], 0.5 * planting.turn[some].astype(np.float64)
        spin = np.zeros((len(place), 4), np.float32)
        spin[:, 1], spin[:, 3] = np.sin(half), np.cos(half)
        instances = {
            "TRANSLATION": glb.attribute((place - place[0]).astype(np.float32), vertex=False),
            "ROTATION": glb.attribute(spin, vertex=False),
            "SCALE": glb.attribute(np.repeat(planting.scale[some][:, None], 3, axis=1), vertex=False),
        }
        extension = {INSTANCING: {"attributes": instances}}
        glb.node(name, mesh=number, translation=place[0].tolist(), extensions=extension)
    return detail


def add_points(glb: Glb, planting: Planting, centre: npt.NDArray[np.float64]) -> None:
    """Add plants as points in their species' colour, a node a species, with ``_SCALE`` and ``_ROTATION``."""
    material = glb.material("plants", pbrMetallicRoughness={"metallicFactor": 0.0, "roughnessFactor": 1.0})
    for kind, some in planting.groups(VARIANTS):
        name = planting.species[kind]
        place = (planting.place[some] - centre).astype(np.float32)
        colour = np.full((len(place), 4), 65535, np.uint16)
        colour[:, :3] = np.rint(65535.0 * np.array(plant_colour(name)))
        attributes = {
            "POSITION": glb.attribute(place, bounds=True),
            "COLOR_0": glb.attribute(colour, normalized=True),
            "_SCALE": glb.attribute(planting.scale[some]),
            "_ROTATION": glb.attribute(planting.turn[some]),
        }
        points = glb.mesh(name, attributes, material=material, mode=0)
        glb.node(name, mesh=points, translation=centre.tolist())


def _detail(planting: Planting) -> int:
    for detail in range(FINEST, COARSEST):
        triangles = sum(
            len(_mesh(planting, kind, detail).place) // 3 * (some.stop - some.start)
            for kind, some in planting.groups()
        )
        if triangles <= _TRIANGLES:
            return detail
    return COARSEST


def _mesh(planting: Planting, kind: int, detail: int) -> Model:
    species = planting.species[kind // VARIANTS]
    if species in STOREYS["woody"]:
        return woody_model(species, kind % VARIANTS, detail)
    return herb_model(species)


def _name(planting: Planting, kind: int) -> str:
    species = planting.species[kind // VARIANTS]
    return f"{species} {kind % VARIANTS + 1}" if variants_of(species) > 1 else species


class Model(NamedTuple):
    """Triangles of a grown plant, three corners each; x east, y up, z south, m from its foot."""

    place: npt.NDArray[np.float32]  # (3 · triangles, 3)
    normal: npt.NDArray[np.float32]  # (3 · triangles, 3)
    colour: npt.NDArray[np.uint16]  # (3 · triangles, 4): linear albedo, darker inside the crown; opaque


def variants_of(species: str) -> int:
    """Return how many different plants of a species there are."""
    return VARIANTS if species in SPECIES else 1


@cache
def woody_model(species: str, variant: int, detail: int) -> Model:
    """Return a tree or shrub."""
    triangles = level(species, variant, detail)
    place = HEIGHTS[SPECIES.index(species)] * triangles.position
    light = _SHADE + (1.0 - _SHADE) * triangles.openness[..., None]
    return _model(place, triangles.normal, triangles.albedo * light)


class _Herb(NamedTuple):
    """Leaves around a foot: how many, their height and width (m), how far they lean, albedos."""

    leaves: int
    tall: float
    wide: float
    lean: float
    albedo: tuple[float, float, float]
    head: tuple[float, float, float] | None = None


_HERBS: Final = {
    "grass": _Herb(7, 0.35, 0.012, 0.35, (0.090, 0.130, 0.035)),
    "flower": _Herb(4, 0.30, 0.016, 0.30, (0.080, 0.125, 0.035), (0.62, 0.52, 0.10)),
    "fern": _Herb(8, 0.55, 0.080, 0.85, (0.055, 0.105, 0.025)),
}


@cache
def herb_model(species: str) -> Model:
    """Return a tuft of grass, a flower or a fern."""
    herb = _HERBS[species]
    turn = 2.0 * np.pi * (np.arange(herb.leaves) + 0.31 * (np.arange(herb.leaves) % 3)) / herb.leaves
    out = np.stack([np.cos(turn), np.sin(turn), np.zeros(herb.leaves)], axis=-1)
    aside = 0.5 * herb.wide * np.stack([-np.sin(turn), np.cos(turn), np.zeros(herb.leaves)], axis=-1)
    up = np.array([0.0, 0.0, 1.0])
    tip = herb.lean * herb.tall * out + herb.tall * up
    place = np.stack([-aside, aside, tip], axis=1)
    outward = np.broadcast_to((0.35 * out + 0.94 * up)[:, None, :], place.shape)
    albedo = np.broadcast_to(np.array(herb.albedo), place.shape)
    if herb.head is not None:
        size = 0.035
        ring = size * np.stack([np.cos(turn[:3]), np.sin(turn[:3]), np.zeros(3)], axis=-1) + herb.tall * up
        place = np.concatenate([place, ring[None]])
        outward = np.concatenate([outward, np.broadcast_to(up, (1, 3, 3))])
        albedo = np.concatenate([albedo, np.broadcast_to(np.array(herb.head), (1, 3, 3))])
    return _model(place, outward, albedo)


@cache
def plant_colour(species: str) -> tuple[float, float, float]:
    """Return the linear albedo of a species as a point."""
    if species in SPECIES:
        mean = woody_model(species, 0, COARSEST).colour[:, :3].mean(axis=0) / _STEPS
        return float(mean[0]), float(mean[1]), float(mean[2])
    herb = _HERBS[species]
    return herb.head or herb.albedo


def _model(place: Floats, outward: Floats, albedo: Floats) -> Model:
    """Turn triangles so that their fronts show where their normals point, and stand them upright in y."""
    faced = np.cross(place[:, 1] - place[:, 0], place[:, 2] - place[:, 0])
    back = (faced * outward.mean(axis=1)).sum(axis=-1) < 0.0
    order = np.where(back[:, None], [0, 2, 1], [0, 1, 2])[..., None]
    place, outward, albedo = (np.take_along_axis(each, order, axis=1) for each in (place, outward, albedo))
    colour = np.full((place.shape[0] * 3, 4), _STEPS, np.uint16)
    colour[:, :3] = np.rint(_STEPS * np.clip(albedo.reshape(-1, 3), 0.0, 1.0))
    unit = outward / np.linalg.norm(outward, axis=-1, keepdims=True)
    return Model(_upright(place), _upright(unit), colour)


def _upright(vectors: Floats) -> npt.NDArray[np.float32]:
    east, north, up = vectors.reshape(-1, 3).T
    return np.stack([east, up, -north], axis=-1).astype(np.float32)
