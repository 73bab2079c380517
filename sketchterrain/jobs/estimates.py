"""Estimates of memory and disk space, checked before work starts, and of the time that it takes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from sketchterrain.errors import InputError
from sketchterrain.io.files import check_disk, format_bytes, free_disk_space
from sketchterrain.io.system import free_memory, physical_memory

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch


# Bytes on disk, compressed: the most that the presets took as Zarr and as GeoTIFF.
_LAYER_BYTES = {"height": 2.9, "normal": 2.0, "materials": 1.1, "appearance": 1.5}
_PLANT_BYTES = {"none": 0, "csv": 84, "ply": 36, "both": 120, "parquet": 40, "flatgeobuf": 190}
_WOODY, _GRASS = 0.004, 2.0  # plants per square metre


@dataclass(frozen=True)
class Estimate:
    """Bytes on disk by part, those already present, and peak bytes of memory."""

    disk: dict[str, float]
    memory: float
    present: float = 0.0

    @property
    def disk_needed(self) -> float:
        """Bytes still to be written."""
        return max(sum(self.disk.values()) - self.present, 0.0)

    def check(self, path: Path, what: str) -> None:
        """Raise InputError if disk or memory are too small for `what`, a plural noun: "the world's files"."""
        check_disk(path, self.disk_needed, what)
        if self.memory > free_memory():
            raise InputError(
                f"{what} need about {format_bytes(self.memory)} of memory at once, "
                f"{format_bytes(free_memory())} are free"
            )

    def as_dict(self, path: Path) -> dict[str, Any]:
        """Return a JSON entry, with the free disk space at a path and the free memory."""
        return {
            "disk": {
                "parts": {name: round(size) for name, size in self.disk.items()},
                "needed": round(self.disk_needed),
                "there": round(self.present),
                "left": free_disk_space(path),
            },
            "memory": {"needed": round(self.memory), "left": free_memory()},
        }

    def lines(self, path: Path) -> list[str]:
        """Return the same as text: a line for the disk and one for memory."""
        parts = ", ".join(f"{name} {format_bytes(size)}" for name, size in self.disk.items())
        parts = f" ({parts})" if len(self.disk) > 1 else ""
        present = f", {format_bytes(self.present)} are present" if self.present else ""
        return [
            f"disk: up to {format_bytes(sum(self.disk.values()))}{parts}{present}, "
            f"{format_bytes(free_disk_space(path))} are free",
            f"memory: about {format_bytes(self.memory)} at once, {format_bytes(free_memory())} are free",
        ]


def layer_bytes(vertices: float, layers: Iterable[str]) -> dict[str, float]:
    """Return the compressed bytes on disk of each layer of a number of vertices."""
    return {name: vertices * _LAYER_BYTES[name] for name in layers}


def plant_bytes(area: float, form: str, *, grass: bool = False) -> float:
    """Return the bytes on disk of the plants of an area (m²) in a file format."""
    return area * (_WOODY + _GRASS * grass) * _PLANT_BYTES[form]


def format_count(count: float) -> str:
    """Return a large number as text.

    >>> format_count(12345.6), format_count(1.4e9)
    ('12 346', '1400 million')
    """
    return f"{count:,.0f}".replace(",", " ") if count < 1e6 else f"{count / 1e6:.4g} million"


def format_duration(seconds: float) -> str:
    """Return seconds as text: ``40 s``, ``12 min``, ``3 h 20 min``."""
    if seconds < 90:
        return f"{max(round(seconds), 1)} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"


_SOON: Final = 2.0  # s of work, from which the rest is estimated


def time_left(share: float, seconds: float) -> str:
    """Return ``about 12 s left`` for work of which a share took so many seconds, else an empty text.

    >>> time_left(0.25, 4.0), time_left(0.25, 1.0), time_left(1.0, 4.0)
    ('about 12 s left', '', '')
    """
    if seconds < _SOON or not 0.0 < share < 1.0:
        return ""
    return f"about {format_duration(seconds * (1.0 - share) / share)} left"


MAX_SIZE = 16385
"""The most vertices along the longer side."""

# Measured at 4097²: heights, normals and weights, once in patches and once joined, take 86.
_BYTES_PER_VERTEX = 95
_BASE_BYTES = 450 << 20


def memory_needed(sketch: Sketch, size: int) -> float:
    """Return the approximate bytes that an export takes, `size` vertices along the longer side."""
    east, north = sketch.size
    return _BASE_BYTES + _BYTES_PER_VERTEX * size * size * min(east, north) / max(east, north)


def check_size(sketch: Sketch, size: int) -> None:
    """Raise InputError if `size` vertices are out of range or need more memory than this machine has."""
    if size < 2:
        raise InputError(f"size = {size}: expected 2 to {MAX_SIZE} vertices")
    needed, physical = memory_needed(sketch, size), physical_memory()
    about = f"about {format_bytes(needed)}"
    if size > MAX_SIZE:
        raise InputError(f"size = {size}: expected 2 to {MAX_SIZE} vertices; this needs {about}")
    if needed > physical:
        raise InputError(f"size = {size} needs {about} of memory, this machine has {format_bytes(physical)}")
