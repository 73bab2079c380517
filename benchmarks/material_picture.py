"""Every texture of materials as a picture: lit, once near and once tiled.

``python -m sketchterrain.benchmarks.material_picture FILE`` draws them.
"""

import io
import sys
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

from sketchterrain.compute.context import ComputeContext
from sketchterrain.io.files import write_atomic
from sketchterrain.look.texture_maker import LAYERS, emboss, paint_layer

_SIDE = 1024  # texels
_PANEL = 320  # px
_ACROSS = 3  # materials side by side
_TILES = 3
_TO_SUN = (-0.6, 0.5, 0.62)
_SUN, _SKY = (2.4, 2.3, 2.1), (0.56, 0.67, 0.84)
_EXPOSURE = {"snow": 0.55, "sand": 0.9}
_OTHERS_EXPOSURE = 1.6


def draw_materials(context: ComputeContext) -> Image.Image:
    """Draw all materials, three a row: a third of the texture's width, and three times three of it."""
    rows = -(-len(LAYERS) // _ACROSS)
    picture = Image.new("RGB", (2 * _PANEL * _ACROSS, _PANEL * rows))
    for index, (name, layer) in enumerate(LAYERS.items()):
        painted = paint_layer(context, index, _SIDE)
        light = _lit(painted, emboss(context, painted, layer))
        light *= _EXPOSURE.get(name, _OTHERS_EXPOSURE)
        near = light[: _SIDE // 3, : _SIDE // 3]
        tiled = np.tile(light, (_TILES, _TILES, 1))
        left, top = 2 * _PANEL * (index % _ACROSS), _PANEL * (index // _ACROSS)
        for column, part in enumerate((near, tiled)):
            panel = _developed(part).resize((_PANEL, _PANEL), Image.Resampling.BOX)
            picture.paste(panel, (left + column * _PANEL, top))
    return picture


def _lit(painted: npt.NDArray[Any], relief: npt.NDArray[Any]) -> npt.NDArray[Any]:
    normal = np.concatenate([-relief[..., :2], np.ones_like(relief[..., :1])], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    sun = np.clip(normal @ (np.array(_TO_SUN) / np.linalg.norm(_TO_SUN)), 0.0, None)[..., None]
    openness = relief[..., 3:]
    light = np.array(_SUN) * sun * (0.5 + 0.5 * openness) + np.array(_SKY) * openness
    return np.asarray(painted[..., :3] * light)


def _developed(light: npt.NDArray[Any]) -> Image.Image:
    shown = np.clip(light * (1.0 + light / 4.0) / (1.0 + light), 0.0, 1.0) ** (1.0 / 2.2)
    return Image.fromarray((255.0 * shown[::-1]).astype(np.uint8))


def main(arguments: list[str]) -> int:
    """Write the picture into the file that is named."""
    stream = io.BytesIO()
    draw_materials(ComputeContext()).save(stream, format="jpeg", quality=88)
    write_atomic(Path(arguments[0]), stream.getvalue())
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
