"""Commands `new`, `bench`, `devices` and `presets`."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from sketchterrain.app.arguments import AsJson, DeviceName, Fast
from sketchterrain.app.listings import (
    device_lines,
    device_test_entry,
    preset_entry,
    preset_lines,
    print_json,
    print_lines,
)
from sketchterrain.app.progress import Stages


def new(folder: Annotated[Path, typer.Argument(metavar="DIR", help="A new or an empty folder.")]) -> None:
    """Write a starter sketch, to be edited in any paint program."""
    from sketchterrain.document.store import new_sketch

    new_sketch(folder)
    print_lines(
        f"wrote a starter sketch to {folder}: paint its PNGs, read its sketch.toml, then run",
        f"sketchterrain generate {folder} -o out",
    )


def bench(
    names: Annotated[list[str] | None, typer.Argument(metavar="[NAME]...", help="All if none.")] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="DIR", help="Write tables and charts there.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Small sizes, few rounds.")] = False,
    device: DeviceName = None,
    fast: Fast = False,
    as_json: AsJson = False,
) -> None:
    """Time kernels, noise, tiles, features and plants, and chart them."""
    from sketchterrain.benchmarks import run

    code = run(names or [], output=output, quick=quick, device=device, fast=fast, as_json=as_json)
    raise typer.Exit(code)


def devices(as_json: AsJson = False) -> None:
    """List the OpenCL devices, with a self-test of their bits and of sharing with OpenGL."""
    from sketchterrain.compute.device import choose_device, list_devices
    from sketchterrain.compute.device_check import clear_check_results
    from sketchterrain.errors import DeviceFailedError
    from sketchterrain.render.sharing_probe import Sharing, probe_sharing
    from sketchterrain.terrain.self_test import self_test

    clear_check_results()  # a missing driver or linker may be installed by now
    default, tested = None, []
    with suppress(DeviceFailedError):  # the self-test reports it
        default = choose_device()
    with Stages() as stages:
        for device in list_devices():
            with stages.stage(str(device.index), f"Testing {device.name} ({device.platform})"):
                verdict = self_test(device)
                failed = verdict.bits == "failed"
                sharing = Sharing("none", "it runs no kernel") if failed else probe_sharing(device)
                tested.append((device, verdict, sharing))
    if as_json:
        print_json([device_test_entry(*each) | {"default": each[0] == default} for each in tested])
        return
    for device, verdict, sharing in tested:
        print_lines(*device_lines(device, verdict, sharing, default=device == default))


def presets(as_json: AsJson = False) -> None:
    """List the presets, which are valid wherever a sketch is expected."""
    from sketchterrain.document.store import load_sketch
    from sketchterrain.io.resources import preset_names

    entries = [preset_entry(name, load_sketch(name)) for name in preset_names()]
    if as_json:
        print_json(entries)
    else:
        print_lines(*preset_lines(entries))
