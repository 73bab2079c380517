"""Frames of the shared memory as pictures of a view."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from sketchterrain.ui.engine.frames import FrameMemory
from sketchterrain.ui.engine.link import PictureSource
from sketchterrain.ui.engine.protocol import FrameTaken, FrameThere, Pick, ViewState


class Source(PictureSource):
    """Remembers its requests."""

    def __init__(self) -> None:
        super().__init__(ViewState())
        self.told: list[Any] = []

    def tell(self, message: Any) -> None:
        self.told.append(message)


def test_a_frame_in_shared_memory_becomes_the_picture_pixel_for_pixel(qapp):
    memory, source, shown = FrameMemory(), Source(), []
    source.frame_shown.connect(shown.append)
    colours = np.random.default_rng(3)
    try:
        for place, (width, height) in enumerate([(33, 20), (64, 48)]):
            rgbx = colours.integers(0, 256, (height, width, 4), dtype=np.uint8)
            start, capacity = memory.place(place, rgbx.nbytes)
            with memory.view(start, rgbx.nbytes, capacity) as pixels:
                pixels[:] = rgbx.tobytes()
            facts = SimpleNamespace(width=width, height=height)
            source._children = SimpleNamespace(frames=memory)
            source._take(0, "engine", FrameThere(facts, start, capacity))
            with memory.view(start, rgbx.nbytes, capacity) as pixels:
                pixels[:] = bytes(rgbx.nbytes)  # the next frame: the picture is a copy
            picture = source.picture
            assert (picture.width(), picture.height()) == (width, height)
            bgrx = np.frombuffer(picture.constBits().asarray(picture.sizeInBytes()), np.uint8)
            bgrx = bgrx.reshape(height, picture.bytesPerLine())[:, : 4 * width].reshape(height, width, 4)
            np.testing.assert_array_equal(bgrx[..., 2::-1], rgbx[..., :3])
            assert shown[-1] is source.frame is facts
        assert source.told == [FrameTaken(), FrameTaken()]
    finally:
        memory.close()


def test_requests_are_numbered_and_repeated_states_are_not_sent(qapp):
    source = Source()
    assert [source.pick(1.0, 2.0), source.pick(3.0, 4.0)] == [1, 2]
    assert source.told == [Pick(1, 1.0, 2.0), Pick(2, 3.0, 4.0)]
    source.show(ViewState())
    source.show(ViewState(width=64, height=48))
    source.show(ViewState(width=64, height=48))
    assert source.told[2:] == [ViewState(width=64, height=48)]
