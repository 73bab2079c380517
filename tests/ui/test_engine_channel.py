"""Messages between processes: whole, with their arrays, and the other end's end is told."""

from __future__ import annotations

import socket
import threading
import time
from types import MappingProxyType

import numpy as np
import pytest

from sketchterrain.ui.engine.channel import Channel, pickled, ready, unpickled
from sketchterrain.ui.engine.frames import FrameMemory
from sketchterrain.ui.engine.protocol import LayerPatch, Turn


@pytest.fixture
def ends():
    pair = [Channel(end) for end in socket.socketpair()]
    yield pair
    for each in pair:
        each.close()


def test_messages_arrive_in_order_with_arrays_and_read_only_mappings(ends) -> None:
    one, other = ends
    one.send(Turn(1.0, 2.0))
    one.send(LayerPatch(3, 4, np.arange(12, dtype=np.uint8).reshape(3, 4)))
    assert other.receive() == Turn(1.0, 2.0)
    patch = other.receive()
    assert (patch.row, patch.column) == (3, 4)
    assert np.array_equal(patch.pixels, np.arange(12).reshape(3, 4))

    whole = np.arange(100, dtype=np.float32).reshape(10, 10)
    one.send({"settings": MappingProxyType({"a": 1.0}), "part": whole[2:5, ::3]})
    got = other.receive()
    assert got["settings"]["a"] == 1.0
    with pytest.raises(TypeError):
        got["settings"]["a"] = 2.0
    assert np.array_equal(got["part"], whole[2:5, ::3])


def test_has_message_waits_no_longer_than_asked(ends):
    one, other = ends
    start = time.monotonic()
    assert not other.has_message()
    assert not other.has_message(0.05)
    assert 0.04 < time.monotonic() - start < 5.0
    one.send("there")
    assert other.has_message()
    assert ready([one, other], 0.0) == [other]


def test_an_end_that_is_gone_is_told(ends):
    one, other = ends
    one.send("last words")
    one.close()
    assert other.receive() == "last words"
    assert other.has_message(None)
    with pytest.raises(EOFError):
        other.receive()


def test_an_impatient_channel_never_waits_and_still_sends_all_in_order():
    mine, its = socket.socketpair()
    channel, other = Channel(mine, patient=False), Channel(its)
    large = np.random.default_rng(1).integers(0, 255, 20_000_000, dtype=np.uint8)
    start = time.monotonic()
    for number in range(3):
        channel.send((number, large))  # nobody reads yet
    assert time.monotonic() - start < 1.0
    for number in range(3):
        got, data = other.receive()
        assert got == number
        assert np.array_equal(data, large)
    channel.close()
    other.close()


def test_closing_ends_a_thread_that_reads_and_one_that_writes():
    mine, its = socket.socketpair()
    channel, other = Channel(mine, patient=False), Channel(its)
    ended = []

    def read():
        try:
            channel.receive()
        except EOFError:
            ended.append(True)

    thread = threading.Thread(target=read)
    thread.start()
    channel.send(np.zeros(50_000_000, np.uint8))  # more than fits; it is never read
    start = time.monotonic()
    channel.close(timeout=0.05)
    thread.join(2.0)
    assert ended == [True]
    assert time.monotonic() - start < 1.0
    other.close()


def test_a_part_may_be_left_out_and_is_put_back_as_another_process_has_it():
    part = np.zeros(100_000)
    data = pickled({"part": part, "more": [part, 1, None]}, but=part)
    assert len(data) < 1000
    mine = np.ones(3)
    got = unpickled(data, but=mine)
    assert got["part"] is mine
    assert got["more"][0] is mine
    assert got["more"][1:] == [1, None]


def test_frames_are_shared_grow_and_do_not_overlap() -> None:
    import os

    memory = FrameMemory()
    other = FrameMemory(os.dup(memory.number))
    for index, size in ((0, 1000), (1, 1000), (1, 5_000_000), (0, 5_000_000)):
        start, capacity = memory.place(index, size)
        with memory.view(start, size, capacity) as view:
            np.frombuffer(view, np.uint8)[:] = index + 1
        with other.view(start, size, capacity) as view:
            assert bytes(view) == bytes([index + 1]) * size
    memory.close()
    other.close()

    memory = FrameMemory()
    size = 3_333_333
    first, second = memory.place(0, size)[0], memory.place(1, size)[0]
    assert second >= first + size
    assert memory.place(1, size)[1] >= second + size
    memory.close()
