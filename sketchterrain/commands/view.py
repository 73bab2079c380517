"""The command `view`: a written world in a window, or a picture of it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from sketchterrain import arguments as given
from sketchterrain import picture_arguments as pictured
from sketchterrain.exit_codes import USAGE_ERROR
from sketchterrain.listings import legend_lines, print_lines
from sketchterrain.progress import Stages
from sketchterrain.termination import restore_default_sigterm


def _check_picture(path: Path | None) -> Path | None:
    if path is not None and (path.suffix.lower() != ".png" or path.is_dir()):
        raise typer.BadParameter(f"expected the name of a .png file, got {str(path)!r}")
    return path


def view(
    store: Annotated[
        Path, typer.Argument(metavar="WORLD", help="What `world` wrote: .zarr, .tif or a folder of tiles.")
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            callback=_check_picture,
            help="Picture to write, a .png; without it a window opens.",
        ),
    ] = None,
    size: given.PictureSize = None,
    kind: pictured.ViewKind = None,
    eye: pictured.Eye = None,
    look_at: pictured.LookAt = None,
    time: pictured.Hour = None,
    clouds: pictured.Clouds = None,
    quality: pictured.QualityNumber = None,
    without: pictured.Without = None,
    textures: pictured.Textures = None,
    overlay: pictured.OverlayNames = None,
    device: given.DeviceName = None,
) -> None:
    """View a written world: walk and fly in it, or render one picture of it."""
    if output is None:
        options = {
            "--size": size,
            "--view": kind,
            "--eye": eye,
            "--look-at": look_at,
            "--time": time,
            "--clouds": clouds,
            "--quality": quality,
            "--without": without,
            "--textures": textures,
            "--overlay": overlay,
        }
        for name, value in options.items():
            if value is not None and value != []:
                raise USAGE_ERROR(f"{name} needs -o: it is for pictures")
        from sketchterrain.ui.app import run_world

        restore_default_sigterm()
        raise typer.Exit(run_world(store, device=device))
    if look_at is not None and (eye is None or eye == look_at):
        raise USAGE_ERROR("--look-at needs an --eye at another place")
    if eye is not None:
        pictured.reject_combination(
            "--eye", {"--view": kind}, "either you or the program chooses where to stand"
        )
    with Stages() as stages:
        with stages.stage("program", "Loading the program"):
            from sketchterrain.still import PictureOptions
            from sketchterrain.world.picture import draw_world

        still = PictureOptions(
            size=size,
            eye=eye,
            look_at=look_at,
            view=kind or "auto",
            hour=time,
            clouds=clouds,
            quality=1.0 if quality is None else quality,
            without=tuple(without or ()),
            overlays=tuple(overlay or ()),
            textures=textures,
        )
        legend, lacks = draw_world(store, output, still, device=device, stages=stages)
    for line in lacks:
        sys.stderr.write(f"sketchterrain: note: {line}\n")
    print_lines(str(output), *legend_lines(legend))
