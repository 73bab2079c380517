"""Labels of draped features in pictures: visible anchors, letters in an atlas, quads."""

from __future__ import annotations

from contextlib import suppress
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Final, cast
from unicodedata import combining, normalize

import moderngl
import numpy as np
from PIL import Image, ImageColor, ImageDraw, ImageFont

from sketchterrain.array_types import BoolArray, Float64Array, StructuredArray, UInt8Array
from sketchterrain.drape.label_layout import LabelCandidates, layer_numbers, place_labels
from sketchterrain.geometry.camera import Camera, Vector
from sketchterrain.render.programs import build_program, set_uniforms
from sketchterrain.render.scene import TerrainSource, surface_heights
from sketchterrain.render.targets import RenderTargets

if TYPE_CHECKING:
    from sketchterrain.document.drapes import DrapedLayer
    from sketchterrain.drape.drapes import Drapes

FONTS: Final = (
    *("DejaVuSans.ttf", "NotoSans-Regular.ttf", "LiberationSans-Regular.ttf", "arial.ttf"),
    *("NotoSansCJK-Regular.ttc", "msyh.ttc", "Arial Unicode.ttf"),
)
"""The first font installed that has all letters of a text draws it; the last one is Pillow's own."""
ATLAS: Final = (2048, 1024)  # texels of two bytes
LIFT: Final = 2.0  # px above the ground that are in view where a label is shown
_BEYOND: Final = 1.3  # half widths from the centre in which labels of a picture are
_OUTLINE: Final = 0.15  # of the height of letters
_QUAD: Final = np.dtype([("low", "f4", 2), ("extent", "f4", 2), ("cell", "f4", 2), ("colour", "f4", 4)])


class Labels:
    """Labels of draped layers, for stills and frames; true if any feature near the eye has one."""

    def __init__(self, context: moderngl.Context, terrain: TerrainSource) -> None:
        self._context, self._terrain = context, terrain
        self._candidates = LabelCandidates(text_size, lambda x, y: surface_heights(self._terrain, x, y))
        self._elapsed: float | None = None
        self._tested: tuple[StructuredArray, moderngl.Buffer] | None = None
        self._fades = self._is_film = False
        self._cells: dict[tuple[str, float], tuple[int, int]] = {}
        self._shelf = (0, 0, 0)  # x, y and height of the atlas's last row

    @cached_property
    def _gl(self) -> tuple[moderngl.Program, moderngl.Program, moderngl.Texture]:
        """Programs that test and draw labels, and the atlas."""
        test = build_program(self._context, "label_seen.vert.glsl", captured=("seen",))
        program = build_program(self._context, "label.vert.glsl", "label.frag.glsl")
        return test, program, self._context.texture(ATLAS, 2)

    def __bool__(self) -> bool:
        return len(self._candidates.anchors) > 0

    @property
    def complete(self) -> bool:
        """Whether all features of the last view are read."""
        return self._candidates.complete

    @property
    def converged(self) -> bool:
        """Whether the labels of the last view are complete, and none fades in or out."""
        return self.complete and not self._fades

    def set_drapes(self, drapes: Drapes | None) -> None:
        """Replace the draped layers."""
        self._candidates.set_drapes(drapes)

    def set_terrain(self, terrain: TerrainSource) -> None:
        """Replace the terrain."""
        self._terrain = terrain
        self._candidates.set_heights()

    def update(self, eye: Vector, above: float, elapsed: float | None, seconds: float) -> bool:
        """Read features near an eye `above` m above the ground for some seconds; return whether all are read.

        `elapsed` are the seconds since the last frame, None for a still. A frame of a film has no limit.
        """
        self._is_film = elapsed is not None and bool(np.isinf(seconds))
        self._elapsed = None if self._is_film and not self else elapsed  # films begin with a still
        self._read_visibility()
        self._candidates.update(eye, above, seconds)
        return self._candidates.complete

    def test(self, targets: RenderTargets, eye: Vector) -> None:
        """Test which anchors the ground drawn into the targets hides."""
        if not self:
            return
        rows, program = self._candidates.anchors, self._gl[0]
        places = self._context.buffer((rows["place"] - rows["place"][0]).astype(np.float32).tobytes())
        array = self._context.vertex_array(program, [(places, "3f4", "place")])
        seen = self._context.buffer(reserve=4 * len(rows))
        origin = tuple((rows["place"][0] - eye).tolist())
        targets.depth.use(0)
        targets.tonemapped.use()  # depth is not attached to it
        set_uniforms(program, {"drawn_depth": 0, "origin": origin, "lift": LIFT / targets.size[1]})
        array.transform(seen, moderngl.POINTS, vertices=len(rows))
        self._tested = rows, seen

    def draw(self, camera: Camera, framebuffer: moderngl.Framebuffer, *, moving: bool) -> None:
        """Draw labels over a picture, those of a still without regard to earlier frames."""
        self._fades = False
        if not self:
            return
        anchors = self._candidates.anchors
        elapsed = np.inf if self._elapsed is None else self._elapsed
        settled = self._elapsed is None or not (moving or self._is_film)
        if settled:  # in motion it is that of the last frame, which needs no waiting
            self._read_visibility()
        width, height = framebuffer.size
        matrix = camera.to_clip(width / height)
        clip = (anchors["place"] - camera.eye) @ matrix[:, :3].T + matrix[:, 3]
        near = np.maximum(*np.abs(clip[:, :2]).T) < _BEYOND * clip[:, 3]
        near = np.flatnonzero(near | (anchors["opacity"] > 0.0))
        rows, clip = np.take(anchors, near), clip[near]
        texel = 2.0 / (height * float(np.linalg.norm(matrix[1, :3]))) * clip[:, 3]
        clip[~self._in_range(rows, texel), 3] = 0.0
        boxes = place_labels(rows, clip, framebuffer.size, elapsed=elapsed, settled=settled)
        anchors[near] = rows
        drawn = (rows["opacity"] > 0.0) & (rows["size"][:, 0] <= ATLAS[0])
        self._fades = bool(rows["waits"].any() or (rows["shown"] != rows["opacity"]).any())
        if drawn.any():
            low = boxes[drawn, :2]
            self._draw_quads(rows[drawn], np.round(low) if settled else low, framebuffer)

    def _in_range(self, rows: StructuredArray, texel: Float64Array) -> BoolArray:
        """Return whether the layers of anchors are shown where a pixel is `texel` m wide."""
        layers = self._candidates.layers
        limits = np.array([(layer["finest"], layer["coarsest"] or np.inf) for layer in layers])
        finest, coarsest = limits[layer_numbers(rows)].T
        return np.asarray((texel >= finest) & (texel < coarsest))

    def _draw_quads(
        self, rows: StructuredArray, low: Float64Array, framebuffer: moderngl.Framebuffer
    ) -> None:
        labels = [self._candidates.labels[number] for number in rows["label"].tolist()]
        keys = list(zip(layer_numbers(rows).tolist(), (label.style for label in labels), strict=True))
        looks = {key: _look(self._candidates.layers[key[0]], key[1]) for key in set(keys)}
        texts = [(label.text, looks[key][1]) for label, key in zip(labels, keys, strict=True)]
        quads = np.zeros(len(rows), _QUAD)
        quads["low"], quads["extent"] = low, rows["size"]
        quads["colour"] = [looks[key][0] for key in keys]
        quads["colour"][:, 3] *= rows["opacity"]
        if not all(map(self._store, texts)):
            self._cells, self._shelf = {}, (0, 0, 0)  # full: without earlier pictures' texts
        quads["cell"] = [self._cells[text] if self._store(text) else (-1, -1) for text in texts]
        quads = quads[quads["cell"][:, 0] >= 0]
        buffer = self._context.buffer(quads.tobytes())
        columns = ("low", "extent", "cell", "colour")
        _, program, atlas = self._gl
        array = self._context.vertex_array(program, [(buffer, "2f4 2f4 2f4 4f4/i", *columns)])
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
        framebuffer.use()
        atlas.use(0)
        set_uniforms(program, {"atlas": 0, "size": framebuffer.size})
        array.render(moderngl.TRIANGLES, vertices=6, instances=len(quads))
        self._context.enable_only(moderngl.NOTHING)
        self._context.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA

    def _store(self, text: tuple[str, float]) -> bool:
        """Draw a text of some size into the atlas unless it is there; return whether there is room."""
        if text in self._cells:
            return True
        texels = draw_text(*text)
        height, width, _ = texels.shape
        x, y, deep = self._shelf
        if x + width > ATLAS[0]:
            x, y, deep = 0, y + deep, 0
        if y + height > ATLAS[1]:
            return False
        self._gl[2].write(texels.tobytes(), viewport=(x, y, width, height), alignment=1)
        self._cells[text] = x, y
        self._shelf = x + width, y, max(deep, height)
        return True

    def _read_visibility(self) -> None:
        """Write the results of the last test into its anchors, unless others have replaced them."""
        if self._tested is not None and self._tested[0] is self._candidates.anchors:
            self._tested[0]["seen"] = np.frombuffer(self._tested[1].read(), np.float32) > 0.5
        self._tested = None


def _look(layer: DrapedLayer, number: int) -> tuple[tuple[float, ...], float]:
    """Return colour with opacity, and height (px), of a class's labels."""
    style = layer.style_of(number)
    colour = np.divide(ImageColor.getrgb(style["label_colour"] or "#202020"), 255.0)
    return (*colour.tolist(), layer["opacity"]), float(style["label_size"])


def text_size(text: str, size: float) -> tuple[int, int]:
    """Return width and height (px) of a text with its outline, for letters `size` px high."""
    text, font = _drawable(text, size)
    ascent, descent = font.getmetrics()
    border = 2 * _outline(size)
    return int(np.ceil(font.getlength(text))) + border, ascent + descent + border


def draw_text(text: str, size: float) -> UInt8Array:
    """Return coverage by letters, and by letters with their outline, (height, width, 2)."""
    (width, height), border = text_size(text, size), _outline(size)
    text, font = _drawable(text, size)
    images = []
    for stroke in (0, border):
        image = Image.new("L", (width, height))
        at = (border, border)
        ImageDraw.Draw(image).text(at, text, 255, font, anchor="la", stroke_width=stroke)
        images.append(np.asarray(image))
    return np.stack(images, axis=-1)


def _outline(size: float) -> int:
    return max(round(_OUTLINE * size), 1)


@lru_cache(maxsize=1 << 14)
def _drawable(text: str, size: float) -> tuple[str, ImageFont.FreeTypeFont]:
    """Return the first font with all letters of a text; else the last one, with plain letters or ``?``."""
    for font in _fonts():
        if all(_has_letter(font, letter) for letter in set(text)):
            break
    else:
        letters = [c for c in normalize("NFKD", text) if not combining(c)]
        text = "".join(c if _has_letter(font, c) else "?" for c in letters)
    return text, font.font_variant(size=size)


@lru_cache(maxsize=1)
def _fonts() -> tuple[ImageFont.FreeTypeFont, ...]:
    found = [cast("ImageFont.FreeTypeFont", ImageFont.load_default(16.0))]
    for name in reversed(FONTS):
        with suppress(OSError):  # it isn't installed
            found.insert(0, ImageFont.truetype(name, 16.0))
    return tuple(found)


@lru_cache(maxsize=1 << 12)
def _has_letter(font: ImageFont.FreeTypeFont, letter: str) -> bool:
    """Return whether a font has a letter: its shape is not that of a character that no font has."""
    return letter == " " or bytes(font.getmask(letter)) != bytes(font.getmask("\uffff"))
