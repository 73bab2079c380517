"""Material textures: procedural layers, mipmaps, cache, looks, user images, phases."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sketchterrain.compute.context import ComputeContext
from sketchterrain.errors import InputError
from sketchterrain.io.disk_cache import cached_bytes
from sketchterrain.io.files import cache_folder
from sketchterrain.look.texture_levels import (
    customized_levels,
    decode_level,
    emboss,
    mipmaps,
    paint_layer,
    procedural_levels,
    read_material_images,
)
from sketchterrain.render.quality import Quality
from sketchterrain.render.textures import (
    OCTAVES,
    PERIOD,
    RATIO,
    MaterialTextures,
    texture_phases,
    texture_uniforms,
    texture_widths,
)
from sketchterrain.schema.colours import linear_from_hex
from sketchterrain.schema.materials import BUILT_IN, Texture
from tests.devices import DEVICES, each_other_device, needs_device

from .conftest import Waves
from .test_shaders import evaluate

pytestmark = needs_device
SIDE = 64


@pytest.fixture(scope="module")
def context():
    return ComputeContext()


@pytest.fixture(scope="module")
def painted(context):
    return [paint_layer(context, name, SIDE) for name in BUILT_IN.layers]


def test_float_build_matches_double(painted):
    with_double = [device for device in DEVICES if device.has_double]
    if not with_double:
        pytest.skip("no device with 64-bit floats")
    double = ComputeContext(with_double[0], real="double")
    for index, name in enumerate(BUILT_IN.layers):
        off = np.abs(painted[index] - paint_layer(double, name, SIDE)).max(axis=-1)
        # Where two stones are equally high, or a texel is on a border, either may win.
        assert np.quantile(off, 0.995) < 1e-4, name
        assert off.mean() < 1e-3, name


@each_other_device
def test_devices_are_bit_equal(painted, other):
    context = ComputeContext(other)
    for mine, layer in zip(painted, BUILT_IN.layers.values(), strict=True):
        theirs = paint_layer(context, layer.name, SIDE)
        np.testing.assert_array_equal(mine, theirs, err_msg=f"{layer.name} on {other.platform}")
        assert (emboss(ComputeContext(), mine, layer) == emboss(context, mine, layer)).all()


def test_textures_tile(context):
    for name in BUILT_IN.layers:
        # Finer than their finest structure, so that neighbouring texels are near each other.
        height = paint_layer(context, name, 512)[..., 3]
        for axis in (0, 1):
            step = np.abs(np.roll(height, -1, axis) - height)
            assert step.take(-1, axis).mean() < 1.6 * step.mean(), name


def test_albedos_are_in_measured_ranges(painted):
    lows = (0.03, 0.05, 0.15, 0.15, 0.22, 0.80, 0.10, 0.02, 0.12, 0.03, 0.06, 0.03, 0.01)
    highs = (0.12, 0.15, 0.35, 0.30, 0.45, 0.92, 0.25, 0.09, 0.30, 0.15, 0.16, 0.09, 0.06)
    albedos = dict(zip(BUILT_IN.layers, (layer[..., :3] for layer in painted), strict=True))
    for (name, albedo), low, high in zip(albedos.items(), lows, highs, strict=True):
        assert low < albedo.mean() < high, name
        assert albedo.min() >= 0.0, name
        assert albedo.max() <= 0.95, name
    grass, sand = (albedos[name].mean(axis=(0, 1)) for name in ("grass", "sand"))
    assert grass[1] > 1.15 * grass[0] > 1.15 * grass[2]
    assert sand[0] > sand[1] > sand[2]

    for name, layer in BUILT_IN.layers.items():
        assert 0.0 < layer.high < layer.low <= 1.0, name
        assert 0.0 < layer.bump < 0.5, name
        assert layer.width > 0.0, name


def test_relief_matches_the_oracle(context):
    rng = np.random.default_rng(3)
    painted = rng.uniform(0.2, 0.8, (32, 32, 4))
    layer = Texture("plain", 1.0, 0.05, 0.9, 0.6, (0, 0))
    got = emboss(context, painted, layer)
    height = painted[..., 3]
    steep = 0.05 * 32
    east = 0.5 * steep * (np.roll(height, -1, 1) - np.roll(height, 1, 1))
    north = 0.5 * steep * (np.roll(height, -1, 0) - np.roll(height, 1, 0))
    openness = np.zeros_like(height)
    for along, up in ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)):
        horizon = np.zeros_like(height)
        for step in (1, 2, 4, 8, 16, 32):
            over = np.roll(height, (-step * up, -step * along), (0, 1)) - height
            horizon = np.maximum(horizon, over / (step * np.hypot(along, up)))
        openness += 0.125 / (1.0 + (steep * horizon) ** 2)
    expected = np.stack([east, north, 0.9 - 0.3 * height, openness], axis=-1)
    assert np.abs(got - expected).max() < 2e-6
    flat = emboss(context, np.full((16, 16, 4), 0.5), Texture("plain", 1.0, 0.1, 0.9, 0.7, (0, 0)))
    assert np.allclose(flat, [0.0, 0.0, 0.8, 1.0], atol=1e-6)


BYTE = 0.5 / 255.0


def surface(size, seed=5, steep=0.4):
    rng = np.random.default_rng(seed)
    painted = rng.uniform(0.05, 0.8, (size, size, 4))
    relief = np.empty((size, size, 4))
    relief[..., :2] = steep * rng.standard_normal((size, size, 2))
    relief[..., 2:] = rng.uniform(0.3, 0.7, (size, size, 2))
    return painted, relief


def block_mean(fields, side):
    n = len(fields) // side
    return fields.reshape(n, side, n, side, -1).mean(axis=(1, 3))


def test_mipmaps_match_float64_averages_and_decoding_inverts():
    painted, relief = surface(32, steep=0.3)
    levels = list(mipmaps(painted, relief))
    for got, expected, bound in zip(decode_level(*levels[0]), (painted, relief), (4e-3, 0.03), strict=True):
        assert np.abs(got - expected).max() < bound
    assert [len(colour) for colour, _ in levels] == [32, 16, 8, 4, 2, 1]
    slopes = relief[..., :2]
    for k, (colour, got) in enumerate(levels):
        side = 2**k
        mean = block_mean(painted, side)
        assert np.abs(colour[..., :3] / 255.0 - np.sqrt(mean[..., :3])).max() < BYTE + 1e-6
        assert np.abs(colour[..., 3] / 255.0 - mean[..., 3]).max() < BYTE + 1e-6
        flat = block_mean(slopes, side)
        scatter = (block_mean(slopes**2, side) - flat**2).mean(axis=-1)
        alpha2 = block_mean(relief[..., 2:3] ** 4, side)[..., 0] + 2.0 * scatter
        expected = np.minimum(alpha2, 1.0) ** 0.25
        normal = -flat / np.sqrt(1.0 + (flat**2).sum(axis=-1, keepdims=True))
        assert np.abs(got[..., :2] / 255.0 - (0.5 + 0.5 * normal)).max() < BYTE + 1e-6
        assert np.abs(got[..., 2] / 255.0 - expected).max() < BYTE + 1e-5
        assert np.abs(got[..., 3] / 255.0 - block_mean(relief[..., 3:], side)[..., 0]).max() < BYTE + 1e-6


def density(slope, alpha):
    """Trowbridge and Reitz's distribution over slopes; integrates to 1."""
    return alpha**2 / (np.pi * (alpha**2 + slope) ** 2)


def test_filtered_texel_reflects_like_the_fine_ones():
    grid = np.linspace(-3.0, 3.0, 61)
    area = (grid[1] - grid[0]) ** 2
    x, y = np.meshgrid(grid, grid)
    for roughness, steep in ((0.5, 0.3), (0.6, 0.5), (0.7, 0.2)):
        slopes = steep * np.random.default_rng(8).standard_normal((4096, 2))
        alpha = roughness**2
        together = np.mean([density((x - p) ** 2 + (y - q) ** 2, alpha) for p, q in slopes], axis=0)
        mean = slopes.mean(axis=0)
        around = (x - mean[0]) ** 2 + (y - mean[1]) ** 2
        rougher = float((roughness**4 + 2.0 * slopes.var(axis=0).mean()) ** 0.25)
        filtered, plain = density(around, rougher**2), density(around, alpha)
        error, without = (0.5 * np.abs(each - together).sum() * area for each in (filtered, plain))
        # Half the L1 distance is the share of light that goes elsewhere. A sum of lobes is no lobe of their
        # kind, so some remains; averaging normals alone misplaces far more.
        assert error < 0.13, (roughness, steep)
        assert error < 0.55 * without, (roughness, steep)


SIZE = 32
ROCK = list(BUILT_IN.layers).index("rock")


@pytest.fixture(scope="module")
def levels(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        return procedural_levels(SIZE, ComputeContext)


def save(folder, name, values, mode=None):
    Image.fromarray(np.asarray(values), mode).save(folder / name)


def test_look_sets_mean_colour_roughness_and_bump(levels):
    assert [colour.shape for colour, _ in levels] == [
        (len(BUILT_IN.layers), n, n, 4) for n in (32, 16, 8, 4, 2, 1)
    ]
    assert all(colour.shape == relief.shape for colour, relief in levels)
    assert customized_levels(levels, BUILT_IN, {}, {}, ComputeContext) is levels

    look = {"rock": {"colour": "#405060", "roughness": 0.5, "bump": 0.0}}
    colour, relief = customized_levels(levels, BUILT_IN, look, {}, ComputeContext)[0]
    albedo = (colour[ROCK, ..., :3] / 255.0) ** 2
    assert np.allclose(albedo.mean(axis=(0, 1)), linear_from_hex("#405060"), rtol=0.03)
    assert relief[ROCK, ..., 2].mean() / 255.0 == pytest.approx(0.5, abs=0.01)
    assert np.abs(relief[ROCK, ..., :2].astype(int) - 128).max() <= 1
    others = [k for k in range(len(BUILT_IN.layers)) if k != ROCK]
    assert (colour[others] == levels[0][0][others]).all()
    assert (relief[others] == levels[0][1][others]).all()

    tinted = customized_levels(levels, BUILT_IN, {"rock": {"colour": "#405060"}}, {}, ComputeContext)
    for (colour, relief), (_, own) in zip(tinted, levels, strict=True):
        albedo = (colour[ROCK, ..., :3] / 255.0) ** 2
        assert np.allclose(albedo.mean(axis=(0, 1)), linear_from_hex("#405060"), rtol=0.03)
        assert (relief == own).all()


def test_user_images_replace_their_maps(levels, tmp_path):
    save(tmp_path, "rock.png", np.full((8, 8, 3), (188, 128, 64), np.uint8))
    save(tmp_path, "rock_roughness.png", np.full((8, 8), 128, np.uint8))
    save(tmp_path, "rock_normal.png", np.full((8, 8, 3), (192, 128, 240), np.uint8))
    save(tmp_path, "sand_height.png", np.full((4, 4), 65535 // 2, np.uint16))
    (tmp_path / "readme.txt").write_text("not a picture")
    pictures = read_material_images(tmp_path, SIZE, BUILT_IN)
    assert set(pictures) == {"rock", "sand"}
    colour, relief = customized_levels(levels, BUILT_IN, {}, pictures, ComputeContext)[0]
    assert np.allclose((colour[ROCK, ..., :3] / 255.0) ** 2, [0.503, 0.216, 0.0513], atol=0.01)
    assert np.abs(relief[ROCK, ..., 2].astype(int) - 128).max() <= 1
    # The normal leans east, so the ground rises westward.
    assert (relief[ROCK, ..., 0] > 180).all()
    sand = list(BUILT_IN.layers).index("sand")
    assert np.abs(colour[sand, ..., 3].astype(int) - 127).max() <= 1
    assert (colour[sand, ..., :3] == levels[0][0][sand, ..., :3]).all()
    assert np.abs(relief[sand, ..., :2].astype(int) - 128).max() <= 1


def test_height_image_orientation_and_height_from_colour(tmp_path, levels):
    rows = np.zeros((SIZE, SIZE), np.uint8)
    rows[0] = 255
    save(tmp_path, "snow_height.png", rows)
    height = read_material_images(tmp_path, SIZE, BUILT_IN)["snow"]["height"]
    assert (height[-1] == 1.0).all()
    assert (height[:-1] == 0.0).all()

    grey = np.zeros((SIZE, SIZE, 3), np.uint8)
    grey[:, SIZE // 2 :] = 255
    save(tmp_path, "rock.jpg", grey)
    colour, relief = customized_levels(
        levels, BUILT_IN, {}, read_material_images(tmp_path, SIZE, BUILT_IN), ComputeContext
    )[0]
    assert colour[ROCK, 5, 5, 3] < 10
    assert colour[ROCK, 5, -5, 3] > 245
    assert relief[ROCK, 5, SIZE // 2, 0] < 100


def test_invalid_texture_folders_are_refused(tmp_path):
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
            read_material_images(folder, SIZE, BUILT_IN)
        assert "\n" not in str(caught.value), names
    (tmp_path / "grass.png").write_bytes(b"\x89PNG\r\n\x1a\nnothing more")
    for folder, line in (
        (tmp_path, r"grass\.png: expected a picture"),
        (tmp_path / "nowhere", "nowhere: expected a folder of textures"),
    ):
        with pytest.raises(InputError, match=line) as caught:
            read_material_images(folder, SIZE, BUILT_IN)
        assert "\n" not in str(caught.value), folder


@pytest.mark.gl
def test_opengl_textures_hold_every_level(gl, levels, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    textures = MaterialTextures(gl, Waves.sketch, None, Quality(material_texels=SIZE))
    for part, array in enumerate((textures.colour, textures.relief)):
        array.use(0)
        for level, both in enumerate(levels):
            n = SIZE >> level
            place = (np.arange(n) + 0.5) / n
            rows = [[x, y, 2.0, level] for y in place for x in place]
            got = evaluate(gl, ["uniform sampler2DArray t;\n"], "textureLod(t, a.xyz, a.w)", rows)
            got = got.reshape(n, n, 4)
            assert np.abs(got * 255.0 - both[part][2]).max() < 0.01


class CountedCompute:
    def __init__(self, content=b"some bytes of textures"):
        self.content, self.calls = content, 0

    def __call__(self):
        self.calls += 1
        return self.content


def cached(compute, folder, recipe="recipe", family="materials-8"):
    return bytes(cached_bytes(family, recipe, compute, folder))


def test_cache_hits_until_the_recipe_changes(tmp_path, monkeypatch):
    compute = CountedCompute()
    assert cached(compute, tmp_path / "new") == cached(compute, tmp_path / "new") == compute.content
    assert compute.calls == 1

    compute, other = CountedCompute(), CountedCompute(b"others of the family, as many bytes"[:22])
    cached(compute, tmp_path)
    cached(compute, tmp_path, family="materials-16")
    assert cached(other, tmp_path, recipe="another") == other.content
    assert other.calls == 1
    assert len(list(tmp_path.glob("materials-8-*"))) == 1
    assert len(list(tmp_path.glob("materials-16-*"))) == 1

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "sketchterrain"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert cache_folder() == Path(tmp_path / "home/.cache/sketchterrain")


def test_corrupt_cache_files_are_replaced_and_missing_folders_tolerated(tmp_path, monkeypatch):
    for harm in ("cut", "longer", "changed", "empty"):
        folder, compute = tmp_path / harm, CountedCompute()
        cached(compute, folder)
        path = next(folder.iterdir())
        content = bytearray(path.read_bytes())
        content[-1] ^= harm == "changed"
        content = {"cut": content[:-3], "longer": content + b"x", "empty": b""}.get(harm, content)
        path.write_bytes(bytes(content))
        assert cached(compute, folder) == compute.content, harm
        assert compute.calls == 2, harm
        assert cached(compute, folder) == compute.content, harm
        assert compute.calls == 2, harm

    place = tmp_path / "file"
    place.write_bytes(b"no folder")
    compute = CountedCompute()
    assert cached(compute, place) == cached(compute, place / "below") == compute.content
    assert compute.calls == 2


WIDTHS = texture_widths(BUILT_IN)


def phases(*eye):
    return texture_phases(BUILT_IN, eye, WIDTHS).reshape(len(BUILT_IN.layers), 3, OCTAVES, 2)


def test_texture_phases_match_the_oracle_and_are_periodic():
    eye = np.array([3.0, 7.0, 2.0])
    got = phases(*eye)
    for layer, (width, _, _, turn) in enumerate(texture_uniforms(BUILT_IN, WIDTHS)["texture_tiling"]):
        for plane, axes in enumerate(((1, 2), (0, 2), (0, 1))):
            for octave in range(OCTAVES):
                place = complex(*eye[list(axes)]) * np.exp(1j * turn * octave) / (width * RATIO**octave)
                expected = np.array([place.real, place.imag]) % PERIOD
                assert np.allclose(got[layer, plane, octave], expected, atol=1e-5)

    grass = WIDTHS[0]
    here, there = phases(0.0, 0.0, 0.0), phases(PERIOD * grass, -2 * PERIOD * grass, 0.0)
    gap = np.abs(here - there)[0, 2, 0]
    assert np.minimum(gap, PERIOD - gap).max() < 1e-5
    far = phases(1e9, -1e9, 10.0)
    assert ((far >= 0) & (far <= PERIOD)).all()
    widths = texture_widths(BUILT_IN, {"sand": {"size": 9.0}, "rock": {"size": 0.0}})
    assert dict(zip(BUILT_IN.layers, widths, strict=True)) == dict(
        zip(BUILT_IN.layers, WIDTHS, strict=True)
    ) | {"sand": 9.0}
