"""Textures: phases, cache, looks and folders of pictures."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sketchterrain.compute import ComputeContext, list_devices
from sketchterrain.disk import cache_folder
from sketchterrain.errors import InputError
from sketchterrain.look.texture_cache import kept
from sketchterrain.look.texture_files import read_pictures
from sketchterrain.look.texture_levels import changed_levels, made_levels
from sketchterrain.look.texture_maker import LAYERS
from sketchterrain.look.texture_mips import linear_of
from sketchterrain.render import Camera, Quality, Sun, render_picture
from sketchterrain.render.texture_places import (
    OCTAVES,
    PERIOD,
    RATIO,
    texture_phases,
    texture_uniforms,
    texture_widths,
)
from sketchterrain.render.textures import MaterialTextures

SIZE = 32
ROCK = list(LAYERS).index("rock")


@pytest.fixture(scope="module")
def levels(tmp_path_factory):
    if not list_devices():
        pytest.skip("no OpenCL device")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        return made_levels(SIZE, ComputeContext)


def save(folder, name, values, mode=None):
    Image.fromarray(np.asarray(values), mode).save(folder / name)


def test_a_look_sets_mean_colour_mean_roughness_and_relief(levels):
    look = {"rock": {"colour": "#405060", "roughness": 0.5, "bump": 0.0}}
    colour, relief = changed_levels(levels, look, {}, ComputeContext)[0]
    albedo = (colour[ROCK, ..., :3] / 255.0) ** 2
    assert np.allclose(albedo.mean(axis=(0, 1)), linear_of("#405060"), rtol=0.03)
    assert relief[ROCK, ..., 2].mean() / 255.0 == pytest.approx(0.5, abs=0.01)
    assert np.abs(relief[ROCK, ..., :2].astype(int) - 128).max() <= 1
    others = [k for k in range(len(LAYERS)) if k != ROCK]
    assert (colour[others] == levels[0][0][others]).all()
    assert (relief[others] == levels[0][1][others]).all()


def test_levels_halve_down_to_one_texel_and_stay_without_changes(levels):
    assert [colour.shape for colour, _ in levels] == [(len(LAYERS), n, n, 4) for n in (32, 16, 8, 4, 2, 1)]
    assert all(colour.shape == relief.shape for colour, relief in levels)
    assert changed_levels(levels, {}, {}, ComputeContext) is levels


def test_pictures_replace_the_maps_they_name(levels, tmp_path):
    save(tmp_path, "rock.png", np.full((8, 8, 3), (188, 128, 64), np.uint8))
    save(tmp_path, "rock_roughness.png", np.full((8, 8), 128, np.uint8))
    save(tmp_path, "rock_normal.png", np.full((8, 8, 3), (192, 128, 240), np.uint8))
    save(tmp_path, "sand_height.png", np.full((4, 4), 65535 // 2, np.uint16))
    (tmp_path / "readme.txt").write_text("not a picture")
    pictures = read_pictures(tmp_path, SIZE)
    assert set(pictures) == {"rock", "sand"}
    colour, relief = changed_levels(levels, {}, pictures, ComputeContext)[0]
    assert np.allclose((colour[ROCK, ..., :3] / 255.0) ** 2, [0.503, 0.216, 0.0513], atol=0.01)
    assert np.abs(relief[ROCK, ..., 2].astype(int) - 128).max() <= 1
    # The normal leans east, so the ground rises westward.
    assert (relief[ROCK, ..., 0] > 180).all()
    sand = list(LAYERS).index("sand")
    assert np.abs(colour[sand, ..., 3].astype(int) - 127).max() <= 1
    assert (colour[sand, ..., :3] == levels[0][0][sand, ..., :3]).all()
    assert np.abs(relief[sand, ..., :2].astype(int) - 128).max() <= 1


def test_heights_are_read_southward_or_follow_the_colour(tmp_path, levels):
    rows = np.zeros((SIZE, SIZE), np.uint8)
    rows[0] = 255
    save(tmp_path, "snow_height.png", rows)
    height = read_pictures(tmp_path, SIZE)["snow"].height
    assert (height[-1] == 1.0).all()
    assert (height[:-1] == 0.0).all()

    grey = np.zeros((SIZE, SIZE, 3), np.uint8)
    grey[:, SIZE // 2 :] = 255
    save(tmp_path, "rock.jpg", grey)
    colour, relief = changed_levels(levels, {}, read_pictures(tmp_path, SIZE), ComputeContext)[0]
    assert colour[ROCK, 5, 5, 3] < 10
    assert colour[ROCK, 5, -5, 3] > 245
    assert relief[ROCK, 5, SIZE // 2, 0] < 100


def test_invalid_folders_are_refused_with_the_name_of_the_file(tmp_path):
    cases = {
        "granite.png": r"granite\.png.*grass, soil, rock.*_height, _normal, _roughness",
        "rock_gloss.png": r"rock_gloss\.png.*grass, soil, rock.*_height, _normal, _roughness",
        "Rock.png": r"Rock\.png.*grass, soil, rock.*_height, _normal, _roughness",
        "grass.png grass.jpg": "expected one picture grass, got two",
    }
    for number, (names, line) in enumerate(cases.items()):
        folder = tmp_path / str(number)
        folder.mkdir()
        for name in names.split():
            save(folder, name, np.zeros((4, 4), np.uint8))
        with pytest.raises(InputError, match=line) as caught:
            read_pictures(folder, SIZE)
        assert "\n" not in str(caught.value), names
    (tmp_path / "grass.png").write_bytes(b"\x89PNG\r\n\x1a\nnothing more")
    for folder, line in (
        (tmp_path, r"grass\.png: expected a picture"),
        (tmp_path / "nowhere", "nowhere: expected a folder of textures"),
    ):
        with pytest.raises(InputError, match=line) as caught:
            read_pictures(folder, SIZE)
        assert "\n" not in str(caught.value), folder


@pytest.mark.gl
def test_opengl_holds_every_level(gl, levels, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    textures = MaterialTextures(gl, None, size=SIZE, looks={})
    text = """#version 430 core
    uniform sampler2DArray t; in vec4 a; out vec4 result;
    void main() { result = textureLod(t, a.xyz, a.w); }"""
    gl.simple_framebuffer((4, 4)).use()  # none at all is an error, even if nothing is drawn
    program = gl.program(vertex_shader=text, varyings=["result"])
    for part, array in enumerate((textures.colour, textures.relief)):
        array.use(0)
        for level, both in enumerate(levels):
            n = SIZE >> level
            place = (np.arange(n) + 0.5) / n
            rows = np.array([[x, y, 2.0, level] for y in place for x in place], np.float32)
            output = gl.buffer(reserve=rows.nbytes)
            gl.vertex_array(program, [(gl.buffer(rows.tobytes()), "4f4", "a")]).transform(
                output, vertices=len(rows)
            )
            got = np.frombuffer(output.read(), np.float32).reshape(n, n, 4)
            assert np.abs(got * 255.0 - both[part][2]).max() < 0.01


@pytest.mark.gl
@pytest.mark.slow
@pytest.mark.usefixtures("gl")
def test_a_picture_shows_the_textures_of_the_folder(waves, tmp_path):
    for name in ("grass", "rock"):
        save(tmp_path, f"{name}.png", np.full((8, 8, 3), (230, 20, 230), np.uint8))
    camera = Camera((500.0, 100.0, 200.0), (500.0, 300.0, 40.0), far=20_000.0)
    plain = Quality.of(0.0, without=["trees", "grass", "rocks", "clouds"])
    cheap = dataclasses.replace(plain, quads=64, material_texels=64)
    own, given = (
        render_picture(
            waves, size=(96, 54), camera=camera, sun=Sun(250.0, 35.0), quality=cheap, textures=folder
        )[-18:].mean(axis=(0, 1))
        for folder in (None, tmp_path)
    )
    assert own[1] > own[2]
    assert given[0] > 1.5 * given[1]
    assert given[2] > 1.5 * given[1]


class Maker:
    def __init__(self, content=b"some bytes of textures"):
        self.content, self.calls = content, 0

    def __call__(self):
        self.calls += 1
        return self.content


def ask(maker, folder, recipe="recipe", family="materials-8"):
    return bytes(kept(family, recipe, len(maker.content), maker, folder))


def test_cached_bytes_are_read_again_until_the_recipe_changes(tmp_path):
    maker = Maker()
    assert ask(maker, tmp_path / "new") == ask(maker, tmp_path / "new") == maker.content
    assert maker.calls == 1

    maker, other = Maker(), Maker(b"others of the family, as many bytes"[:22])
    ask(maker, tmp_path)
    ask(maker, tmp_path, family="materials-16")
    assert ask(other, tmp_path, recipe="another") == other.content
    assert other.calls == 1
    assert len(list(tmp_path.glob("materials-8-*"))) == 1
    assert len(list(tmp_path.glob("materials-16-*"))) == 1


def test_a_broken_file_is_replaced(tmp_path):
    for harm in ("cut", "longer", "changed", "empty"):
        folder, maker = tmp_path / harm, Maker()
        ask(maker, folder)
        path = next(folder.iterdir())
        content = bytearray(path.read_bytes())
        content[-1] ^= harm == "changed"
        content = {"cut": content[:-3], "longer": content + b"x", "empty": b""}.get(harm, content)
        path.write_bytes(bytes(content))
        assert ask(maker, folder) == maker.content, harm
        assert maker.calls == 2, harm
        assert ask(maker, folder) == maker.content, harm
        assert maker.calls == 2, harm


def test_without_a_writable_folder_or_a_home_nothing_is_cached(tmp_path, monkeypatch):
    place = tmp_path / "file"
    place.write_bytes(b"no folder")
    maker = Maker()
    assert ask(maker, place) == ask(maker, place / "below") == maker.content
    assert maker.calls == 2
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)

    def homeless(_):
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "expanduser", homeless)
    assert ask(maker, None) == maker.content


def test_the_folder_is_that_of_the_environment(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "sketchterrain"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert cache_folder() == Path(tmp_path / "home/.cache/sketchterrain")


WIDTHS = texture_widths()


def phases(*eye):
    return texture_phases(eye, WIDTHS).reshape(len(LAYERS), 3, OCTAVES, 2)


def test_phases_repeat_after_whole_periods_and_stay_within_one():
    grass = WIDTHS[0]
    here, there = phases(0.0, 0.0, 0.0), phases(PERIOD * grass, -2 * PERIOD * grass, 0.0)
    gap = np.abs(here - there)[0, 2, 0]
    assert np.minimum(gap, PERIOD - gap).max() < 1e-5
    far = phases(1e9, -1e9, 10.0)
    assert ((far >= 0) & (far <= PERIOD)).all()


def test_phases_are_places_in_turned_planes_over_widths():
    eye = np.array([3.0, 7.0, 2.0])
    got = phases(*eye)
    for layer, (width, _, _, turn) in enumerate(texture_uniforms(WIDTHS)["laid"]):
        for plane, axes in enumerate(((1, 2), (0, 2), (0, 1))):
            for octave in range(OCTAVES):
                place = complex(*eye[list(axes)]) * np.exp(1j * turn * octave) / (width * RATIO**octave)
                expected = np.array([place.real, place.imag]) % PERIOD
                assert np.allclose(got[layer, plane, octave], expected, atol=1e-5)


def test_beds_of_rock_lie_level_at_every_size():
    laid, spins = (texture_uniforms(WIDTHS)[name] for name in ("laid", "spins"))
    rock = list(LAYERS).index("rock")
    assert laid[rock][3] == 0.0
    assert spins[rock] == 0.0
    assert laid[0][3] > 0.0


def test_a_look_sets_the_width_of_a_texture():
    widths = texture_widths({"sand": {"size": 9.0}, "rock": {"size": 0.0}})
    names = list(LAYERS)
    assert widths[names.index("sand")] == 9.0
    assert widths[names.index("rock")] == LAYERS["rock"].width
