"""Maps of what is measured, over a hillshade: adherence of painted layers, faults of landforms."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont
from scipy import ndimage

from sketchterrain.export.files import write_png
from sketchterrain.schema.layers import LAYERS

if TYPE_CHECKING:
    from sketchterrain.generation.terrain import Terrain
    from sketchterrain.measure.adherence import Adherence
    from sketchterrain.measure.realism import Realism

# Okabe and Ito's palette for colour-blind readers.
_AREAS = {
    "as painted": (0, 158, 115),
    "missing: painted, but not in the terrain": (230, 130, 0),
    "spill: in the terrain, but not painted": (204, 70, 150),
}
_TINT = 0.55  # opacity of the colours over the hillshade
_SHORTER_SIDE = 512  # px of a panel
_GAP, _HEADING, _LEGEND_HEIGHT, _TITLE_HEIGHT = 14, 34, 34, 24  # px
_TEXT = (40, 40, 40)
_PAPER = (255, 255, 255)
_SUN = np.array([-0.5, 0.5, 0.7]) / np.linalg.norm([-0.5, 0.5, 0.7])


def write_adherence_image(path: Path, terrain: Terrain, adherence: Adherence) -> tuple[Path, ...]:
    """Write a panel for each painted layer over the terrain's hillshade, with a legend, as a PNG."""
    shade = _hillshade(terrain)
    panels = [
        _panel(shade, images.painted, images.affected, _title(adherence, name))
        for name, images in adherence.images.items()
    ]
    nothing = np.zeros(shade.shape, bool)
    panels = panels or [_panel(shade, nothing, nothing, "not painted")]
    columns = min(len(panels), 3)
    rows = -(-len(panels) // columns)
    width, height = panels[0].size
    size = (columns * (width + _GAP) + _GAP, _HEADING + rows * (height + _GAP) + _GAP + _LEGEND_HEIGHT)
    image = Image.new("RGB", size, _PAPER)
    for index, panel in enumerate(panels):
        row, column = divmod(index, columns)
        image.paste(panel, (_GAP + column * (width + _GAP), _HEADING + row * (height + _GAP)))
    draw, sketch = ImageDraw.Draw(image), terrain.sketch
    heading = f"{sketch.name}, seed {sketch.seed}, fidelity {sketch.fidelity:g}: adherence of each layer"
    draw.text((_GAP, 8), heading, fill=_TEXT, font=ImageFont.load_default(17))
    _draw_legend(draw, size[1] - _LEGEND_HEIGHT, _AREAS)
    return (write_png(path, np.asarray(image, np.uint8)),)


def _panel(
    shade: npt.NDArray[np.float32], painted: npt.NDArray[np.bool_], terrain: npt.NDArray[np.bool_], title: str
) -> Image.Image:
    pixels = np.repeat(shade[..., None], 3, axis=-1)
    areas = painted & terrain, painted & ~terrain, terrain & ~painted
    for area, colour in zip(areas, np.array([*_AREAS.values()], np.float32), strict=True):
        pixels[area] = (1.0 - _TINT) * pixels[area] + _TINT * colour * (pixels[area] / 200.0)
    image = Image.fromarray(np.clip(pixels, 0, 255).astype(np.uint8))
    scale = _SHORTER_SIDE / min(image.size)
    size = (max(round(image.width * scale), 1), max(round(image.height * scale), 1))
    resampling = Image.Resampling.NEAREST if scale > 1.0 else Image.Resampling.BOX
    panel = Image.new("RGB", (size[0], size[1] + _TITLE_HEIGHT), _PAPER)
    panel.paste(image.resize(size, resampling), (0, _TITLE_HEIGHT))
    ImageDraw.Draw(panel).text((0, 3), title, fill=_TEXT, font=ImageFont.load_default(14))
    return panel


def _title(adherence: Adherence, name: str) -> str:
    layer = adherence.layers[name]
    shapes = f"{layer.shapes} shape" + ("" if layer.shapes == 1 else "s")
    parts = [f"{name}: {shapes}", f"{layer.lost} lost"]
    if layer.iou_mean is not None:
        parts.append(f"overlap {layer.iou_mean:.0%}")
    ratios = [
        each.reached / each.built
        for each in adherence.shapes
        if each.layer == name and each.reached and each.built
    ]
    if ratios:
        parts.append(f"heights {min(ratios):.0%} to {max(ratios):.0%}")
    courses = [river.mean_distance for river in adherence.rivers if river.mean_distance is not None]
    if LAYERS[name].kind == "course" and courses:
        # A stroke gives a river's course and its label the width: the overlap alone would mislead.
        parts.append(f"course {np.mean(courses):.1f} px off")
    return ", ".join(parts)


def _draw_legend(draw: ImageDraw.ImageDraw, top: int, colours: dict[str, tuple[int, int, int]]) -> None:
    font = ImageFont.load_default(14)
    left = float(_GAP)
    for meaning, colour in colours.items():
        draw.rectangle((left, top + 4, left + 18, top + 20), fill=colour)
        draw.text((left + 26, top + 4), meaning, fill=_TEXT, font=font)
        left += 26 + draw.textlength(meaning, font=font) + 26


def _hillshade(terrain: Terrain) -> npt.NDArray[np.float32]:
    """Return greys at each pixel of the sketch, lit from the north-west."""
    sketch, step = terrain.sketch, terrain.sketch.pixel_size
    x = (np.arange(-1, sketch.width_px + 1) + 0.5) * step
    y = (sketch.height_px - np.arange(-1, sketch.height_px + 1) - 0.5) * step
    height = terrain.heights(x[None, :], y[:, None], cell_size=step)
    east = (height[1:-1, 2:] - height[1:-1, :-2]) / (2.0 * step)
    north = (height[:-2, 1:-1] - height[2:, 1:-1]) / (2.0 * step)
    return np.asarray(_lit(east, north), np.float32)


def _lit(east: npt.NDArray[Any], north: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return greys from 60 to 245 of ground with slopes (m/m) eastward and northward."""
    light = (_SUN[2] - east * _SUN[0] - north * _SUN[1]) / np.sqrt(1.0 + east**2 + north**2)
    return np.asarray(60.0 + 185.0 * np.clip(light, 0.0, 1.0))


_FAULTS = {
    "hollow": ("closed hollow", (40, 110, 220)),
    "rising": ("channel that rises", (204, 40, 120)),
    "wall": ("steeper than real land's 95 %", (230, 130, 0)),
}
_FAULT_TINT = 0.7
_MAP_SIDE = 768  # px, at least, of a map of faults


def write_realism_map(path: Path, realism: Realism) -> Path:
    """Write a hillshade with the faults of :meth:`Realism.fault_maps` and a legend, as a PNG."""
    image = Image.fromarray(_fault_pixels(realism))
    scale = max(_MAP_SIDE / min(image.size), 1.0)
    size = (round(image.width * scale), round(image.height * scale))
    sheet = Image.new("RGB", (size[0], size[1] + _LEGEND_HEIGHT), _PAPER)
    sheet.paste(image.resize(size, Image.Resampling.NEAREST))
    _draw_legend(ImageDraw.Draw(sheet), size[1] + 4, dict(_FAULTS.values()))
    return write_png(path, np.asarray(sheet, np.uint8))


def _fault_pixels(realism: Realism) -> npt.NDArray[np.uint8]:
    """Return a hillshade with coloured faults, (rows, columns, 3)."""
    south, east = np.gradient(np.where(np.isfinite(realism.height), realism.height, 0.0), realism.cell)
    pixels = np.repeat(_lit(east, -south)[..., None], 3, axis=-1)
    faults = realism.fault_maps()
    faults["rising"] = ndimage.binary_dilation(faults["rising"], np.ones((2, 2), np.bool_))
    for name in ("wall", "hollow", "rising"):
        colour = np.array(_FAULTS[name][1])
        pixels[faults[name]] = (1.0 - _FAULT_TINT) * pixels[faults[name]] + _FAULT_TINT * colour
    return np.asarray(np.clip(pixels, 0, 255), np.uint8)
