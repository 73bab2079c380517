"""From what was painted as rivers to the courses of their networks, before a person's edits."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from hashlib import blake2b
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array
from sketchterrain.errors import InputError
from sketchterrain.features.lakes import lake_pixels
from sketchterrain.features.recent import IdentityKey
from sketchterrain.features.river_course import (
    LAKE_GAP,
    RiverCourse,
    dab_course,
    pixel_positions,
    reach_course,
    reversed_course,
)
from sketchterrain.features.river_gaps import close_gaps
from sketchterrain.features.river_network import exit_normal, longest_path, river_ends, split_into_reaches
from sketchterrain.features.rounding import rounded
from sketchterrain.features.shapes import find_regions
from sketchterrain.features.skeleton import sort_skeletons, thin_region

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from scipy.spatial import cKDTree

    from sketchterrain.features.river_network import RiverEnd
    from sketchterrain.features.shapes import Region
    from sketchterrain.features.skeleton import Skeleton
    from sketchterrain.features.water_memory import HydrologyCache
    from sketchterrain.sketch.document import Sketch

GroundHeight: TypeAlias = "Callable[[Float64Array, Float64Array], npt.NDArray[np.floating[Any]]]"

_EDGE_BONUS = (10.0, 0.02)
"""A mouth at the sketch's edge may lie this much higher: metres, and metres for each metre of river."""

_LONGEST_DAB = 2.0  # px; so short a skeleton is a dab, however thin


def lay_out_rivers(
    sketch: Sketch, *, seed: int, ground: GroundHeight, memory: HydrologyCache
) -> list[RiverCourse]:
    """Draw the courses of all networks, parents first.

    Parameters
    ----------
    sketch, seed, ground
        As for `trace_rivers`.
    memory : HydrologyCache
        Of skeletons and courses; what is not painted anew is the very same object again.
    """
    found, outlines = _networks(sketch, seed, memory)
    if not found:
        return []
    image = sketch.layers["river"]
    rivers = [(bone, each) for bone, each in zip(found, outlines, strict=True) if isinstance(each, tuple)]
    closed = memory.images.of(
        ("closed", IdentityKey(image), *(IdentityKey(bone) for bone, _ in rivers)),
        lambda: close_gaps(image, rivers, LAKE_GAP),
    )
    if closed is not None:
        sketch = sketch.replace(layers={**sketch.layers, "river": closed})
        found, outlines = _networks(sketch, seed, memory)
    lakes = sketch.layers["lake"]
    lake = memory.images.of(("lake pixels", IdentityKey(lakes)), lambda: lake_pixels(sketch))
    positions = [_end_positions(sketch, *each) for each in zip(found, outlines, strict=True)]
    courses: list[RiverCourse] = []
    for skeleton, outline, heights in zip(found, outlines, heights_at(ground, positions), strict=True):
        courses.extend(_courses(sketch, skeleton, outline, heights, seed, lake, memory))
    return courses


def heights_at(ground: GroundHeight, groups: Sequence[Float64Array]) -> list[Float64Array]:
    """Ask for the ground at groups of positions, all at once; heights are rounded to 1/1024 m.

    Raises
    ------
    InputError
        If `ground` returns something of another shape, or not finite.
    """
    at = np.concatenate(groups)
    heights = np.asarray(ground(at[:, 0].copy(), at[:, 1].copy()), dtype=np.float64)
    if heights.shape != (len(at),) or not np.isfinite(heights).all():
        raise InputError(f"expected {len(at)} finite ground heights, got shape {heights.shape} or not finite")
    return np.split(rounded(heights), np.cumsum([len(group) for group in groups])[:-1])


def _settings(sketch: Sketch, seed: int) -> tuple[object, ...]:
    """Everything but pixels that courses depend on."""
    labels = tuple((key, tuple(each.items())) for key, each in sketch.labels.items() if key[0] == "river")
    return sketch.extent, sketch.height_px, sketch.width_px, sketch.fidelity, seed, labels


def _networks(
    sketch: Sketch, seed: int, memory: HydrologyCache
) -> tuple[tuple[Skeleton, ...], list[RiverCourse | tuple[RiverEnd, ...]]]:
    """Find the skeletons of what was painted, and of each the dab's course or the ends."""
    image, settings = sketch.layers["river"], _settings(sketch, seed)
    found: tuple[Skeleton, ...] = memory.images.of(
        ("skeletons", IdentityKey(image), settings), lambda: _skeletons(sketch, settings, memory)
    )
    return found, [
        memory.parts.of(
            ("outline", IdentityKey(each), settings, _seen_around(sketch, each)),
            partial(_dab_or_ends, sketch, each, seed),
        )
        for each in found
    ]


def _seen_around(sketch: Sketch, skeleton: Skeleton) -> IdentityKey | None:
    """Return what of the layer beside a skeleton matters: all, if its width is as painted; else nothing."""
    image = sketch.layers["river"]
    labels = np.unique(image[skeleton.rows, skeleton.columns])
    as_painted = any(sketch.properties("river", int(label))["width"] == 0.0 for label in labels)
    return IdentityKey(image) if as_painted else None


def _skeletons(sketch: Sketch, settings: tuple[object, ...], memory: HydrologyCache) -> tuple[Skeleton, ...]:
    image = sketch.layers["river"]
    widths = _label_widths(sketch)

    def made(region: Region) -> Skeleton:
        window = np.where(region.mask, image[region.rows, region.columns], 0)
        corner = (region.rows.start, region.columns.start, window.shape)
        return memory.parts.of(
            ("skeleton", corner, blake2b(window.tobytes()).digest(), settings),
            lambda: _weighted(sketch, thin_region(region, widths[window], image.shape)),
        )

    return sort_skeletons(made(region) for region in find_regions((image > 0).astype(np.uint8)))


def _weighted(sketch: Sketch, skeleton: Skeleton) -> Skeleton:
    """Let what is as wide as painted weigh by how wide it is."""
    painted = 2.0 * skeleton.depth * sketch.pixel_size
    return replace(skeleton, weight=np.where(skeleton.weight > 0, skeleton.weight, painted))


def _label_widths(sketch: Sketch) -> Float64Array:
    """Width (m) that each label says: wider rivers are main stems; 0 is as painted."""
    widths = np.ones(256)
    for label in np.unique(sketch.layers["river"]):
        if label > 0:
            widths[label] = sketch.properties("river", int(label))["width"]
    return widths


def _dab_or_ends(sketch: Sketch, skeleton: Skeleton, seed: int) -> RiverCourse | tuple[RiverEnd, ...]:
    path = longest_path(skeleton)
    steps = np.hypot(np.diff(skeleton.rows[path]), np.diff(skeleton.columns[path]))
    if float(steps.sum()) <= max(2.0 * float(skeleton.depth[path].max()), _LONGEST_DAB):
        return dab_course(sketch, skeleton, path, seed=seed)
    return river_ends(skeleton)


def _end_positions(
    sketch: Sketch, skeleton: Skeleton, outline: RiverCourse | tuple[RiverEnd, ...]
) -> Float64Array:
    if isinstance(outline, RiverCourse):
        return outline.line[[0, -1]]
    return pixel_positions(sketch, skeleton, np.array([end.pixel for end in outline]))


def _mouth(
    sketch: Sketch,
    skeleton: Skeleton,
    ends: tuple[RiverEnd, ...],
    heights: Float64Array,
    lake: cKDTree | None,
) -> int:
    """Choose the end farthest along the label's flow; or the lowest, rather in a lake or at the edge."""
    flow = _flow(sketch, skeleton)
    at = np.array([end.pixel for end in ends])
    if flow is not None:
        return ends[int(np.argmax(pixel_positions(sketch, skeleton, at) @ flow))].pixel
    length = max(end.length for end in ends) * sketch.pixel_size
    bonus = _EDGE_BONUS[0] + _EDGE_BONUS[1] * length
    size = (sketch.height_px, sketch.width_px)
    favoured = np.array([exit_normal(skeleton, end.lead, size) is not None for end in ends])
    if lake is not None:
        places = np.stack([skeleton.rows[at], skeleton.columns[at]], axis=-1)
        favoured |= lake.query(places)[0] <= skeleton.depth[at] + LAKE_GAP
    return ends[int(np.argmin(heights - bonus * favoured))].pixel


def _flow(sketch: Sketch, skeleton: Skeleton) -> Float64Array | None:
    """Direction (east, north) in which the label of most of a network says it runs; None: downhill."""
    labels = sketch.layers["river"][skeleton.rows, skeleton.columns]
    said = float(sketch.properties("river", int(np.argmax(np.bincount(labels))))["flow"])
    towards = np.deg2rad(said)
    return None if said < 0.0 else np.array([np.sin(towards), np.cos(towards)])


def _courses(
    sketch: Sketch,
    skeleton: Skeleton,
    outline: RiverCourse | tuple[RiverEnd, ...],
    heights: Float64Array,
    seed: int,
    lake: cKDTree | None,
    memory: HydrologyCache,
) -> list[RiverCourse]:
    """Lay out one network, parents first."""
    key = (IdentityKey(skeleton), _settings(sketch, seed))
    if isinstance(outline, RiverCourse):
        dab = outline
        if heights[0] >= heights[1]:
            return [dab]
        return [memory.parts.of(("turned", *key), lambda: reversed_course(dab))]
    mouth = _mouth(sketch, skeleton, outline, heights, lake)

    def made() -> list[RiverCourse]:
        courses: list[RiverCourse] = []
        for reach in split_into_reaches(skeleton, mouth):
            parent = courses[reach.parent] if reach.parent >= 0 else None
            courses.append(reach_course(sketch, skeleton, reach, parent, seed=seed, lake=lake))
        return courses

    return memory.parts.of(("courses", *key, mouth, IdentityKey(lake), _seen_around(sketch, skeleton)), made)
