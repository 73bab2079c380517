"""User textures: images in a folder, by material."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image, UnidentifiedImageError

from sketchterrain.errors import InputError, one_line
from sketchterrain.look.texture_maker import LAYERS
from sketchterrain.look.texture_mips import linear

KINDS: Final = ("", "_height", "_normal", "_roughness")
"""Suffixes of a material's name; the albedo has none."""
SUFFIXES: Final = (".png", ".jpg", ".jpeg")
_STEEPEST: Final = 8.0
"""Largest slope of a normal map."""
_LARGEST: Final = 16384
"""Largest side, px."""


@dataclass(frozen=True, eq=False)
class MaterialImages:
    """Images of a material, row 0 south: linear albedo, height and roughness 0..1, slopes east and north."""

    albedo: npt.NDArray[Any] | None = None
    height: npt.NDArray[Any] | None = None
    slopes: npt.NDArray[Any] | None = None
    roughness: npt.NDArray[Any] | None = None


def read_material_images(folder: Path, size: int) -> dict[str, MaterialImages]:
    """Read ``rock.png``, ``rock_height.png``, ``rock_normal.jpg``, …, resized to `size` texels a side.

    Colours are sRGB; a normal map has x to the right, y up and z to the eye in red, green and blue; height
    and roughness are grey, of 8 or 16 bits. Any image may be missing; other files are ignored.
    """
    if not folder.is_dir():
        raise InputError(f"{one_line(folder)}: expected a folder of textures")
    found: dict[str, dict[str, npt.NDArray[Any]]] = {}
    for path in sorted(each for each in folder.iterdir() if each.suffix.lower() in SUFFIXES):
        material, kind = _split_name(path)
        field = {"": "albedo", "_height": "height", "_normal": "slopes", "_roughness": "roughness"}[kind]
        if field in found.setdefault(material, {}):
            raise InputError(
                f"{one_line(path)}: expected one picture {path.stem}, got two of different suffixes"
            )
        found[material][field] = _read(path, kind, size)
    return {material: MaterialImages(**fields) for material, fields in found.items()}


def _split_name(path: Path) -> tuple[str, str]:
    for material in LAYERS:
        for kind in KINDS:
            if path.stem == material + kind:
                return material, kind
    ends = ", ".join(kind for kind in KINDS if kind)
    raise InputError(
        f"{one_line(path)}: expected the name of a material, {', '.join(LAYERS)}, alone or with {ends}"
    )


def _read(path: Path, kind: str, size: int) -> npt.NDArray[Any]:
    try:
        with Image.open(path) as picture:
            if max(picture.size) > _LARGEST:
                got = f"{picture.width}×{picture.height}"
                raise InputError(f"{one_line(path)}: expected sides of {_LARGEST} px at most, got {got}")
            if kind in {"", "_normal"}:
                values = np.asarray(picture.convert("RGB"), np.float32) / 255.0
            else:
                wide = picture.mode.startswith(("I", "F"))
                values = np.asarray(picture if wide else picture.convert("L"), np.float32)
                values = values / (65535.0 if wide else 255.0)
    except (OSError, ValueError, SyntaxError, UnidentifiedImageError, Image.DecompressionBombError) as error:
        raise InputError(f"{one_line(path)}: expected a picture, PNG or JPEG ({one_line(error)})") from error
    values = linear(values) if kind == "" else values
    if kind == "_normal":
        normal = 2.0 * values - 1.0
        values = -normal[..., :2] / np.maximum(normal[..., 2:], 1.0 / _STEEPEST)
    channels = [values] if values.ndim == 2 else list(np.moveaxis(values, -1, 0))
    resized = [_resized(channel, size)[::-1] for channel in channels]
    return resized[0] if values.ndim == 2 else np.stack(resized, axis=-1)


def _resized(channel: npt.NDArray[Any], size: int) -> npt.NDArray[Any]:
    picture = Image.fromarray(np.ascontiguousarray(channel, np.float32))
    return np.asarray(
        picture.resize(
            (size, size), Image.Resampling.BOX if min(picture.size) >= size else Image.Resampling.BICUBIC
        )
    )
