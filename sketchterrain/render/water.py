"""Water: waves; meshes, the sea's as a disc, others in chunks with levels of detail; rendering."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, cast

import moderngl
import numpy as np

from sketchterrain.caching import LRUCache
from sketchterrain.look.objects import ACROSS, SEA, quads, terrain_objects
from sketchterrain.render.programs import build_program, mipmapped, set_uniforms
from sketchterrain.render.targets import bands
from sketchterrain.render.vertex_memory import COMMAND
from sketchterrain.tiles.lod import inside_frustum

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    import numpy.typing as npt

    from sketchterrain.array_types import Float32Array, Float64Array, StructuredArray
    from sketchterrain.geometry.camera import Camera
    from sketchterrain.look.objects import WaterSurface
    from sketchterrain.render.targets import RenderTargets
    from sketchterrain.terrain.surfaces import TerrainFeatures


SIZE: Final = 256  # texels along a side of the texture
BAND: Final = (3.0, 56.0)  # longest and shortest waves, per side
LAYERS: Final = (
    (8.0, -0.42, 0.40, 0.32),
    (2.3, 0.55, 0.28, 0.26),
    (31.0, 0.16, 0.32, 0.31),
    (173.0, -0.23, 0.0, 0.11),
)
"""Side (m), rotation against the wind (rad) and shares of slope² inland and at sea of each layer."""
GRAVITY: Final = 9.81  # m/s²
TYPICAL: Final = 7.0  # waves per side whose phase speed a layer drifts at


def wave_slopes() -> Float64Array:
    """Return (SIZE, SIZE, 3) slopes along x and y and height in sides of a wave field on a torus.

    Waves in a wide band have the same slope² an octave, as short gravity waves have (Phillips 1958), and
    spread about the wind (x) by cos² (Mitsuyasu 1975), with an isotropic part. Mean 0, mean slope² 1.
    """
    rng, cycles = np.random.default_rng(1954), np.fft.fftfreq(SIZE, 1 / SIZE)
    across, along = np.meshgrid(cycles, cycles)
    waves = np.hypot(across, along)
    waves[0, 0] = 1.0
    low, high = BAND
    fade = 1.0 / (1.0 + (low / waves) ** 8) / (1.0 + (waves / high) ** 8)
    spread = 0.3 + 0.7 * (across / waves) ** 2
    amplitude = np.sqrt(fade * spread) / waves**2
    amplitude[0, 0] = 0.0
    spectrum = np.fft.fft2(rng.standard_normal((SIZE, SIZE))) * amplitude
    height, east, north = (
        np.fft.ifft2(spectrum * factor).real for factor in (1.0, 2j * np.pi * across, 2j * np.pi * along)
    )
    field = np.stack([east, north, height], axis=-1)
    return np.asarray(field / np.sqrt(np.mean(east**2 + north**2)))


def wave_mipmaps(slopes: Float64Array) -> list[Float32Array]:
    """Return (n, n, 4) levels of `wave_slopes`: both slopes, their squared length, the height."""
    level = np.concatenate(
        [slopes[..., :2], (slopes[..., :2] ** 2).sum(-1, keepdims=True), slopes[..., 2:]], -1
    )
    levels = [level.astype(np.float32)]
    while len(level) > 1:
        level = 0.25 * (level[::2, ::2] + level[1::2, ::2] + level[::2, 1::2] + level[1::2, 1::2])
        levels.append(level.astype(np.float32))
    return levels


def wave_texture(context: moderngl.Context) -> moderngl.Texture:
    """Upload `wave_mipmaps` as a repeating RGBA16F texture."""
    levels = wave_mipmaps(wave_slopes())
    texture = mipmapped(context.texture((SIZE, SIZE), 4, dtype="f2"))
    for number, level in enumerate(levels):
        texture.write(level.astype(np.float16).tobytes(), level=number)
    return texture


def wave_layers(wind: tuple[float, float], count: int = len(LAYERS)) -> Float64Array:
    """Return (count, 4): the texture's x axis over its side (1/m), √ of the shares of slope².

    Only the direction of the wind (m/s, east and north) counts.
    """
    heading = np.arctan2(wind[1], wind[0])
    side, turn, *shares = np.array(LAYERS[:count]).T
    angle = heading + turn
    roots = [np.sqrt(share / share.sum()) for share in shares]
    return np.stack([np.cos(angle) / side, np.sin(angle) / side, *roots], axis=-1)


def wave_phases(layers: Float64Array, eye: tuple[float, float, float], clock: float) -> Float64Array:
    """Return the eye's (n, 2) position in each layer, in [0, 1), at a time (s): waves run downwind."""
    x, y = layers[:, 0], layers[:, 1]
    side = 1.0 / np.hypot(x, y)
    speed = np.sqrt(GRAVITY * side / TYPICAL / (2.0 * np.pi))
    drift = speed * clock / side
    return np.stack([x * eye[0] + y * eye[1] - drift, x * eye[1] - y * eye[0]], axis=-1) % 1.0


ATTRIBUTES: Final = ("3f4 4f4 2f4 4f4", "local_position", "flow_frame", "shore", "stream_params")
NEAREST_RING: Final = 1e-4  # radius of the innermost ring of the sea in draw distances
RINGS, SECTORS = 60, 96
STATIONS: Final = 32  # stations of a river along a chunk
LEVELS: Final = ((1, 1), (2, 2), (4, 4), (8, 4), (16, 4), (32, 4))
"""Vertices along and across from one drawn vertex to the next, by level of detail."""
LONGEST: Final = 0.25  # length of a quad in distances from the eye: attributes aren't linear in perspective


CHUNK: Final = np.dtype(
    [
        *(("low", "f8", 3), ("high", "f8", 3)),  # corners of its bounding box, m
        ("error", "f8", len(LEVELS)),  # largest deviation from the finest level, m
        ("length", "f8", len(LEVELS)),  # longest quad, m
        *(("first", "u4", len(LEVELS)), ("count", "u4", len(LEVELS))),  # range of the indices
    ]
)
"""A chunk of inland waters, with ranges of one index buffer by its levels of detail."""


def chunk_commands(
    chunks: StructuredArray, camera: Camera, aspect: float, tolerance: float
) -> StructuredArray:
    """Return draw commands of the chunks in view, deviating by `tolerance` m per metre of distance."""
    chunks = chunks[inside_frustum(camera.frustum(aspect), chunks["low"], chunks["high"])]
    outside = np.maximum(chunks["low"] - camera.eye, camera.eye - chunks["high"])
    away = np.linalg.norm(np.maximum(outside, 0.0), axis=1)[:, None]
    fits = (chunks["error"] <= tolerance * away) & (chunks["length"] <= LONGEST * away)
    level = np.logical_and.accumulate(fits[:, 1:], axis=1).sum(axis=1)
    commands = np.zeros(len(chunks), COMMAND)
    for name in ("first", "count"):
        commands[name] = chunks[name][np.arange(len(chunks)), level]
    commands["instances"] = 1
    return commands


_meshes = LRUCache(1)  # the last inland waters: stills have those of the moving picture


def inland_mesh(
    meshes: Sequence[WaterSurface],
) -> tuple[Float64Array, Float32Array, npt.NDArray[np.uint32], StructuredArray]:
    """Return the first vertex, vertices of `ATTRIBUTES` relative to it, indices, and their chunks."""
    anchor, vertices, indices, chunks = meshes[0].position[0].copy(), [], [], []
    base = first = 0
    for mesh in meshes:
        bank = np.full(len(mesh.position), max(-mesh.shore_distance.min(), 0.0))
        shore = np.column_stack([mesh.shore_distance, bank])
        vertices.append(np.column_stack([mesh.position - anchor, mesh.flow, shore, mesh.stream]))
        is_river = mesh.stream[0, 3] > 0.0
        chunks.append(_river_chunks(mesh) if is_river else _chunks(mesh.position[None]))
        for level, own in enumerate(_strip_indices(mesh) if is_river else [mesh.triangles[None]]):
            chunks[-1]["first"][:, level] = first + np.arange(len(own)) * own.shape[1]
            chunks[-1]["count"][:, level] = own.shape[1]
            indices.append((own + base).astype(np.uint32).ravel())
            first += own.size
        base += len(mesh.position)
    attributes = np.concatenate(vertices).astype(np.float32)
    return anchor, attributes, np.concatenate(indices), np.concatenate(chunks)


def _stations(mesh: WaterSurface) -> npt.NDArray[np.intp]:
    """Return the (chunks, STATIONS + 1) stations of a river; the last one is repeated."""
    last = len(mesh.position) // ACROSS - 1
    first = np.arange(0, last, STATIONS)
    return np.asarray(np.minimum(first[:, None] + np.arange(STATIONS + 1), last))


def _strip_indices(mesh: WaterSurface) -> list[npt.NDArray[np.uint32]]:
    """Return the (chunks, k) indices of a river by level of detail."""
    stations = _stations(mesh)
    vertices = (
        (stations[:, :, None] * ACROSS + np.arange(ACROSS)).astype(np.uint32).reshape(len(stations), -1)
    )
    places = np.arange((STATIONS + 1) * ACROSS, dtype=np.uint32).reshape(-1, ACROSS)
    return [vertices[:, quads(places[::along, ::across]).ravel()] for along, across in LEVELS]


def _river_chunks(mesh: WaterSurface) -> StructuredArray:
    """Return the chunks of a river without their indices."""
    stations = _stations(mesh)
    half = mesh.stream[:, 3]
    values = np.column_stack([mesh.position, mesh.shore_distance, mesh.stream[:, 2] * half])
    values = values.reshape(-1, ACROSS, 5)[stations]
    along = mesh.flow[::ACROSS, 1][stations]
    chunks = _chunks(values[..., :3].reshape(len(stations), -1, 3))
    for level, (step, _) in enumerate(LEVELS):
        chunks["length"][:, level] = np.diff(along[:, ::step], axis=1).max(axis=1)
        before = np.arange(STATIONS) // step * step
        start, end = along[:, before], along[:, before + step]
        share = (along[:, :-1] - start) / np.maximum(end - start, 1e-9)
        kept = values[:, before] + share[..., None, None] * (values[:, before + step] - values[:, before])
        chunks["error"][:, level] = np.linalg.norm(values[:, :-1] - kept, axis=-1).max(axis=(1, 2))
    return chunks


def _chunks(position: Float64Array) -> StructuredArray:
    """Return chunks of (n, k, 3) vertices (m) that have one level of detail, without indices."""
    chunks = np.zeros(len(position), CHUNK)
    chunks["low"], chunks["high"], chunks["error"] = position.min(axis=1), position.max(axis=1), np.inf
    return chunks


def sea_mesh() -> tuple[Float32Array, npt.NDArray[np.uint32]]:
    """Return vertices of `ATTRIBUTES` and indices of a disc of radius 1, in rings that widen outward."""
    radius = np.concatenate([[0.0], np.geomspace(NEAREST_RING, 1.0, RINGS)])
    angle = np.linspace(0.0, 2.0 * np.pi, SECTORS + 1)
    vertices = np.zeros((len(radius), len(angle), 13), np.float32)
    vertices[..., 0], vertices[..., 1] = radius[:, None] * np.cos(angle), radius[:, None] * np.sin(angle)
    vertices[..., 6], vertices[..., 11], vertices[..., 12] = 1.0, 1.0, SEA
    index = np.arange(vertices[..., 0].size, dtype=np.uint32).reshape(vertices.shape[:2]).T
    return vertices.reshape(-1, 13), quads(index).ravel()


ALPHA_BLEND: Final = (moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA)
DARKEN_AND_ADD: Final = (moderngl.ONE, moderngl.SRC_ALPHA)
"""Blend function of wet banks: water_bank.frag.glsl."""
BANDS_PER_PART: Final = 4  # water may fill few bands of a picture, and its pixels cost most
_NOWHERE: Final = (0.0, 0.0, 0.0, 0.0)
DEVIATION: Final = 0.25  # of water, in errors of the displayed ground


class Water:
    """The surfaces of all waters; ``MATERIALS`` 1 leaves out wet banks.

    Rivers and lakes are in one vertex buffer; the sea is a disc about the eye. `textures` are to be bound for
    the passes by the names of their samplers.
    """

    def __init__(
        self,
        context: moderngl.Context,
        features: TerrainFeatures,
        *,
        enabled: bool = True,
        defines: Mapping[str, int | str] | None = None,
    ) -> None:
        self._context = context
        self._enabled, self._defines = enabled, dict(defines or {})
        self._arrays: list[list[moderngl.VertexArray]] = []  # of each pass: the sea, inland waters
        self._anchors: list[float | Float64Array] = []  # of each array: the sea's level (m), or a place (m)
        self._chunks: StructuredArray | None = None  # of inland waters …
        self._commands: moderngl.Buffer | None = None  # … and those in view
        self._programs: list[moderngl.Program] = []
        self._uploaded: object = None
        self._cheap = self._defines.get("MATERIALS") == 1
        self.textures: dict[str, moderngl.Texture] = {}
        self.set_features(features)

    def __bool__(self) -> bool:
        return bool(self._anchors)

    def rebuild(self, features: TerrainFeatures, defines: Mapping[str, int | str]) -> None:
        """Replace the programs by ones with other macros."""
        self._defines, self._programs, self._uploaded = dict(defines), [], None
        self.set_features(features)

    def set_features(self, features: TerrainFeatures) -> None:
        """Replace the waters; nothing happens if they are equal."""
        objects = terrain_objects(features) if self._enabled else []
        state = [each.key for each in objects]
        if state == self._uploaded:
            return
        self._uploaded, self._chunks, self._commands = state, None, None
        # The sea is first: rivers fade into it.
        self._anchors = [each.level for each in objects if each.level is not None]
        parts = [sea_mesh() for _ in self._anchors]
        inland = [each for each in objects if each.level is None]
        if inland:
            anchor, vertices, indices, self._chunks = _meshes.get_or_compute(
                tuple(state), lambda: inland_mesh([each.mesh(_NOWHERE) for each in inland])
            )
            self._anchors.append(anchor)
            parts.append((vertices, indices))
            self._commands = self._context.buffer(reserve=len(self._chunks) * COMMAND.itemsize)
        self._arrays = []
        if not parts:
            return
        if not self._programs:
            self._programs = [
                build_program(self._context, f"{name}.vert.glsl", f"{name}.frag.glsl", defines=self._defines)
                for name in (["water"] if self._cheap else ["water_bank", "water"])
            ]
            self.textures["wave_slopes"] = wave_texture(self._context)
        buffers = [[self._context.buffer(array.tobytes()) for array in part] for part in parts]
        for program in self._programs:
            self._arrays.append(
                [
                    self._context.vertex_array(
                        program, [(vertices, *ATTRIBUTES)], index_buffer=indices, skip_errors=True
                    )
                    for vertices, indices in buffers
                ]
            )

    def draw(
        self,
        camera: Camera,
        targets: RenderTargets,
        uniforms: Mapping[str, object],
        *,
        parts: int,
    ) -> Iterator[None]:
        """Draw wet banks and the water into ``targets.scene``, after all other content; yield between parts.

        `uniforms` are those of all passes, ``clock`` (s), ``wind`` (m/s) and ``lift`` (water.vert.glsl).
        """
        eye, (width, height) = camera.eye, targets.size
        visible = self.select(camera, width / height, lift=cast("float", uniforms["lift"]))
        count = 1 if self._cheap else len(LAYERS)
        layers = wave_layers(cast("tuple[float, float]", uniforms["wind"]), count)
        own = {
            "wave_layers": _uniform_array(layers),
            "wave_phases": _uniform_array(wave_phases(layers, eye, cast(float, uniforms["clock"]))),
        }
        context = self._context
        context.enable(moderngl.BLEND)
        try:
            for arrays in self._arrays:
                targets.copy_scene()  # each pass reads what was drawn before it
                water = arrays is self._arrays[-1]
                targets.scene.depth_mask = water
                context.blend_func = ALPHA_BLEND if water else DARKEN_AND_ADD
                for array, anchor in zip(arrays, self._anchors, strict=True):
                    place = (*eye[:2], anchor) if isinstance(anchor, float) else anchor
                    set_uniforms(array.program, {**uniforms, **own, "anchor": tuple(np.subtract(place, eye))})
                    for _ in bands(targets.scene, parts if parts == 1 else BANDS_PER_PART * parts):
                        if isinstance(anchor, float):
                            array.render()
                        elif visible and self._commands is not None:
                            array.render_indirect(self._commands, moderngl.TRIANGLES, count=visible)
                        yield
        finally:  # a picture in parts may be abandoned
            targets.scene.depth_mask = True
            context.disable(moderngl.BLEND)

    def select(self, camera: Camera, aspect: float, *, lift: float) -> int:
        """Select the chunks of inland waters in view and their levels of detail; return their number."""
        if self._chunks is None or self._commands is None:
            return 0
        commands = chunk_commands(self._chunks, camera, aspect, DEVIATION * lift)
        self._commands.orphan()
        self._commands.write(commands.tobytes())
        return len(commands)


def _uniform_array(rows: Float64Array) -> object:
    """Return an array of vectors as a uniform's value; for a single vector, that vector."""
    values = [tuple(row) for row in rows.tolist()]
    return values if len(values) > 1 else values[0]
