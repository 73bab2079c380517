"""The command that measures a written world, and checks whether its files are what was written."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sketchterrain.arguments import AsJson
from sketchterrain.exit_codes import PARTIAL, USAGE_ERROR, fail
from sketchterrain.listings import print_json, print_lines
from sketchterrain.progress import Stages

if TYPE_CHECKING:
    from sketchterrain.world.journal import Broken
    from sketchterrain.world.statistics import Statistics

__all__ = ["stats"]

_NAMED = 10  # files that are missing or broken; --json has them all
_BAR = 40  # characters
_NAME = 12  # columns of the first word


def stats(
    store: Annotated[
        Path, typer.Argument(metavar="WORLD", help="What `world` wrote: .zarr, .tif or a folder of tiles.")
    ],
    level: Annotated[
        int | None, typer.Option("--level", metavar="N", min=0, help="Of the pyramid; 0, the finest.")
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Compare every file with the world's list of hashes instead.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Tell a written world's relief, slopes and hypsometry, or whether all of its files are whole."""
    if check and level is not None:
        raise USAGE_ERROR("--level with --check: all levels are checked")
    with Stages() as stages:
        if check:
            with stages.stage("check", "Reading every file") as tell:
                from sketchterrain.world.journal import check_world

                broken = list(check_world(store, progress=tell))
        else:
            with stages.stage("open", "Opening the world"):
                from sketchterrain.world.opening import open_world
                from sketchterrain.world.statistics import statistics_of

                stored = open_world(store)
            with stages.stage("statistics", "Measuring") as tell:
                found = statistics_of(stored, level=level or 0, progress=tell)
    if not check:
        if as_json:
            print_json({"world": str(store), **found.as_dict()})
        else:
            print_lines(*_lines(store, found))
        return
    _tell_checked(store, broken, as_json=as_json)


def _tell_checked(store: Path, broken: list[Broken], *, as_json: bool) -> None:
    """Tell what a check found."""
    from sketchterrain.errors import one_line

    if as_json:
        told = [{"file": each.file, "why": each.why} for each in broken]
        print_json({"world": str(store), "broken": told})
    elif broken:
        print_lines(*(f"{one_line(each.file)} {each.why}" for each in broken[:_NAMED]))
        if len(broken) > _NAMED:
            print_lines(f"and {len(broken) - _NAMED} more")
    else:
        print_lines(f"{store}: every file is as it was written")
    if broken:
        files = "1 file is" if len(broken) == 1 else f"{len(broken)} files are"
        raise typer.Exit(fail(f"{files} missing or broken; `world --resume` mends them", PARTIAL))


def _lines(store: Path, found: Statistics) -> list[str]:
    relief, slopes = found.relief, found.slopes
    lines = [
        f"{store}, level {found.level}: {found.columns} × {found.rows} vertices {found.cell:g} m apart, "
        f"{_area(found.area)}",
        f"{'relief':<{_NAME}}{relief.minimum:.1f} to {relief.maximum:.1f} m, range {relief.range:.1f} m; "
        f"mean {relief.mean:.1f}, standard deviation {relief.standard_deviation:.1f}",
        f"{'':<{_NAME}}{_quantiles(relief.quantiles, ' m')}",
    ]
    if slopes is not None:
        lines += [
            f"{'slopes':<{_NAME}}mean {slopes.mean:.1f}°, steepest {slopes.maximum:.1f}° ({slopes.method}); "
            f"the surface is {slopes.surface_ratio:.3f} of its map's area",
            f"{'':<{_NAME}}{_quantiles(slopes.quantiles, '°')}",
        ]
        step = slopes.class_width
        last = max(number for number, share in enumerate(slopes.shares) if share > 0)
        top = max(slopes.shares)
        lines += [
            _bar(f"{number * step}–{number * step + step}°", share, top)
            for number, share in enumerate(slopes.shares[: last + 1])
        ]
    hypsometry = found.hypsometry
    lines.append(f"{'hypsometry':<{_NAME}}integral {hypsometry.integral:.3f} (Strahler 1952); area above")
    rows = list(zip(hypsometry.heights, hypsometry.share_above, strict=True))
    lines += [_bar(f"{height:.0f} m", share, 1.0) for height, share in rows[::-2]]
    if found.materials:
        lines.append(f"{'materials':<{_NAME}}share of the whole")
        ordered = sorted(found.materials.items(), key=lambda each: -each[1])
        lines += [_bar(name, share, ordered[0][1]) for name, share in ordered]
    return lines


def _bar(name: str, share: float, top: float) -> str:
    filled = round(_BAR * share / top) if top > 0 else 0
    return f"  {name:>{_NAME}}  {share:6.1%}  {'█' * filled}".rstrip()


def _quantiles(quantiles: dict[str, float], unit: str) -> str:
    return ", ".join(f"{float(share):.0%} {value:.1f}{unit}" for share, value in quantiles.items())


def _area(square_metres: float) -> str:
    return f"{square_metres / 1e6:.4g} km²" if square_metres >= 1e6 else f"{square_metres:.4g} m²"
