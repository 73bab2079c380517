"""Random sketches, each a function of its number: shapes of every kind that people, or accidents, paint."""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import pytest

from sketchterrain.sketch.document import Sketch
from sketchterrain.sketch.parameters import DENSITY, LAYERS, Parameter

COUNT = 300

Rng = np.random.Generator
Image = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]
Path = list[tuple[float, float]]

AREAS = tuple(name for name in LAYERS if name != "river")


def distances(size: tuple[int, int], row: float, column: float) -> tuple[np.ndarray, np.ndarray]:
    down, across = np.ogrid[: size[0], : size[1]]
    return down - row, across - column


def somewhere(rng: Rng, size: tuple[int, int]) -> tuple[float, float]:
    """A place, a little beyond the edges too."""
    return tuple(rng.uniform(-0.1, 1.1, 2) * size)


def blob(rng: Rng, size: tuple[int, int]) -> Mask:
    down, across = distances(size, *somewhere(rng, size))
    angle = np.arctan2(down, across)
    radius = rng.uniform(0.05, 0.35) * min(size)
    outline = 1.0 + sum(0.3 / k * np.cos(k * angle + rng.uniform(0, 6.3)) for k in range(2, 6))
    return np.hypot(down, across) <= np.maximum(radius * outline, 0.5)


def ring(rng: Rng, size: tuple[int, int]) -> Mask:
    distance = np.hypot(*distances(size, *(rng.uniform(0.3, 0.7, 2) * size)))
    radius = rng.uniform(0.15, 0.4) * min(size)
    return np.abs(distance - radius) <= rng.uniform(0.5, 0.2 * radius + 0.5)


def cross(rng: Rng, size: tuple[int, int]) -> Mask:
    down, across = distances(size, *(rng.uniform(0.2, 0.8, 2) * size))
    turn, arm = rng.uniform(0, math.pi), rng.uniform(0.1, 0.5) * min(size)
    u = down * math.cos(turn) + across * math.sin(turn)
    v = across * math.cos(turn) - down * math.sin(turn)
    thick = rng.uniform(0.5, 0.3 * arm + 0.5)
    return ((np.abs(u) <= thick) & (np.abs(v) <= arm)) | ((np.abs(v) <= thick) & (np.abs(u) <= arm))


def sliver(rng: Rng, size: tuple[int, int]) -> Mask:
    mask = np.zeros(size, np.bool_)
    stroke(mask, [somewhere(rng, size), somewhere(rng, size)], rng.choice([0.5, 0.7, 1.0, 1.6]))
    return mask


def pixels(rng: Rng, size: tuple[int, int]) -> Mask:
    mask = np.zeros(size, np.bool_)
    mask.flat[rng.integers(0, mask.size, int(rng.integers(1, 12)))] = True
    return mask


def corners(rng: Rng, size: tuple[int, int]) -> Mask:
    """Single pixels in the corners and along the edge."""
    mask = np.zeros(size, np.bool_)
    for row in (0, -1):
        mask[row, [0, -1, int(rng.integers(size[1]))]] = True
    return mask


def canvas(rng: Rng, size: tuple[int, int]) -> Mask:
    mask = np.ones(size, np.bool_)
    if rng.random() < 0.5:  # but for some pinholes
        mask.flat[rng.integers(0, mask.size, 5)] = False
    return mask


def tiny(rng: Rng, size: tuple[int, int], *, count: int = 500) -> Mask:
    """500 shapes of one to six pixels, as far as they find room apart from each other."""
    rows, columns = (np.arange(1, side - 2, 4) for side in size)
    at = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1).reshape(-1, 2)
    mask = np.zeros(size, np.bool_)
    for row, column in at[rng.permutation(len(at))[:count]]:
        mask[row : row + rng.integers(1, 3), column : column + rng.integers(1, 4)] = True
    return mask


def checkers(rng: Rng, size: tuple[int, int]) -> Mask:
    """Squares that touch at their corners, so that they are one shape."""
    side = int(rng.integers(1, 9))
    down, across = distances(size, 0, 0)
    return (down // side + across // side) % 2 == 0


def stroke(mask: Mask, path: Path, radius: float) -> None:
    """Draw a polyline with a round brush."""
    for (row, column), (to_row, to_column) in pairwise(path):
        steps = 2 * math.ceil(math.hypot(to_row - row, to_column - column)) + 1
        for t in np.linspace(0, 1, steps):
            r, c = row + t * (to_row - row), column + t * (to_column - column)
            reach = math.ceil(radius)
            top, left = max(round(r) - reach, 0), max(round(c) - reach, 0)
            window = mask[top : round(r) + reach + 1, left : round(c) + reach + 1]
            down, across = np.ogrid[: window.shape[0], : window.shape[1]]
            window |= (down + top - round(r)) ** 2 + (across + left - round(c)) ** 2 <= radius**2


def wander(rng: Rng, size: tuple[int, int], start: tuple[float, float], heading: float, steps: int) -> Path:
    path, stride = [start], 0.06 * max(size)
    for _ in range(steps):
        heading += rng.uniform(-0.6, 0.6)
        row, column = path[-1]
        path.append((row + stride * math.sin(heading), column + stride * math.cos(heading)))
    return path


def brush(rng: Rng) -> float:
    return float(rng.choice([0.5, 1.0, 1.5, 3.0]))


def off_edge(rng: Rng, size: tuple[int, int]) -> Mask:
    mask = np.zeros(size, np.bool_)
    stroke(mask, wander(rng, size, (rng.uniform(0, size[0]), 0.0), 0.0, 24), brush(rng))
    return mask


def branching(rng: Rng, size: tuple[int, int]) -> Mask:
    mask, radius = np.zeros(size, np.bool_), brush(rng)
    stem = wander(rng, size, (0.5 * size[0], 0.1 * size[1]), 0.0, 14)
    stroke(mask, stem, radius)
    for _ in range(int(rng.integers(1, 5))):
        joint = stem[int(rng.integers(1, len(stem)))]
        side = rng.choice([-1.0, 1.0])
        stroke(mask, wander(rng, size, joint, math.pi + side * rng.uniform(0.5, 1.3), 7), radius)
    return mask


def looping(rng: Rng, size: tuple[int, int]) -> Mask:
    """A closed loop, with or without a river into it and out of it."""
    mask, radius = np.zeros(size, np.bool_), brush(rng)
    middle, reach = (0.5 * size[0], 0.5 * size[1]), rng.uniform(0.08, 0.3) * min(size)
    angles = np.linspace(0, 2 * math.pi, 24)
    stroke(mask, [(middle[0] + reach * math.sin(a), middle[1] + reach * math.cos(a)) for a in angles], radius)
    for side in (-1, 1)[: int(rng.integers(0, 3))]:
        edge = (rng.uniform(0, size[0]), 0.0 if side < 0 else size[1])
        stroke(mask, [(middle[0], middle[1] + side * reach), edge], radius)
    return mask


def touching_itself(rng: Rng, size: tuple[int, int]) -> Mask:
    """A meander so tight that its bends touch, or a figure of eight."""
    mask, t = np.zeros(size, np.bool_), np.linspace(0, 1, 160)
    if rng.random() < 0.5:
        row, column = 0.5 + 0.3 * np.sin(4 * math.pi * t), 0.5 + 0.4 * np.sin(2 * math.pi * t)
    else:
        row, column = 0.5 + 0.35 * np.sin(18 * math.pi * t), 0.05 + 0.9 * t + 0.04 * np.sin(36 * math.pi * t)
    stroke(mask, list(zip(row * size[0], column * size[1], strict=True)), brush(rng))
    return mask


def dabs(rng: Rng, size: tuple[int, int]) -> Mask:
    """Fewer than 500: every water is traced on the ground."""
    return tiny(rng, size, count=60)


def flooded(rng: Rng, size: tuple[int, int]) -> Mask:
    """Somebody used the bucket."""
    return canvas(rng, size) if rng.random() < 0.2 else blob(rng, size)


AREA_KINDS: tuple[Callable[[Rng, tuple[int, int]], Mask], ...] = (
    *(blob, ring, cross, sliver, pixels, corners, canvas, tiny, checkers),
)
RIVER_KINDS: tuple[Callable[[Rng, tuple[int, int]], Mask], ...] = (
    *(branching, looping, touching_itself, off_edge, flooded, sliver, pixels, dabs),
)
KINDS = len(AREA_KINDS) + len(RIVER_KINDS) + 1


def random_sketch(number: int) -> Sketch:
    """Sketch `number`: its main kind goes through all there are, the rest is thrown."""
    rng = np.random.default_rng([20261121, number])
    size = random_size(rng, number)
    layers = {name: np.zeros(size, np.uint8) for name in LAYERS}
    main = number % KINDS
    if main < len(AREA_KINDS):
        for name in rng.choice(AREAS, int(rng.integers(1, 4)), replace=False):
            kind = dabs if name == "lake" and AREA_KINDS[main] is tiny else AREA_KINDS[main]
            paint(rng, layers[name], kind, times=int(kind in (tiny, dabs)))
    elif main < KINDS - 1:
        kind = RIVER_KINDS[main - len(AREA_KINDS)]
        paint(rng, layers["river"], kind, times=int(kind is dabs))
    else:  # a river across mountains
        paint(rng, layers["mountain"], blob, times=3)
        paint(rng, layers["river"], off_edge)
    for _ in range(int(rng.integers(0, 4))):
        name = str(rng.choice(list(LAYERS)))
        kinds = RIVER_KINDS[:4] if name == "river" else AREA_KINDS[:6]
        paint(rng, layers[name], kinds[int(rng.integers(len(kinds)))])
    return Sketch(
        extent=random_extent(rng, layers),
        seed=int(rng.integers(2**63)),
        fidelity=float(rng.choice([0.0, 0.4, 0.8, 0.8, 1.0])),
        density={name: float(rng.choice([0.0, 0.0, 0.3])) for name in DENSITY},
        layers=layers,
        labels={
            (name, int(label)): random_properties(rng, name)
            for name, image in layers.items()
            for label in np.unique(image[image > 0])
            if rng.random() < 0.6
        },
    )


def random_extent(rng: Rng, layers: dict[str, Image]) -> float:
    """Metres. Rivers are drawn in steps of metres, so that hundreds of kilometres of them take minutes."""
    extent = float(rng.choice([50.0, 1000.0, 4096.0, 12000.0, 3e5]))
    return min(extent, 4096.0) if layers["river"].any() else extent


def random_size(rng: Rng, number: int) -> tuple[int, int]:
    if number % 50 == 49:
        return 512, 512
    longer = int(rng.integers(64, 193))
    shorter = longer if rng.random() < 0.5 else int(rng.integers(1 + longer // 12, longer + 1))
    return (longer, shorter) if rng.random() < 0.5 else (shorter, longer)


def paint(rng: Rng, image: Image, kind: Callable[[Rng, tuple[int, int]], Mask], *, times: int = 0) -> None:
    for _ in range(times or int(rng.integers(1, 4))):
        image[kind(rng, image.shape)] = rng.choice([1, 1, 2, 3, 255])


def random_properties(rng: Rng, name: str) -> dict[str, object]:
    return {key: random_value(rng, parameter) for key, parameter in LAYERS[name].parameters.items()}


def random_value(rng: Rng, parameter: Parameter) -> object:
    """The default, either end of what is allowed, or anything between."""
    if parameter.choices:
        return str(rng.choice(parameter.choices))
    low, high = float(parameter.low), float(parameter.high)
    between = low + (high - low) * rng.random() ** 4
    value = rng.choice([float(parameter.default), float(parameter.default), low, high, between])
    return int(value) if parameter.kind is int else float(value)


@pytest.fixture(scope="session")
def sketch_of() -> Callable[[int], Sketch]:
    return random_sketch
