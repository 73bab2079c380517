"""A picture of how far a terrain does what its sketch says."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from sketchterrain.export.files import write_png

if TYPE_CHECKING:
    from sketchterrain.terrain import Terrain
    from sketchterrain.terrain.adherence import Adherence


Pixels = npt.NDArray[np.uint8]
# Okabe and Ito's palette, which colour-blind people can tell apart.
_COLOURS = {"both": (0, 158, 115), "painted only": (230, 130, 0), "terrain only": (204, 70, 150)}
_MEANINGS = {
    "both": "as painted",
    "painted only": "missing: painted, but not in the terrain",
    "terrain only": "spill: in the terrain, but not painted",
}
_TINT = 0.55  # share of the colour over the hillshade
_SHORTER_SIDE = 512  # px of a panel
_GAP = 14
_HEADING = 34
_TEXT = (40, 40, 40)
_PAPER = (255, 255, 255)
_SUN = np.array([-0.5, 0.5, 0.7]) / np.linalg.norm([-0.5, 0.5, 0.7])


def write_agreement(path: Path, terrain: Terrain, adherence: Adherence) -> tuple[Path, ...]:
    """Write :func:`agreement_picture` as a PNG at `path`."""
    return (write_png(path, agreement_picture(terrain, adherence)),)


def agreement_picture(terrain: Terrain, adherence: Adherence) -> Pixels:
    """Return a panel for each painted layer, over the terrain's hillshade, and a legend.

    Parameters
    ----------
    terrain : Terrain
    adherence : Adherence
        As measured on this terrain.

    Returns
    -------
    (height, width, 3) uint8
    """
    shade = _hillshade(terrain)
    panels = [
        _panel(shade, images.painted, images.affected, _title(adherence, name))
        for name, images in adherence.images.items()
    ]
    panels = panels or [
        _panel(shade, np.zeros(shade.shape, bool), np.zeros(shade.shape, bool), "not painted")
    ]
    columns = min(len(panels), 3)
    rows = -(-len(panels) // columns)
    width, height = panels[0].size
    legend = 34
    sheet = Image.new(
        "RGB", (columns * (width + _GAP) + _GAP, _HEADING + rows * (height + _GAP) + _GAP + legend), _PAPER
    )
    for index, panel in enumerate(panels):
        row, column = divmod(index, columns)
        sheet.paste(panel, (_GAP + column * (width + _GAP), _HEADING + row * (height + _GAP)))
    _draw_heading(sheet, terrain)
    _draw_legend(sheet, sheet.height - legend)
    return np.asarray(sheet, np.uint8)


def _panel(
    shade: npt.NDArray[np.float32], painted: npt.NDArray[np.bool_], shown: npt.NDArray[np.bool_], title: str
) -> Image.Image:
    pixels = np.repeat(shade[..., None], 3, axis=-1)
    areas = {"both": painted & shown, "painted only": painted & ~shown, "terrain only": shown & ~painted}
    for name, area in areas.items():
        colour = np.array(_COLOURS[name], np.float32)
        pixels[area] = (1.0 - _TINT) * pixels[area] + _TINT * colour * (pixels[area] / 200.0)
    image = Image.fromarray(np.clip(pixels, 0, 255).astype(np.uint8))
    scale = _SHORTER_SIDE / min(image.size)
    size = (max(round(image.width * scale), 1), max(round(image.height * scale), 1))
    how = Image.Resampling.NEAREST if scale > 1.0 else Image.Resampling.BOX
    panel = Image.new("RGB", (size[0], size[1] + 24), _PAPER)
    panel.paste(image.resize(size, how), (0, 24))
    ImageDraw.Draw(panel).text((0, 3), title, fill=_TEXT, font=ImageFont.load_default(14))
    return panel


def _title(adherence: Adherence, name: str) -> str:
    layer = adherence.layers[name]
    shapes = f"{layer.shapes} shape" + ("" if layer.shapes == 1 else "s")
    parts = [f"{name}: {shapes}", f"{layer.lost} lost"]
    if layer.iou_mean is not None:
        parts.append(f"overlap {layer.iou_mean:.0%}")
    courses = [river.mean_distance for river in adherence.rivers if river.mean_distance is not None]
    if name == "river" and courses:
        # A stroke says where a river runs and its label how wide it is: the overlap alone would mislead.
        parts.append(f"course {np.mean(courses):.1f} px off")
    return ", ".join(parts)


def _draw_heading(sheet: Image.Image, terrain: Terrain) -> None:
    sketch = terrain.sketch
    text = f"{sketch.name}, seed {sketch.seed}, fidelity {sketch.fidelity:g}: what became of each layer"
    ImageDraw.Draw(sheet).text((_GAP, 8), text, fill=_TEXT, font=ImageFont.load_default(17))


def _draw_legend(sheet: Image.Image, top: int) -> None:
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(14)
    left = float(_GAP)
    for name, colour in _COLOURS.items():
        draw.rectangle((left, top + 4, left + 18, top + 20), fill=colour)
        draw.text((left + 26, top + 4), _MEANINGS[name], fill=_TEXT, font=font)
        left += 26 + draw.textlength(_MEANINGS[name], font=font) + 26


def _hillshade(terrain: Terrain) -> npt.NDArray[np.float32]:
    """Grey from 60 to 245 at each pixel of the sketch, lit from the north-west."""
    sketch, step = terrain.sketch, terrain.sketch.pixel_size
    x = (np.arange(-1, sketch.width_px + 1) + 0.5) * step
    y = (sketch.height_px - np.arange(-1, sketch.height_px + 1) - 0.5) * step
    height = terrain.heights(x[None, :], y[:, None], cell_size=step)
    east = (height[1:-1, 2:] - height[1:-1, :-2]) / (2.0 * step)
    north = (height[:-2, 1:-1] - height[2:, 1:-1]) / (2.0 * step)
    light = (_SUN[2] - east * _SUN[0] - north * _SUN[1]) / np.sqrt(1.0 + east**2 + north**2)
    return np.asarray(60.0 + 185.0 * np.clip(light, 0.0, 1.0), np.float32)
