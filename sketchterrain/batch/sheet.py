"""Contact sheets: the previews of a batch with their names, so many on a page."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from sketchterrain.export import write_picture

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sketchterrain.batch.manifest import Entry

__all__ = ["COLUMNS", "PAGE", "sheets"]

COLUMNS: Final = 4
PAGE: Final = 40
"""Pictures on a page."""
_PICTURE: Final = (400, 225)
_GAP: Final = 12
_LINE: Final = 22
_SIZE: Final = 15  # px of the letters
_PAPER, _INK, _QUIET, _RED = (250, 250, 248), (40, 40, 40), (225, 225, 222), (170, 30, 30)


def sheets(folder: Path, entries: Sequence[Entry]) -> list[str]:
    """Write the contact sheets of a batch: ``sheet.png``, ``sheet-2.png`` and so on.

    Parameters
    ----------
    folder
        Of the batch.
    entries
        Those that are shown, in this order: with their preview, or with what went wrong.

    Returns
    -------
    list of str
        Names of the files; none where there is no preview at all.

    Raises
    ------
    SketchterrainError
        If one cannot be written.
    """
    if not any(_preview(each) for each in entries):
        return []
    names = []
    for page, first in enumerate(range(0, len(entries), PAGE), start=1):
        name = "sheet.png" if page == 1 else f"sheet-{page}.png"
        write_picture(folder / name, np.asarray(_page(folder, entries[first : first + PAGE])))
        names.append(name)
    return names


def _page(folder: Path, entries: Sequence[Entry]) -> Image.Image:
    columns = min(COLUMNS, len(entries))
    rows = -(-len(entries) // columns)
    width, height = _PICTURE[0] + _GAP, _PICTURE[1] + _LINE + _GAP
    sheet = Image.new("RGB", (columns * width + _GAP, rows * height + _GAP), _PAPER)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(_SIZE)
    for index, entry in enumerate(entries):
        left, top = _GAP + index % columns * width, _GAP + index // columns * height
        picture = _small(folder / entry.name / "preview.png") if _preview(entry) else None
        if picture is None:
            draw.rectangle((left, top, left + _PICTURE[0] - 1, top + _PICTURE[1] - 1), fill=_QUIET)
            told = entry.error or "no preview"
            draw.text((left + _GAP, top + _GAP), _cut(draw, told, font), fill=_RED, font=font)
        else:
            sheet.paste(picture, (left, top))
        draw.text((left, top + _PICTURE[1] + 2), _cut(draw, entry.name, font), fill=_INK, font=font)
    return sheet


def _preview(entry: Entry) -> bool:
    return entry.state != "failed" and any(each.file == "preview.png" for each in entry.files)


def _small(path: Path) -> Image.Image | None:
    """Return a preview as small as the sheet has it; None where it is not there any more."""
    try:
        with Image.open(path, formats=("PNG",)) as picture:
            return picture.convert("RGB").resize(_PICTURE, Image.Resampling.BOX)
    except OSError:
        return None


def _cut(draw: ImageDraw.ImageDraw, text: str, font: ImageFont.FreeTypeFont | ImageFont.ImageFont) -> str:
    """Return a text that fits under a picture: its end, which tells one from the other."""
    room = _PICTURE[0] - 2 * _GAP
    if draw.textlength(text, font=font) <= room:
        return text
    while text and draw.textlength(f"…{text}", font=font) > room:
        text = text[1:]
    return f"…{text}"
