"""Parts of the engine's processes: channels, shared frames, updates of the sketch, the relief."""

import os
import socket
import threading
import time
from types import MappingProxyType

import numpy as np
import pytest

from sketchterrain.document.parameters import LAYERS
from sketchterrain.document.sketch import Sketch
from sketchterrain.ui.engine.channel import Channel, pickle_without, ready, unpickle_with
from sketchterrain.ui.engine.frames import FrameMemory
from sketchterrain.ui.engine.protocol import LayerPatch, Turn
from sketchterrain.ui.engine.relief import LARGEST, ReliefBuilder, hill_shade
from sketchterrain.ui.engine.sketch_updates import SketchMirror, UpdateBuilder, settings_of
from sketchterrain.ui.models.document import Document


@pytest.fixture
def ends():
    pair = [Channel(end) for end in socket.socketpair()]
    yield pair
    for each in pair:
        each.close()


def test_messages_arrive_in_order_with_arrays_and_read_only_mappings(ends):
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


def test_an_end_that_is_gone_is_told(ends):
    one, other = ends
    assert not other.has_message(0.05)
    one.send("last words")
    assert ready([one, other], 0.0) == [other]
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
    channel, other, ended = Channel(mine, patient=False), Channel(its), []

    def read():
        with pytest.raises(EOFError):
            channel.receive()
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
    part, mine = np.zeros(100_000), np.ones(3)
    data = pickle_without({"part": part, "more": [part, 1, None]}, part)
    assert len(data) < 1000
    got = unpickle_with(data, mine)
    assert got["part"] is got["more"][0] is mine
    assert got["more"][1:] == [1, None]


def test_frames_are_shared_grow_and_do_not_overlap():
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
def maker(small_document):
    made = UpdateBuilder(small_document)
    made.start(lambda: None)
    yield made
    made.stop()


def same(sketch: Sketch, small_document: Document) -> bool:
    layers = all(np.array_equal(sketch.layers[name], small_document.layer(name)) for name in LAYERS)
    return layers and settings_of(sketch) == settings_of(small_document.sketch)


def paint(document, layer, box, label, *, commit=False):
    draft = document.begin_draft(layer)
    top, left, bottom, right = box
    draft.image[top:bottom, left:right] = label
    draft.touch(box)
    if commit:
        draft.commit("Paint")
    return draft


def test_the_first_update_holds_everything_and_a_stroke_its_box_only(small_document, maker):
    update, fresh = maker.next()
    assert fresh
    assert set(update.layers) == set(LAYERS)
    assert update.shape == (40, 60)

    maker.next()
    draft = paint(small_document, "mountain", (10, 20, 12, 25), 1)
    update, fresh = maker.next()
    assert not fresh
    assert list(update.layers) == ["mountain"]
    assert update.layers["mountain"].pixels.shape == (2, 5)
    draft.image[10:12, 20:25] = 2  # the stroke goes on: what was sent stays
    assert (update.layers["mountain"].pixels == 1).all()


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 4))])
def test_a_mirror_follows_strokes_undo_settings_and_other_documents(small_document, maker, seed):
    rng = np.random.default_rng(seed)
    mirror, second = SketchMirror(), SketchMirror()
    mirror.apply(maker.next()[0])
    for turn in range(60):
        choice = int(rng.integers(0, 7))
        if choice <= 2:
            layer, (top, left) = str(rng.choice(list(LAYERS))), rng.integers(0, (30, 50)).tolist()
            box = (top, left, top + int(rng.integers(1, 10)), left + int(rng.integers(1, 10)))
            paint(small_document, layer, box, rng.integers(0, 4), commit=choice > 0)
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
            mirror.apply(maker.next()[0])
        if rng.random() < 0.3:
            second.apply(mirror.changes())
    mirror.apply(maker.next()[0])
    second.apply(mirror.changes())
    assert second.version == mirror.version
    assert same(mirror.sketch(), small_document)
    assert same(second.sketch(), small_document)


def test_what_stays_as_it_was_stays_the_same_array(small_document, maker):
    mirror = SketchMirror()
    mirror.apply(maker.next()[0])
    before = mirror.sketch()
    draft = paint(small_document, "mountain", (3, 3, 5, 5), 1)
    mirror.apply(maker.next()[0])
    stroke = mirror.sketch()
    assert stroke.layers["hill"] is before.layers["hill"]
    assert stroke.layers["mountain"] is not before.layers["mountain"]
    draft.commit("Paint mountains")
    mirror.apply(maker.next()[0])
    assert mirror.sketch().layers["mountain"] is stroke.layers["mountain"]


EVERYWHERE = (-np.inf, -np.inf, np.inf, np.inf)


class Bumpy:
    """A plane with a bump, that counts what it is asked."""

    def __init__(self, shape=(60, 90), bump=0.0):
        self.sketch = Sketch(extent=900.0, layers={"hill": np.zeros(shape, np.uint8)})
        self.bump = bump
        self.asked = 0

    def heights(self, x, y, *, cell_size=0.0):
        x, y = np.broadcast_arrays(x, y)
        self.asked += x.size
        inside = (np.abs(x - 300.0) < 50.0) & (np.abs(y - 200.0) < 50.0)
        return (0.1 * x + 0.2 * y + self.bump * inside).astype(np.float32)


BUMP = (250.0, 150.0, 350.0, 250.0)


def finish(maker):
    while maker.busy:
        made = maker.work(0.001)
    return made


def expected(ground):
    rows, columns, size = ground.sketch.height_px, ground.sketch.width_px, ground.sketch.pixel_size
    x, y = (np.arange(columns) + 0.5) * size, (rows - np.arange(rows) - 0.5) * size
    return ground.heights(x[None], y[:, None])


def relief_of(ground, version=1):
    """Return a maker, and the whole relief that it made of a ground."""
    maker = ReliefBuilder()
    maker.set_terrain(ground, version, [EVERYWHERE])
    return maker, finish(maker)


def test_heights_stand_at_pixel_centres_and_another_size_restarts():
    ground, other = Bumpy(), Bumpy(shape=(30, 40))
    maker, made = relief_of(ground, 3)
    assert (made.version, made.step) == (3, 1)
    assert np.array_equal(made.height, expected(ground))
    assert made.shade.shape == made.height.shape

    maker.set_terrain(ground, 4, [EVERYWHERE])
    maker.work(0.0)
    maker.set_terrain(other, 5, [EVERYWHERE])
    assert np.array_equal(finish(maker).height, expected(other))


def test_a_version_that_differs_nowhere_is_taken_over_while_one_is_made():
    maker, ground = ReliefBuilder(), Bumpy()
    maker.set_terrain(ground, 3, [EVERYWHERE])
    maker.work(0.0)
    asked = ground.asked
    maker.set_terrain(ground, 4, [])
    assert finish(maker).version == 4
    assert ground.asked < asked + ground.sketch.width_px * ground.sketch.height_px
    maker.set_terrain(ground, 5, [])
    assert not maker.busy


def test_only_what_changed_is_asked_again_and_the_shading_is_that_of_the_whole():
    maker, first = relief_of(Bumpy())
    bumped = Bumpy(bump=40.0)
    maker.set_terrain(bumped, 2, [BUMP])
    second = finish(maker)
    assert bumped.asked < 0.2 * first.height.size
    assert np.array_equal(second.height, expected(Bumpy(bump=40.0)))
    assert np.array_equal(second.shade, hill_shade(second.height, 10.0))
    assert np.array_equal(first.height, expected(Bumpy()))  # what was handed out stays


def test_each_relief_is_of_one_version_even_if_others_come_meanwhile():
    maker = ReliefBuilder()
    grounds = [Bumpy(bump=10.0 * number) for number in range(6)]
    maker.set_terrain(grounds[0], 0, [EVERYWHERE])
    made = []
    for number in range(1, 6):
        made.append(maker.work(0.0))
        maker.set_terrain(grounds[number], number, [BUMP])
    while maker.busy:
        made.append(maker.work(0.0))
    made = [each for each in made if each is not None]
    assert [each.version for each in made] == sorted(each.version for each in made)
    assert made[-1].version == 5
    for each in made:
        assert np.array_equal(each.height, expected(grounds[each.version]))


def test_large_sketches_are_sampled_less_often_and_one_row_is_a_relief():
    for shape, step in [((1024, 10), 1), ((10, 1025), 2), ((4096, 2048), 4), ((1, 8), 1)]:
        _, made = relief_of(Bumpy(shape=shape))
        assert made.step == step, (shape, step)
        assert max(made.height.shape) <= LARGEST, (shape, step)
        assert made.height.shape == made.shade.shape == tuple(-(-side // step) for side in shape), shape


def test_light_comes_from_the_north_west():
    level = np.zeros((5, 5), np.float32)
    down, across = np.mgrid[:5, :5].astype(np.float32)
    plain = int(hill_shade(level, 1.0)[2, 2])
    to_light = int(hill_shade(down + across, 1.0)[2, 2])  # rises to the south-east: faces the light
    away = int(hill_shade(-down - across, 1.0)[2, 2])
    assert away < plain < to_light
