"""Layout of rivers from vectors: mouths of their networks, and painted rivers that join them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np
from PIL import Image, ImageDraw
from scipy.spatial import cKDTree

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array
from sketchterrain.document.label_layers import LabelImage, freeze_image, labels_in
from sketchterrain.features.table import AREA, FeatureTable
from sketchterrain.landforms.hydrology.courses import LAKE_GAP, RiverCourse, part_of_course
from sketchterrain.landforms.hydrology.lakes import WaterPixels
from sketchterrain.landforms.hydrology.layout import best_mouth, end_heights, lay_out_rivers
from sketchterrain.landforms.hydrology.vector_rivers import (
    LineNetwork,
    areas_without_axes,
    line_networks,
    line_path,
    line_sizes,
    network_courses,
)
from sketchterrain.landforms.placement.feature_types import GroundHeight
from sketchterrain.stages.parts import part_of
from sketchterrain.stages.runner import Runner

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch


_LINES: Final = ("vectors.river", "labels.river", "extent", "size", "fidelity")


def lay_out_lines(sketch: Sketch, *, seed: int, ground: GroundHeight, run: Runner) -> list[RiverCourse]:
    """Return the courses of lines, parents first.

    A network of lines without a direction flows to one end, as a painted one does.
    """
    layer = sketch.vectors["river"]
    if not len(layer):
        return []
    networks: list[LineNetwork] = run(line_networks, layer, line_sizes(sketch)[0])
    mouths = [network.mouths() for network in networks]
    free = [number for number, nodes in enumerate(mouths) if not len(nodes)]
    if free:
        ends = [networks[number].at[networks[number].ends()] for number in free]
        flows, size, gap = sketch.vector_values("river", "flow"), sketch.size, LAKE_GAP * sketch.pixel_size
        for number, at, heights in zip(free, ends, end_heights(sketch, ground, ends), strict=True):
            network = networks[number]
            is_edge: BoolArray = np.any((at <= gap) | (at >= np.array(size) - gap), axis=1)
            flow = float(flows[network.line[0]])
            best = best_mouth(sketch, at, flow, *heights, is_edge, float(network.lengths.sum()))
            mouths[number] = network.ends()[[best]]
    courses: list[RiverCourse] = run(_courses, part_of(sketch, *_LINES), networks, mouths, seed)
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
    sketch: Sketch, drawn: Sequence[RiverCourse], *, seed: int, ground: GroundHeight, run: Runner
) -> list[RiverCourse]:
    """Return the courses of painted networks, parents first; those that end at one of `drawn` join it."""
    lakes = part_of(sketch, "layers.lake", "vectors.lake", "extent", "size")
    sketch = with_areas_painted(sketch, run)
    sketch = sketch.replace(layers={**sketch.layers, **vectors_painted(lakes, run)})
    if not drawn:
        return lay_out_rivers(sketch, seed=seed, ground=ground, run=run)
    near = _DrawnCourses(tuple(drawn))
    water = run(_drawn_water, near, sketch.layers["lake"], sketch.pixel_size)
    after: dict[int, RiverCourse] = {}
    for course in lay_out_rivers(sketch, seed=seed, ground=ground, run=run, water=water):
        new = course
        if course.parent is None:
            new = run(_joined_to, course, near, sketch.pixel_size)
        elif (parent := after[course.parent.id]) is not course.parent:
            new = _with_parent(course, parent)
        after[course.id] = new
    return list(after.values())


@dataclass(frozen=True, eq=False)
class _DrawnCourses:
    """Courses of lines, with a tree of their points."""

    courses: tuple[RiverCourse, ...]

    @cached_property
    def line(self) -> Float64Array:
        return np.concatenate([course.line for course in self.courses])

    @cached_property
    def tree(self) -> cKDTree:
        return cKDTree(self.line)

    @cached_property
    def owner(self) -> Int64Array:
        return np.repeat(np.arange(len(self.courses)), [len(course.line) for course in self.courses])


def _with_parent(course: RiverCourse, parent: RiverCourse) -> RiverCourse:
    """Return a tributary of a shortened river: a river of its own if it joined what was cut off."""
    if course.joint < len(parent.line) - 1:
        return replace(course, parent=parent)
    return replace(course, parent=None, joint=-1)


def _drawn_water(drawn: _DrawnCourses, lakes: LabelImage, pixel: float) -> WaterPixels:
    """Return the pixels with lakes, and those of the points of courses."""
    x, y = drawn.line.T / pixel
    at = np.stack([len(lakes) - y - 0.5, x - 0.5], axis=-1)
    return WaterPixels(np.concatenate([at, np.argwhere(lakes > 0)]))


def _joined_to(course: RiverCourse, near: _DrawnCourses, pixel: float) -> RiverCourse:
    """Return a course that ends at a drawn one as its tributary; others are returned as they are."""
    drawn, tree, owner = near.courses, near.tree, near.owner
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


def with_areas_painted(sketch: Sketch, run: Runner) -> Sketch:
    """Return a sketch whose areas of rivers without an axis are painted, as wide as they are."""
    layer = sketch.vectors["river"]
    if not (layer.kinds == AREA).any():
        return sketch
    areas: BoolArray = run(areas_without_axes, layer)
    if not areas.any():
        return sketch
    used = labels_in(sketch.layers["river"])
    label = next(number for number in range(255, 0, -1) if number not in used)
    part = part_of(sketch, "layers.river", "vectors.river", "labels.river", "extent", "size")
    painted: LabelImage = run(_painted, part, "river", areas, label)
    properties = {**sketch.properties("river", int(layer.labels[areas][0])), "width": 0.0}
    labels = {**sketch.labels, ("river", label): properties}
    return sketch.replace(layers={**sketch.layers, "river": painted}, labels=labels)


def vectors_painted(sketch: Sketch, run: Runner) -> dict[str, LabelImage]:
    """Return the label layers with their vectors, by name."""
    return {
        name: run(_painted, part_of(sketch, f"layers.{name}", f"vectors.{name}", *_sizes(name)), name)
        if name in sketch.vectors and len(sketch.vectors[name])
        else image
        for name, image in sketch.layers.items()
    }


def _sizes(name: str) -> tuple[str, ...]:
    return ("extent", "size", "labels.river") if name == "river" else ("extent", "size")


def _painted(sketch: Sketch, name: str, selected: BoolArray | None = None, label: int = 0) -> LabelImage:
    """Return a layer's image with vectors, at least a pixel wide, beneath its paint."""
    layer, pixel = sketch.vectors[name], sketch.pixel_size
    image = sketch.layers[name].copy()
    widths = line_sizes(sketch)[0] / pixel if name == "river" else np.zeros(len(layer))
    drawn = Image.fromarray(np.zeros(image.shape, np.uint8))
    draw = ImageDraw.Draw(drawn)
    for index in np.arange(len(layer))[slice(None) if selected is None else selected].tolist():
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


def _paths(layer: FeatureTable, index: int) -> list[Float64Array]:
    if layer.kinds[index] == AREA:
        return [layer.ring(number) for number in range(*layer.parts[index : index + 2])]
    return [line_path(layer, index)]
