"""Shape of live pictures beside that of stills: silhouettes by column, water."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple
from unittest import mock

import numpy as np
from scipy.ndimage import maximum_filter1d

from sketchterrain.array_types import BoolArray, Float32Array
from sketchterrain.geometry.camera import Camera
from sketchterrain.io.files import write_atomic
from sketchterrain.io.system import module_command
from sketchterrain.render.offscreen import canvas
from sketchterrain.render.quality import Quality
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.sky import Sun
from sketchterrain.ui.engine import channel, engine, view_renderer

if TYPE_CHECKING:
    from sketchterrain.render.scene import TerrainSource

_PIXELS: Final = 3  # px that a silhouette may be off
_STEP: Final = 1.3, 1.15  # ratios of distances at a silhouette that is sought, and at one that is found
_PLAIN: Final = frozenset({"shadows", "clouds", "rocks", "grass"})  # not drawn; trees hide water


class PictureShape(NamedTuple):
    """What a picture shows, row 0 on top."""

    distance: Float32Array  # (h, w) m to the ground; infinite: sky
    water: BoolArray  # (h, w)
    clear: BoolArray  # (h, w) ground that the air does not hide


def still_shape(terrain: TerrainSource, camera: Camera, size: tuple[int, int]) -> PictureShape:
    """Return the shape of a still of a camera."""
    quality = Quality.for_still(size)
    with canvas(size) as (context, _, framebuffer):
        plain = Quality(quads=quality.quads, tile_memory=quality.tile_memory, samples=1, without=_PLAIN)
        renderer = Renderer(context, terrain, sun=Sun(180.0), quality=plain)
        renderer.prepare(camera, size)
        renderer.draw(camera, framebuffer)
        return PictureShape(*renderer.shape(camera, size))


def columns_alike(one: PictureShape, other: PictureShape) -> float:
    """Return the share of columns in which every silhouette of one shape is within 3 px in the other."""
    missing = np.zeros(one.distance.shape[1], np.bool_)
    for sought, found in ((one, other), (other, one)):
        edges = _silhouettes(found, _STEP[1]) | (found.clear[1:] & ~found.clear[:-1])
        near = maximum_filter1d(edges.astype(np.uint8), 2 * _PIXELS + 1, axis=0) > 0
        missing |= (_silhouettes(sought, _STEP[0]) & sought.clear[1:] & ~near).any(axis=0)
    return 1.0 - float(missing.mean())


def _silhouettes(shape: PictureShape, ratio: float) -> BoolArray:
    above, below = shape.distance[:-1], shape.distance[1:]
    return np.asarray(np.isfinite(below) & (above > ratio * np.where(np.isfinite(below), below, 1.0)))


def water_overlap(one: PictureShape, other: PictureShape) -> float:
    """Return the intersection over union of the water; 1 without any."""
    union = np.count_nonzero(one.water | other.water)
    return np.count_nonzero(one.water & other.water) / union if union else 1.0


class MeasuredRenderer(view_renderer.ViewRenderer):
    """The engine's renderer, which saves the shapes of frames at rest in the file of the last argument."""

    _last: Camera | None = None

    def draw(self, camera: Camera, **times: Any) -> Any:
        """Draw a frame and save its shape."""
        statistics = super().draw(camera, **times)
        assert self._renderer is not None  # noqa: S101 # it has drawn
        moves, self._last = camera != (self._last or camera), camera
        if moves:
            return statistics
        shape = self._renderer.shape(camera, (self._view.width, self._view.height))
        write_atomic(Path(sys.argv[2]), np.stack(shape).astype(np.float32).tobytes())
        return statistics


@contextmanager
def measured_engine(path: Path) -> Iterator[None]:
    """Let engines that are started meanwhile save the shapes of their frames."""

    def command(module: str, *arguments: str) -> list[str]:
        if not module.endswith(".engine.engine"):
            return module_command(module, *arguments)
        return [sys.executable, "-P", "-c", f"import {__name__} as m; m.serve()", *arguments, str(path)]

    with mock.patch.object(channel, "module_command", command):
        yield


def saved_shape(path: Path, size: tuple[int, int]) -> PictureShape:
    """Return the shape of the last frame, of a size (px)."""
    distance, water, clear = np.frombuffer(path.read_bytes(), np.float32).reshape(3, size[1], size[0])
    return PictureShape(distance, water > 0.5, clear > 0.5)


def serve() -> None:
    """Run the engine's process, whose frames are measured."""
    with mock.patch.object(view_renderer, "ViewRenderer", MeasuredRenderer):
        engine._main(json.loads(sys.argv[1]))
