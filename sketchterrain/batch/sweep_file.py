"""A batch as a small TOML file: what the command line can say, to be kept."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import msgspec

from sketchterrain.batch.seeds import seeds_of
from sketchterrain.batch.settings import Swept, setting
from sketchterrain.errors import InputError, one_line
from sketchterrain.sketch.toml_reading import load_toml
from sketchterrain.sketch.wording import did_you_mean, shown

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["ExportTable", "SweepFile", "no_sweep", "read_sweep"]

_LARGEST = 1 << 20  # bytes


class ExportTable(msgspec.Struct, frozen=True):
    """``[export]``: the options of the target, named and meant as `ExportOptions` has them."""

    tiles: tuple[int, int] | None = None
    overlap: int | None = None
    tile_name: str | None = None
    tile_first: int | None = None
    tiles_from_south: bool | None = None
    format: str | None = None
    heights: tuple[float, float] | None = None
    error: float | None = None
    crs: str | None = None
    origin: tuple[float, float] | None = None
    plants: bool | None = None


class _Keys(msgspec.Struct):
    sketches: str | list[str] = []
    seeds: str | int | list[int] = ""
    size: int | None = None
    preview: bool | None = None
    view: str | None = None
    foliage: str | None = None
    grass: bool | None = None
    map: str | None = None
    to: str | None = None
    export: ExportTable = ExportTable()
    set: dict[str, Any] = {}


@dataclass(frozen=True)
class SweepFile:
    """What a sweep file says; None and empty: it says nothing of it.

    Attributes
    ----------
    sketches : tuple of str
        Paths as they are from here, or presets.
    seeds : tuple of int
    settings : tuple of Swept
    keys : object
        ``size``, ``preview``, ``view``, ``foliage``, ``grass``, ``map`` and ``to``, as the command line has
        them.
    export : ExportTable
    """

    sketches: tuple[str, ...]
    seeds: tuple[int, ...]
    settings: tuple[Swept, ...]
    keys: _Keys
    export: ExportTable


def no_sweep() -> SweepFile:
    """Return what there is to know without a file."""
    return SweepFile((), (), (), _Keys(), ExportTable())


def read_sweep(path: Path) -> SweepFile:
    """Read a sweep file.

    Sketches are looked for beside the file, then as the command line does.

    Raises
    ------
    InputError
        If it cannot be read, is not TOML, or has a key or a value that means nothing.
    """
    place = one_line(path)
    try:
        if path.stat().st_size > _LARGEST:
            raise InputError(f"{place}: expected a sweep file, this has more than 1 MiB")
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{place}: cannot be read ({error.strerror})") from None
    try:
        document = load_toml(content)
        _refuse_unknown(document, _Keys, "")
        if isinstance(document.get("export"), dict):
            _refuse_unknown(document["export"], ExportTable, "export.")
        keys = msgspec.convert(document, type=_Keys)
        names = [keys.sketches] if isinstance(keys.sketches, str) else keys.sketches
        beside = ((name, path.parent / name) for name in names)
        return SweepFile(
            tuple(str(there) if there.exists() else name for name, there in beside),
            _seeds(keys.seeds),
            tuple(_settings(keys.set)),
            keys,
            keys.export,
        )
    except InputError as error:
        raise InputError(f"{place}: {error}") from None
    except msgspec.ValidationError as error:
        told = one_line(error).replace("`", "").replace("$.", "").replace("Expected", "expected")
        raise InputError(f"{place}: {told}") from None


def _refuse_unknown(table: Any, kind: type[msgspec.Struct], prefix: str) -> None:
    known = kind.__struct_fields__
    for name in table:
        if name not in known:
            raise InputError(
                f"unknown key {shown(prefix + name)}: expected {', '.join(known)}{did_you_mean(name, known)}"
            )


def _seeds(given: str | int | list[int]) -> tuple[int, ...]:
    if isinstance(given, str):
        return seeds_of(given) if given else ()
    return seeds_of(",".join(str(seed) for seed in ([given] if isinstance(given, int) else given)))


def _settings(table: dict[str, Any], prefix: str = "") -> list[Swept]:
    """Return settings, whether their names are quoted or made of tables."""
    found = []
    for name, value in table.items():
        if isinstance(value, dict):
            found += _settings(value, f"{prefix}{name}.")
        else:
            listed = value if isinstance(value, list | str) else [value]
            found.append(setting(prefix + name, listed))
    return found
