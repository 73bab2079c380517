"""A known sketch drawn as a map, and measures of traced ones."""

from typing import NamedTuple

import numpy as np
import pytest
from PIL import Image, ImageDraw
from scipy import ndimage

from sketchterrain.schema.layers import LAYERS

SIDE = 256
_EIGHT = np.ones((3, 3), dtype=bool)


class KnownMap(NamedTuple):
    """A map whose labels are known: (256, 256), 0 nothing, else the layer's place in `LAYERS` plus one.

    The picture is in the program's own colours on white, without antialiasing; the large one is drawn four
    times as large, for antialiasing, and its labels are those of most of each pixel.
    """

    labels: np.ndarray
    picture: Image.Image
    large_labels: np.ndarray
    large: Image.Image


def _most(labels: np.ndarray) -> np.ndarray:
    """Of each 4×4 pixels, what most of them are."""
    blocks = labels.reshape(SIDE, 4, SIDE, 4)
    counts = [(blocks == value).sum(axis=(1, 3)) for value in range(len(LAYERS) + 1)]
    return np.argmax(counts, axis=0).astype(np.uint8)


def _drawn(scale: int, colours: dict, paper: object, mode: str) -> Image.Image:
    image = Image.new(mode, (SIDE * scale, SIDE * scale), paper)
    draw = ImageDraw.Draw(image)

    def at(*points: tuple[float, float]) -> list:
        return [(x * scale, y * scale) for x, y in points]

    draw.polygon(at((20, 20), (120, 10), (140, 70), (60, 110), (15, 80)), fill=colours["mountain"])
    draw.ellipse(at((150, 20), (235, 90)), fill=colours["hill"])
    draw.polygon(at((10, 140), (90, 130), (100, 200), (30, 245)), fill=colours["forest"])
    draw.ellipse(at((120, 180), (170, 235)), fill=colours["lake"])
    draw.rectangle(at((185, 130), (250, 240)), fill=colours["dune"])
    draw.rectangle(at((200, 150), (225, 170)), fill=colours["material"])
    course = at((-5, 118), (60, 120), (110, 128), (150, 110), (185, 115), (261, 100))
    draw.line(course, fill=colours["river"], width=4 * scale, joint="curve")
    return image


@pytest.fixture(scope="session")
def known() -> KnownMap:
    numbers = {name: place for place, name in enumerate(LAYERS, start=1)}
    colours = {name: layer.colour for name, layer in LAYERS.items()}
    labels, fine = (np.asarray(_drawn(scale, numbers, 0, "L")) for scale in (1, 4))
    small, large = (_drawn(scale, colours, (255,) * 3, "RGB") for scale in (1, 4))
    return KnownMap(labels, small, _most(fine), large)


@pytest.fixture(scope="session")
def labels_of():
    """What a sketch has at each pixel, as `KnownMap.labels`."""

    def read(sketch) -> np.ndarray:
        labels = np.zeros((sketch.height_px, sketch.width_px), np.uint8)
        for place, image in enumerate(sketch.layers.values(), start=1):
            assert not (labels[image > 0]).any(), "two layers at one pixel"
            labels[image > 0] = place
        return labels

    return read


@pytest.fixture(scope="session")
def away():
    """Where no other label is within three pixels."""
    return lambda labels: ndimage.maximum_filter(labels, 7) == ndimage.minimum_filter(labels, 7)


@pytest.fixture(scope="session")
def parts():
    """How many 8-connected parts a mask has."""
    return lambda mask: ndimage.label(mask, structure=_EIGHT)[1]


@pytest.fixture
def saved(tmp_path):
    """Save a picture, given as an image or an array, under a name."""

    def save(image: Image.Image | np.ndarray, name: str = "map.png", **options: object):
        path = tmp_path / name
        given = image if isinstance(image, Image.Image) else Image.fromarray(image)
        given.save(path, **options)
        return path

    return save
