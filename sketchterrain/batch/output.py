"""What is written of each terrain of a batch, and what that and its sketch are known by."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from hashlib import sha256
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from sketchterrain.sketch.toml_text import settings_text

if TYPE_CHECKING:
    from sketchterrain.export.target import ExportOptions
    from sketchterrain.sketch import Sketch
    from sketchterrain.sketch.document import LabelImage

__all__ = ["Fingerprints", "Output", "image_digest"]


@dataclass(frozen=True)
class Output:
    """What is written of each terrain.

    Attributes
    ----------
    size : int or None
        Vertices along the longer side; None: what suits the target, 1025 where there is none.
    preview : bool
        Whether there is a ``preview.png``.
    view : str
        What kind of view it shows.
    foliage : str
        As what plants are written; see :class:`~sketchterrain.export.FoliageFiles`.
    grass : bool
        Whether grass is, too.
    map : str or None
        ``png`` or ``svg``: there is a map.
    target : str or None
        A target of `sketchterrain.export`; None: the files of ``generate``.
    options : ExportOptions or None
        Of the target.
    fast : bool
        Whether the kernels may trade bits for speed.
    """

    size: int | None = None
    preview: bool = True
    view: str = "auto"
    foliage: str = "csv"
    grass: bool = False
    map: str | None = None
    target: str | None = None
    options: ExportOptions | None = None
    fast: bool = False

    def as_dict(self) -> dict[str, Any]:
        """Return all of it as JSON has it."""
        told: dict[str, Any] = json.loads(json.dumps(asdict(self)))
        return told


class Fingerprints:
    """What the files of a terrain follow from, as one number.

    The same number: the same sketch, seed and settings, written as the same files by the same version of the
    program. The device is not part of it, for it changes no bit.

    Parameters
    ----------
    output
    """

    def __init__(self, output: Output) -> None:
        self._made_by = {"version": version("sketchterrain"), "output": output.as_dict()}
        self._images: dict[int, tuple[LabelImage, str]] = {}

    def of(self, sketch: Sketch) -> str:
        """Return the SHA-256 of a sketch and of what is written of it, as hexadecimal digits."""
        layers = {name: self._image(image) for name, image in sketch.layers.items()}
        whole = {**self._made_by, "layers": layers, "settings": settings_text(sketch)}
        return sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()

    def _image(self, image: LabelImage) -> str:
        # Images are read-only and shared by all seeds: each is hashed once.
        known = self._images.get(id(image))
        if known is None:
            known = self._images[id(image)] = image, image_digest(image)
        return known[1]


def image_digest(image: LabelImage) -> str:
    """Return the SHA-256 of a layer's shape and labels, as hexadecimal digits."""
    return sha256(f"{image.shape}".encode() + image.tobytes()).hexdigest()
