"""Children that save numbered sketches without end kill themselves; what they leave must be a whole sketch.

Each dies at a random call of the operating system. Vectors and stored rasters appear and disappear between
saves. A child reports each finished save: the sketch on disk is that one or the next. Arguments: place,
kills, seed.
"""

import io
import itertools
import os
import random
import signal
import sys
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path

import numpy as np

from sketchterrain.document.rasters import RasterSource
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import JOURNAL, load_sketch, save_sketch
from sketchterrain.features.table import AREA, LINE, Feature, FeatureTable
from sketchterrain.schema.layers import LAYERS, PAINTED_LAYERS, VECTOR_LAYERS
from tests.document.conftest import same

SAVES = 5  # most saves until a kill, by the calls of one
SQUARE = np.array([[0.0, 0.0], [50.0, 0.0], [50.0, 50.0], [0.0, 50.0]])


def numbered_sketch(number: int) -> Sketch:
    """Return a sketch that depends on a number in all of its files, and in which files it has."""
    dice = random.Random(number)
    image = np.full((20, 30), number % 255 + 1, dtype=np.uint8)
    vectors = {name: _layer(name, number) for name in VECTOR_LAYERS if dice.random() < 0.5}
    contents = [b"raster %d" % (number % 7 * 10 + k) for k in range(dice.randrange(3))]
    rasters = [(sha256(content).hexdigest(), content) for content in contents]
    return Sketch(
        seed=number,
        layers=dict.fromkeys(PAINTED_LAYERS, image),
        vectors=vectors,
        rasters=tuple(
            RasterSource(f"map-{digest[:8]}.raster", sha256=digest, content=content)
            for digest, content in rasters
        ),
    )


@cache
def _layer(name: str, number: int) -> FeatureTable:
    kind = LINE if "line" in LAYERS[name].vectors else AREA
    feature = Feature(kind, (SQUARE + number,), properties={"note": f"n° {number}"})
    return FeatureTable(name).edited(add=[feature])


def count_calls(on_call: Callable[[], None]) -> None:
    """Call a function before and after each call of the operating system."""

    def profile(_: object, event: str, function: object) -> None:
        if event in ("c_call", "c_return") and (
            function.__module__ == os.name or isinstance(function.__self__, io.IOBase)
        ):
            on_call()

    sys.setprofile(profile)


def save_until_killed(place: Path, number: int, pipe: int, moment: int) -> None:
    calls = itertools.count()
    count_calls(lambda: next(calls) == moment and os.kill(os.getpid(), signal.SIGKILL))
    while True:
        number += 1
        save_sketch(numbered_sketch(number), place)
        os.write(pipe, number.to_bytes(8, "little"))


def main(place: Path, kills: int, seed: int) -> None:
    dice, number, saves, cut_off = random.Random(seed), 2, 0, 0
    save_sketch(numbered_sketch(number - 1), place)  # loads libraries
    calls = itertools.count()
    count_calls(lambda: next(calls))
    save_sketch(numbered_sketch(number), place)
    sys.setprofile(None)
    most = SAVES * next(calls)
    for _ in range(kills):
        moment = dice.randrange(most)
        ours, theirs = os.pipe()
        child = os.fork()
        if child == 0:
            save_until_killed(place, number, theirs, moment)
        os.close(theirs)
        os.waitpid(child, 0)
        with os.fdopen(ours, "rb") as stream:
            reported = np.frombuffer(stream.read(), "<u8").tolist()
        last = reported[-1] if reported else number
        found = load_sketch(place)
        assert found.seed in (last, last + 1), f"{found.seed} is on disk, {last} was saved"
        same(found, numbered_sketch(found.seed))
        saves, number = saves + len(reported), found.seed
        left = [*place.parent.rglob(".*.tmp"), *place.parent.rglob(JOURNAL)]
        cut_off += bool(left)
        for each in left:
            if each.name != JOURNAL:
                each.unlink()
    print(f"{kills} kills, {cut_off} of them in the middle of writing, {saves} saves, nothing lost")  # noqa: T201


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
