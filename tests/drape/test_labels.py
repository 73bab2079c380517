"""Labels of draped features: layout, texts, stability in motion, pictures."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import shapely

from sketchterrain.document.drapes import DrapeClass, DrapedLayer, draped_feature
from sketchterrain.document.sketch import Sketch
from sketchterrain.drape import label_layout
from sketchterrain.drape.label_layout import (
    FADE,
    MARGIN,
    MOST_SHOWN,
    REPEAT,
    SPACING,
    LabelCandidates,
    anchors,
    choose,
    label_text,
    place_labels,
)
from sketchterrain.generation.building import build
from sketchterrain.geometry.camera import Camera
from sketchterrain.render import labels as labels_module
from sketchterrain.render.labels import LIFT, Labels, draw_text, text_size
from sketchterrain.render.quality import Quality
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.sky import Sun
from sketchterrain.render.targets import FrameBlock

SIZE = (1280, 720)
FPS = 60.0


class Drapes:
    """Draped layers of features in memory: (geometry, properties) by id, for each layer."""

    extent = 8000.0

    def __init__(self, layers, features):
        self.layers, self.reads, self._features = tuple(layers), 0, []
        for layer, own in zip(self.layers, features, strict=True):
            edited = {name: (each.geometry, each.properties) for name, each in layer.edits.items()}
            self._features.append(dict(sorted({**own, **edited}.items())))

    def features(self, layer, box):
        ids, shapes = (
            np.array([*self._features[layer]]),
            [shape for shape, _ in self._features[layer].values()],
        )
        return ids[shapely.intersects(shapely.box(*box), shapes)]

    def table(self, layer):
        self.reads += 1
        geometry, properties = ({k: e[n] for k, e in self._features[layer].items()} for n in (0, 1))
        own = {name: SimpleNamespace(properties=each) for name, each in properties.items()}
        return SimpleNamespace(geometry=geometry.get, feature=own.get)


def drapes_of(features, **style):
    return Drapes([DrapedLayer("/a.gpkg", style={"label": "name", **style})], [dict(enumerate(features))])


def random_points(count, seed=0, extent=8000.0):
    random = np.random.default_rng(seed)
    return [
        (shapely.Point(*at), {"name": f"Place {number} {'x' * (number % 17)}"})
        for number, at in enumerate(random.uniform(0.0, extent, (count, 2)))
    ]


def flat(x, y):
    return np.zeros(len(x), np.float32)


def candidates(drapes, eye=(4000.0, 4000.0, 500.0), heights=flat):
    found = LabelCandidates(text_size, heights)
    found.set_drapes(drapes)
    found.update(eye, 500.0, np.inf)
    assert found.complete
    found.anchors["seen"] = True
    return found


def clip_of(rows, camera, size=SIZE):
    matrix = camera.to_clip(size[0] / size[1])
    return (rows["place"] - camera.eye) @ matrix[:, :3].T + matrix[:, 3]


def overlaps(boxes, margin=0.0):
    """Return whether pairs of different boxes are nearer than a margin, (n, n)."""
    low = np.maximum(boxes[:, None, :2], boxes[None, :, :2])
    high = np.minimum(boxes[:, None, 2:], boxes[None, :, 2:])
    return ((high - low) > -margin).all(axis=-1) & ~np.eye(len(boxes), dtype=bool)


def test_random_layouts_do_not_overlap_and_respect_priority():
    random = np.random.default_rng(1)
    for _ in range(300):
        n = random.integers(1, 120)
        low = random.uniform(0.0, 600.0, (n, 2))
        boxes = np.concatenate([low, low + random.uniform(5.0, 90.0, (n, 2))], axis=1)
        state = random.choice([0, 0, 1, 2], n).astype(np.int8)
        order = np.argsort(-state, kind="stable")
        chosen = choose(order, boxes, np.arange(n), state)
        assert not chosen[state == 1].any()
        assert not overlaps(boxes[chosen]).any()
        near = overlaps(boxes, MARGIN)
        new = np.flatnonzero(chosen & (state == 0))
        assert not near[np.ix_(new, np.flatnonzero(chosen | (state == 1)))].any()
        # What is left out is too close to one that comes before it.
        rank = np.argsort(order)
        for i in np.flatnonzero(~chosen & (state == 0)):
            before = (rank < rank[i]) & (chosen | (state == 1))
            assert near[i, before].any()


def test_number_of_labels_is_limited_and_repeats_are_apart():
    n = 900
    low = np.stack(np.divmod(np.arange(n), 30), axis=1) * 100.0
    boxes = np.concatenate([low, low + 10.0], axis=1)
    state, order = np.zeros(n, np.int8), np.arange(n)
    assert np.flatnonzero(choose(order, boxes, order, state)).tolist() == list(range(MOST_SHOWN))
    chosen = choose(order, boxes, np.zeros(n, np.int64), state)
    apart = np.abs(low[chosen][:, None] - low[chosen][None]).max(axis=-1)
    assert chosen.sum() > 50
    assert (apart[~np.eye(len(apart), dtype=bool)] >= REPEAT).all()


def test_text_of_properties():
    for value, text in (
        (None, ""), ("", ""), ("  ", ""), (float("nan"), ""), (3.0, "3"), (2.5, "2.5"), (7, "7"), (0, "0"),
        ("Piz d'Err\n Süd", "Piz d'Err Süd"), ("a\x00b", "a\ufffdb"), ("x" * 48, "x" * 48),
        ("x" * 49, "x" * 47 + "…"), ("y" * 10**6, "y" * 47 + "…"),
    ):  # fmt: skip
        assert label_text(value) == text


def test_anchors_lie_on_their_features():
    ring = shapely.Point(500, 500).buffer(400).difference(shapely.Point(500, 500).buffer(300))
    line = shapely.LineString([(0, 0), (3000, 0), (3000, 5000)])
    shapes = [
        shapely.Point(1, 2), shapely.MultiPoint([(0, 0), (5, 5)]), ring, line,
        shapely.MultiPolygon([ring, shapely.box(2000, 0, 2001, 1)]),
        shapely.MultiLineString([line, [(0, 9), (1, 9)]]),
        shapely.GeometryCollection([shapely.Point(0, 0), line, ring]),
        shapely.Polygon([(0, 0), (1000, 1000), (1000, 0), (0, 900)]),
    ]  # fmt: skip
    for shape in shapes:
        places, weight = anchors(shape)
        assert len(places)
        assert (shapely.distance(shapely.points(places), shape) < 1e-6).all()
        assert (weight > 0.0) == (shapely.get_dimensions(shape) > 0)
    places, _ = anchors(line)
    along = [line.project(shapely.Point(place)) for place in places]
    assert along[0] == pytest.approx(4000.0)  # the middle comes first
    assert (np.diff(np.sort(along)) >= SPACING).all()
    for nothing in (None, shapely.Point(), shapely.Polygon(), shapely.GeometryCollection()):
        assert len(anchors(nothing)[0]) == 0


def test_layers_classes_and_edits_decide_what_is_labelled():
    features = {
        0: (shapely.Point(10, 10), {"name": "low", "kind": "a"}),
        1: (shapely.Point(20, 10), {"name": "other", "kind": "b", "long": "Long"}),
        2: (shapely.Point(30, 10), {"name": None}),
        3: (shapely.LineString([(0, 0), (100, 0)]), {"name": "line"}),
        4: (shapely.LineString([(0, 0), (90, 0)]), {"name": "shorter"}),
    }
    layer = DrapedLayer(
        "/a.gpkg",
        values={"by": "kind"},
        style={"label": "name"},
        classes=(DrapeClass("b", {"label": "long", "label_size": 20.0}),),
    )
    bare = DrapedLayer("/b.gpkg")
    drapes = Drapes([layer, bare, layer], [features] * 3)
    found = candidates(drapes)
    texts = [found.labels[label].text for label in found.anchors["label"]]
    assert texts == ["line", "shorter", "low", "Long"] * 2  # the upper layer first, then by length and id
    assert found.anchors["size"][3].tolist() == list(text_size("Long", 20.0))
    # Colours and another feature's edit read nothing again; the edited feature is read.
    reads = drapes.reads
    edit = draped_feature(shapely.Point(11, 10), {"name": "New"}, 0)
    layers = [layer.replace(label_colour="#ff0000", edits={0: edit}), bare, layer]
    edited = Drapes(layers, [features] * 3)
    found.set_drapes(edited)
    found.update((4000.0, 4000.0, 500.0), 500.0, np.inf)
    assert edited.reads == 1
    assert drapes.reads == reads
    assert "New" in [found.labels[label].text for label in found.anchors["label"]]
    found.set_drapes(Drapes([layer.replace(visible=0), bare, layer.replace(visible=0)], [features] * 3))
    found.update((4000.0, 4000.0, 500.0), 500.0, np.inf)
    assert not len(found.anchors)
    found.set_drapes(None)


def orbit(turn, radius=3000.0):
    eye = (4000.0 + radius * np.sin(turn), 4000.0 + radius * np.cos(turn), 900.0)
    return Camera(eye, (4000.0, 4000.0, 0.0))


def pan(shift):
    return Camera((3000.0 + shift, -500.0, 900.0), (3000.0 + shift, 3000.0, 0.0))


def test_slow_motion_never_blinks():
    for path, steps in ((orbit, np.linspace(0.0, 0.1, 180)), (pan, np.linspace(0.0, 180.0, 180))):
        found = candidates(drapes_of(random_points(1500)))
        rows = found.anchors
        random = np.random.default_rng(2)
        shown = []
        for step in steps:
            rows["seen"] = random.uniform(size=len(rows)) > 0.02  # depth at an edge flickers
            boxes = place_labels(rows, clip_of(rows, path(step)), SIZE, elapsed=1.0 / FPS, settled=False)
            assert not overlaps(boxes[rows["shown"]]).any()
            shown.append(rows["shown"].copy())
        shown = np.array(shown)
        assert shown[60:].sum(axis=1).min() > 30
        changes = np.diff(shown.astype(np.int8), axis=0)
        for column in changes.T[(changes != 0).any(axis=0)]:
            at = np.flatnonzero(column)
            # From one change of a label to the next one it takes longer than fading out and in.
            assert (np.diff(at) / FPS >= FADE).all()


def test_labels_fade():
    found = candidates(drapes_of(random_points(300)))
    rows, camera = found.anchors, orbit(0.0)
    before = rows["opacity"].copy()
    for step in range(120):
        place_labels(rows, clip_of(rows, camera), SIZE, elapsed=1.0 / FPS, settled=step > 60)
        assert np.abs(rows["opacity"] - before).max() <= 1.0 / FPS / FADE + 1e-6
        before = rows["opacity"].copy()
    assert set(before) == {0.0, 1.0}
    assert (rows["shown"] == (before == 1.0)).all()


def test_settled_layout_depends_on_the_view_alone():
    camera, results = orbit(0.3), []
    for start in (None, 0.0, 0.6):
        found = candidates(drapes_of(random_points(1500)), eye=(500.0, 7000.0, 200.0))
        if start is not None:
            for turn in np.linspace(start, 0.3, 30):
                rows, view = found.anchors, orbit(turn)
                found.update(view.eye, 900.0, np.inf)
                place_labels(rows, clip_of(rows, view), SIZE, elapsed=1.0 / FPS, settled=False)
            for _ in range(40):
                rows = found.anchors
                place_labels(rows, clip_of(rows, camera), SIZE, elapsed=1.0 / FPS, settled=True)
        else:
            found.update(camera.eye, 900.0, np.inf)
            rows = found.anchors
            place_labels(rows, clip_of(rows, camera), SIZE, elapsed=np.inf, settled=True)
        assert set(rows["opacity"]) == {0.0, 1.0}
        results.append(sorted(rows["feature"][rows["shown"]].tolist()))
    assert len(results[0]) > 40
    assert results[0] == results[1] == results[2]


def test_reading_keeps_to_its_time_and_takes_the_nearest(monkeypatch):
    clock = iter(np.arange(10**6) * 1e-4)
    monkeypatch.setattr(label_layout.time, "perf_counter", lambda: next(clock))
    drapes = drapes_of(random_points(400))
    found = LabelCandidates(text_size, flat)
    found.set_drapes(drapes)
    eye = (4000.0, 4000.0, 300.0)
    found.update(eye, 300.0, 1e-3)
    assert 5 <= drapes.reads <= 12
    away = np.abs(found.anchors["place"][:, :2] - 4000.0).max()
    assert away <= 2.0 * 4.5 * 256.0
    while not found.complete:
        found.update(eye, 300.0, 1e-3)
    assert drapes.reads == 400
    monkeypatch.setattr(label_layout, "MOST_FEATURES", 100)
    found.update((1000.0, 1000.0, 300.0), 300.0, np.inf)
    assert len(found.anchors) == 100
    assert found.complete


def test_letters_are_those_of_the_text():
    assert (draw_text("Zürich", 13.0) != draw_text("Zurich", 13.0)).any() or len(labels_module._fonts()) == 1
    for text in ("Bern", "Łódź", "富士山", "a" * 48, "\U0001f600"):
        letters, outlined = np.moveaxis(draw_text(text, 13.0).astype(int), -1, 0)
        assert letters.shape[::-1] == text_size(text, 13.0)
        assert letters.max() > 200
        assert (outlined >= letters).all()
        assert not outlined[:, 0].any() or outlined.shape[1] < 8 or outlined[:, 0].mean() < 128


def test_without_other_fonts_accents_are_dropped(monkeypatch):
    own = labels_module._fonts()[-1:]
    labels_module._drawable.cache_clear()
    monkeypatch.setattr(labels_module, "_fonts", lambda: own)
    assert labels_module._drawable("Zürich, Łódź 山", 13.0)[0] == "Zurich, ?odz ?"
    labels_module._drawable.cache_clear()


@pytest.fixture
def drawn(gl):
    """Return a function that draws labels for a camera over a plain colour, with a wall in front or none."""
    size = (320, 180)
    depth = gl.depth_texture(size)
    depth.compare_func = ""
    texture = gl.texture(size, 4)
    targets = SimpleNamespace(depth=depth, tonemapped=gl.framebuffer([gl.texture(size, 4)]), size=size)
    target = gl.framebuffer([texture])
    scene = gl.framebuffer([], depth)

    def draw(drapes, *, ground=(0.0, 0.0, 0.0), wall=np.inf, heights=0.0):
        camera = Camera((0.0, -1000.0, 300.0), (0.0, 0.0, 0.0), near=1.0, far=30_000.0)
        terrain = SimpleNamespace(
            heights=lambda x, y, cell_size=0.0: np.full(np.shape(x), heights, np.float32), sea_level=None
        )
        frame = FrameBlock(gl)
        frame["to_clip"] = camera.to_clip(size[0] / size[1])
        frame.upload()
        scene.clear(depth=(1.0 - camera.near / wall) / (1.0 - camera.near / camera.far))
        labels = Labels(gl, terrain)
        labels.set_drapes(drapes)
        assert labels.update(camera.eye, 300.0, None, np.inf)
        target.clear(*ground, 1.0)
        labels.test(targets, camera.eye)
        labels.draw(camera, target, moving=False)
        assert labels.converged
        pixels = np.frombuffer(texture.read(), np.uint8).reshape(size[1], size[0], 4)[::-1, :, :3]
        return pixels.astype(int), labels

    return draw


@pytest.mark.gl
def test_drawn_labels_are_legible_and_stand_above_their_place(drawn):
    for ground in (0.0, 0.5, 1.0):
        for colour in ("#202020", "#e03131", "#ffffff"):
            drapes = drapes_of([(shapely.Point(0.0, 0.0), {"name": "Höhe 12"})], label_colour=colour)
            picture, _ = drawn(drapes, ground=(ground,) * 3)
            changed = (np.abs(picture - round(255 * ground)) > 2).any(axis=-1)
            rows, columns = np.nonzero(changed)
            # The centre of the picture is its place.
            assert abs(0.5 * (columns.min() + columns.max()) - 159.5) <= 2.0
            assert 2 <= 90 - rows.max() <= 12
            assert rows.max() - rows.min() <= 22
            grey = picture[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1] @ (
                0.2126,
                0.7152,
                0.0722,
            )
            assert grey.max() - grey.min() > 100.0  # letters against their outline


@pytest.mark.gl
def test_labels_behind_terrain_are_not_shown(drawn):
    drapes = drapes_of([(shapely.Point(0.0, 0.0), {"name": "Hidden"})])
    for wall, is_shown in ((np.inf, True), (1100.0, True), (1043.0, True), (1000.0, False), (50.0, False)):
        picture, _ = drawn(drapes, wall=wall)
        assert bool(picture.any()) == is_shown, wall


@pytest.mark.gl
def test_text_that_fills_the_atlas_is_left_out(drawn, monkeypatch):
    monkeypatch.setattr(labels_module, "ATLAS", (64, 32))
    features = [(shapely.Point(200.0 * k - 300.0, 0.0), {"name": f"P{k}"}) for k in range(4)]
    features.append((shapely.Point(0.0, 300.0), {"name": "much longer than sixty-four pixels"}))
    picture, labels = drawn(drapes_of(features))
    assert picture.any()
    assert len(labels._cells) == 3
    picture, _ = drawn(drapes_of(features[-1:]))
    assert not picture.any()


def numbered(count, extent):
    return [(place, {"name": str(n)}) for n, (place, _) in enumerate(random_points(count, extent=extent))]


@pytest.fixture(scope="module")
def scene(gl):
    """A terrain with a mountain, a camera in front of it, and what draws it at a quality."""
    mountain = np.zeros((96, 96), np.uint8)
    mountain[30:40, 20:70] = 1
    terrain = build(Sketch(extent=3072.0, seed=3, layers={"mountain": mountain}))
    eye = (1400.0, 100.0, float(terrain.heights(1400.0, 100.0)) + 150.0)
    size = (240, 136)
    texture = gl.texture(size, 4)

    def renderer(level):
        quality = replace(Quality.from_level(level), map_texels=128, material_texels=128, budget=0.25)
        renderer = Renderer(gl, terrain, sun=Sun(140.0, 40.0), quality=quality)
        renderer.scenery.labels.set_drapes(drapes_of(numbered(500, 3072.0), label_size=6.0))
        return renderer

    view = Camera(eye, (1500.0, 1500.0, 100.0), fov=50.0)
    return SimpleNamespace(
        terrain=terrain, view=view, renderer=renderer, texture=texture, target=gl.framebuffer([texture])
    )


@pytest.mark.slow
@pytest.mark.gl
def test_frames_come_to_rest_as_stills(scene):
    renderer, view = scene.renderer(0.0), scene.view
    labels = renderer.scenery.labels
    drapes, shown, pictures = labels._candidates._drapes, [], []
    for path in ((), (-150.0, -75.0), (700.0,)):
        labels.set_drapes(None)
        labels.set_drapes(drapes)
        for shift in path:
            eye = (view.eye[0] + shift, *view.eye[1:])
            renderer.frame(replace(view, eye=eye), scene.target, elapsed=0.05)
        if path:
            while not renderer.frame(view, scene.target, elapsed=0.3).converged:
                pass
        else:
            renderer.prepare(view, scene.target.size)
            renderer.draw(view, scene.target)
        rows = labels._candidates.anchors
        assert (rows["opacity"] == rows["shown"]).all()
        shown.append(rows["feature"][rows["shown"]].tolist())
        pictures.append(scene.texture.read())
    film, blinks = [], 0
    for number in range(12):
        eye = (view.eye[0] + 0.5 * number, *view.eye[1:])
        renderer.prepare(replace(view, eye=eye), scene.target.size, elapsed=0.04)
        renderer.draw(replace(view, eye=eye), scene.target)
        rows = labels._candidates.anchors
        film.append({*rows["feature"][rows["shown"]].tolist()})
        blinks += number > 1 and len((film[-3] & film[-1]) - film[-2])
    assert len(film[0]) > 10
    assert not blinks
    assert len(shown[0]) > 10
    assert shown[1] == shown[2]
    assert pictures[1] == pictures[2]
    assert len(set(shown[0]) ^ set(shown[1])) <= 3  # a still has other tiles


@pytest.mark.slow
@pytest.mark.gl
def test_visibility_agrees_with_lines_of_sight_on_true_heights(scene):
    renderer, view, size = scene.renderer(0.75), scene.view, scene.target.size
    renderer.prepare(view, size)
    renderer.draw(view, scene.target)
    rows = renderer.scenery.labels._candidates.anchors
    along = rows["place"] - view.eye
    clip = clip_of(rows, replace(view, near=1.0), size)
    inside = (np.abs(clip[:, :2]) < clip[:, 3:]).all(axis=1)
    share = np.linspace(0.0, 0.97, 400)[:, None]
    ground = scene.terrain.heights(*(view.eye[axis] + share * along[:, axis] for axis in (0, 1)))
    pixel = 2.0 * np.tan(np.radians(25.0)) / size[1]
    for lift, seen in ((LIFT + 1.0, False), (LIFT - 1.0, True)):
        rise = along[:, 2] + lift * pixel * clip[:, 3]
        clear = (view.eye[2] + share * rise - ground).min(axis=0)
        certain = inside & (clear > 3.0 if seen else clear < -3.0)
        assert certain.sum() >= 30
        assert (rows["seen"][certain] == seen).mean() > 0.98
