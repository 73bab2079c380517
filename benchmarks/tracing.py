"""Sketches drawn as maps and traced again: which labels come back, beside each pixel's nearest colour."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from PIL import Image
from scipy import ndimage

from sketchterrain.benchmarks.outcome import Column, Outcome, Row, Table
from sketchterrain.document.label_layers import DRAW_ORDER, label_rgb, labels_in, to_oklab
from sketchterrain.document.store import load_sketch
from sketchterrain.importing.images import read_map
from sketchterrain.importing.legend import NOTHING, Legend, Meaning
from sketchterrain.importing.traced_layers import TraceOptions, sketch_picture

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.benchmarks.timing import TimedContext
    from sketchterrain.document.sketch import Sketch

    Labels = npt.NDArray[np.int64]

OWN: Final = "this program"
NEAREST: Final = "nearest colour of each pixel"

_QUALITIES: Final = (15, 25, 40, 60, 80, 95)
_LARGER: Final = 1.7  # times as many pixels a side the map has
_AWAY: Final = 5  # px: the window in which nothing else lies
_EIGHT = np.ones((3, 3), dtype=bool)
_COLUMNS = (
    Column("method", "method"),
    Column("quality", "JPEG quality"),
    Column("wrong", "wrong labels, % of pixels"),
    Column("wrong_away", "away from borders, %"),
    Column("strange", "labels that are not in the map"),
    Column("river_parts", "parts of rivers"),
    Column("drawn_parts", "drawn"),
    Column("ms", "time, ms"),
)


def measure(_: TimedContext, effort: Effort) -> Outcome:
    """Labels that are wrong after a map went through JPEG, and the time that tracing takes.

    The sketches of the presets are drawn in their labels' colours on white, smoothly scaled to 1.7 times
    their size (Lanczos), saved as JPEG (colours at half resolution) and traced to their own size with the
    legend that they were drawn by. Wrong labels are counted over all pixels, and over those with no other
    label in a window of five; labels that are not in the map are summed over the presets, and so are parts
    of rivers. The rival takes the legend's nearest colour in Oklab of every 1.7th pixel. Milliseconds are
    of all presets together, once.
    """
    presets = [load_sketch(name) for name in effort.presets]
    rows: list[Row] = []
    for quality in _QUALITIES if effort.rounds > 3 else _QUALITIES[1::2]:
        for method, trace in ((OWN, _own), (NEAREST, _nearest)):
            wrong, away, strange, parts, drawn, seconds = [], [], 0, 0, 0, 0.0
            for sketch in presets:
                truth, legend = _labels(sketch), _legend(sketch)
                with tempfile.TemporaryDirectory() as folder:
                    path = Path(folder) / "map.jpg"
                    size = (round(_LARGER * sketch.width_px), round(_LARGER * sketch.height_px))
                    picture = Image.fromarray(sketch_picture(sketch))
                    picture.resize(size, Image.Resampling.LANCZOS).save(path, quality=quality)
                    began = time.perf_counter()
                    found = trace(path, legend, sketch)
                    seconds += time.perf_counter() - began
                bad = found != truth
                inner = ndimage.maximum_filter(truth, _AWAY) == ndimage.minimum_filter(truth, _AWAY)
                wrong.append(bad.mean())
                away.append(bad[inner].mean())
                strange += len(np.setdiff1d(found, truth))
                parts, drawn = parts + _rivers(found), drawn + _rivers(truth)
            rows.append(
                {
                    "method": method,
                    "quality": quality,
                    "wrong": 100.0 * float(np.mean(wrong)),
                    "wrong_away": 100.0 * float(np.mean(away)),
                    "strange": strange,
                    "river_parts": parts,
                    "drawn_parts": drawn,
                    "ms": 1e3 * seconds,
                }
            )
    return Outcome((Table("Labels that come back", _COLUMNS, tuple(rows)),))


def _own(path: Path, legend: Legend, sketch: Sketch) -> Labels:
    longest = max(sketch.width_px, sketch.height_px)
    return _labels(read_map(path, legend).traced(TraceOptions(size_px=longest)).sketch)


def _nearest(path: Path, legend: Legend, sketch: Sketch) -> Labels:
    with Image.open(path) as image:
        size = (sketch.width_px, sketch.height_px)
        rgb = np.asarray(image.convert("RGB").resize(size, Image.Resampling.NEAREST))
    lab = to_oklab(rgb / 255.0)
    colours = to_oklab(np.array(list(legend.colours)) / 255.0)
    nearest = np.argmin(np.stack([((lab - each) ** 2).sum(axis=-1) for each in colours]), axis=0)
    values = np.array([_value(*meaning) for meaning in legend.colours.values()])
    return np.asarray(values[nearest])


def _legend(sketch: Sketch) -> Legend:
    painted = [Meaning(layer, label) for layer in DRAW_ORDER for label in labels_in(sketch.layers[layer])]
    colours = {label_rgb(*each): each for each in painted}
    return Legend({(255, 255, 255): NOTHING, **colours})


def _labels(sketch: Sketch) -> Labels:
    """Return what lies topmost at each pixel of a sketch, as one number."""
    found = np.zeros((sketch.height_px, sketch.width_px), dtype=np.int64)
    for layer in DRAW_ORDER:
        image = sketch.layers[layer]
        found[image > 0] = image[image > 0].astype(np.int64) + _value(layer, 0)
    return found


def _rivers(labels: Labels) -> int:
    return int(ndimage.label(labels // 256 == _place("river"), structure=_EIGHT)[1])


def _value(layer: str, label: int) -> int:
    return 256 * _place(layer) + label


def _place(layer: str) -> int:
    return DRAW_ORDER.index(layer) + 1 if layer in DRAW_ORDER else 0
