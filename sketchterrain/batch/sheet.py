"""Contact sheets: the previews of a batch with their names, so many on a page."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from sketchterrain.batch.manifest import Entry
from sketchterrain.export.images import write_picture

COLUMNS: Final = 4
PAGE: Final = 40  # pictures on a page
_PICTURE: Final = (400, 225)
_GAP, _LINE, _FONT = 12, 22, 15  # px
_PAPER, _INK, _QUIET, _RED = (250, 250, 248), (40, 40, 40), (225, 225, 222), (170, 30, 30)


def write_sheets(folder: Path, entries: Sequence[Entry]) -> list[str]:
    """Write ``sheet.png``, ``sheet-2.png`` and so on; return their names, none where there is no preview.

    Entries are shown in this order, with their preview, or with what went wrong.
    """
    if not any(_has_preview(each) for each in entries):
        return []
    names = []
    for page, first in enumerate(range(0, len(entries), PAGE), start=1):
        names.append("sheet.png" if page == 1 else f"sheet-{page}.png")
        write_picture(folder / names[-1], np.asarray(_page(folder, entries[first : first + PAGE])))
    return names


def _page(folder: Path, entries: Sequence[Entry]) -> Image.Image:
    columns = min(COLUMNS, len(entries))
    rows = -(-len(entries) // columns)
    width, height = _PICTURE[0] + _GAP, _PICTURE[1] + _LINE + _GAP
    sheet = Image.new("RGB", (columns * width + _GAP, rows * height + _GAP), _PAPER)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(_FONT)
    for index, entry in enumerate(entries):
        left, top = _GAP + index % columns * width, _GAP + index // columns * height
        picture = _thumbnail(folder / entry.name / "preview.png") if _has_preview(entry) else None
        if picture is None:
            draw.rectangle((left, top, left + _PICTURE[0] - 1, top + _PICTURE[1] - 1), fill=_QUIET)
            problem = _fitting(draw, entry.error or "no preview", font)
            draw.text((left + _GAP, top + _GAP), problem, fill=_RED, font=font)
        else:
            sheet.paste(picture, (left, top))
        draw.text((left, top + _PICTURE[1] + 2), _fitting(draw, entry.name, font), fill=_INK, font=font)
    return sheet


def _has_preview(entry: Entry) -> bool:
    return entry.state != "failed" and any(each.file == "preview.png" for each in entry.files)


def _thumbnail(path: Path) -> Image.Image | None:
    """Return a preview at the size of the sheet; None where it is missing."""
    try:
        with Image.open(path, formats=("PNG",)) as picture:
            return picture.convert("RGB").resize(_PICTURE, Image.Resampling.BOX)
    except OSError:
        return None


def _fitting(draw: ImageDraw.ImageDraw, text: str, font: ImageFont.FreeTypeFont | ImageFont.ImageFont) -> str:
    """Return as much of the end of a text as fits under a picture."""
    width = _PICTURE[0] - 2 * _GAP
    cuts = (text, *(f"…{text[cut:]}" for cut in range(1, len(text))), "…")
    return next(each for each in cuts if draw.textlength(each, font=font) <= width)
