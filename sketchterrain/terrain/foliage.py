"""Which plants stand where: Poisson-disk places, thinned by forest, slope and water; species in patches."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import cKDTree

from sketchterrain.errors import InputError
from sketchterrain.features import FEATURE_TYPES
from sketchterrain.features.catalogue import conifer_share
from sketchterrain.features.hashing import smooth_noise, unit
from sketchterrain.terrain.culling import features_near
from sketchterrain.terrain.lattice import metres_per_unit, to_lattice
from sketchterrain.terrain.packing import support_radii
from sketchterrain.terrain.plant import PLANT, STOREYS
from sketchterrain.terrain.poisson import poisson_disk_steps

if TYPE_CHECKING:
    from collections.abc import Generator

    import numpy.typing as npt

    from sketchterrain.terrain.evaluation import Evaluator

    Reals = npt.NDArray[np.float64]

__all__ = ["SPACING", "FoliageSampler"]

SPACING = 5.0
"""Metres between plants, at least."""

_SPRUCE, _PINE, _OAK, _BIRCH, _SHRUB = range(len(STOREYS["woody"]))

_LONE_PLANTS = 0.016  # share of places outside forests that bear a plant where it is not dry, on the mean
_GROUPS = (190.0, 55.0)  # m, from group to group of those, and from thicket to thicket in a group
_MOST_IN_GROUP = 6.0  # times as many as on the mean stand there at most
_STEEPEST = 1.0  # rise over run on which trees hold
_WATERSIDE = 0.7  # water mask from which on it is too wet
_MASK_CELL = 2.0  # m: how finely forests and banks are told apart
_CONIFER_BELT = 450.0  # m below the tree line in which conifers take over
_STANDS = (420.0, 90.0)  # m, from one species' stand to the next, and their ragged borders
_FRINGE = 0.55  # share of places just outside a forest that may bear undergrowth
_SEED_FLIES = 22.0  # m: how far from a forest that is found
_OUTSIDE = 0.22  # forest mask below which a place is outside
_EDGE = 0.55  # forest mask below which trees are smaller: it is the forest's edge
_YOUNG = 0.16  # share of a forest's trees that are not grown


class FoliageSampler:
    """Plants of a recipe on a device."""

    def __init__(self, evaluator: Evaluator) -> None:
        self._evaluator = evaluator
        self._recipe = evaluator.recipe

    def within(self, west: float, south: float, east: float, north: float) -> npt.NDArray[np.void]:
        """Return the plants of a rectangle in metres; see :meth:`Terrain.foliage`."""
        steps = self.steps(west, south, east, north)
        while True:
            try:
                next(steps)
            except StopIteration as end:
                plants: npt.NDArray[np.void] = end.value
                return plants

    def steps(
        self, west: float, south: float, east: float, north: float
    ) -> Generator[None, None, npt.NDArray[np.void]]:
        """Do the same in steps; see :meth:`Terrain.foliage_steps`."""
        corners = to_lattice([west, south, east, north], self._recipe.extent)
        if west > east or south > north:
            raise InputError(
                f"expected west ≤ east and south ≤ north, got {west:g}, {south:g}, {east:g}, {north:g}"
            )
        area = (int(corners[0]), int(corners[1]), int(corners[2]), int(corners[3]))
        metre = 1 / metres_per_unit(self._recipe.extent)
        places = yield from poisson_disk_steps(
            self._evaluator.context, area, max(round(SPACING * metre), 2), seed=self._recipe.seed
        )
        yield
        if not len(places):
            return np.zeros(0, PLANT)
        x, y = places.T
        # The draws first, against what there can be at most: most places bear nothing and cost no height.
        draw, lone = self._draw("presence", x, y), self._lone_share(x, y)
        woody = self._evaluator.may_hold(x, y, "forest")
        kept = woody | (draw < lone)
        x, y, draw, lone, woody = x[kept], y[kept], draw[kept], lone[kept], woody[kept]
        yield
        if not x.size:
            return np.zeros(0, PLANT)
        _, masks = self._evaluator.points(x, y, cell_size=_MASK_CELL)
        own = draw < self._most_plants(masks, lone)
        yield
        young = self._undergrowth(x, y, woody & ~own & (masks[:, 2] < _OUTSIDE))
        kept = own | young
        x, y, masks, young = x[kept], y[kept], masks[kept], young[kept]
        yield
        step = max(round(metre), 1)
        z = self._heights(x, y)
        slope = np.stack([self._heights(x + step, y) - z, self._heights(x, y + step) - z], axis=-1)
        slope /= step / metre
        yield
        kept = self._draw("hold", x, y) < self._hold(z, np.hypot(*slope.T), masks)
        return self._plants(x[kept], y[kept], z[kept], slope[kept], masks[kept], young[kept])

    def _heights(self, x: npt.NDArray[np.int64], y: npt.NDArray[np.int64]) -> Reals:
        height, _ = self._evaluator.points(x, y, cell_size=0.0)
        return height.astype(np.float64)

    def _lone_share(self, x: npt.NDArray[np.int64], y: npt.NDArray[np.int64]) -> Reals:
        """Share of places outside forests that bear a plant: in loose groups, few between them."""
        wide, narrow = (self._field("group", x, y, width) for width in _GROUPS)
        thick = _ramp(0.65 * wide + 0.35 * narrow, 0.42, 0.86) ** 2
        share = _LONE_PLANTS * (1 - self._recipe.climate["aridity"])
        return np.asarray(share * (0.25 + (_MOST_IN_GROUP - 0.25) * thick))

    def _most_plants(self, masks: npt.NDArray[Any], lone: Reals) -> Reals:
        """Share of places, 0 … 1, that bear a plant on level ground in a mild climate."""
        _, dune, forest, _ = masks.T.astype(np.float64)
        return np.asarray(np.maximum(forest, lone * (1 - dune)))

    def _undergrowth(
        self, x: npt.NDArray[np.int64], y: npt.NDArray[np.int64], candidates: npt.NDArray[np.bool_]
    ) -> npt.NDArray[np.bool_]:
        """Tell which places just outside a forest bear what has seeded itself from it."""
        chance = self._draw("seed", x, y) / _FRINGE
        grown = np.flatnonzero(candidates & (chance < 1.0))
        found = np.zeros(x.size, np.bool_)
        if grown.size:
            metre = 1 / metres_per_unit(self._recipe.extent)
            angle = 2 * np.pi * self._draw("seed bearing", x[grown], y[grown])
            away = _SEED_FLIES * metre * np.sqrt(self._draw("seed flight", x[grown], y[grown]))
            from_x, from_y = (
                start[grown] + np.rint(away * turn).astype(np.int64)
                for start, turn in ((x, np.cos(angle)), (y, np.sin(angle)))
            )
            _, masks = self._evaluator.points(from_x, from_y, cell_size=_MASK_CELL)
            found[grown] = chance[grown] < masks[:, 2]
        return found

    def _hold(self, z: Reals, steepness: Reals, masks: npt.NDArray[Any]) -> Reals:
        """Share of those plants, 0 … 1, that the slope, the height and the water leave."""
        tree_line = self._recipe.climate["tree_line"]
        hold = 1 - _ramp(steepness, _STEEPEST - 0.25, _STEEPEST)
        warm = 1 - _ramp(z, tree_line - 60, tree_line + 60)
        return np.asarray(hold * warm * (masks[:, 3] < _WATERSIDE))

    def _plants(
        self,
        x: npt.NDArray[np.int64],
        y: npt.NDArray[np.int64],
        z: Reals,
        slope: Reals,
        masks: npt.NDArray[Any],
        young: npt.NDArray[np.bool_],
    ) -> npt.NDArray[np.void]:
        climate, steepness = self._recipe.climate, np.hypot(*slope.T)
        forest, water = masks[:, 2].astype(np.float64), masks[:, 3].astype(np.float64)
        belt = _ramp(z, climate["tree_line"] - 2 * _CONIFER_BELT, climate["tree_line"] - 0.3 * _CONIFER_BELT)
        conifers = self._conifers(x, y, 0.22 + 0.78 * belt)
        # Pines hold dry and steep ground, birches come first to edges and stand with their feet wet.
        dry = 0.7 * _ramp(steepness, 0.25, 0.7) + 0.7 * climate["aridity"]
        pines = self._stands("pine", x, y, dry - 0.45)
        birches = self._stands("birch", x, y, 0.35 * (forest < _EDGE) + 0.5 * (water > 0.02) - 0.3)
        # Shrubs stand in the open, at forest edges and where it is dry.
        shrubs = np.clip(
            0.08 + 1.25 * climate["aridity"] ** 2 + 0.3 * (forest < _OUTSIDE) + 0.3 * young, 0, 1
        )
        conifer = np.where(self._draw("pine", x, y) < pines, _PINE, _SPRUCE)
        broadleaf = np.where(self._draw("birch", x, y) < birches, _BIRCH, _OAK)
        tree = np.where(self._draw("conifer", x, y) < conifers, conifer, broadleaf)
        plants = np.zeros(x.size, PLANT)
        unit_m = metres_per_unit(self._recipe.extent)
        plants["x"], plants["y"], plants["z"] = x * unit_m, y * unit_m, z
        plants["species"] = np.where(self._draw("shrub", x, y) < shrubs, _SHRUB, tree)
        plants["scale"] = self._scale(x, y, forest, young, plants["species"] == _SHRUB)
        plants["rotation"] = 2 * np.pi * self._draw("rotation", x, y)
        plants["tint"] = self._draw("tint", x, y)
        upward = 1 / np.sqrt(1 + steepness**2)
        plants["normal"] = np.stack([-slope[:, 0] * upward, -slope[:, 1] * upward, upward], axis=-1)
        return plants

    def _scale(
        self,
        x: npt.NDArray[np.int64],
        y: npt.NDArray[np.int64],
        forest: Reals,
        young: npt.NDArray[np.bool_],
        shrub: npt.NDArray[np.bool_],
    ) -> Reals:
        """Sizes: most plants are grown, smaller ones among them; trees get lower towards a forest's edge."""
        size = self._draw("scale", x, y)
        grown = 0.65 + 0.6 * size**2
        edge = np.where((forest > 0) & (forest < _EDGE), 0.6 + 0.4 * forest / _EDGE, 1.0)
        small = young | ((forest >= _OUTSIDE) & (self._draw("young", x, y) < _YOUNG))
        tree = np.where(small, 0.22 + 0.38 * size, grown * edge)
        return np.where(shrub, grown, tree)

    def _stands(self, name: str, x: npt.NDArray[np.int64], y: npt.NDArray[np.int64], lean: Reals) -> Reals:
        """Share of a species against its rival, 0.05 … 0.95: either in stands; `lean` above 0 favours it."""
        wide, narrow = (self._field(name, x, y, width) for width in _STANDS)
        return np.asarray(np.clip(0.5 + 4.0 * (0.75 * wide + 0.25 * narrow - 0.5) + lean, 0.05, 0.95))

    def _field(self, name: str, x: npt.NDArray[np.int64], y: npt.NDArray[np.int64], width: float) -> Reals:
        """Smooth noise, 0 … 1, one swing in about two widths (m)."""
        steps = metres_per_unit(self._recipe.extent) / width
        at = [steps * each.astype(np.float64) for each in (x, y)]
        return smooth_noise(self._recipe.seed, f"plant {name} {width:g}", at[0], at[1])

    def _conifers(self, x: npt.NDArray[np.int64], y: npt.NDArray[np.int64], by_elevation: Reals) -> Reals:
        """Share of conifers at places: the mean of the forests there, by how much each covers a place."""
        if not x.size:
            return by_elevation
        area = np.array([[x.min(), y.min(), x.max(), y.max()]])
        near = features_near(self._recipe, area, min_radius=0.0)
        forests = near[near["type"] == FEATURE_TYPES.index("forest")]
        share = conifer_share(forests["peakiness"])
        if not (share >= 0).any():
            return by_elevation
        places = np.stack([x, y], axis=-1) * metres_per_unit(self._recipe.extent)
        centres = np.stack([forests["x"], forests["y"]], axis=-1)
        radii = support_radii(self._recipe) * forests["radius"].astype(np.float64)
        members = cKDTree(places).query_ball_point(centres, radii, return_sorted=True)
        total, weights = np.zeros((2, x.size))
        # One after the other in the order of their ids, so that a place's sum is the same in any rectangle.
        for forest, (i, centre, radius) in enumerate(zip(members, centres, radii, strict=True)):
            cover = np.maximum(1 - np.sum((places[i] - centre) ** 2, axis=-1) / radius**2, 0)
            weights[i] += cover
            total[i] += cover * (share[forest] if share[forest] >= 0 else by_elevation[i])
        covered = weights > 0
        return np.where(covered, total / np.where(covered, weights, 1), by_elevation)

    def _draw(self, stream: str, x: npt.NDArray[np.int64], y: npt.NDArray[np.int64]) -> Reals:
        """One number in [0, 1) for each place."""
        return unit(self._recipe.seed, f"plant {stream}", x, y)


def _ramp(x: Reals, low: float, high: float) -> Reals:
    return np.asarray(np.clip((x - low) / (high - low), 0, 1))
