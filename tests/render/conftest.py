from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from sketchterrain.landforms.placement.feature_types import FEATURE
from sketchterrain.render.offscreen import read_picture
from sketchterrain.render.programs import ResourceCache
from sketchterrain.render.renderer import Renderer
from sketchterrain.roads.road_types import RoadNetwork
from sketchterrain.schema.layers import LAYERS
from sketchterrain.schema.materials import BUILT_IN
from sketchterrain.schema.parameters import GEOLOGY, defaults
from sketchterrain.terrain.surfaces import VertexStore
from sketchterrain.vegetation.plants import PLANT

from .ground_model import HostContext, write_tiles


@dataclass
class Surface:
    height: np.ndarray
    normal: np.ndarray
    materials: np.ndarray


class Waves:
    """Terrain of two long waves with a straight river at y = 500 and a row of trees."""

    context = HostContext()
    extent = 1000.0
    size = (1000.0, 1000.0)
    sketch = SimpleNamespace(
        climate={"aridity": 0.2},
        geology=defaults(GEOLOGY) | {"dip": 0.0},
        weather={},
        drapes=(),
        looks={},
        materials={},
        material_table=BUILT_IN,
    )

    def __init__(self, *, rivers=True, plants=True, sea_level=None):
        t = np.linspace(-200.0, 1200.0, 60)
        line = np.stack([t, np.full(60, 500.0), np.linspace(2.0, 0.0, 60)], axis=1)
        river = SimpleNamespace(
            id=LAYERS["river"].code << 48, centreline=line, centreline_width=np.full(60, 24.0, np.float32)
        )
        self.features = SimpleNamespace(
            points=np.zeros(0, FEATURE),
            rivers=(river,) if rivers else (),
            lakes=(),
            sea_level=sea_level,
            network=RoadNetwork(),
        )
        self.sea_level = sea_level
        self.plants = plants

    def heights(self, x, y, *, cell_size=0.0):
        x, y = np.asarray(x, float), np.asarray(y, float)
        hills = 30.0 * np.sin(x / 190.0) + 40.0 * np.cos(y / 260.0) + 35.0
        return (hills - 60.0 * np.exp(-(((y - 500.0) / 30.0) ** 2))).astype(np.float32)

    def tiles(self, keys):
        tiles = []
        for level, col, row in keys:
            width = self.extent * 2.0**-level
            x = (col + np.arange(65) / 64) * width
            y = (row + 1 - np.arange(65) / 64)[:, None] * width
            d = 0.01 * width
            dx = (self.heights(x + d, y) - self.heights(x - d, y)) / (2 * d)
            dy = (self.heights(x, y + d) - self.heights(x, y - d)) / (2 * d)
            normal = np.stack([-dx, -dy, np.ones_like(dx)], axis=-1)
            normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
            materials = np.zeros((65, 65, len(BUILT_IN)), np.float32)
            materials[..., 0], materials[..., 2] = 0.75, 0.25
            tiles.append(Surface(self.heights(x, y), normal.astype(np.float32), materials))
        return tiles

    def vertex_store(self, slots, *, quads=64, memory=None):
        return VertexStore(self.context, slots, len(BUILT_IN), quads=quads, memory=memory)

    def write_tiles(self, keys, slots, parents, store):
        return write_tiles(self, keys, slots, parents, store)

    def foliage(self, west, south, east, north):
        n = 40 if self.plants else 0
        plants = np.zeros(n, PLANT)
        plants["x"], plants["y"] = np.linspace(0.0, 1000.0, n), 300.0
        plants["z"] = self.heights(plants["x"], plants["y"])
        plants["scale"], plants["species"], plants["tint"] = 1.0, np.arange(n) % 5, 0.5
        inside = (plants["x"] >= west) & (plants["x"] < east) & (plants["y"] >= south) & (plants["y"] < north)
        return plants[inside]

    def foliage_steps(self, west, south, east, north):
        yield
        return self.foliage(west, south, east, north)


@pytest.fixture
def waves():
    return Waves()


class SharedTextures(ResourceCache):
    """Material textures and noise of the shared context; other resources are each renderer's own."""

    def __init__(self, shared):
        super().__init__()
        self._shared = shared

    def get_or_create(self, kind, key, create, *, close=None):
        if kind not in ("materials", "noise"):
            return super().get_or_create(kind, key, create, close=close)
        if (kind, key) not in self._shared:
            self._shared[kind, key] = create()
        return self._shared[kind, key]


@pytest.fixture(scope="session")
def loaded_textures():
    return {}


@pytest.fixture(scope="module")
def open_renderer(gl, loaded_textures):
    """Return a function that opens a renderer in the shared context; time stands still unless given."""

    def open_renderer(terrain, *, timer=lambda: 0.0, **options):
        gl.__enter__()
        renderer = Renderer(gl, terrain, resources=SharedTextures(loaded_textures), timer=timer, **options)
        renderer.stream._timer = timer
        return renderer

    return open_renderer


@pytest.fixture(scope="module")
def draw(gl, open_renderer):
    """Return a function that draws a still, as `render_picture` does, in the shared context."""

    def draw(terrain, camera, *, size, clock=0.0, **options):
        renderer = open_renderer(terrain, **options)
        texture = gl.texture(size, 4)
        renderer.prepare(camera, size)
        renderer.draw(camera, gl.framebuffer([texture]), clock=clock)
        return read_picture(texture).astype(int)

    return draw
