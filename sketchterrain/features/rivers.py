"""Rivers: from what was painted to centrelines with width, depth and a falling water level."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from hashlib import blake2b
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array
from sketchterrain.features.contradictions import label_mountains, mountain_crossings, resolve_conflicts
from sketchterrain.features.lakes import mouth_lakes, painted_lakes, solve_lake_levels
from sketchterrain.features.memory import PlacementCache
from sketchterrain.features.recent import IdentityKey
from sketchterrain.features.river_beyond import separate_beyond_edge
from sketchterrain.features.river_edits import apply_lake_edits, apply_river_edits
from sketchterrain.features.river_layout import heights_at, lay_out_rivers
from sketchterrain.features.river_shape import build_network
from sketchterrain.features.river_water import build_rivers
from sketchterrain.features.water_memory import HydrologyCache

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sketchterrain.features.catalogue import Lake, River
    from sketchterrain.features.contradictions import Resolution
    from sketchterrain.features.river_course import RiverCourse
    from sketchterrain.features.river_layout import GroundHeight
    from sketchterrain.sketch.document import Sketch


def trace_rivers(sketch: Sketch, *, seed: int, ground: GroundHeight) -> tuple[River, ...]:
    """Trace the rivers that were painted.

    Painted regions of any label that touch are one network, and so is an end painted a few pixels short of
    another river's middle. A dab that is no longer than it is wide, even
    one pixel, becomes a short straight reach. The mouth is the lowest end, and rather one at the sketch's
    edge; a river that reaches the edge runs on beyond it for about a third of the sketch. A loop becomes two
    arms that part at its top and meet at its bottom.

    Parameters
    ----------
    sketch : Sketch
        The document; its own seed is not looked at.
    seed : int
        Seed of the terrain.
    ground : callable
        ``ground(x, y)``: height (m) of the land without rivers, for 1-D float64 arrays of positions (m). It
        is called twice: for all ends, then for all centrelines.

    Returns
    -------
    tuple of River, sorted by id. Along each centreline the water level falls by at least 1e-4 m a metre; a
    tributary's last point is a point of the centreline that it joins, z included.

    Raises
    ------
    InputError
        If `ground` returns something of another shape, or not finite.
    """
    return trace_hydrology(sketch, seed=seed, ground=ground).rivers


@dataclass(frozen=True, eq=False)
class Hydrology:
    """Rivers, lakes, and what was decided about them.

    Attributes
    ----------
    rivers : tuple of River
        Sorted by id.
    lakes : tuple of Lake
        Painted ones in reading order, then those in which rivers end beyond the sketch.
    resolutions : tuple of Resolution
        One line for each contradiction between layers, and where; see `contradictions`.
    orphans : tuple of str
        One line for each edit that found nothing to change.
    grounds : tuple of (m,) float64
        Height (m) of the ground without rivers along each river's centreline.
    """

    rivers: tuple[River, ...]
    lakes: tuple[Lake, ...]
    resolutions: tuple[Resolution, ...]
    orphans: tuple[str, ...]
    grounds: tuple[Float64Array, ...]


def trace_hydrology(
    sketch: Sketch,
    *,
    seed: int,
    ground: GroundHeight,
    memory: PlacementCache | None = None,
    checkpoint: Callable[[], None] | None = None,
) -> Hydrology:
    """Trace rivers as `trace_rivers` does, and lay out the lakes that they run through and end in.

    `ground` is called once more, for the shores of all lakes.

    Parameters
    ----------
    sketch, seed, ground
        As for `trace_rivers`.
    memory : PlacementCache, optional
        From the last time. It saves time; the bits are the same.
    checkpoint : callable, optional
        Called between the steps; it may raise to abandon the work.
    """
    memory = PlacementCache() if memory is None else memory
    known = memory.part(HydrologyCache)
    pause = _go_on if checkpoint is None else checkpoint
    lakes = painted_lakes(sketch, ground, known)
    pause()
    drawn = lay_out_rivers(sketch, seed=seed, ground=ground, memory=known)
    courses, orphans = apply_river_edits(drawn, sketch.edits)
    pause()
    courses = known.parts.of(
        ("apart", sketch.size, *map(IdentityKey, courses)), lambda: separate_beyond_edge(courses, sketch.size)
    )
    lakes, lost = apply_lake_edits([*lakes, *mouth_lakes(sketch, courses, seed=seed)], sketch.edits)
    pause()
    rivers, lakes, grounds = _with_water(sketch, courses, lakes, ground, memory, pause)
    pause()
    decided = resolve_conflicts(sketch, _mountains(sketch, memory), rivers, grounds, lakes)
    return Hydrology(tuple(rivers), tuple(lakes), decided, orphans + lost, tuple(grounds))


def _go_on() -> None:
    """Never abandon the work."""


def _mountains(sketch: Sketch, memory: PlacementCache) -> npt.NDArray[np.int64]:
    image = sketch.layers["mountain"]
    numbers: npt.NDArray[np.int64] = memory.part(HydrologyCache).images.of(
        ("mountains", IdentityKey(image)), lambda: label_mountains(sketch, memory.regions(image))
    )
    return numbers


def _with_water(
    sketch: Sketch,
    courses: list[RiverCourse],
    lakes: list[Lake],
    ground: GroundHeight,
    memory: PlacementCache,
    pause: Callable[[], None],
) -> tuple[list[River], list[Lake], list[Float64Array]]:
    """Let water flow: rivers sorted by id, lakes at their levels, and the ground along each river."""
    if not courses:
        return [], lakes, []
    grounds = heights_at(ground, [course.line for course in courses])
    pause()
    mountains, known = _mountains(sketch, memory), memory.part(HydrologyCache)
    cuts = tuple(
        tuple((run.first, run.last) for run in mountain_crossings(sketch, mountains, course.line))
        for course in courses
    )
    shape = known.parts.of(
        ("network", *map(IdentityKey, courses)), lambda: build_network(courses, [()] * len(courses), known)
    )
    before = tuple((IdentityKey(lake.shape), lake.id, lake.level, lake.depth) for lake in lakes)
    levels = tuple(each.tobytes() for each in grounds)
    pause()

    def flown() -> tuple[list[River], list[Lake]]:
        network = replace(shape, cuts=cuts)
        filled, levels = solve_lake_levels(lakes, network, grounds)
        return _same_again(build_rivers(network, levels), known), filled

    rivers, filled = known.parts.of(("water", IdentityKey(shape), cuts, before, levels), flown)
    order = sorted(range(len(rivers)), key=lambda number: rivers[number].id)
    return [rivers[number] for number in order], filled, [grounds[number] for number in order]


def _same_again(rivers: Sequence[River], known: HydrologyCache) -> list[River]:
    """Return for each river that was there before, bit for bit, the very same object."""
    return [
        known.parts.of(("river", *(_bits(part) for part in vars(river).values())), partial(_itself, river))
        for river in rivers
    ]


def _itself(river: River) -> River:
    return river


def _bits(part: object) -> object:
    return blake2b(part.tobytes()).digest() if isinstance(part, np.ndarray) else part
