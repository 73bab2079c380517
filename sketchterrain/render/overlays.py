"""Overlays: what the ground is made of, drawn over a picture of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import moderngl
import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.render.overlay_lines import COLOURS, FeatureLines, KnownHeights
from sketchterrain.render.programs import fullscreen_pass, set_uniforms

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from sketchterrain.render.ground_stream import TerrainStream
    from sketchterrain.render.scene import TerrainSource
    from sketchterrain.tiles import DrawList

    Floats = npt.NDArray[np.float64]
    Box = tuple[float, float, float, float]

OVERLAYS: Final = {
    "wireframe": "the triangles that are drawn, coloured by their tile's level",
    "levels": "tiles, coloured by level",
    "error": "tiles, coloured by their geometric error δ (m)",
    "screen-error": "tiles, coloured by what their error covers on the screen (px)",
    "materials": "the ground's materials",
    "features": "rings about features, posts in their middles, rivers' splines, lakes' shores",
    "triplanar": "which planes the ground is textured from",
}
"""Names and what they show."""

_SAMPLES: Final = 2
_LEVELS: Final = np.array(
    [
        (230, 25, 75),
        (245, 130, 48),
        (255, 225, 25),
        (60, 180, 75),
        (70, 220, 240),
        (0, 130, 200),
        (145, 30, 180),
        (240, 50, 230),
    ]
)
"""Tiles of a level and of the eighth below it have one colour."""
_RAMP: Final = np.array([(48, 18, 130), (40, 140, 230), (60, 220, 130), (250, 220, 60), (210, 30, 20)])
_ERRORS: Final = (0.01, 100.0)
"""m; ends of the ramp, logarithmic."""
_PIXELS: Final = 2.0
"""px; the end of the ramp that begins at 0."""
_MATERIALS: Final = {
    "grass": (90, 170, 60),
    "soil": (130, 90, 50),
    "rock": (130, 130, 140),
    "scree": (190, 180, 165),
    "sand": (235, 205, 120),
    "snow": (250, 250, 255),
    "river_bed": (60, 110, 200),
    "forest_floor": (30, 90, 50),
}
_PLANES: Final = {"across x": (255, 0, 0), "across y": (0, 255, 0), "across z": (0, 0, 255)}
_TILES, _WEIGHTS, _TRIPLANAR, _PLAIN, _RELIEF = range(5)
_OPACITY: Final = 0.8
_WIRES: Final = 0.65
"""Opacity of wires: where they are many, the relief still shows."""


class LegendEntry(NamedTuple):
    """What a colour of an overlay means."""

    colour: tuple[int, int, int]
    meaning: str


class Overlay:
    """Draws overlays of a ground.

    Parameters
    ----------
    context
        Where they are drawn.
    terrain
        Whose features.
    ground
        What is drawn: its tiles as of the last frame.
    """

    def __init__(self, context: moderngl.Context, terrain: TerrainSource, ground: TerrainStream) -> None:
        self._context = context
        self._terrain = terrain
        self._ground = ground
        self._tints = context.buffer(reserve=16 * ground.tiles.pool.slots, dynamic=True)
        program = ground.pool.build("overlay.vert.glsl", "overlay.frag.glsl")
        self._tiles = ground.pool.array(program, values=(self._tints, "tint"))
        self._blend = fullscreen_pass(context, "overlay_blend.frag.glsl")
        self._lines: FeatureLines | None = None
        self._known = KnownHeights()
        self._target: moderngl.Framebuffer | None = None

    def change(self, terrain: TerrainSource, areas: Sequence[Box] | None = None) -> None:
        """Draw the features of another terrain from now on.

        Parameters
        ----------
        terrain
            The other one.
        areas
            West, south, east, north (m): elsewhere its ground is the same; by default it may differ anywhere.
        """
        self._terrain = terrain
        self._lines = None
        if areas is None:
            self._known = KnownHeights()
        else:
            self._known.change(areas)

    def draw(
        self,
        name: str,
        eye: tuple[float, float, float],
        framebuffer: moderngl.Framebuffer,
        *,
        samples: int = _SAMPLES,
    ) -> None:
        """Draw one over a picture; the camera stands in the frame's uniform block.

        Parameters
        ----------
        name
            One of ``OVERLAYS``.
        eye
            Of the camera, m.
        framebuffer
            Which holds the picture.
        samples
            A pixel, along each axis; 1 is quicker, for an eye that moves.

        Raises
        ------
        InputError
            If there is no such overlay.
        """
        draws = self._ground.draws
        check_overlays([name])
        if draws is None or not draws.keys:
            return
        target = self._sized(framebuffer.size, samples)
        self._tints.write(_tints(name, draws).tobytes())
        self._ground.pool.place(draws, eye)
        target.use()
        target.clear(0.0, 0.0, 0.0, 0.0, depth=1.0)
        self._context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        if name == "wireframe":
            self._draw_wires()
        elif name == "features":
            self._draw_features(eye, target, samples)
        else:
            self._draw_tiles({"materials": _WEIGHTS, "triplanar": _TRIPLANAR}.get(name, _TILES), _OPACITY)
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
        framebuffer.use()
        self._colour.use(0)
        set_uniforms(self._blend.program, {"overlay": 0, "samples": samples})
        self._blend.render(vertices=3)
        self._context.enable_only(moderngl.NOTHING)
        self._context.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA

    def legend(self, name: str) -> tuple[LegendEntry, ...]:
        """Return what the colours of an overlay mean, for the tiles of the last frame."""
        check_overlays([name])
        if name in ("wireframe", "levels"):
            levels = sorted({key.level for key in self._ground.draws.keys}) if self._ground.draws else []
            return tuple(LegendEntry(_rgb(_LEVELS[level % 8]), f"level {level}") for level in levels)
        if name == "error":
            return _marks(np.geomspace(*_ERRORS, len(_RAMP)), "m")
        if name == "screen-error":
            return _marks(np.linspace(0.0, _PIXELS, len(_RAMP)), "px")
        named = {"materials": _MATERIALS, "triplanar": _PLANES}.get(name, COLOURS)
        return tuple(LegendEntry(colour, meaning) for meaning, colour in named.items())

    def _draw_tiles(self, shown: int, opacity: float) -> None:
        palette = [tuple(np.divide(colour, 255.0).tolist()) for colour in _MATERIALS.values()]
        set_uniforms(self._tiles.program, {"shown": shown, "opacity": opacity, "palette": palette})
        self._ground.pool.draw(self._tiles)

    def _draw_wires(self) -> None:
        """Draw the ground a little behind itself, then its triangles' edges."""
        context = self._context
        context.polygon_offset = 1.0, 1.0
        self._draw_tiles(_RELIEF, _OPACITY)
        context.polygon_offset = 0.0, 0.0
        context.enable(moderngl.BLEND)
        context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
        context.wireframe = True
        self._draw_tiles(_PLAIN, _WIRES)
        context.wireframe = False

    def _draw_features(
        self, eye: tuple[float, float, float], target: moderngl.Framebuffer, samples: int
    ) -> None:
        if self._lines is None:
            self._lines = FeatureLines(self._context, self._terrain, known=self._known)
        # Of the ground only its depth is wanted: without colours nothing is shaded.
        target.color_mask = (False, False, False, False)
        self._draw_tiles(_PLAIN, 0.0)
        target.color_mask = (True, True, True, True)
        self._context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
        self._lines.draw(eye, target.size, width=2.0 * samples)

    def _sized(self, size: tuple[int, int], samples: int) -> moderngl.Framebuffer:
        inner = (samples * size[0], samples * size[1])
        if self._target is None or self._target.size != inner:
            self._colour = self._context.texture(inner, 4)
            self._target = self._context.framebuffer([self._colour], self._context.depth_renderbuffer(inner))
        return self._target


def check_overlays(names: Sequence[str]) -> None:
    """Refuse names that are none of ``OVERLAYS``.

    Raises
    ------
    InputError
        With the names that there are.
    """
    for name in names:
        if name not in OVERLAYS:
            raise InputError(f"no overlay {name!r}; there are: {', '.join(OVERLAYS)}")


def _tints(name: str, draws: DrawList) -> npt.NDArray[np.float32]:
    """Return each tile's colour, (n, 4)."""
    if name == "error":
        low, high = np.log(_ERRORS)
        colours = _ramp((np.log(np.maximum(draws.errors, _ERRORS[0])) - low) / (high - low))
    elif name == "screen-error":
        colours = _ramp(draws.screen_errors / _PIXELS)
    else:
        colours = _LEVELS[draws.levels % 8].astype(np.float64)
    tints = np.ones((len(colours), 4), np.float32)
    tints[:, :3] = colours / 255.0
    return tints


def _ramp(at: Floats) -> Floats:
    """Return colours, (n, 3), for places 0 … 1 on the ramp."""
    stops = np.linspace(0.0, 1.0, len(_RAMP))
    return np.stack([np.interp(at, stops, channel) for channel in _RAMP.T], axis=-1)


def _marks(values: Floats, unit: str) -> tuple[LegendEntry, ...]:
    return tuple(
        LegendEntry(_rgb(colour), f"{value:g} {unit}") for value, colour in zip(values, _RAMP, strict=True)
    )


def _rgb(colour: npt.NDArray[np.int64]) -> tuple[int, int, int]:
    red, green, blue = (int(part) for part in colour)
    return red, green, blue
