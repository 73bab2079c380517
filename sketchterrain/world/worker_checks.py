"""What a worker must be able to do before it gets a task: see the folder, and compute the same bits."""

from __future__ import annotations

import os
import time
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from sketchterrain.errors import SketchterrainError
from sketchterrain.world.code import code_digest
from sketchterrain.world.grid import CHUNK, Shard

if TYPE_CHECKING:
    from sketchterrain.compute import Device
    from sketchterrain.world.making import Maker

__all__ = ["RefusedError", "bits_of", "check_device", "check_folder", "check_program", "own_device"]

_PATIENCE = 5.0  # s until a network's file system shows a new file


class RefusedError(SketchterrainError):
    """A worker cannot be trusted with the job."""


def check_program(order: dict[str, Any]) -> None:
    """Refuse a worker whose program is not the one that sent the order.

    Raises
    ------
    RefusedError
        Naming both versions.
    """
    own = version("sketchterrain")
    if own != order["version"]:
        raise RefusedError(f"it has sketchterrain {own}, not {order['version']}")
    if code_digest() != order["code"]:
        raise RefusedError(f"its sketchterrain {own} has other code of the same version")


def check_folder(order: dict[str, Any]) -> None:
    """Refuse a worker that does not see the output's folder, or cannot write into it.

    Raises
    ------
    RefusedError
        Naming the folder.
    """
    token = Path(order["token"])
    until = time.monotonic() + _PATIENCE
    while (held := _text_of(token)) != order["text"]:
        if time.monotonic() > until:
            found = (
                "another folder is there" if held is not None or token.parent.is_dir() else "nothing is there"
            )
            raise RefusedError(f"it does not see the output's folder {token.parent}: {found}")
        time.sleep(0.1)
    own = token.with_name(f"{token.name}-{uuid4().hex[:8]}")
    try:
        own.write_bytes(b"")
        own.unlink()
    except OSError as error:
        raise RefusedError(f"it cannot write into {token.parent}: {error.strerror or error}") from error


def own_device(selector: str | None, turn: int) -> Device:
    """Return the device of the worker that is the so-manieth of its machine.

    Parameters
    ----------
    selector
        As for :func:`~sketchterrain.compute.choose_device`; None: workers of a machine share its GPUs
        out among them, unless ``PYOPENCL_CTX`` is set where a worker runs.
    turn
        0 for a machine's first worker.

    Raises
    ------
    DeviceError
        If there is none.
    """
    from sketchterrain.compute import choose_device, is_usable, list_devices

    graphics = [device for device in list_devices() if device.type == "GPU" and is_usable(device)]
    if selector is not None or os.environ.get("PYOPENCL_CTX") or not graphics:
        return choose_device(selector)
    return graphics[turn % len(graphics)]


def check_device(device: Device) -> None:
    """Refuse a worker whose device does not compute the program's bits.

    A driver whose bits the tests hold is spared the test's terrain: the world's own ground follows.

    Raises
    ------
    RefusedError
        Naming the device.
    """
    from sketchterrain.terrain import self_test

    verdict = self_test(device, compare=not device.known)
    if verdict.bits != "same":
        raise RefusedError(f"self-test of {device.name} ({device.platform}): {verdict.line}")


def bits_of(maker: Maker) -> str:
    """Return the SHA-256 of some of a job's ground: its coarsest level, and the middle of its finest.

    The self-test's terrain is another one; this also finds what differs before the device is at work.

    Raises
    ------
    DeviceFailedError
        If the device gave up, or computed what is no number.
    """
    world = maker.job.world
    coarsest, finest = world.levels[-1], world.levels[0]
    whole = maker.ground(Shard(coarsest.number, 0, 0))
    digest = sha256()
    for array in (whole.height, whole.normal, whole.materials):
        digest.update(array.tobytes())
    columns, rows = min(CHUNK, finest.columns), min(CHUNK, finest.rows)
    middle = maker.terrain.window(
        world.west,
        world.north,
        cell=finest.cell,
        left=(finest.columns - columns) // 2,
        top=(finest.rows - rows) // 2,
        columns=columns,
        rows=rows,
    )
    for band in middle:
        digest.update(band.height.tobytes())
    return digest.hexdigest()


def _text_of(token: Path) -> str | None:
    try:
        return token.read_text(encoding="utf-8")
    except OSError:
        return None
