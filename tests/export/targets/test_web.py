"""The web page: its data decoded here, and the page itself in a headless Chromium."""

import base64
import functools
import json
import shutil
import subprocess
import threading
import zlib
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files

import numpy as np
import pytest
from PIL import Image

from sketchterrain.errors import InputError
from sketchterrain.export.planning import checked_plan
from sketchterrain.export.target import ExportOptions
from sketchterrain.export.targets.web import _PAGE, four_bit_weights, height_levels
from tests.export.exporting import export

from .chromium import Chromium


def decoded(folder, name):
    """Return the facts and arrays of a data script."""
    text = (folder / f"{name}.js").read_text(encoding="utf-8")
    form, own, facts, entries = json.loads(
        "[" + text.removeprefix("sketchterrainData(").removesuffix(");\n") + "]"
    )
    assert (form, own) == (1, name)
    arrays = {}
    for key, kind, size, differences, content in entries:
        planes = np.frombuffer(zlib.decompress(base64.b64decode(content)), np.uint8)
        values = np.ascontiguousarray(planes.reshape(-1, size).T).view(f"<{kind}").ravel()
        arrays[key] = np.cumsum(values, dtype=values.dtype) if differences else values
    return facts, arrays


def finer(coarse, rest):
    """Return the next level of numbers from its residuals, by the formula of web/ground.js."""
    rest = (rest >> 1).astype(np.int32) ^ -(rest & 1).astype(np.int32)
    rows, columns = coarse.shape

    def between(values):
        wide = np.concatenate([values[:1], values, values[-1:]]).astype(np.int64)
        return np.floor((9 * (wide[1:-2] + wide[2:-1]) - wide[:-3] - wide[3:] + 8) / 16).astype(np.int64)

    fine = np.zeros((2 * rows - 1, 2 * columns - 1), np.int64)
    fine[::2, ::2] = coarse
    first = (rows - 1) * columns
    fine[1::2, ::2] = (between(coarse) + rest[:first].reshape(rows - 1, columns)) % 65536
    fine[:, 1::2] = between(fine[:, ::2].T).T + rest[first:].reshape(2 * rows - 1, columns - 1)
    return fine % 65536


def heights_of(folder):
    """Return all heights (m) of the page's grid."""
    facts, _ = decoded(folder, "scene")
    grid = facts["grid"]
    coarse = decoded(folder, "coarse")[1]["heights"]
    side = -(-(grid["columns"] - 1) // grid["step"]) + 1
    numbers = coarse.reshape(-1, side)
    for level in range(grid["levels"]):
        numbers = finer(numbers, decoded(folder, f"heights{level + 1}")[1]["rest"])
    return facts["low"] + facts["metres"] * numbers[: grid["rows"], : grid["columns"]]


@pytest.fixture(scope="module")
def page(exported):
    return exported("web", size=100)


def test_heights_are_within_the_bound(page, exported):
    heights = page.sidecar["heights"]
    bound = 0.5 * heights["metres_per_step"]
    assert heights["largest_error"] == bound
    assert bound <= 0.005 + 0.5 * (heights["maximum"] - heights["minimum"]) / 65535
    expected = np.load(exported("npy", size=100).paths("_height.npy")[0])
    found = heights_of(page.folder)
    assert found.shape == expected.shape
    assert np.abs(found - expected).max() <= bound + 1e-4


def test_weights_and_levels_are_exact():
    rng = np.random.default_rng(3)
    weights = rng.multinomial(255, [0.5, 0.3, 0.15, 0.05], (9, 17)).astype(np.uint8)
    steps = four_bit_weights(weights)
    assert (steps.sum(axis=0) == 15).all()
    assert np.abs(np.moveaxis(steps, 0, -1) / 15.0 - weights / 255.0).max() <= 1.0 / 15.0 + 1e-9
    numbers = rng.integers(0, 65536, (17, 25)).astype(np.uint16)  # residuals wrap around
    coarse, *rest = height_levels(numbers)
    for each in rest:
        coarse = finer(coarse, each)
    assert (coarse == numbers).all()


def test_plants_are_where_other_exports_have_them(page, exported):
    _, arrays = decoded(page.folder, "foliage")
    scene, _ = decoded(page.folder, "scene")
    plants = np.load(exported("npy", size=100).folder / "foliage.npy")
    assert scene["plants"] == {"count": len(plants), "of": len(plants)} == page.sidecar["plants"]
    step = scene["size"][0] / 65535
    found = np.stack([arrays["x"], arrays["y"]], axis=-1) * step
    distance = np.abs(found[:, None] - np.stack([plants["x"], plants["y"]], axis=-1)[None]).max(axis=-1)
    assert distance.min(axis=1).max() <= 0.51 * step
    nearest = distance.argmin(axis=1)
    assert len(set(nearest.tolist())) == len(plants)
    scales = arrays["scale"] / 255.0 * scene["largestPlant"]
    assert np.abs(scales - plants["scale"][nearest]).max() <= 0.51 / 255.0 * scene["largestPlant"]
    assert arrays["model"].max() + 1 == len(scene["models"])
    cells = (arrays["y"] >> 10).astype(int) * 64 + (arrays["x"] >> 10)
    assert (np.diff(cells * 256 + arrays["model"]) >= 0).all()


def test_page_is_small_and_all_there(page):
    scene, sky = decoded(page.folder, "scene")
    assert sky["sky"].size == 128 * 64 * 3
    assert {f"{name}.js" for name in scene["files"]} <= {path.name for path in page.folder.iterdir()}
    assert sum(path.stat().st_size for path in page.folder.iterdir()) < 1_500_000
    html = (page.folder / "index.html").read_text(encoding="utf-8")
    assert "http" not in html
    _, water = decoded(page.folder, "water")
    assert water["triangles"].max() < water["x"].size


def test_reproducible_and_refused(corner, terrain, page, tmp_path):
    export(terrain, "web", tmp_path, size=100)
    for path in tmp_path.iterdir():
        assert path.read_bytes() == (page.folder / path.name).read_bytes(), path.name
    with pytest.raises(InputError, match="at most 4097 vertices"):
        checked_plan(corner, "web", ExportOptions(size=4098))


def test_scripts_parse():
    node = shutil.which("node")
    if node is None:
        pytest.skip("needs node")
    for name in _PAGE[1:]:
        subprocess.run(
            [node, "--check", str(files("sketchterrain.export").joinpath("web", name))], check=True
        )


# What the page is asked in the tests with a browser.
_READY = "sketchterrain.ready.then(() => sketchterrain.stats)"
_NEXT = (
    "new Promise((done) => { sketchterrain.change(); "
    "requestAnimationFrame(() => requestAnimationFrame(done)); })"
)


@pytest.fixture
def server(page):
    """Return the address of a server of the page's folder."""

    class Handler(SimpleHTTPRequestHandler):
        def log_message(self, *_: object) -> None: ...

    with ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Handler, directory=page.folder)) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


@pytest.fixture
def browser(tmp_path):
    with Chromium(tmp_path / "profile", (640, 360)) as browser:
        yield browser


def pixels(browser, path):
    """Return a screenshot as floats, (rows, columns, 3)."""
    return np.asarray(Image.open(browser.screenshot(path)).convert("RGB"), float)


@pytest.mark.soak
def test_page_shows_the_terrain(browser, page, server, tmp_path):
    for origin in (page.folder.as_uri(), server):
        browser.open(f"{origin}/index.html")
        stats = browser.run(_READY)
        assert stats["first"] < stats["complete"]
        browser.run(_NEXT)
        assert browser.console == []
        assert all(each.startswith((origin, "data:", "blob:")) for each in browser.requests)
    stats = browser.run("sketchterrain.stats")
    assert min(stats[name] for name in ("frames", "tiles", "plants")) > 0
    browser.run("document.querySelector('header').remove()")
    browser.run(_NEXT)
    picture = pixels(browser, tmp_path / "page.png")
    sky, ground = picture[:40].mean(axis=(0, 1)), picture[-80:].mean(axis=(0, 1))
    assert picture.std() > 20.0
    assert sky[2] > sky[0] + 8.0
    assert sky.mean() > ground.mean() + 20.0


@pytest.mark.soak
@pytest.mark.gl
def test_composition_is_that_of_the_still(browser, page, terrain, tmp_path):
    from sketchterrain.render.offscreen import render_picture

    browser.open((page.folder / "index.html").as_uri())
    browser.run(_READY)
    browser.run("document.querySelector('header').remove()")
    browser.run(_NEXT)
    shown = pixels(browser, tmp_path / "page.png")
    still = render_picture(terrain, size=(640, 360)).astype(float)
    ours, theirs = (each.mean(axis=-1).reshape(36, 10, 64, 10).mean(axis=(1, 3)) for each in (shown, still))
    likeness = {
        shift: np.corrcoef(np.roll(ours, shift, axis=(0, 1))[4:-4, 4:-4].ravel(), theirs[4:-4, 4:-4].ravel())[
            0, 1
        ]
        for shift in ((0, 0), (3, 0), (-3, 0), (0, 4), (0, -4))
    }
    assert likeness[0, 0] > 0.75
    assert max(likeness, key=likeness.get) == (0, 0)


@pytest.mark.soak
def test_water_walking_and_the_hash(browser, page, tmp_path):
    browser.open((page.folder / "index.html").as_uri() + "#orbit,160,180,120,0,-1.5,100")  # over the lake
    browser.run(_READY)
    browser.run(_NEXT)
    assert browser.run("sketchterrain.camera.eye.map(Math.round).join()") == "160,180,120"
    decoded_there = browser.run(
        "(({ height, columns }) => [[...height], columns])(sketchterrain.page.ground)"
    )
    found = np.array(decoded_there[0]).reshape(-1, decoded_there[1])[:100, :100]
    assert np.abs(found - heights_of(page.folder)).max() < 1e-3
    wet = pixels(browser, tmp_path / "wet.png")[150:210, 290:350].mean(axis=(0, 1))
    browser.run("void (sketchterrain.page.meshes.water = null)")
    browser.run(_NEXT)
    dry = pixels(browser, tmp_path / "dry.png")[150:210, 290:350].mean(axis=(0, 1))
    assert wet[2] - wet[0] > dry[2] - dry[0] + 10.0
    browser.run("document.getElementById('walk').click()")
    for _ in range(4):
        browser.run("dispatchEvent(new KeyboardEvent('keydown', { code: 'KeyW' }))")
        browser.run(_NEXT)
        browser.run("dispatchEvent(new KeyboardEvent('keyup', { code: 'KeyW' }))")
        above = "(({ camera: { eye }, page }) => eye[2] - page.ground.heightAt(...eye))(sketchterrain)"
        assert browser.run(above) == pytest.approx(1.7, abs=1e-6)
    assert browser.run("sketchterrain.camera.eye[1]") > 180.0
    browser.run("document.getElementById('share').click()")
    shared = browser.run("location.hash")
    assert shared.startswith("#walk,")
    browser.run("location.hash = '#orbit,500,400,300,1,-0.2,250'")
    browser.run(_NEXT)
    assert browser.run("sketchterrain.camera.hash") == "#orbit,500,400,300,1,-0.2,250"
    browser.run(f"location.hash = '{shared}'")
    browser.run(_NEXT)
    assert browser.run("sketchterrain.camera.hash") == shared
    assert browser.console == []


@pytest.mark.soak
def test_bad_folders_get_one_line(browser, page, tmp_path):
    def shown(change):
        folder = tmp_path / "page"
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(page.folder, folder)
        change(folder)
        browser.open("about:blank")
        browser.open((folder / "index.html").as_uri())
        browser.run("sketchterrain.ready.catch(() => 0)")
        assert not browser.run("document.getElementById('message').hidden")
        return browser.run("document.getElementById('message').textContent")

    def rewritten(name, old, new):
        def change(folder):
            text = (folder / name).read_text(encoding="utf-8")
            (folder / name).write_text(text.replace(old, new, 1), encoding="utf-8")

        return change

    def half(folder):
        content = (folder / "heights3.js").read_bytes()
        (folder / "heights3.js").write_bytes(content[: len(content) // 2])

    expected = {
        "The file foliage.js is missing: export the page again.": lambda folder: (
            folder / "foliage.js"
        ).unlink(),
        "The file scene.js is missing: export the page again.": lambda folder: (folder / "scene.js").unlink(),
        "The file ground.js is missing: export the page again.": lambda folder: (
            folder / "ground.js"
        ).unlink(),
        "The file water.js is incomplete: export the page again.": rewritten("water.js", '"eN', '"eeN'),
        "The file heights3.js is incomplete: export the page again.": half,
        "The file scene.js has format 2, expected 1: export the page again.": rewritten(
            "scene.js", "(1", "(2"
        ),
        "This browser has no WebGL 2, which the page needs.": rewritten(
            "viewer.js", '"use strict";', '"use strict"; HTMLCanvasElement.prototype.getContext = () => null;'
        ),
    }
    for line, change in expected.items():
        assert shown(change) == line
