"""A map as people draw them, with lettering and through JPEG, beside the sketch traced from it.

``python -m sketchterrain.benchmarks.trace_picture docs/tracing.png`` draws the picture of docs/tracing.md.
"""

from __future__ import annotations

import io
import sys
import tempfile
from pathlib import Path
from typing import Final

from PIL import Image, ImageDraw, ImageFont

from sketchterrain.importing.images import read_map
from sketchterrain.importing.traced_layers import TraceOptions, preview_png
from sketchterrain.io.files import write_atomic

_SIZE: Final = (600, 420)
_FINER: Final = 4  # times as large it is drawn, then scaled down: antialiased
_QUALITY: Final = 70  # of the JPEG
_AREAS: Final = (
    ("#add19e", ((40, 210), (150, 190), (230, 240), (210, 330), (90, 360), (30, 300))),
    ("#f5e9c6", ((380, 300), (560, 270), (590, 390), (430, 400))),
    ("#8b5a2b", ((60, 40), (190, 25), (300, 70), (330, 130), (240, 160), (120, 120))),
    ("#7aa048", ((360, 60), (470, 40), (540, 110), (480, 170), (380, 150))),
)
_LAKE: Final = (250, 250, 340, 320)
_RIVERS: Final = (
    ((210, 150), (240, 190), (235, 225), (275, 262)),
    ((328, 300), (360, 330), (350, 370), (372, 425)),
    ((470, 165), (440, 200), (400, 225), (335, 280)),
)
_NAMES: Final = (
    ("THE BROWN MOUNTAINS", (92, 74), 15),
    ("Deepwood", (88, 262), 18),
    ("Long Mere", (262, 278), 12),
    ("Green Downs", (398, 98), 14),
    ("The Sands", (455, 330), 16),
    ("River Ash", (383, 205), 12),
)


def draw_map() -> Image.Image:
    """Return a map of 600×420 px in the colours of common maps, antialiased and lettered."""
    picture = Image.new("RGB", (_SIZE[0] * _FINER, _SIZE[1] * _FINER), "#f2efe9")
    draw = ImageDraw.Draw(picture)
    for colour, corners in _AREAS:
        points = _finer(corners)
        draw.polygon(points, fill=colour)
        draw.line([*points, points[0]], fill="#303030", width=_FINER, joint="curve")
    draw.ellipse(tuple(_FINER * each for each in _LAKE), fill="#aad3df")
    for course in _RIVERS:
        draw.line(_finer(course), fill="#3874c4", width=4 * _FINER, joint="curve")
    for name, (left, top), size in _NAMES:
        font = ImageFont.load_default(size * _FINER)
        draw.text((left * _FINER, top * _FINER), name, fill="black", font=font)
    return picture.resize(_SIZE, Image.Resampling.LANCZOS)


def main(arguments: list[str]) -> None:
    """Write the picture to the file that is named."""
    stream = io.BytesIO()
    draw_map().save(stream, "JPEG", quality=_QUALITY)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.jpg"
        path.write_bytes(stream.getvalue())
        read = read_map(path)
        traced = read.traced(TraceOptions())
    write_atomic(Path(arguments[0]), preview_png(traced.sketch, read.rgba))
    sys.stdout.writelines(f"{line}\n" for line in traced.notes)


def _finer(points: tuple[tuple[int, int], ...]) -> list[tuple[int, int]]:
    return [(_FINER * x, _FINER * y) for x, y in points]


if __name__ == "__main__":
    main(sys.argv[1:])
