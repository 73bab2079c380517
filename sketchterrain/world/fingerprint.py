"""The fingerprint of a job: equal fingerprints mean equal bytes."""

from __future__ import annotations

import json
from dataclasses import asdict
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from importlib.resources import files
from typing import Final

from sketchterrain.batch.output import image_digest
from sketchterrain.sketch.toml_text import settings_text
from sketchterrain.world.job import Job

_ROOMS: Final = ("sketch", "features", "compute", "terrain", "export", "world", "kernels")
_ENDINGS: Final = (".py", ".cl", ".clh")
_PACKERS: Final = {
    "zarr": ("zarr", "numcodecs"),
    "tiles": ("rasterio",),
    "tif": ("rasterio",),
    "none": (),
    "parquet": ("pyarrow",),
    "flatgeobuf": ("pyogrio",),
}
"""Libraries whose versions may change bytes of files, but no value in them."""


def fingerprint(job: Job) -> str:
    """Return the SHA-256 of all that a world's bytes follow from: not the output's path, nor the device."""
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
        "libraries": {name: version(name) for name in (*_PACKERS[job.form], *_PACKERS[job.plants])},
    }
    return sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()


@cache
def code_digest() -> str:
    """Return the SHA-256 of the code and the kernels that a world's bytes follow from."""
    digest = sha256()
    for room in _ROOMS:
        sources = [
            each
            for each in files(f"sketchterrain.{room}").iterdir()
            if each.name.endswith(_ENDINGS) and each.is_file()
        ]
        for each in sorted(sources, key=lambda found: found.name):
            digest.update(f"{room}/{each.name}\n".encode())
            digest.update(each.read_bytes())
    return digest.hexdigest()
