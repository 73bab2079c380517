"""The gallery: each preset near the ground, from a hill and from the air, at dawn, at noon and under clouds.

``python -m sketchterrain.benchmarks.gallery DIR [PRESET …] [--size 1920x1080] [--quality 1]`` writes the
pictures and a sheet of them for each preset.
"""

import argparse
import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from PIL import Image

from sketchterrain.document.store import load_sketch
from sketchterrain.io.files import write_atomic
from sketchterrain.io.resources import preset_names
from sketchterrain.render.offscreen import render_picture
from sketchterrain.render.quality import Quality
from sketchterrain.render.sky import Weather
from sketchterrain.terrain.building import build
from sketchterrain.terrain.terrain import Terrain

VIEWS: Final = ("ground", "hill", "air")
LIGHTS: Final = {
    "dawn": {"hour": 6.5, "clouds": 0.25},
    "noon": {"hour": 12.5, "clouds": 0.4},
    "overcast": {"hour": 10.0, "clouds": 1.0},
}
"""What `Weather.from_sketch` is given for each."""
_THUMBNAIL: Final = (640, 360)


def pictures(
    terrain: Terrain, *, size: tuple[int, int], quality: Quality
) -> Iterator[tuple[str, str, Image.Image]]:
    """Yield the view's name, the light's name and the picture, for each of both."""
    for view in VIEWS:
        for light, told in LIGHTS.items():
            weather = Weather.from_sketch(terrain.sketch, **told)
            pixels = render_picture(terrain, size=size, view=view, weather=weather, quality=quality)
            yield view, light, Image.fromarray(pixels)


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the gallery of some presets, all by default."""
    parser = argparse.ArgumentParser(description="Each preset from three heights in three lights.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("presets", nargs="*", default=preset_names())
    parser.add_argument("--size", default="1920x1080")
    parser.add_argument("--quality", type=float, default=1.0)
    asked = parser.parse_args(arguments)
    width, height = (int(part) for part in asked.size.split("x"))
    asked.folder.mkdir(parents=True, exist_ok=True)
    for preset in asked.presets:
        terrain = build(load_sketch(preset))
        sheet = Image.new("RGB", (_THUMBNAIL[0] * len(LIGHTS), _THUMBNAIL[1] * len(VIEWS)))
        for view, light, picture in pictures(
            terrain, size=(width, height), quality=Quality.from_level(asked.quality)
        ):
            _write(asked.folder / f"{preset}-{view}-{light}.png", picture)
            place = (list(LIGHTS).index(light) * _THUMBNAIL[0], VIEWS.index(view) * _THUMBNAIL[1])
            sheet.paste(picture.resize(_THUMBNAIL, Image.Resampling.LANCZOS), place)
        _write(asked.folder / f"{preset}.png", sheet)


def _write(path: Path, picture: Image.Image) -> None:
    stream = io.BytesIO()
    picture.save(stream, format="PNG")
    write_atomic(path, stream.getvalue())


if __name__ == "__main__":
    main()
