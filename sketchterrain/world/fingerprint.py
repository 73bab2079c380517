"""What a world follows from, as one number: the same number, the same bytes."""

from __future__ import annotations

import json
from dataclasses import asdict
from hashlib import sha256
from importlib.metadata import version
from typing import TYPE_CHECKING, Final

from sketchterrain.batch.output import image_digest
from sketchterrain.sketch.toml_text import settings_text
from sketchterrain.world.code import code_digest

if TYPE_CHECKING:
    from sketchterrain.world.job import Job

__all__ = ["fingerprint"]

_PACKERS: Final = {
    "zarr": ("numcodecs",),
    "tiles": ("rasterio",),  # its GDAL deflates
    "tif": ("rasterio",),
    "none": (),
    "parquet": ("pyarrow",),
    "flatgeobuf": ("pyogrio",),
}


def fingerprint(job: Job) -> str:
    """Return the SHA-256 of a job, as hexadecimal digits.

    Neither the output's place nor the device is part of it: they change no byte.
    """
    whole = {
        "version": version("sketchterrain"),
        "code": code_digest(),
        "settings": settings_text(job.sketch),
        "painted": {name: image_digest(image) for name, image in job.sketch.layers.items()},
        "world": asdict(job.world),
        "form": job.form,
        "layers": sorted(job.layers),
        "plants": job.plants,
        "grass": job.grass,
        "crs": job.crs,
        "origin": job.origin,
        "step": job.step,
        "fast": job.fast,
        "packed by": _packers(job),
    }
    return sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()


def _packers(job: Job) -> dict[str, str]:
    """Return the libraries whose versions may change bytes of files, but no value in them."""
    wanted = (*_PACKERS[job.form], *_PACKERS[job.plants])
    return {name: version(name) for name in wanted}
