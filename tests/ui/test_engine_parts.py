"""Channels, shared frame memory, sketch updates and relief of the engine."""

import os
import socket
import threading
from types import MappingProxyType, SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from sketchterrain.document.sketch import Sketch
from sketchterrain.schema.layers import PAINTED_LAYERS
from sketchterrain.stages.digests import digest_of
from sketchterrain.ui.engine import frames
from sketchterrain.ui.engine.channel import (
    Channel,
    ContentChannel,
    UpdateBuilder,
    ready,
)
from sketchterrain.ui.engine.frames import FrameMemory
from sketchterrain.ui.engine.protocol import Relief, Turn, ViewState
from sketchterrain.ui.engine.terrain_session import LARGEST, ReliefBuilder, hill_shade
from sketchterrain.ui.models.document import Document

from .events import paint


@pytest.fixture(params=[Channel])
def ends(request):
    """The two ends of a connection, the first of the kind that a test names."""
    ours, theirs = socket.socketpair()
    pair = request.param(ours), Channel(theirs)
    yield pair
    for each in pair:
        each.close()


sends_content = pytest.mark.parametrize("ends", [ContentChannel], indirect=True)


def test_messages_arrive_in_order_with_arrays_and_read_only_mappings(ends):
    one, other = ends
    one.send(Turn(1.0, 2.0))
    one.send(Relief(3, 4, np.arange(12, dtype=np.float32).reshape(3, 4), np.zeros((3, 4), np.uint8), None))
    assert other.receive() == Turn(1.0, 2.0)
    relief = other.receive()
    assert (relief.version, relief.step) == (3, 4)
    assert np.array_equal(relief.height, np.arange(12).reshape(3, 4))

    whole = np.arange(100, dtype=np.float32).reshape(10, 10)
    one.send({"settings": MappingProxyType({"a": 1.0}), "part": whole[2:5, ::3]})
    received = other.receive()
    assert received["settings"]["a"] == 1.0
    with pytest.raises(TypeError):
        received["settings"]["a"] = 2.0
    assert np.array_equal(received["part"], whole[2:5, ::3])


def test_a_closed_connection_raises_after_pending_messages(ends):
    one, other = ends
    assert not other.has_message(0.05)
    one.send("last message")
    assert ready([one, other], 0.0) == [other]
    one.close()
    assert other.receive() == "last message"
    assert other.has_message(None)
    with pytest.raises(EOFError):
        other.receive()


def test_an_impatient_channel_queues_without_blocking():
    ours, theirs = socket.socketpair()
    channel, other = Channel(ours, patient=False), Channel(theirs)
    large = np.random.default_rng(1).integers(0, 255, 20_000_000, dtype=np.uint8)
    for number in range(3):
        channel.send((number, large))  # not read yet
    for number in range(3):
        received, data = other.receive()
        assert received == number
        assert np.array_equal(data, large)
    channel.close()
    other.close()


def test_closing_wakes_reader_and_writer_threads():
    ours, theirs = socket.socketpair()
    channel, other, ended = Channel(ours, patient=False), Channel(theirs), []

    def read():
        with pytest.raises(EOFError):
            channel.receive()
        ended.append(True)

    thread = threading.Thread(target=read)
    thread.start()
    channel.send(np.zeros(50_000_000, np.uint8))  # more than fits; it is never read
    channel.close(timeout=0.05)
    thread.join(300.0)
    assert ended == [True]
    other.close()


@sends_content
def test_arrays_are_sent_once_then_by_digest_and_of_images_only_changed_blocks(ends):
    (one, other), sent = ends, []
    one._write = lambda parts, write=one._write: (
        sent.append(sum(part.nbytes for part in parts)),
        write(parts),
    )
    rng = np.random.default_rng(2)
    image = rng.integers(0, 255, (400, 500), dtype=np.uint8)
    points = np.zeros(200, [("id", "u8"), ("x", "f4")])
    changed = image.copy()
    changed[7, 7] += 1
    for each in (image, changed):
        each.flags.writeable = False
    received = []
    for layers in ([image, image], [image], [changed], [image]):
        one.send({"layers": layers, "points": points, "small": np.arange(3)})
        message = other.receive()
        received.append(message["layers"][0])
        assert all(np.array_equal(*pair) for pair in zip(message["layers"], layers, strict=True))
        assert message["points"].dtype == points.dtype
        assert not received[-1].flags.writeable
    assert sent[0] > image.nbytes
    assert all(size < 1500 for size in (sent[1], sent[3]))
    assert sent[2] < 8_000
    assert received[0] is received[1] is received[3] is not received[2]

    for number in range(8):  # both ends forget the same arrays
        one.send(np.full(2000, number))
        assert np.array_equal(other.receive(), np.full(2000, number))
    one.send([image, changed])
    assert all(np.array_equal(*pair) for pair in zip(other.receive(), (image, changed), strict=True))
    assert len(set().union(*other._received)) <= 6


def test_frame_slots_are_shared_grow_and_do_not_overlap():
    memory = FrameMemory()
    other = FrameMemory(os.dup(memory.number))
    for index, size in ((0, 1000), (1, 1000), (1, 5_000_000), (0, 5_000_000)):
        start, capacity = memory.allocate(index, size)
        with memory.view(start, size, capacity) as view:
            np.frombuffer(view, np.uint8)[:] = index + 1
        with other.view(start, size, capacity) as view:
            assert bytes(view) == bytes([index + 1]) * size
    memory.close()
    other.close()

    memory, size = FrameMemory(), 3_333_333
    first, second = memory.allocate(0, size)[0], memory.allocate(1, size)[0]
    assert second >= first + size
    assert memory.allocate(1, size)[1] >= second + size
    memory.close()


@pytest.fixture
def small_document(qapp):
    return Document(Sketch(layers={"hill": np.zeros((40, 60), np.uint8)}))


@pytest.fixture
def builder(small_document):
    return UpdateBuilder(small_document)


def live(document):
    draft = document.draft
    layers = {} if draft is None else {draft.layer: draft.snapshot()}
    return document.sketch.replace(layers={**document.sketch.layers, **layers})


def test_updates_hold_the_stroke_as_it_was(small_document, builder):
    update, fresh = builder.next()
    assert fresh
    assert builder.is_empty
    assert digest_of(update.sketch) == digest_of(small_document.sketch)

    draft = paint(small_document, "mountain", (10, 20, 12, 25), title=None)
    assert not builder.is_empty
    stroke, fresh = builder.next()
    assert not fresh
    draft.image[10:12, 20:25] = 2  # what was sent does not follow the stroke
    assert (stroke.sketch.layers["mountain"][10:12, 20:25] == 1).all()
    assert stroke.sketch.layers["hill"] is update.sketch.layers["hill"]
    draft.cancel()
    assert not builder.is_empty
    assert digest_of(builder.next()[0].sketch) == digest_of(update.sketch)


@sends_content
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 4))])
def test_the_other_end_follows_strokes_undo_settings_and_other_documents(small_document, builder, ends, seed):
    rng, (one, other) = np.random.default_rng(seed), ends
    for turn in range(200):
        choice = int(rng.integers(0, 7))
        if choice <= 2:
            layer, (top, left) = str(rng.choice(list(PAINTED_LAYERS))), rng.integers(0, (30, 50)).tolist()
            box = (top, left, top + int(rng.integers(1, 10)), left + int(rng.integers(1, 10)))
            paint(small_document, layer, box, rng.integers(0, 4), title="Paint" if choice else None)
        elif choice == 3:
            small_document.undo()
        elif choice == 4:
            small_document.redo()
        elif choice == 5:
            small_document.do("Set seed", small_document.sketch.replace(seed=int(rng.integers(0, 99))))
        elif turn % 3 == 0:
            side = int(rng.integers(30, 70))
            small_document.open(Sketch(layers={"hill": np.ones((side, 60), np.uint8)}))
        if rng.random() < 0.5:
            one.send(builder.next()[0])
            received, expected = other.receive().sketch, live(small_document)
            assert digest_of(received) == digest_of(expected), turn
            assert all(
                np.array_equal(received.layers[name], expected.layers[name]) for name in PAINTED_LAYERS
            )


EVERYWHERE = (-np.inf, -np.inf, np.inf, np.inf)


class Bumpy:
    """A plane with a bump; counts evaluated points."""

    sea_level = None

    def __init__(self, shape=(60, 90), bump=0.0):
        self.sketch = Sketch(extent=900.0, layers={"hill": np.zeros(shape, np.uint8)})
        self.bump = bump
        self.evaluated = 0

    def heights(self, x, y, *, cell_size=0.0):
        x, y = np.broadcast_arrays(x, y)
        self.evaluated += x.size
        inside = (np.abs(x - 300.0) < 50.0) & (np.abs(y - 200.0) < 50.0)
        return (0.1 * x + 0.2 * y + self.bump * inside).astype(np.float32)


BUMP = (250.0, 150.0, 350.0, 250.0)


def finish(builder):
    while builder.busy:
        relief = builder.work(0.001)
    return relief


def expected(terrain):
    rows, columns, size = terrain.sketch.height_px, terrain.sketch.width_px, terrain.sketch.pixel_size
    x, y = (np.arange(columns) + 0.5) * size, (rows - np.arange(rows) - 0.5) * size
    return terrain.heights(x[None], y[:, None])


def relief_of(terrain, version=1):
    """Return a builder and its complete relief of a terrain."""
    builder = ReliefBuilder()
    builder.set_terrain(terrain, version, [EVERYWHERE])
    return builder, finish(builder)


def test_heights_are_at_pixel_centres_and_another_size_restarts():
    terrain, other = Bumpy(), Bumpy(shape=(30, 40))
    builder, relief = relief_of(terrain, 3)
    assert (relief.version, relief.step) == (3, 1)
    assert np.array_equal(relief.height, expected(terrain))
    assert relief.shade.shape == relief.height.shape

    builder.set_terrain(terrain, 4, [EVERYWHERE])
    builder.work(0.0)
    builder.set_terrain(other, 5, [EVERYWHERE])
    assert np.array_equal(finish(builder).height, expected(other))


def test_an_equal_newer_version_is_adopted_during_work():
    builder, terrain = ReliefBuilder(), Bumpy()
    builder.set_terrain(terrain, 3, [EVERYWHERE])
    builder.work(0.0)
    evaluated = terrain.evaluated
    builder.set_terrain(terrain, 4, [])
    assert finish(builder).version == 4
    assert terrain.evaluated < evaluated + terrain.sketch.width_px * terrain.sketch.height_px
    builder.set_terrain(terrain, 5, [])
    assert not builder.busy


def test_only_changed_areas_are_evaluated_and_shading_equals_a_full_one():
    builder, first = relief_of(Bumpy())
    bumped = Bumpy(bump=40.0)
    builder.set_terrain(bumped, 2, [BUMP])
    second = finish(builder)
    assert bumped.evaluated < 0.2 * first.height.size
    assert np.array_equal(second.height, expected(Bumpy(bump=40.0)))
    assert np.array_equal(second.shade, hill_shade(second.height, 10.0))
    assert np.array_equal(first.height, expected(Bumpy()))  # returned reliefs do not change


def test_each_relief_is_of_a_single_version():
    builder = ReliefBuilder()
    terrains = [Bumpy(bump=10.0 * number) for number in range(6)]
    builder.set_terrain(terrains[0], 0, [EVERYWHERE])
    reliefs = []
    for number in range(1, 6):
        reliefs.append(builder.work(0.0))
        builder.set_terrain(terrains[number], number, [BUMP])
    while builder.busy:
        reliefs.append(builder.work(0.0))
    reliefs = [each for each in reliefs if each is not None]
    assert [each.version for each in reliefs] == sorted(each.version for each in reliefs)
    assert reliefs[-1].version == 5
    for each in reliefs:
        assert np.array_equal(each.height, expected(terrains[each.version]))


def test_large_sketches_are_sampled_less_often_and_one_row_is_a_relief():
    for shape, step in [((1024, 10), 1), ((10, 1025), 2), ((4096, 2048), 4), ((1, 8), 1)]:
        _, relief = relief_of(Bumpy(shape=shape))
        assert relief.step == step, (shape, step)
        assert max(relief.height.shape) <= LARGEST, (shape, step)
        assert relief.height.shape == relief.shade.shape == tuple(-(-side // step) for side in shape), shape


def test_light_comes_from_the_north_west():
    level = np.zeros((5, 5), np.float32)
    down, across = np.mgrid[:5, :5].astype(np.float32)
    plain = int(hill_shade(level, 1.0)[2, 2])
    to_light = int(hill_shade(down + across, 1.0)[2, 2])  # rises to the south-east: faces the light
    away = int(hill_shade(-down - across, 1.0)[2, 2])
    assert away < plain < to_light


def test_frames_at_rest_follow_a_slow_first_frame_before_the_still_is_drawn(monkeypatch):
    clock, drawn = [100.0], []
    monkeypatch.setattr(frames, "time", SimpleNamespace(monotonic=lambda: clock[0]))

    def draw(camera, **times):
        clock[0] += 0.1 if drawn else 3.0
        drawn.append("frame")
        return Mock(converged=False)

    renderer = Mock(is_software=True, draw=draw, load=Mock(return_value=False))
    renderer.refine = Mock(side_effect=lambda *given, **named: drawn.append("still"))
    pacer = frames.FramePacer(renderer, FrameMemory(), used_bytes=lambda: 0)
    pacer.set_view(ViewState(width=8, height=8))
    pacer.set_terrain(Mock(), 1, [], Mock())
    controller = Mock(advance=Mock(return_value=False))
    while "still" not in drawn:
        clock[0] += pacer.due(moving=False) or 0.01
        pacer.draw(controller)
        pacer.acknowledge_frame()
    assert drawn.count("frame") >= 3
