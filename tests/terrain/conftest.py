from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.material_rules import DEFAULT_RULES
from sketchterrain.document.sketch import Sketch
from sketchterrain.elevation.base import BaseElevation, BaseGrid
from sketchterrain.elevation.build import build_patches
from sketchterrain.elevation.grids import ElevationGrid
from sketchterrain.elevation.selection import Patchwork
from sketchterrain.generation.stages import STAGES, with_network
from sketchterrain.generation.terrain import Terrain
from sketchterrain.geometry.lattice import to_lattice
from sketchterrain.io import resources
from sketchterrain.io.resources import Defines
from sketchterrain.landforms.base_ground import BaseGround
from sketchterrain.landforms.placement.feature_types import (
    FEATURE,
    FEATURE_TYPES,
    Cover,
    Lake,
    River,
    ShapeField,
)
from sketchterrain.landforms.placement.fill import Fill
from sketchterrain.landforms.placement.plateaus import Plateau, layer_top
from sketchterrain.landforms.placement.sea import Sea
from sketchterrain.landforms.unpainted import Nodes
from sketchterrain.schema.materials import BUILT_IN
from sketchterrain.stages.runner import Results, Runner
from sketchterrain.terrain.evaluator import Evaluator
from sketchterrain.terrain.layers import layer_stack
from sketchterrain.terrain.layers.layer import WorldSettings
from sketchterrain.terrain.layers.relief import ReliefLayer
from sketchterrain.terrain.materials import material_defines
from sketchterrain.terrain.noise import corner_table
from sketchterrain.terrain.recipe import TerrainRecipe
from tests import terrains
from tests.devices import DEVICES, NO_DEVICE

NO_FILL = Fill.from_sketch(Sketch(), np.zeros(0, FEATURE), seed=0)
"""Unpainted areas without features."""


@dataclass(frozen=True)
class Waves:
    """Nodes of an extent of 4096 m on waves of a height (m): high ones are rocky, low ones wet."""

    height: float = 40.0
    spacing: float = 16.0

    def window(
        self, level: int, column: int, row: int, rows: int, columns: int, *, painted: bool = True
    ) -> Nodes:
        del painted
        step = self.spacing * 2**level
        x = (column + np.arange(columns)) * step
        y = ((row + np.arange(rows)) * step)[:, None]
        wave = np.sin(x / 190 + 0.5 * np.sin(y / 310)) * np.cos(y / 230) + 0.2 * np.sin((x + y) / 47)
        rock, wet = (np.clip(each * (self.height > 0), 0, 1).astype(np.float32) for each in (wave, -wave))
        return Nodes(self.height * wave, rock, np.full((rows, columns), step * step, np.float32), wet)

    def prepare(self, *_: Any, **__: Any) -> None:
        pass


@dataclass(frozen=True)
class Cone(Waves):
    """A rocky cone of a height (m) and a radius in the middle of a plain."""

    radius: float = 500.0

    def window(
        self, level: int, column: int, row: int, rows: int, columns: int, *, painted: bool = True
    ) -> Nodes:
        nodes = super().window(level, column, row, rows, columns, painted=painted)
        x, y = (
            (first + np.arange(count)) * self.spacing * 2**level - 2000.0
            for first, count in ((column, columns), (row, rows))
        )
        share = np.maximum(1 - np.hypot(x, y[:, None]) / self.radius, 0.0)
        return nodes._replace(height=self.height * share, rock=(share > 0).astype(np.float32))


def tiers(names, quick, slow=(), soak=()):
    """Parametrise a test by cases of the default tier, and by others of later tiers."""
    later = [(case, pytest.mark.slow) for case in slow if case not in quick]
    later += [(case, pytest.mark.soak) for case in soak]
    one = isinstance(names, str)
    marked = [pytest.param(*([case] if one else case), marks=mark) for case, mark in later]
    return pytest.mark.parametrize(names, [*quick, *marked])


def half_sums(parent: np.ndarray) -> dict[tuple[int, int], np.ndarray]:
    """Return twice the values between a parent's vertices: along its edges and its north-west diagonals."""
    return {
        (0, 1): parent[:, :-1] + parent[:, 1:],
        (1, 0): parent[:-1] + parent[1:],
        (1, 1): parent[:-1, :-1] + parent[1:, 1:],
    }


@pytest.fixture
def calls(monkeypatch) -> list[str]:
    """Calls of OpenCL since the start, or since the list was cleared."""
    done, real = [], ComputeContext._call

    def counted(self, action, *given, **named):
        done.append(action)
        return real(self, action, *given, **named)

    monkeypatch.setattr(ComputeContext, "_call", counted)
    return done


def launches(calls: list[str]) -> list[str]:
    """Return the kernels launched."""
    return [call.removeprefix("launching ") for call in calls if call.startswith("launching")]


@pytest.fixture
def with_kernel(monkeypatch):
    """Return a function that adds a program: a kernel file and more source."""
    source = resources.source

    def add(name: str, base: str, kernel: str) -> None:
        macros = material_defines(BUILT_IN)

        def found(file: str, defines: Defines = ()) -> str:
            return source(base, macros) + kernel if file == name else source(file, defines)

        monkeypatch.setattr(resources, "source", found)

    return add


def assert_same(one, other, *, parents=False) -> None:
    """Assert that two tiles or rasters are bit-equal."""
    for name in ("height", "normal", "materials", *(("parent_height", "parent_normal") if parents else ())):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def heights_at(recipe: TerrainRecipe, context: ComputeContext, x: Any, y: Any, cell: float = 0.0) -> Any:
    """Return heights (m) at positions (m) that are broadcast together."""
    x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
    lattice = to_lattice(x.ravel(), recipe.extent), to_lattice(y.ravel(), recipe.extent)
    return Evaluator(recipe, context).points(*lattice, cell_size=cell)[0].reshape(x.shape)


def tile_vertices(level: int, key: tuple[int, int]) -> list[np.ndarray]:
    """Return lattice x and y of a tile's vertices."""
    side = (1 << 24) >> level
    step = np.arange(65) * (side >> 6)
    return [each.ravel() for each in np.meshgrid(key[0] * side + step, key[1] * side + step[::-1])]


def assert_tiles_meet(evaluator: Evaluator, level: int, keys: list[tuple[int, int]], again: Evaluator) -> Any:
    """Assert that borders of tiles are bit-equal, and that points and other launches have the same bits."""
    surface, bounds = evaluator.tiles(keys, level)
    number = {key: index for index, key in enumerate(keys)}
    for (column, row), index in number.items():
        beside = ((column + 1, row), np.s_[:, -1], np.s_[:, 0]), ((column, row + 1), np.s_[0], np.s_[-1])
        for other, mine, its in (each for each in beside if each[0] in number):
            for values in (surface.height, surface.normal, surface.materials):
                np.testing.assert_array_equal(values[index][mine], values[number[other]][its])
    for start in range(0, len(keys), 13):
        part, own = again.tiles(keys[start : start + 13][::-1], level)
        np.testing.assert_array_equal(part.ground[::-1], surface.ground[start : start + 13])
        np.testing.assert_array_equal(own[::-1], bounds[start : start + 13])
    for key in keys[::17]:
        height, _ = again.points(*tile_vertices(level, key), cell_size=again.recipe.extent / (64 << level))
        np.testing.assert_array_equal(height, surface.height[number[key]].ravel())
    return surface


def assert_bounds_hold(evaluator: Evaluator, level: int, keys: list[tuple[int, int]]) -> None:
    """Assert that what a tile's cell size omits is within its bound at all vertices."""
    surface, bounds = evaluator.tiles(keys, level)
    for key, own, bound in zip(keys, surface.height, bounds, strict=True):
        full, _ = evaluator.points(*tile_vertices(level, key), cell_size=0.0)
        assert np.abs(own.ravel() - full).max() <= bound + 1e-3, (level, key)


def assert_changed_within(
    areas: Any, evaluators: tuple[Evaluator, Evaluator, Evaluator], x: Any, y: Any, cell: float, wider: float
) -> None:
    """Assert that an updated evaluator equals a new one, and differs from the old one in areas (m) only."""
    updated, fresh, old = (each.points(x, y, cell_size=cell) for each in evaluators)
    at = np.stack([x, y], axis=-1) * evaluators[0].recipe.world.unit
    low, high = np.reshape(areas, (-1, 2, 2)).swapaxes(0, 1)
    inside = ((at[:, None] >= low - wider) & (at[:, None] <= high + wider)).all(axis=2).any(axis=1)
    for one, two, before in zip(updated, fresh, old, strict=True):
        np.testing.assert_array_equal(one, two)
        assert not ((one != before).reshape(len(x), -1).any(axis=1) & ~inside).any()


@pytest.fixture(scope="session", autouse=True)
def usable_device() -> None:
    if not DEVICES:
        pytest.skip(NO_DEVICE)


@pytest.fixture(scope="session")
def context() -> ComputeContext:
    return terrains.context()


@pytest.fixture(scope="session")
def double_context() -> ComputeContext:
    with_double = [device for device in DEVICES if device.has_double]
    if not with_double:
        pytest.skip("no device with 64-bit floats")
    return ComputeContext(with_double[0], real="double")


@pytest.fixture(scope="session")
def valley() -> Terrain:
    return terrains.preset("valley_river")


@pytest.fixture(scope="session")
def desert() -> Terrain:
    return terrains.preset("desert_mountains")


def feature(kind, x, y, radius, strength, **more) -> np.ndarray[Any, Any]:
    row = np.zeros(1, FEATURE)
    row["type"], row["x"], row["y"] = FEATURE_TYPES.index(kind), x, y
    row["radius"], row["strength"], row["painted"] = radius, strength, True
    for name, value in more.items():
        row[name] = value
    return row


def with_roads(sketch: Sketch, recipe: TerrainRecipe, results: Results | None = None) -> TerrainRecipe:
    run = Runner(results)
    surface = STAGES["surface"].function(recipe)
    return with_network(recipe, STAGES["roads"].function(sketch, surface, run), run)


def octave_arguments(context, octaves, corner, step_bits) -> tuple[object, ...]:
    """Return the octave arguments of a kernel for a patch whose south-west vertex is ``corner``, in steps."""
    corners = np.array([corner], np.int64) << step_bits
    scale, corner = octaves.scale.astype(context.real_dtype), corner_table(octaves, corners, step_bits)
    arrays = (octaves.form, octaves.offset, scale, corner)
    return (*(context.upload(each) for each in arrays), np.int32(len(octaves.form)))


def river_of(line: np.ndarray, width: float, *, every: int = 20, depth: float = 2.0) -> River:
    """Return a river of one width and depth whose control points are some of its centreline's."""
    ones = np.ones(len(line), np.float32)
    few, points = ones[::every], line[::every]
    return River(1, 1, points, width * few, depth * few, line, width * ones, depth * ones)


def straight_river(y: float = 2048.0, *, width: float = 20.0, fall: float = 0.004) -> River:
    """Return a river from west to east along a slightly waving line."""
    x = np.linspace(200, 3900, 300)
    return river_of(np.column_stack([x, y + 150 * np.sin(x / 400), 12 - fall * x]), width)


def round_field(x, y, radius, *, spacing=8.0, margin=80.0) -> ShapeField:
    """Return the distance field of a disc."""
    count = int(np.ceil((radius + margin) / spacing)) + 1
    step = np.arange(-count, count + 1) * spacing
    inside = radius - np.hypot(step, step[:, None])
    return ShapeField(x - count * spacing, y - count * spacing, spacing, inside.astype(np.float32))


def lake(x: float, y: float, radius: float, level: float, *, depth: float = 8.0, **more: float) -> Lake:
    """Return a round lake."""
    return Lake(1, 1, round_field(x, y, radius, **more), level, depth)


def winding_sea(x: float = 2048.0, y: float = 2048.0, *, level: float = 2.0, wave: float = 300.0) -> Sea:
    """Return a sea west of a winding coast, in a field of 4 km around a position."""
    spacing, count = 16.0, 256
    step = (np.arange(count) - 0.5 * (count - 1)) * spacing
    inside = wave * np.sin(step[:, None] / 500) - step
    coast = ShapeField(x + step[0], y + step[0], spacing, np.clip(inside, -500, 900).astype(np.float32))
    depth = replace(coast, inside=np.full(inside.shape, 30.0, np.float32))
    return Sea(level, beach=40.0, shelf=700.0, coast=coast, depth=depth)


def plateau(
    x: float, y: float, radius: float, height: float, *, cliffness=0.8, strata=0.6, foot=0.35
) -> Plateau:
    """Return a round plateau that stands on ground at 0."""
    thickness = 2.0 ** round(np.log2(height / 8.0))
    field = round_field(x, y, radius, margin=2.0 * height + radius)
    top = layer_top(height, thickness)
    return Plateau(1, 1, field, 0.0, top, height, cliffness, strata, foot, 0.25, thickness)


def cover(x: float, y: float, radius: float, material: int, strength: float = 1.0) -> Cover:
    """Return a round patch of one material."""
    return Cover(1, 1, round_field(x, y, radius), material, strength)


@pytest.fixture(scope="session")
def make_recipe() -> Callable[..., TerrainRecipe]:
    """Return a function that makes a 4096 m recipe of only the given features and rivers."""

    def make(*features, rivers=(), fidelity=0.8, resolutions=(), material_rules=DEFAULT_RULES, **changes):
        painted = np.concatenate([np.zeros(0, FEATURE), *features])
        painted["id"] = np.arange(painted.size)
        ground = changes.pop("ground", {"relief": 40.0})
        extent, seed = changes.pop("extent", 4096.0), changes.pop("seed", 5)
        climate = changes.pop("climate", {"snow_line": 600.0, "tree_line": 400.0, "aridity": 0.2})
        values: dict[str, Any] = {
            "relief": ReliefLayer(Waves(float(ground["relief"]), extent / 256)),
            "painted": painted,
            "fill": NO_FILL,
            "rivers": rivers,
            "valley_radii": tuple(np.full(len(river.centreline), 160.0) for river in rivers),
        }
        layers = layer_stack(extent=extent, **(values | changes))
        world = WorldSettings(extent, seed, fidelity)
        return TerrainRecipe(world, climate, layers, material_rules=material_rules, resolutions=resolutions)

    return make


CASES = {
    "noise": [],
    "hill": [feature("hill", 1500, 1700, 600, 120), feature("hill", 2100, 1800, 500, 90)],
    "mountain": [
        feature("mountain", 2000, 2000, 1200, 1000, peakiness=0.6),
        feature("mountain", 2900, 2300, 900, 700, peakiness=0.2),
    ],
    "eroded": [
        feature("mountain", 2000, 2000, 1200, 1000, peakiness=0.6, erosion=0.7),
        feature("mountain", 2900, 2300, 900, 700, peakiness=0.2, erosion=1.0),
        feature("hill", 900, 2900, 700, 200, erosion=0.6),
    ],
    "crest": [
        feature("mountain", 1700, 2000, 1300, 700, peakiness=0.6, erosion=0.5, painted=False, id=5),
        feature("mountain", 3000, 2600, 900, 500, peakiness=0.3, painted=False),
    ],
    "dune": [
        feature("dune", 2000, 2000, 1500, 18, wavelength=150, wind=250),
        feature("dune", 900, 3000, 700, 9, wavelength=90, wind=10),
    ],
    "forest": [feature("forest", 2500, 1200, 800, 0.8)],
    "river": [],
    "lake": [],
    "plateau": [],
    "sea": [feature("mountain", 2100, 2300, 900, 300), feature("forest", 2300, 1700, 500, 0.8)],
    "flood": [feature("hill", 2100, 2300, 900, 60)],
    "base": [feature("dune", 900, 3000, 700, 9, wavelength=90, wind=10)],
}


def base_of(*grids: ElevationGrid, margin: float = 500.0) -> BaseElevation:
    """Return the elevation data of some grids."""
    work = Patchwork({each.id: each for each in map(build_patches, grids)})
    parts = [BaseGrid(each.name, work.grids[each.id], False, ()) for each in grids]
    return BaseElevation(tuple(parts), work, work.rim_fade(margin, 48.0), margin, b"".join(work.grids), ())


def grid_of(step: float, count: int, west: float, south: float, turn: float) -> ElevationGrid:
    """Return a square grid of waves with a step (m), turned about its south-west corner."""
    a, d = step * np.cos(turn), step * np.sin(turn)
    row, column = np.indices((count, count))
    place = (a, d, west, d, -a, south + a * count)
    x, y = (place[3 * i] * column + place[3 * i + 1] * row + place[3 * i + 2] for i in (0, 1))
    height = 700.0 + 90.0 * np.sin(x / 170) * np.cos(y / 230) + 0.04 * x + 14.0 * np.sin((x - y) / 37)
    return ElevationGrid(height.astype(np.float32), place, 0.5, name=f"{step:.0f} m")


def small_base() -> BaseElevation:
    """Return data for 4096 m: waves of 30 m samples with a void, and a turned grid of 10 m in them."""
    wide = grid_of(30.0, 110, 100.0, 200.0, 0.0)
    wide.samples[40:60, 70:90] = np.nan
    return base_of(wide, grid_of(10.0, 120, 1200.0, 1100.0, 0.4))


SEAS = {"sea": winding_sea(), "flood": Sea(2.0, 40.0, 700.0, None, None)}
LAKES = (
    lake(1800, 1900, 420, 3.0),
    lake(2270, 2300, 150, 9.0, margin=60.0, spacing=5.0),
    lake(900, 700, 30, -4.0),
)


PLATEAUS = (
    plateau(1500, 1700, 700, 260.0),
    plateau(2600, 1500, 350, 180.0, cliffness=1.0, strata=1.0, foot=0.15),
    plateau(3000, 2900, 500, 90.0, cliffness=0.0, strata=0.0, foot=0.8),
    plateau(900, 3100, 60, 70.0),
)


@pytest.fixture(params=list(CASES))
def case(request, make_recipe) -> tuple[str, TerrainRecipe]:
    """One kind of feature alone."""
    name = request.param
    rivers = (straight_river(), straight_river(900, width=6)) if name == "river" else ()
    lakes = LAKES if name == "lake" else ()
    plateaus = PLATEAUS if name == "plateau" else ()
    changes: dict[str, Any] = {"sea": SEAS.get(name)}
    if name == "base":
        changes["relief"] = ReliefLayer(Waves(), base=BaseGround(small_base(), 16.0, Waves()))
    return name, make_recipe(*CASES[name], rivers=rivers, lakes=lakes, plateaus=plateaus, **changes)
