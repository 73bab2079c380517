"""Layout of rivers from vectors: mouths of their networks, and painted rivers that join them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image, ImageDraw
from scipy.spatial import cKDTree

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array
from sketchterrain.caching import IdentityKey, LRUCache
from sketchterrain.document.label_layers import LabelImage, freeze_image, labels_in
from sketchterrain.document.vectors import AREA, VectorLayer
from sketchterrain.hydrology.courses import LAKE_GAP, RiverCourse, part_of_course
from sketchterrain.hydrology.lakes import GroundHeight
from sketchterrain.hydrology.layout import (
    best_mouth,
    heights_at,
    lay_out_rivers,
    ring_around,
    river_settings,
)
from sketchterrain.hydrology.vector_rivers import (
    LineNetwork,
    areas_with_axes,
    line_networks,
    line_path,
    line_sizes,
    network_courses,
)

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch


def lay_out_lines(sketch: Sketch, *, seed: int, ground: GroundHeight, cache: LRUCache) -> list[RiverCourse]:
    """Return the courses of lines, parents first; unchanged ones are the identical objects.

    A network of lines without a direction flows to one end, as a painted one does.
    """
    layer, settings = sketch.vectors["river"], river_settings(sketch, seed)
    if not len(layer):
        return []
    networks: list[LineNetwork] = cache.get_or_compute(
        ("line networks", IdentityKey(layer), settings), lambda: line_networks(layer, line_sizes(sketch)[0])
    )
    mouths = [network.mouths() for network in networks]
    free = [number for number, nodes in enumerate(mouths) if not len(nodes)]
    if free:
        ends = [networks[number].at[networks[number].ends()] for number in free]
        found = heights_at(ground, [*ends, *(ring_around(sketch, at) for at in ends)])
        flows = sketch.vector_values("river", "flow")
        for number, at, heights, near in zip(free, ends, found, found[len(ends) :], strict=False):
            network = networks[number]
            size, gap = np.array(sketch.size), LAKE_GAP * sketch.pixel_size
            is_edge: BoolArray = np.any((at <= gap) | (at >= size - gap), axis=1)
            means = near.reshape(len(heights), -1).mean(axis=1)
            flow = float(flows[network.line[0]])
            best = best_mouth(sketch, at, flow, heights, means, is_edge, float(network.lengths.sum()))
            mouths[number] = network.ends()[[best]]
    key = ("line courses", IdentityKey(layer), settings, *(nodes.tobytes() for nodes in mouths))
    courses: list[RiverCourse] = cache.get_or_compute(key, partial(_courses, sketch, networks, mouths, seed))
    return courses


def _courses(
    sketch: Sketch, networks: Sequence[LineNetwork], mouths: Sequence[Int64Array], seed: int
) -> list[RiverCourse]:
    import shapely

    layer, sizes, taken = sketch.vectors["river"], line_sizes(sketch), set[int]()
    areas = shapely.STRtree(layer.shapes()[layer.kinds == AREA])
    return [
        course
        for network, nodes in zip(networks, mouths, strict=True)
        for course in network_courses(sketch, network, nodes, sizes, areas, seed=seed, taken=taken)
    ]


def lay_out_painted(
    sketch: Sketch, drawn: Sequence[RiverCourse], *, seed: int, ground: GroundHeight, cache: LRUCache
) -> list[RiverCourse]:
    """Return the courses of painted networks, parents first; those that end at one of `drawn` join it."""
    lakes = with_vectors_painted(sketch, cache).layers["lake"]
    sketch = with_areas_painted(sketch, cache)
    if lakes is not sketch.layers["lake"]:
        sketch = sketch.replace(layers={**sketch.layers, "lake": lakes})
    if not drawn:
        return lay_out_rivers(sketch, seed=seed, ground=ground, cache=cache)
    key = ("drawn water", *map(IdentityKey, drawn), IdentityKey(sketch.layers["lake"]), sketch.extent)
    tree, owner, water = cache.get_or_compute(key, partial(_drawn_water, sketch, drawn))
    after: dict[int, RiverCourse] = {}
    for course in lay_out_rivers(sketch, seed=seed, ground=ground, cache=cache, water=water):
        new, parent = course, None if course.parent is None else after[id(course.parent)]
        if parent is None:
            compute = partial(_joined_to, course, drawn, tree, owner, sketch.pixel_size)
            new = cache.get_or_compute(("joined", IdentityKey(course), key), compute)
        elif parent is not course.parent:
            compute = partial(_with_parent, course, parent)
            new = cache.get_or_compute(("joined", IdentityKey(course), IdentityKey(parent)), compute)
        after[id(course)] = new
    return list(after.values())


def _with_parent(course: RiverCourse, parent: RiverCourse) -> RiverCourse:
    """Return a tributary of a shortened river: a river of its own if it joined what was cut off."""
    if course.joint < len(parent.line) - 1:
        return replace(course, parent=parent)
    return replace(course, parent=None, joint=-1)


def _drawn_water(sketch: Sketch, drawn: Sequence[RiverCourse]) -> tuple[cKDTree, Int64Array, cKDTree]:
    """Return a tree of the points (m) of courses, the course of each, and a tree of pixels with lakes."""
    line = np.concatenate([course.line for course in drawn])
    owner = np.repeat(np.arange(len(drawn)), [len(course.line) for course in drawn])
    x, y = line.T / sketch.pixel_size
    pixels = np.stack([sketch.height_px - y - 0.5, x - 0.5], axis=-1)
    return cKDTree(line), owner, cKDTree(np.concatenate([pixels, np.argwhere(sketch.layers["lake"] > 0)]))


def _joined_to(
    course: RiverCourse, drawn: Sequence[RiverCourse], tree: cKDTree, owner: Int64Array, pixel: float
) -> RiverCourse:
    """Return a course that ends at one of `drawn` as its tributary; others are returned as they are."""
    away, nearest = (np.asarray(each) for each in tree.query(course.line))
    reach = 0.5 * np.array([each.width.max() for each in drawn])[owner[nearest]] + LAKE_GAP * pixel
    beside = away <= reach
    first = len(beside) - int(np.argmin(beside[::-1])) if not beside.all() else 0  # of its last run there
    if not beside[-1] or first < 2:
        return course
    first += int(np.argmin(away[first:]))
    parent = drawn[int(owner[nearest[first]])]
    joint = int(nearest[first] - np.searchsorted(owner, owner[nearest[first]]))
    if joint < 1:
        return course
    own = part_of_course(course, 0, first)
    line = np.concatenate([own.line, parent.line[joint : joint + 1]])
    return replace(
        own,
        parent=parent,
        joint=joint,
        line=line,
        controls=np.append(own.controls[:-1], len(line) - 1),
        width=np.append(own.width, own.width[-1]),
        depth=np.append(own.depth, own.depth[-1]),
    )


def with_areas_painted(sketch: Sketch, cache: LRUCache) -> Sketch:
    """Return a sketch whose areas of rivers without an axis are painted, as wide as they are."""
    layer, image = sketch.vectors["river"], sketch.layers["river"]
    if not (layer.kinds == AREA).any():
        return sketch
    areas: BoolArray = cache.get_or_compute(
        ("areas without axes", IdentityKey(layer)), lambda: (layer.kinds == AREA) & ~areas_with_axes(layer)
    )
    if not areas.any():
        return sketch
    used = labels_in(image)
    label = next(number for number in range(255, 0, -1) if number not in used)
    painted: LabelImage = cache.get_or_compute(
        ("areas painted", IdentityKey(layer), IdentityKey(image), sketch.extent),
        lambda: _painted(sketch, "river", areas, label),
    )
    properties = {**sketch.properties("river", int(layer.labels[areas][0])), "width": 0.0}
    labels = {**sketch.labels, ("river", label): properties}
    return sketch.replace(layers={**sketch.layers, "river": painted}, labels=labels)


def with_vectors_painted(sketch: Sketch, cache: LRUCache) -> Sketch:
    """Return a sketch whose label layers also show its vectors; the same sketch if it has none."""
    painted = {
        name: cache.get_or_compute(
            (
                "vectors painted",
                IdentityKey(layer),
                IdentityKey(sketch.layers[name]),
                river_settings(sketch, 0),
            ),
            partial(_painted, sketch, name, np.ones(len(layer), np.bool_)),
        )
        for name, layer in sketch.vectors.items()
        if len(layer) and name in sketch.layers
    }
    return sketch.replace(layers={**sketch.layers, **painted}) if painted else sketch


def _painted(sketch: Sketch, name: str, selected: BoolArray, label: int | None = None) -> LabelImage:
    """Return a layer's image with vectors, at least a pixel wide, beneath its paint."""
    layer, pixel = sketch.vectors[name], sketch.pixel_size
    image = sketch.layers[name].copy()
    widths = line_sizes(sketch)[0] / pixel if name == "river" else np.zeros(len(layer))
    drawn = Image.fromarray(np.zeros(image.shape, np.uint8))
    draw = ImageDraw.Draw(drawn)
    for index in np.flatnonzero(selected).tolist():
        is_area = layer.kinds[index] == AREA
        for number, path in enumerate(_paths(layer, index)):
            at = np.stack([path[:, 0] / pixel - 0.5, image.shape[0] - path[:, 1] / pixel - 0.5], axis=-1)
            points = at.clip(-1e6, 1e6).ravel().tolist()
            if is_area:
                draw.polygon(points, fill=int(number == 0))
            else:
                draw.line(points, fill=1, width=max(round(float(widths[index])), 1))
    image[(np.asarray(drawn) > 0) & (image == 0)] = label or int(image.max()) or 1
    return freeze_image(image)


def _paths(layer: VectorLayer, index: int) -> list[Float64Array]:
    if layer.kinds[index] == AREA:
        return [layer.ring(number) for number in range(*layer.parts[index : index + 2])]
    return [line_path(layer, index)]
