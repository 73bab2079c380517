"""The layers of the terrain, in the order in which they are laid: see ``kernels/height.clh``."""

from collections.abc import Sequence

from sketchterrain.array_types import Float64Array, StructuredArray
from sketchterrain.landforms.placement.feature_types import Cover, Lake, River
from sketchterrain.landforms.placement.fill import Fill
from sketchterrain.landforms.placement.plateaus import Plateau
from sketchterrain.landforms.placement.sea import Sea
from sketchterrain.landuse.areas import NO_LAND_USE
from sketchterrain.schema.materials import BUILT_IN
from sketchterrain.terrain.layers.base import BaseLayer
from sketchterrain.terrain.layers.corridors import CorridorsLayer
from sketchterrain.terrain.layers.covers import CoversLayer
from sketchterrain.terrain.layers.dunes import DunesLayer
from sketchterrain.terrain.layers.forests import ForestsLayer
from sketchterrain.terrain.layers.lakes import LakesLayer
from sketchterrain.terrain.layers.landuse import LandUseLayer
from sketchterrain.terrain.layers.layer import TerrainLayer
from sketchterrain.terrain.layers.pads import PadsLayer
from sketchterrain.terrain.layers.plateaus import PlateausLayer
from sketchterrain.terrain.layers.points import PointsLayer
from sketchterrain.terrain.layers.relief import ReliefLayer
from sketchterrain.terrain.layers.roads import RoadsLayer
from sketchterrain.terrain.layers.sea import SeaLayer


def layer_stack(
    *,
    extent: float,
    relief: ReliefLayer,
    painted: StructuredArray,
    fill: Fill,
    rivers: Sequence[River] = (),
    valley_radii: Sequence[Float64Array] = (),
    plateaus: Sequence[Plateau] = (),
    lakes: Sequence[Lake] = (),
    covers: Sequence[Cover] = (),
    sea: Sea | None = None,
    detail: float = 1.0,
    materials: tuple[str, ...] = BUILT_IN.names,
) -> tuple[TerrainLayer, ...]:
    """Return all layers of a terrain.

    ``relief`` is the drained ground, ``painted`` and ``fill`` are the point features, ``valley_radii`` the
    radius of influence (m) of each river's valley at each point of its centreline, ``detail`` the strength
    of what elevation data lack, ``materials`` the names of materials. Land use, pads and roads are laid on
    the result.
    """
    points = PointsLayer(painted, fill)
    return (
        points,
        BaseLayer.of(None if relief.base is None else relief.base.base, detail),
        relief,
        ForestsLayer(),
        DunesLayer(points.dune_styles),
        PlateausLayer(tuple(plateaus)),
        SeaLayer.of(sea),
        LakesLayer(tuple(lakes)),
        CorridorsLayer.of(rivers, valley_radii, extent),
        LandUseLayer(materials, NO_LAND_USE),
        PadsLayer(materials, ()),
        RoadsLayer(materials, ()),
        CoversLayer(tuple(covers)),
    )
