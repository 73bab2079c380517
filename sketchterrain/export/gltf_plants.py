"""Plants in a glTF scene: many of few models by EXT_mesh_gpu_instancing, or each one a point."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.export.engine_plants import plants_within, storeys_of
from sketchterrain.export.grid_ground import ground_at
from sketchterrain.export.plant_models import (
    COARSEST,
    FINEST,
    Model,
    herb_model,
    plant_colour,
    variants_of,
    woody_model,
)
from sketchterrain.look.plant_variants import plant_chances, plant_variants
from sketchterrain.look.tree_levels import VARIANTS
from sketchterrain.terrain.plant import STOREYS

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from sketchterrain.export.engine_axes import EngineAxes
    from sketchterrain.export.glb import Glb
    from sketchterrain.export.target import Export

__all__ = [
    "BYTES_PER_PLANT",
    "INSTANCING",
    "MOST_PLANTS",
    "Planting",
    "add_instances",
    "add_points",
    "gathered_plants",
]

INSTANCING: Final = "EXT_mesh_gpu_instancing"
BYTES_PER_PLANT: Final = 40 + 24
"""As an instance and as a point."""

MOST_PLANTS: Final = 10_000_000
"""That a scene is made of; what it takes of memory is about 130 bytes each."""

_TRIANGLES: Final = 20_000_000  # of all plants together; beyond that models are coarser


class Planting(NamedTuple):
    """Plants of a scene, those of one model next to each other.

    Attributes
    ----------
    place : (n, 3) float64
        Their feet along the scene's axes.
    scale, turn : (n,) float32
        1 is grown; radians about the vertical axis.
    model : (n,) int64
        Species · `VARIANTS` + variant.
    species : tuple of str
        Names of the species, in order.
    """

    place: npt.NDArray[np.float64]
    scale: npt.NDArray[np.float32]
    turn: npt.NDArray[np.float32]
    model: npt.NDArray[np.int64]
    species: tuple[str, ...]

    def groups(self, width: int = 1) -> Iterator[tuple[int, slice]]:
        """Return each model that there is, or each `width` in a row, and its plants."""
        kinds = self.model // width
        for kind in np.unique(kinds).tolist():
            first, last = np.searchsorted(kinds, [kind, kind + 1])
            yield kind, slice(int(first), int(last))


def gathered_plants(export: Export, axes: EngineAxes) -> Planting:
    """Find the plants of an export: they stand on the ground between the grid's vertices.

    Parameters
    ----------
    export
    axes
        The scene's; must turn as seen from above, counter-clockwise.

    Raises
    ------
    InputError
        If there can be more than a scene holds.
    """
    terrain, sampled = export.terrain, export.sampled
    storeys = storeys_of(export.options)
    many = sum(terrain.foliage_estimate(*sampled.grid.area, storey=storey)[0] for storey in storeys)
    if many > MOST_PLANTS:
        raise InputError(
            f"up to {many:.3g} plants: a GLB takes {MOST_PLANTS:.3g}: expected no grass, or a smaller extent"
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
    """Add plants as points in their species' colour, a node a species, with ``_SCALE`` and ``_ROTATION``.

    Parameters
    ----------
    glb
    planting
    centre
        (3,) along the scene's axes, from which places are counted.
    """
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
