"""Oracles of terrain tiles: vertex shader in NumPy, packed vertices, pictures and their holes."""

from collections import deque
from dataclasses import dataclass
from functools import cache
from types import SimpleNamespace

import moderngl
import numpy as np

from sketchterrain.geometry.camera import Camera, clip_planes, direction
from sketchterrain.geometry.lattice import LATTICE_BITS, metres_per_unit
from sketchterrain.io.resources import source
from sketchterrain.render.programs import FRAME_BINDING
from sketchterrain.render.targets import FrameBlock
from sketchterrain.schema.materials import BUILT_IN, weight_words
from sketchterrain.terrain.surfaces import FACTS, vertex_dtype
from sketchterrain.tiles.lod import morph_weights
from sketchterrain.tiles.quadtree import tile_indices

QUADS = 64
SIDE = QUADS + 1
VERTEX = vertex_dtype(len(BUILT_IN))
WORDS = weight_words(len(BUILT_IN))
HEADER = f"#version 430 core\n#define TILE_QUADS {QUADS}\n#define WEIGHT_WORDS {WORDS}\n"
TILE_BYTES = SIDE * SIDE * VERTEX.itemsize


@dataclass
class Draws:
    slots: np.ndarray
    corners: np.ndarray
    steps: np.ndarray
    cases: np.ndarray
    morph: np.ndarray

    @classmethod
    def of(cls, keys, *, cases=None, morph=None, slots=None):
        keys = np.asarray(keys, np.int64).reshape(-1, 3)
        width = 1 << (LATTICE_BITS - keys[:, 0])
        corners = np.stack([keys[:, 1] * width, (keys[:, 2] + 1) * width], axis=1)
        none = np.zeros(len(keys), np.int64)
        return cls(
            np.arange(len(keys)) if slots is None else np.asarray(slots),
            corners,
            width // QUADS,
            none if cases is None else np.asarray(cases, np.int64),
            np.zeros((len(keys), 3, 3), np.float32) if morph is None else np.asarray(morph, np.float32),
        )

    def part(self, tile):
        """One tile alone, whose vertices are the first of their buffer."""
        one = slice(tile, tile + 1)
        return Draws(
            np.zeros(1, np.int64), self.corners[one], self.steps[one], self.cases[one], self.morph[one]
        )


def neighbours(eye):
    """Four tiles of a level and a coarser one west of them, with random valid morphs."""
    rng, west = np.random.default_rng(5), 4
    x, y = (int(axis // 1000.0) for axis in eye[:2])
    keys = [(1, 2 * x, 2 * y)]
    keys += [(2, 4 * x + col, 4 * y + row) for col, row in ((2, 1), (3, 1), (2, 0), (3, 0))]
    grid = rng.uniform(0, 1, (5, 5)).astype(np.float32)  # shared control values
    grid[:, 0] = 1.0
    coarse = rng.uniform(0, 1, (3, 3)).astype(np.float32)
    coarse[:, 2] = 0.0
    morph = [coarse, grid[:3, :3], grid[:3, 2:], grid[2:, :3], grid[2:, 2:]]
    return keys, Draws.of(keys, cases=[0, west, 0, west, 0], morph=morph)


def packed(tile):
    vertices = np.zeros((SIDE, SIDE), VERTEX)
    vertices["height"] = tile.height
    vertices["slope"] = np.rint(tile.normal[..., :2] * 32767.0)
    vertices["weights"][..., : len(BUILT_IN)] = np.rint(tile.materials * 255.0)
    return vertices


def add_parent(vertices, key, parent):
    """Fill the parent's part of a tile from the vertices of its parent, None for a root."""
    for name in ("height", "slope", "weights"):
        if parent is None:
            vertices[f"parent_{name}"] = vertices[name]
            continue
        top, left = QUADS // 2 * (1 - key[2] % 2), QUADS // 2 * (key[1] % 2)
        part = parent[name][top : top + QUADS // 2 + 1, left : left + QUADS // 2 + 1]
        fine = part.astype(np.float32 if name == "height" else np.float64)
        whole = np.zeros((SIDE, SIDE, *fine.shape[2:]), fine.dtype)
        whole[::2, ::2] = fine
        whole[::2, 1::2] = 0.5 * (fine[:, :-1] + fine[:, 1:])
        whole[1::2, ::2] = 0.5 * (fine[:-1] + fine[1:])
        whole[1::2, 1::2] = 0.5 * (fine[:-1, :-1] + fine[1:, 1:])
        vertices[f"parent_{name}"] = whole if name == "height" else np.rint(whole)


def pack_tiles(terrain, keys):
    """Vertices of tiles, (n, SIDE, SIDE) of VERTEX, with their parents' part."""
    keys = [tuple(map(int, key)) for key in keys]
    above = [(level - 1, col >> 1, row >> 1) for level, col, row in keys]
    own, parents = terrain.tiles(keys), terrain.tiles(above)
    vertices = np.stack([packed(tile) for tile in own])
    for each, key, parent in zip(vertices, keys, parents, strict=True):
        add_parent(each, key, packed(parent))
    return vertices


class HostContext:
    """Compute context whose buffers are NumPy arrays."""

    gl = None
    device = SimpleNamespace(type="none", name="NumPy")

    def empty(self, shape, dtype):
        return np.zeros(shape, dtype)

    def download_into(self, buffer, array, *, start=0):
        array[...] = buffer[start : start + array.nbytes]


def write_tiles(terrain, keys, slots, parents, store):
    """`Terrain.write_tiles` in NumPy."""
    side = store.quads + 1
    vertices = store.buffer.view(VERTEX).reshape(-1, side, side)
    statistics = np.zeros(len(keys), FACTS)
    middle = (np.arange(0, store.quads, 2) + 0.5) / store.quads
    for key, slot, parent, entry in zip(keys, slots, parents, statistics, strict=True):
        level, col, row = key
        vertices[slot] = packed(terrain.tiles([key])[0])
        add_parent(vertices[slot], key, vertices[parent] if parent >= 0 else None)
        both = vertices[slot]["height"], vertices[slot]["parent_height"]
        entry["low"], entry["high"] = np.min(both), np.max(both)
        width = terrain.extent * 2.0**-level
        true = terrain.heights((col + middle) * width, ((row + 1 - middle) * width)[:, None])
        h = vertices[slot]["height"]
        entry["error"] = np.abs(0.5 * (h[:-1:2, :-1:2] + h[1::2, 1::2]) - true).max()
    store.release(np.asarray(slots))
    return statistics


def shaded(draws, vertices, extent, eye):
    """Output of the shader: positions (n, SIDE, SIDE, 3) float32, parent shares, slopes, weights."""
    unit = metres_per_unit(extent)
    eye_units = np.floor(np.asarray(eye[:2]) / unit)
    fraction = np.float32(np.asarray(eye[:2]) - eye_units * unit)
    along = np.arange(SIDE)
    step = draws.steps[:, None, None]
    corner = draws.corners - eye_units.astype(np.int64)
    places = np.empty((len(draws.slots), SIDE, SIDE, 3), np.float32)
    for axis, units in enumerate(
        (corner[:, 0, None, None] + along * step, corner[:, 1, None, None] - along[:, None] * step)
    ):
        assert np.abs(units).max() < 2**31
        places[..., axis] = units.astype(np.float32) * np.float32(unit) - fraction[axis]
    share = morph_weights(draws.morph, QUADS)
    mine = vertices[draws.slots]
    own = np.float32(1) - share
    places[..., 2] = (own * mine["height"] + share * mine["parent_height"]) - np.float32(eye[2])
    mixed = {
        name: own[..., None] * mine[name].astype(np.float32)
        + share[..., None] * mine[f"parent_{name}"].astype(np.float32)
        for name in ("slope", "weights")
    }
    return places, share, mixed["slope"], mixed["weights"]


@cache
def rims(quads=QUADS):
    """Return the directed border edges of a tile for each case: (k, 2) vertices."""
    indices, first, count = tile_indices(quads)
    found = []
    for start, many in zip(first, count, strict=True):
        triangles = indices[start : start + many].reshape(-1, 3).astype(np.int64)
        edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        code, back = edges[:, 0] << 32 | edges[:, 1], edges[:, 1] << 32 | edges[:, 0]
        assert len(np.unique(code)) == len(code)
        found.append(edges[~np.isin(code, back)])
    return found


def along_rims(draws, values):
    """Return values (n, SIDE, SIDE, k) at the ends of border edges: (edges, 2, k)."""
    flat = values.reshape(len(values), SIDE * SIDE, -1)
    return np.concatenate([flat[tile][rims()[case]] for tile, case in enumerate(draws.cases)])


def names_of(places):
    """Return an id for each position (..., 3) float32, equal for equal bits."""
    codes = np.ascontiguousarray(places).view(np.dtype((np.void, 12)))[..., 0]
    return np.unique(codes, return_inverse=True)[1].reshape(codes.shape).astype(np.int64)


def open_edges(draws, places):
    """Return edges (k, 2, 3) of drawn triangles without an opposite edge: only along the outer border."""
    edges = along_rims(draws, places)
    names = names_of(edges)
    assert (names[:, 0] != names[:, 1]).all()
    code, back = names[:, 0] << 32 | names[:, 1], names[:, 1] << 32 | names[:, 0]
    return edges[~np.isin(code, back)]


def beyond(draws, edges, extent, eye):
    """Return whether directed edges (k, 2, 3), m from the eye, have no drawn tile on their right."""
    unit = metres_per_unit(extent)
    start, end = edges[:, 0, :2].astype(np.float64), edges[:, 1, :2].astype(np.float64)
    direction = end - start
    outside = 0.5 * (start + end) + 1e-3 * np.stack([direction[:, 1], -direction[:, 0]], axis=1)
    low = draws.corners * unit - eye[:2]
    width = (draws.steps * QUADS * unit)[:, None]
    free = np.ones(len(edges), bool)
    for (west, north), (side,) in zip(low, width, strict=True):
        x, y = outside[:, 0] - west, north - outside[:, 1]
        free &= ~((x > 0) & (x < side) & (y > 0) & (y < side))
    return free


MAGENTA = (255, 0, 255)
LIT = """
in vec3 ground_normal;
out float light;
void main()
{
    light = 110.0 + 140.0 * max(dot(normalize(ground_normal), vec3(-0.5, 0.35, 0.79)), 0.0);
    vec3 clip = vec3(gl_FragCoord.xy / view_range.zw, gl_FragCoord.z) * 2.0 - 1.0;
    vec4 position = from_clip * vec4(clip, 1.0);
    light = mix(light, 255.0, smoothstep(0.75, 0.98, length(position.xy / position.w) / view_range.x));
}
"""
FINER = 4
"""Samples a pixel along each axis, against aliasing of tiny facets."""


class ShadedView:
    """Draws tiles lit from the side (up to 250) before a sky of 255, faded at the draw distance."""

    def __init__(self, gl, stream, size):
        self.gl, self.size = gl, size
        inner = (FINER * size[0], FINER * size[1])
        self.light = gl.texture(inner, 1, dtype="f4")
        self.target = gl.framebuffer([self.light], gl.depth_renderbuffer(inner))
        self.frame = FrameBlock(gl)
        macros = (("TILE_QUADS", stream.tiles.quads), ("WEIGHT_WORDS", WORDS))
        program = gl.program(
            vertex_shader=source("render/ground.vert.glsl", macros),
            fragment_shader=f"#version 430 core\n{source('render/frame.glsl')}{LIT}",
        )
        program["Frame"].binding = FRAME_BINDING
        self.pool = stream.tile_renderer
        self.array = stream.tile_renderer.vertex_array(program)

    def draw(self, camera, reach):
        to_clip = camera.to_clip(self.size[0] / self.size[1])
        self.frame["to_clip"], self.frame["from_clip"] = to_clip, np.linalg.inv(to_clip)
        self.frame["view_range"] = (reach, 0.0, *self.light.size)
        self.frame["eye"] = (0.0, 0.0, camera.eye[2])
        self.frame.upload()
        self.target.use()
        self.target.clear(255.0, depth=1.0)
        self.gl.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        self.pool.draw(self.array)
        self.gl.enable_only(moderngl.NOTHING)
        samples = np.frombuffer(self.light.read(), np.float32)
        width, height = self.size
        return samples.reshape(height, FINER, width, FINER).mean(axis=(1, 3), dtype=np.float64)


def change(before, after):
    """Return the change of each pixel beyond its 3 × 3 neighbourhood: edges may move by a pixel."""
    padded = np.pad(before, 1, mode="edge")
    height, width = before.shape
    near = [padded[i : i + height, j : j + width] for i in range(3) for j in range(3)]
    return np.maximum(np.maximum(np.min(near, axis=0) - after, after - np.max(near, axis=0)), 0.0)


def rays(camera, size):
    """Return the directions of pixel centres, (height, width, 3), row 0 at the bottom."""
    width, height = size
    half = np.tan(np.radians(camera.fov) / 2.0)
    x = ((np.arange(width) + 0.5) / width * 2.0 - 1.0) * half * width / height
    y = ((np.arange(height) + 0.5) / height * 2.0 - 1.0)[:, None] * half
    axes = camera.view()[:3, :3]
    return x[..., None] * axes[0] + y[..., None] * axes[1] - axes[2]


def must_be_covered(camera, size, reach, lowest):
    """Return whether pixel rays meet the plane below all terrain (`lowest` m) within reach."""
    direction = rays(camera, size)
    with np.errstate(divide="ignore"):
        far = (camera.eye[2] - lowest) / np.maximum(-direction[..., 2], 0.0)
    return far * np.hypot(direction[..., 0], direction[..., 1]) < reach


def holes(picture, camera, reach, lowest):
    """Return the number of magenta pixels of a picture (height, width, 4) that must be covered."""
    magenta = (picture[..., :3] == MAGENTA).all(axis=-1)
    return int(np.count_nonzero(magenta & must_be_covered(camera, picture.shape[1::-1], reach, lowest)))


class HoleView:
    """Draws tiles before magenta."""

    def __init__(self, gl, size):
        self.gl, self.size = gl, size
        self.texture = gl.texture(size, 4)
        self.target = gl.framebuffer([self.texture], gl.depth_renderbuffer(size))
        self.frame = FrameBlock(gl)

    def draw(self, stream, camera):
        self.frame["to_clip"] = camera.to_clip(self.size[0] / self.size[1])
        self.frame["eye"] = (0.0, 0.0, camera.eye[2])
        self.frame.upload()
        self.target.use()
        self.target.clear(1.0, 0.0, 1.0, 1.0, depth=1.0)
        self.gl.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        deque(stream.draw(camera.eye), maxlen=0)
        self.gl.enable_only(moderngl.NOTHING)
        return np.frombuffer(self.texture.read(), np.uint8).reshape(*self.size[::-1], 4)


def camera_towards(eye, ground, bearing, pitch, reach):
    near, far = clip_planes(eye[2] - ground, reach)
    return Camera(tuple(eye), tuple(np.add(eye, direction(bearing, pitch))), fov=50.0, near=near, far=far)
