"""What is written of each terrain of a batch, what it takes, and the hash of what it follows from."""

import json
from dataclasses import dataclass
from hashlib import sha256
from importlib.metadata import version
from typing import Final, NamedTuple

import msgspec

from sketchterrain.estimate import plant_bytes
from sketchterrain.export.target import ExportOptions
from sketchterrain.exporting import checked_plan
from sketchterrain.exporting import memory_needed as export_memory
from sketchterrain.sizes import check_size, memory_needed
from sketchterrain.sketch import Sketch
from sketchterrain.sketch.document import LabelImage
from sketchterrain.sketch.toml_text import settings_text

DEFAULT_SIZE: Final = 1025
PREVIEW_MEMORY: Final = 1600 << 20  # bytes, for all previews; measured with OpenGL on a processor
_PREVIEW_DISK: Final = 3 << 20
_VERTEX_DISK: Final = 9  # bytes: heights twice, normals, materials; the presets take 7


@dataclass(frozen=True)
class Output:
    """What is written of each terrain; without a target, the files of ``generate``.

    `size` is in vertices along the longer side (None: what suits the target, or `DEFAULT_SIZE`).
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


class Needs(NamedTuple):
    """What a terrain takes: vertices, bytes of memory but for its preview, bytes of disk."""

    vertices: int
    memory: float
    disk: float


def needs_of(sketch: Sketch, output: Output) -> Needs:
    """Return what a terrain takes; raise SketchterrainError if there cannot be one."""
    east, north = sketch.size
    if output.target is None:
        size = output.size or DEFAULT_SIZE
        check_size(sketch, size)
        vertices = size * (round((size - 1) * min(east, north) / max(east, north)) + 1)
        memory, disk = memory_needed(sketch, size), float(_VERTEX_DISK * vertices)
        disk += plant_bytes(east * north, output.foliage, grass=output.grass)
    else:
        options = output.options or ExportOptions()
        wanted = checked_plan(sketch, output.target, options)
        vertices, memory = wanted.vertices, export_memory(wanted)
        disk = wanted.target.disk * vertices + plant_bytes(east * north, "csv", grass=options.grass)
    return Needs(vertices, memory, disk + output.preview * _PREVIEW_DISK)


def fingerprint(sketch: Sketch, output: Output) -> str:
    """Return a hash of what a terrain's files follow from; the device is not part, for it changes no bit."""
    layers = {name: image_digest(image) for name, image in sketch.layers.items()}
    whole = {"version": version("sketchterrain"), "output": msgspec.to_builtins(output)}
    whole |= {"layers": layers, "settings": settings_text(sketch)}
    return sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()


def image_digest(image: LabelImage) -> str:
    """Return the SHA-256 of a layer's shape and labels, as hexadecimal digits."""
    return sha256(f"{image.shape}".encode() + image.tobytes()).hexdigest()
