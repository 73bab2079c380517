"""Draped layers drawn into a buffer of the picture's size: cutting, coverage, depth, fades, both methods."""

import warnings
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pyogrio
import pytest
import shapely
from scipy.ndimage import maximum_filter

from sketchterrain.document.drapes import DrapedLayer
from sketchterrain.document.sketch import Sketch
from sketchterrain.drape.drapes import Drapes
from sketchterrain.errors import InputError
from sketchterrain.features.items import ENDS, STARTS, STROKE, Items
from sketchterrain.geometry.camera import Camera
from sketchterrain.render.draped import FADE, DrapedScreen, check_method
from sketchterrain.render.draped_geometry import ConvexPieces, cut, mesh_of
from sketchterrain.render.offscreen import read_picture, render_picture
from sketchterrain.render.quality import Quality
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.sky import Sun
from sketchterrain.tiles.quadtree import CASES
from tests import terrains
from tests.render.conftest import SharedTextures, Waves

SUN = Sun(200.0, 60.0)
SIZE = (160, 96)
BARE = ("clouds", "haze", "grass", "rocks", "detail", "shadows", "trees", "water")
QUALITY = replace(
    Quality.from_level(0.0, without=BARE),
    quads=64,
    tolerance=2.0,
    finest_quad=4.0,
    material_texels=128,
)
HILL = Camera((500.0, 60.0, 180.0), (500.0, 400.0, 30.0), fov=50.0)
AIR = Camera((480.0, 420.0, 900.0), (480.5, 421.0, 30.0), fov=50.0)
LOW = Camera((430.0, 250.0, 110.0), (520.0, 400.0, 60.0), fov=50.0)
FRAME = Sketch().frame
T = np.linspace(40.0, 960.0, 60)
SHAPES = {
    "bend": shapely.LineString(np.stack([T, 320.0 + 110.0 * np.sin(T / 80.0)], axis=1)),
    "cliff": shapely.LineString([(520.0, 150.0), (520.0, 700.0)]),  # across the gorge at y = 500
    "area": shapely.Polygon(
        [(200, 200), (420, 230), (380, 420), (220, 380)], [[(280, 280), (280, 320), (320, 320), (320, 280)]]
    ),
}


@pytest.fixture
def write(tmp_path):
    """Return a function that writes shapes and returns their layer."""

    def layer(*shapes, title="layer", **style):
        path = tmp_path / f"{title}.gpkg"
        kind = "Polygon" if shapes[0].geom_type == "Polygon" else "LineString"
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a file without a CRS
            values = [np.arange(len(shapes))], ["number"]
            pyogrio.raw.write(
                path, shapely.to_wkb(shapes), *values, geometry_type=kind, driver="GPKG", crs=None
            )
        return DrapedLayer(str(path), {}, style)

    return layer


def drapes_of(*layers, extent=1000.0):
    found = Drapes.open(layers, FRAME, (extent, extent), extent)
    assert not found.problems
    return found


@pytest.fixture(scope="module")
def ground():
    return terrains.plain()


@pytest.fixture(scope="module")
def studio(gl):
    """Return a function that opens a renderer.

    Its ``draw`` returns the picture from a camera, and the buffer's share.
    """
    loaded, texture = {}, gl.texture(SIZE, 4)
    framebuffer = gl.framebuffer([texture])

    def open_renderer(terrain, drapes, method):
        gl.__enter__()
        resources = SharedTextures(loaded)
        options = {"sun": SUN, "quality": QUALITY, "drapes": drapes, "drape_method": method}
        renderer = Renderer(gl, terrain, resources=resources, **options)

        def draw(camera, *, prepare=True):
            if prepare:
                renderer.prepare(camera, SIZE)
            renderer.draw(camera, framebuffer)
            share = np.zeros(SIZE[::-1])
            if textures := renderer.scenery.draped.textures:
                read = np.frombuffer(textures["draped"].read(), np.float16).reshape(*SIZE[::-1], 4)
                share = read[::-1, :, 3].astype(float)
            return read_picture(texture).astype(int), share

        return SimpleNamespace(
            renderer=renderer, draw=draw, context=gl, framebuffer=framebuffer, texture=texture
        )

    return open_renderer


def exact_share(room, camera, shape, times=6):
    """Return the share of each pixel that a shape covers, and where there is one ground in it."""
    size = (times * SIZE[0], times * SIZE[1])
    texture = room.context.texture(size, 4)
    room.renderer.draw(camera, room.context.framebuffer([texture]))
    targets = room.renderer.scenery._targets[size]
    samples = targets.sample_size[0] // size[0]
    depth = np.frombuffer(targets.depth.read(), np.float32).reshape(targets.sample_size[::-1])
    depth = depth[::-1][::samples, ::samples]
    clipped = room.renderer._clipped(camera)[0]
    x, y = np.meshgrid(
        (np.arange(size[0]) + 0.5) / size[0] * 2 - 1, 1 - (np.arange(size[1]) + 0.5) / size[1] * 2
    )
    ends = np.stack([x, y, 2.0 * depth - 1.0, np.ones_like(x)], axis=-1)
    place = ends @ np.linalg.inv(clipped.to_clip(size[0] / size[1])).T
    east, north = (place[..., axis] / place[..., 3] + camera.eye[axis] for axis in (0, 1))
    inside = shapely.contains_xy(shape, east, north) & (depth < 1.0)
    blocks = [each.reshape(SIZE[1], times, SIZE[0], times) for each in (inside, 1.0 / place[..., 3])]
    away = blocks[1]
    return blocks[0].mean(axis=(1, 3)), away.max(axis=(1, 3)) < 1.1 * away.min(axis=(1, 3))


def areas(triangles):
    one, two = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    return 0.5 * (one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0])


def test_pieces_are_cut_at_triangles_of_every_border_case_without_gap_or_overlap():
    rng = np.random.default_rng(1)
    line = np.array([[10, 10], [200, 300], [400, 310], [610, 50.0]])
    items = Items(
        np.zeros(1, np.int64),
        *(np.zeros(1, np.int32) for _ in range(2)),
        np.full(1, STROKE, np.int8),
        np.array([0, len(line)]),
        line,
        np.zeros(1),
        np.full(1, STARTS | ENDS, np.uint8),
    )
    strips = ConvexPieces.of_items(items, np.array([9.0]), np.zeros(1))
    polygons = [
        shapely.Polygon(corners[:count]) for corners, count in zip(strips.corners, strips.counts, strict=True)
    ]
    assert shapely.union_all(polygons).area == pytest.approx(sum(each.area for each in polygons))
    whole = shapely.LineString(line).buffer(8.9, cap_style="square")
    assert whole.difference(shapely.union_all(polygons)).area < 1e-6
    for case in range(CASES):
        mesh = mesh_of(64, case)
        vertices = cut(strips, mesh, (0.0, 0.0, 640.0, 640.0))
        corners = np.stack([vertices["corners"][:, :3] % 65, vertices["corners"][:, :3] // 65], axis=-1)
        weights = np.insert(vertices["weights"], 0, 1.0 - vertices["weights"].sum(axis=1), axis=1)
        assert weights.min() > -1e-5
        known = {tuple(row) for row in mesh.numbers.tolist()}
        assert all(tuple(row) in known for row in rng.permutation(vertices["corners"][:, :3])[:50].tolist())
        place = np.einsum("nk,nkd->nd", weights, corners) * [10.0, -10.0] + [0.0, 640.0]
        found = areas(place.reshape(-1, 3, 2))
        assert found.min() > -1e-6
        inside = [each.intersection(shapely.box(0, 0, 640, 640)).area for each in polygons]
        assert np.bincount(vertices["part"][::3], found) == pytest.approx(inside, abs=0.02)
        # Places are those along and across each segment.
        frame = strips.frame[vertices["part"]]
        away = place - frame[:, :2]
        along = (away * frame[:, 2:]).sum(axis=1)
        assert vertices["place"][:, 0] == pytest.approx(along, abs=2e-3)


@pytest.mark.gl
@pytest.mark.parametrize(
    ("name", "cameras"),
    [
        ("area", (HILL, AIR)),
        pytest.param("cliff", (HILL, LOW, AIR), marks=pytest.mark.slow),
        pytest.param("bend", (HILL, AIR, LOW), marks=pytest.mark.slow),
    ],
)
def test_geometry_covers_what_the_drawn_ground_shows(write, studio, name, cameras):
    shape = SHAPES[name]
    style = (
        {"fill": "#ffffff", "fill_opacity": 1.0, "colour": ""}
        if name == "area"
        else {"width": 8.0, "unit": "m"}
    )
    covered = shape if name == "area" else shape.buffer(4.0)
    room = studio(Waves(rivers=False, plants=False), drapes_of(write(shape, **style)), "geometry")
    for camera in cameras:
        _, share = room.draw(camera)
        exact, plain = exact_share(room, camera, covered)
        error = np.abs(share - exact)
        edge = ((exact > 0.0) | (share > 0.0)) & plain
        assert edge.any()
        assert np.quantile(error[edge], 0.97) < 0.5
        assert error[edge].mean() < 0.06
        assert share[plain].sum() == pytest.approx(exact[plain].sum(), rel=0.03)


@pytest.mark.gl
def test_lines_thinner_than_a_pixel_keep_their_coverage(write, studio):
    drapes = drapes_of(write(SHAPES["bend"], width=0.7, unit="m"))
    room = studio(Waves(rivers=False, plants=False), drapes, "geometry")
    for camera in (AIR, HILL):
        _, share = room.draw(camera)
        exact, plain = exact_share(room, camera, SHAPES["bend"].buffer(0.35), times=8)
        assert share[plain].sum() == pytest.approx(exact[plain].sum(), rel=0.1)


@pytest.mark.gl
@pytest.mark.parametrize("method", ["geometry", pytest.param("two-step", marks=pytest.mark.slow)])
def test_no_ground_comes_through_at_any_morph(write, studio, ground, method):
    """Of an area over everything: in each frame of a flight, and in the still after it."""
    everywhere = shapely.box(-900.0, -900.0, 1900.0, 1900.0)
    drapes = drapes_of(write(everywhere, fill="#ffffff", fill_opacity=1.0, colour=""))
    room = studio(ground if method == "two-step" else Waves(rivers=False, plants=False), drapes, method)
    room.draw(HILL)
    for number in range(4):
        eye = (300.0 + 50.0 * number, 60.0, 170.0 - 16.0 * number)
        camera = Camera(eye, (500.0, 400.0, 30.0), fov=50.0)
        room.renderer.frame(camera, room.framebuffer, elapsed=0.03)
        _, share = room.draw(camera, prepare=method == "two-step")  # whose tiles may be missing in motion
        exact, _ = exact_share(room, camera, shapely.box(-880, -880, 1880, 1880), times=1)
        ground = exact > 0.0
        bare = ground & (share < 0.98)
        assert bare.sum() <= (0.001 if method == "geometry" else 0.02) * ground.sum(), number


@pytest.mark.gl
@pytest.mark.parametrize("method", ["geometry", pytest.param("two-step", marks=pytest.mark.slow)])
def test_a_camera_reached_by_other_ways_shows_the_same_pixels(write, studio, ground, method):
    layers = [
        write(SHAPES[name], title=name, fill="#3050ff", width=3.0, dash="6 3") for name in ("bend", "area")
    ]
    terrain = ground if method == "two-step" else Waves(rivers=False, plants=False)
    room = studio(terrain, drapes_of(*layers, extent=terrain.extent), method)
    first, share = room.draw(HILL)
    assert share.any()
    for camera in (AIR, LOW):
        room.draw(camera)
        room.renderer.frame(camera, room.framebuffer, elapsed=0.1)
    again, same_share = room.draw(HILL)
    assert np.array_equal(share, same_share)
    if method == "geometry":  # other pixels depend on the terrain
        assert np.array_equal(first, again)


@pytest.mark.gl
def test_hidden_layers_and_painted_ones_draw_nothing(write, studio):
    layer = write(SHAPES["bend"])
    for visible, method in ((0, "geometry"), (0, "two-step"), (1, "tiles")):
        drapes = drapes_of(layer.replace(visible=visible))
        room = studio(Waves(rivers=False, plants=False), None, method)
        draped = room.renderer.scenery.draped
        draped.set_drapes(drapes, None)
        assert draped.painted is (drapes if method == "tiles" else None)
        room.renderer.scenery.settle_drapes = lambda: None  # painting needs a device
        room.draw(HILL)
        assert room.renderer.scenery.draped.seconds == 0.0
        assert not room.renderer.scenery.draped.textures
        assert draped.converged


def test_areas_of_two_layers_with_one_id_are_two(write):
    shapes = {"a": shapely.box(0, 0, 100, 100), "b": shapely.box(200, 0, 300, 100)}
    drapes = drapes_of(*(write(each, title=name, fill="#ff0000", colour="") for name, each in shapes.items()))
    none = np.zeros(len(drapes.styles))
    pieces = ConvexPieces.of_items(drapes.items((0, 0, 1000, 1000), 1.0), none + 1.0, none)
    fills = pieces.counts == 3
    found = areas(pieces.corners[fills, :3])
    layer = np.array([each.layer for each in drapes.styles])[pieces.parts["style"][fills].astype(int)]
    assert np.bincount(layer, found) == pytest.approx([1e4, 1e4])


def test_unknown_methods_are_refused_in_one_line():
    assert DrapedScreen(*[None] * 4, "auto").method == "tiles"
    message = r"^expected a method of draping, one of auto, tiles, two-step, geometry.*, got 'stencil'$"
    with pytest.raises(InputError, match=message):
        check_method("stencil")
    with pytest.raises(InputError, match=message):
        render_picture(None, drape_method="stencil")


def over(terrain, height, down):
    x, y = 0.4 * terrain.extent, 0.3 * terrain.extent
    z = float(terrain.heights(x, y)) + height
    along = np.array([0.1, 1.0, -np.tan(np.radians(down))])
    return Camera((x, y, z), tuple(np.add((x, y, z), 100.0 * along).tolist()), fov=50.0)


def scattered(terrain, write):
    """Return drapes with areas and lines of 12 m over a terrain."""
    at = 0.1 * terrain.extent * np.arange(1, 9)
    squares = [
        shapely.box(x, y, x + 0.05 * terrain.extent, y + 0.04 * terrain.extent) for x in at for y in at
    ]
    lines = [shapely.LineString([(x, 0.0), (0.9 * x, terrain.extent)]) for x in at]
    layers = (
        write(*squares, title="areas", fill="#4060ff", fill_opacity=0.6, colour=""),
        write(*lines, title="lines", colour="#ff4040", width=0.004 * terrain.extent, unit="m"),
    )
    return Drapes.open(layers, FRAME, terrain.size, terrain.extent)


@pytest.mark.gl
def test_methods_agree_from_the_air(ground, write, studio):
    drapes, camera = scattered(ground, write), over(ground, 0.3 * ground.extent, 40.0)
    rooms = {method: studio(ground, drapes, method) for method in ("tiles", "geometry", "two-step")}
    pictures = {method: room.draw(camera)[0] for method, room in rooms.items()}
    rooms["tiles"].renderer.set_drapes(None)
    bare, _ = rooms["tiles"].draw(camera)
    assert np.abs(pictures["tiles"] - bare).mean() > 5.0
    for method in ("geometry", "two-step"):
        apart = np.abs(pictures[method] - pictures["tiles"]).max(axis=2)
        assert np.quantile(apart, 0.8) <= 4, method
        assert np.abs((pictures[method] - pictures["tiles"]).mean(axis=(0, 1))).max() <= 1.0, method


@pytest.mark.gl
def test_a_held_feature_shows_as_painted_while_it_is_taken_and_released(ground, write, studio):
    drapes, camera = scattered(ground, write), over(ground, 0.3 * ground.extent, 40.0)
    room = studio(ground, drapes, "tiles")
    renderer = room.renderer
    painted, _ = room.draw(camera)
    renderer.set_drapes(drapes, held=(0, 29))
    held, share = room.draw(camera)
    where = share > 0.55
    assert where.sum() > 20
    assert np.quantile(np.abs(held - painted).max(axis=2)[where], 0.95) <= 4
    beside = maximum_filter(share, 5) == 0.0  # tiles are filtered: their edges are softer
    assert np.abs(held - painted).max(axis=2)[beside].max() <= 4
    renderer.set_drapes(drapes)
    room.draw(camera)  # once tiles have all again
    steps = []
    for version in ((0, 29), None):
        renderer.set_drapes(drapes, held=version)
        for _ in range(12):
            renderer.frame(camera, room.framebuffer, elapsed=FADE / 4.0, budget=1.0)
            steps.append(read_picture(room.texture).astype(int)[where])
    apart = np.abs(np.array(steps) - painted[where]).mean(axis=(1, 2))
    assert apart.max() < 16.0  # without it the area would be gone: no flash
    assert renderer.scenery.draped.converged
    renderer.set_drapes(drapes, held=(1, 3))
    renderer.set_drapes(drapes.updated(drapes.layers[:1]))  # its layer is removed
    renderer.frame(camera, room.framebuffer, elapsed=0.02)


@pytest.mark.gl
def test_rasters_are_draped_in_two_steps_as_tiles_show_them(ground, studio, tmp_path):
    import rasterio

    path, n = tmp_path / "picture.tif", 256
    at = np.arange(n)
    board = np.uint8(60 + 140 * ((at[:, None] // 32 + at[None, :] // 32) % 2))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a file without a georeference
        step = ground.extent / n
        place = rasterio.Affine(step, 0.0, 0.0, 0.0, -step, ground.extent)
        size = {"width": n, "height": n, "count": 3, "dtype": "uint8", "transform": place}
        with rasterio.open(path, "w", driver="GTiff", photometric="RGB", **size) as file:
            file.write(np.stack([board, board, 255 - board]))
    drapes = Drapes.open((DrapedLayer(str(path)),), FRAME, ground.size, ground.extent)
    assert not drapes.problems
    camera, pictures = over(ground, 0.3 * ground.extent, 40.0), {}
    for method in ("tiles", "two-step"):
        room = studio(ground, drapes, method)
        pictures[method] = room.draw(camera)[0]
        assert room.renderer.scenery.draped.converged
    apart = np.abs(pictures["two-step"] - pictures["tiles"]).max(axis=2)
    assert np.quantile(apart, 0.75) <= 4
    assert np.ptp(pictures["tiles"][60:].mean(axis=2)) > 20
