"""A sheet as pixels, drawn several times finer and averaged, band by band."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from PIL import Image, ImageChops, ImageDraw, ImageFont

from sketchterrain.export.map_sheet import Areas, Lines, Picture, Words

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from sketchterrain.export.map_sheet import Box, Colour, Path, Sheet

    Pixels = npt.NDArray[np.uint8]

__all__ = ["pixels_of"]

FINER: Final = 4
"""Times finer along each axis than the picture."""
BAND: Final = 256
"""px of the picture that are drawn at once."""
HALO: Final = 0.14
"""Width of the rim of a letter's halo, in font sizes."""
BOLD: Final = 0.022
"""By which bold letters are thicker on each side, in font sizes."""


def pixels_of(sheet: Sheet, *, width: int) -> Pixels:
    """Draw a sheet.

    Parameters
    ----------
    sheet
    width
        Of the picture (px); its height follows.

    Returns
    -------
    (height, width, 3) uint8
        sRGB, row 0 on top.
    """
    height = max(round(width * sheet.height / sheet.width), 1)
    scale = FINER * width / sheet.width
    placed = [(layer.clip, [_placed(shape, scale) for shape in layer.shapes]) for layer in sheet.layers]
    picture = np.empty((height, width, 3), np.uint8)
    for top in range(0, height, BAND):
        rows = min(BAND, height - top)
        band = _Band((FINER * width, FINER * rows), FINER * top, sheet.paper)
        for clip, shapes in placed:
            band.draw(shapes, None if clip is None else _pixels(clip, scale))
        small = band.image.resize((width, rows), Image.Resampling.BOX)
        picture[top : top + rows] = np.asarray(small)
    return picture


class _Ink:
    """A shape in fine pixels, and the rows that it touches."""

    def __init__(self, rows: tuple[float, float]) -> None:
        self.rows = rows

    def on(self, band: _Band) -> None:
        raise NotImplementedError


class _Band:
    """Rows of the fine picture."""

    def __init__(self, size: tuple[int, int], top: int, paper: Colour) -> None:
        self.image = Image.new("RGB", size, paper)
        self.top = top

    def draw(self, shapes: list[_Ink], clip: Box | None) -> None:
        """Draw what touches the band, as far as it lies in a box (fine pixels)."""
        low, high = self.top, self.top + self.image.height
        here = [shape for shape in shapes if shape.rows[1] >= low and shape.rows[0] <= high]
        if not here:
            return
        if clip is None:
            for shape in here:
                shape.on(self)
            return
        left, above, width, height = clip
        box = (round(left), max(round(above) - low, 0), round(left + width), round(above + height) - low)
        box = (*box[:3], min(box[3], self.image.height))
        if box[3] <= box[1]:
            return
        before = self.image
        self.image = before.copy()
        for shape in here:
            shape.on(self)
        inside = self.image.crop(box)
        self.image = before
        self.image.paste(inside, box[:2])


class _LineInk(_Ink):
    def __init__(self, lines: Lines, scale: float) -> None:
        self.width = max(round(lines.width * scale), 1)
        self.colour, self.opacity = lines.colour, lines.opacity
        self.paths = [path * scale for path in lines.paths]
        edge = self.width
        self.reach = [(path[:, 1].min() - edge, path[:, 1].max() + edge) for path in self.paths]
        super().__init__(_span(self.reach))

    def on(self, band: _Band) -> None:
        if self.opacity < 1.0:
            mask = Image.new("L", band.image.size)
            self._draw(ImageDraw.Draw(mask), band, round(255 * self.opacity))
            band.image.paste(self.colour, (0, 0, *band.image.size), mask)
        else:
            self._draw(ImageDraw.Draw(band.image), band, self.colour)

    def _draw(self, draw: ImageDraw.ImageDraw, band: _Band, ink: Colour | int) -> None:
        low, high = band.top, band.top + band.image.height
        for path, (first, last) in zip(self.paths, self.reach, strict=True):
            if last < low or first > high:
                continue
            at = path - [0.0, low]
            # Joints show where a line is wide; thin ones are drawn eight times as fast without.
            draw.line(at.ravel().tolist(), ink, self.width, "curve" if self.width > 2 * FINER else None)
            radius = self.width / 2.0
            for x, y in (at[0], at[-1]):
                draw.ellipse((x - radius, y - radius, x + radius, y + radius), ink)


class _AreaInk(_Ink):
    def __init__(self, areas: Areas, scale: float) -> None:
        self.colour, self.opacity = areas.colour, areas.opacity
        self.rings = [ring * scale for ring in areas.rings]
        super().__init__(_span([(ring[:, 1].min(), ring[:, 1].max()) for ring in self.rings]))

    def on(self, band: _Band) -> None:
        rings = [ring - [0.0, band.top] for ring in self.rings]
        whole = _within(rings, band.image.size)
        if whole is None:
            return
        mask = Image.new("1", (whole[2] - whole[0], whole[3] - whole[1]))
        for ring in rings:
            at = ring - whole[:2]
            box = _within([at], mask.size)
            if box is None:
                continue
            part = Image.new("1", (box[2] - box[0], box[3] - box[1]))
            ImageDraw.Draw(part).polygon((at - box[:2]).ravel().tolist(), fill=1)
            mask.paste(ImageChops.logical_xor(mask.crop(box), part), box[:2])
        ink = mask.convert("L")
        if self.opacity < 1.0:
            ink = ink.point([round(self.opacity * value) for value in range(256)])
        band.image.paste(self.colour, whole, ink)


class _WordInk(_Ink):
    def __init__(self, words: Words, scale: float) -> None:
        self.words = words
        self.font = ImageFont.load_default(words.size * scale)
        self.place = (words.x * scale, words.y * scale)
        self.size = words.size * scale
        reach = (words.width + 2.0 * words.size) * scale if words.turn else 2.0 * self.size
        super().__init__((self.place[1] - reach, self.place[1] + reach))

    def on(self, band: _Band) -> None:
        words = self.words
        place = (self.place[0], self.place[1] - band.top)
        bold = BOLD * self.size if words.bold else 0.0
        if words.halo is not None:
            self._write(band, place, words.halo, bold + HALO * self.size)
        self._write(band, place, words.colour, bold)

    def _write(self, band: _Band, place: tuple[float, float], colour: Colour, thicker: float) -> None:
        anchor = {"start": "l", "middle": "m", "end": "r"}[self.words.anchor] + "m"
        if not self.words.turn:
            draw = ImageDraw.Draw(band.image)
            draw.text(place, self.words.text, colour, self.font, anchor, stroke_width=thicker)
            return
        # Turned about its anchor on a square of its own.
        half = int(self.words.width / self.words.size * self.size + 2.0 * self.size)
        mask = Image.new("L", (2 * half, 2 * half))
        ImageDraw.Draw(mask).text((half, half), self.words.text, 255, self.font, anchor, stroke_width=thicker)
        mask = mask.rotate(-self.words.turn, Image.Resampling.BICUBIC)
        corner = (round(place[0]) - half, round(place[1]) - half)
        band.image.paste(colour, (*corner, corner[0] + 2 * half, corner[1] + 2 * half), mask)


class _PictureInk(_Ink):
    def __init__(self, picture: Picture, scale: float) -> None:
        self.box = _pixels(picture.box, scale)
        self.image = Image.fromarray(picture.pixels)
        super().__init__((self.box[1], self.box[1] + self.box[3]))

    def on(self, band: _Band) -> None:
        left, above, width, height = self.box
        first, last = max(band.top, round(above)), min(band.top + band.image.height, round(above + height))
        if last <= first:
            return
        rows = self.image.height / height
        part = (0.0, (first - above) * rows, float(self.image.width), (last - above) * rows)
        part = (0.0, max(part[1], 0.0), part[2], min(part[3], float(self.image.height)))
        band.image.paste(
            self.image.resize((round(width), last - first), Image.Resampling.BICUBIC, part),
            (round(left), first - band.top),
        )


def _placed(shape: Lines | Areas | Words | Picture, scale: float) -> _Ink:
    if isinstance(shape, Lines):
        return _LineInk(shape, scale)
    if isinstance(shape, Areas):
        return _AreaInk(shape, scale)
    if isinstance(shape, Words):
        return _WordInk(shape, scale)
    return _PictureInk(shape, scale)


def _within(rings: list[Path], size: tuple[int, int]) -> tuple[int, int, int, int] | None:
    """Return the box of whole pixels around rings as far as it lies in a picture, None if it does not."""
    points = np.concatenate(rings)
    left, top = (int(number) for number in np.floor(points.min(axis=0)))
    right, bottom = (int(number) + 1 for number in np.ceil(points.max(axis=0)))
    box = (max(left, 0), max(top, 0), min(right, size[0]), min(bottom, size[1]))
    return box if box[0] < box[2] and box[1] < box[3] else None


def _span(reach: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Return the rows from the first to the last; none where there is nothing."""
    if not reach:
        return np.inf, -np.inf
    return min(low for low, _ in reach), max(high for _, high in reach)


def _pixels(box: Box, scale: float) -> Box:
    left, top, width, height = box
    return left * scale, top * scale, width * scale, height * scale
