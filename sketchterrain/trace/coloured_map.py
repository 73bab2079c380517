"""A coloured map as a sketch: its colours, what each stands for, and so the label of each pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from sketchterrain.errors import InputError, one_line
from sketchterrain.sketch import LAYERS
from sketchterrain.trace import label_image, picture_colours
from sketchterrain.trace.legend import INK, NOTHING, OWN_LEGEND, Legend, Meaning
from sketchterrain.trace.picture import Picture, read_picture
from sketchterrain.trace.picture_colours import CLEAR, UNKNOWN, FoundColour, find_colours, sort_pixels
from sketchterrain.trace.sheet import Sheet, Traced

SPECKS: Final = 16  # areas of fewer pixels of the sketch vanish unless it is asked otherwise

_INK_REACH = 24.0  # px of the sketch that lettering is filled from its sides; a wider area stays empty
_THIN = ("river",)
_GAP = 14  # px of the sketch; lettering and noise break a river so far
_NARROW = 8  # px of the sketch, of waters that may be meant as rivers
_TOLD = 12  # colours that notes name


@dataclass(frozen=True, eq=False)
class TracedMap(Traced):
    """A traced map: what each of its colours was taken for (None: the legend does not have it).

    `sure`, `taken` and `unknown` are shares of the picture, as in `SortedPixels`.
    """

    colours: tuple[tuple[FoundColour, Meaning | None], ...]
    sure: float
    taken: float
    unknown: float


@dataclass(frozen=True, eq=False)
class ColouredMap:
    """A coloured map that was read: a sketch can be made of it as often as meanings change.

    `rgba` is uint8, (height, width, 4); `meanings` is what the legend says of its colours, the most common
    first.
    """

    name: str
    rgba: npt.NDArray[np.uint8]
    colours: tuple[FoundColour, ...]
    meanings: tuple[Meaning | None, ...]
    pixels: picture_colours.SortedPixels

    def traced(
        self,
        sheet: Sheet,
        *,
        meanings: Sequence[Meaning | None] | None = None,
        specks: int = SPECKS,
        narrow: float = 0.0,
    ) -> TracedMap:
        """Return the sketch; raise `InputError` if no colour stands for a label."""
        meant = tuple(self.meanings if meanings is None else meanings)
        painted = {each for each in meant if each is not None and each.label}
        if not painted:
            named = ", ".join(each.code for each in self.colours[:_TOLD])
            raise InputError(
                f"no colour of the legend in it, but {named}: expected some to be named, "
                "as with --colour mountain=#8b5a2b"
            )
        order = sorted(painted, key=lambda each: (tuple(LAYERS).index(each.layer), each.label))
        value_of = {meaning: value for value, meaning in enumerate(order, start=1)}
        table = np.zeros(256, dtype=np.uint8)
        table[UNKNOWN] = label_image.NO_VOTE
        table[CLEAR] = 0
        for index, meaning in enumerate(meant):
            table[index] = label_image.NO_VOTE if meaning == INK else value_of.get(meaning or NOTHING, 0)
        height, width = self.pixels.index.shape
        thin = [value for meaning, value in value_of.items() if meaning.layer in _THIN]
        values = label_image.majority(table[self.pixels.index], sheet.size(width, height), thin=thin)
        if INK in meant:  # where lettering is, outlines are too
            values = label_image.without_threads(values, {0, *value_of.values()}.difference(thin))
        values = label_image.fill_gaps(values, reach=_INK_REACH, beyond=0)
        for value in thin:
            values[label_image.joined(values == value, _GAP)] = value
        values = label_image.without_specks(values, specks)
        layers = {name: np.zeros(values.shape, dtype=np.uint8) for name in LAYERS}
        for meaning, value in value_of.items():
            layers[meaning.layer][values == value] = meaning.label
        if narrow > 0.0:
            layers["river"], layers["lake"] = label_image.parted_waters(
                layers["river"], layers["lake"], narrow
            )
        sketch, told = sheet.sketch(layers, self.name)
        pairs = tuple(zip(self.colours, meant, strict=True))
        pixels = self.pixels
        notes = (
            f"{pixels.sure:.1%} of the picture is plainly one of its {len(self.colours)} colours, "
            f"{pixels.taken:.1%} took what is beside it, {pixels.unknown:.1%} is like nothing around it",
            *_colour_notes(pairs),
            *([] if narrow > 0.0 else _water_notes(layers["river"] > 0, layers["lake"] > 0)),
            *told,
        )
        return TracedMap(sketch, notes, pairs, pixels.sure, pixels.taken, pixels.unknown)


def read_map(path: Path, legend: Legend = OWN_LEGEND) -> ColouredMap:
    """Read a coloured map from a picture; raise `InputError` if it is none or has no colours."""
    return map_of(read_picture(path), path, legend)


def map_of(picture: Picture, path: Path, legend: Legend = OWN_LEGEND) -> ColouredMap:
    """Return the coloured map that a picture from a path is; raise `InputError` if it has no colours."""
    place = one_line(path)
    if picture.is_grey:
        raise InputError(
            f"{place}: it is black, white and grey: expected a coloured map, or the layer "
            "that is painted in it, as with --layer mountain"
        )
    # The program's own legend has more colours than any picture: they are no reason to tell two apart.
    sought = () if legend.colours is OWN_LEGEND.colours else legend.colours
    colours = find_colours(picture.rgba, sought=sought)
    if not colours:
        raise InputError(f"{place}: no area of it is of one colour: expected a coloured map")
    meanings = tuple(legend.meaning(each.rgb) for each in colours)
    return ColouredMap(path.stem, picture.rgba, colours, meanings, sort_pixels(picture.rgba, colours))


def _colour_notes(pairs: Sequence[tuple[FoundColour, Meaning | None]]) -> list[str]:
    known = [f"{each.code} is {meaning} ({each.share:.1%})" for each, meaning in pairs if meaning is not None]
    left = [f"{each.code} ({each.share:.1%})" for each, meaning in pairs if meaning is None]
    notes = [", ".join(known[:_TOLD]) + _more(known)] if known else []
    if left:
        notes.append(
            f"no colour of the legend, left empty: {', '.join(left[:_TOLD])}{_more(left)}; "
            "--colour LAYER=#rrggbb names one"
        )
    return notes


def _water_notes(river: npt.NDArray[np.bool_], lake: npt.NDArray[np.bool_]) -> list[str]:
    if river.any() or not lake.any() or not label_image.narrow_waters(lake, _NARROW).any():
        return []
    return [f"some lakes are narrow and long: --rivers-up-to {_NARROW} makes rivers of them"]


def _more(told: Sequence[str]) -> str:
    return f" and {len(told) - _TOLD} more" if len(told) > _TOLD else ""
