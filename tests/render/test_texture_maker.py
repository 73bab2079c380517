"""Textures as they are made, and their mipmaps."""

import numpy as np
import pytest

from sketchterrain.compute import ComputeContext, list_devices
from sketchterrain.look.texture_maker import LAYERS, Layer, embossed, painted_layer
from sketchterrain.look.texture_mips import (
    decoded,
    encoded,
    halved,
    linear,
    linear_of,
    mipmaps,
    moments,
    roughened,
)

if not list_devices():
    pytest.skip("no OpenCL device", allow_module_level=True)
SIDE = 64


@pytest.fixture(scope="module")
def context():
    return ComputeContext()


@pytest.fixture(scope="module")
def painted(context):
    return [painted_layer(context, index, SIDE) for index in range(len(LAYERS))]


def smoothstep(low, high, x):
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    return t * t * (3 - 2 * t)


def test_the_float_build_is_near_the_double_one(painted):
    with_double = [device for device in list_devices() if device.has_double]
    if not with_double:
        pytest.skip("no device with 64-bit floats")
    double = ComputeContext(with_double[0], real="double")
    for index, name in enumerate(LAYERS):
        off = np.abs(painted[index] - painted_layer(double, index, SIDE)).max(axis=-1)
        # Where two stones are equally high, or a place lies on a border, either may win.
        assert np.quantile(off, 0.995) < 1e-4, name
        assert off.mean() < 1e-3, name


def test_all_devices_make_the_same_bits(painted):
    devices = list_devices()
    if len(devices) < 2:
        pytest.skip("one device has nothing to differ from")
    for device in devices[1:]:
        other = ComputeContext(device)
        for index, (mine, layer) in enumerate(zip(painted, LAYERS.values(), strict=True)):
            theirs = painted_layer(other, index, SIDE)
            np.testing.assert_array_equal(mine, theirs, err_msg=f"layer {index} on {device.platform}")
            assert (embossed(ComputeContext(), mine, layer) == embossed(other, mine, layer)).all()


def test_textures_have_no_seam(context):
    for index, name in enumerate(LAYERS):
        # Finer than their finest structure, so that neighbouring texels are near each other.
        height = painted_layer(context, index, 512)[..., 3]
        for axis in (0, 1):
            step = np.abs(np.roll(height, -1, axis) - height)
            assert step.take(-1, axis).mean() < 1.6 * step.mean(), name


def test_albedos_are_those_of_measured_ground(painted):
    bounds = {
        "grass": (0.03, 0.12),
        "soil": (0.05, 0.15),
        "rock": (0.15, 0.35),
        "scree": (0.15, 0.30),
        "sand": (0.22, 0.45),
        "snow": (0.80, 0.92),
        "river_bed": (0.10, 0.25),
        "forest_floor": (0.02, 0.09),
        "canopy": (0.01, 0.06),
    }
    albedos = dict(zip(LAYERS, (layer[..., :3] for layer in painted), strict=True))
    for name, (low, high) in bounds.items():
        assert low < albedos[name].mean() < high, name
        assert albedos[name].min() >= 0.0, name
        assert albedos[name].max() <= 0.95, name
    grass, sand = (albedos[name].mean(axis=(0, 1)) for name in ("grass", "sand"))
    assert grass[1] > 1.15 * grass[0] > 1.15 * grass[2]
    assert sand[0] > sand[1] > sand[2]


def test_relief_is_slope_roughness_and_openness_of_the_heights(context):
    rng = np.random.default_rng(3)
    painted = rng.uniform(0.2, 0.8, (32, 32, 4))
    layer = Layer(1.0, 0.05, 0.9, 0.6)
    got = embossed(context, painted, layer)
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
    flat = embossed(context, np.full((16, 16, 4), 0.5), Layer(1.0, 0.1, 0.9, 0.7))
    assert np.allclose(flat, [0.0, 0.0, 0.8, 1.0], atol=1e-6)


def test_roughness_lies_between_a_mirror_and_lambert_and_is_greatest_in_hollows() -> None:
    for name, layer in LAYERS.items():
        assert 0.0 < layer.high < layer.low <= 1.0, name
        assert 0.0 < layer.bump < 0.5, name
        assert layer.width > 0.0, name


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


def test_every_level_is_the_float64_average_of_the_first():
    painted, relief = surface(32)
    levels = list(mipmaps(painted, relief))
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


def test_only_scattered_slopes_get_rougher_and_by_the_formula():
    painted, relief = surface(16)
    relief[...] = [0.3, -0.2, 0.4, 0.8]
    for _, level in mipmaps(painted, relief):
        assert (level == level[0, 0]).all()
        assert abs(level[0, 0, 2] / 255.0 - 0.4) < BYTE + 1e-6
    fields = np.zeros((2, 2, 4))
    fields[..., 0] = [[0.5, -0.5], [0.5, -0.5]]
    fields[..., 2] = 0.5
    slopes = moments(np.zeros((2, 2, 4)), fields)[1]
    _, relief = encoded((np.zeros((1, 1, 4), np.float32), halved(slopes)))
    # Variance 0.25 in one direction, none in the other.
    assert abs(relief[0, 0, 2] / 255.0 - (0.5**4 + 2 * 0.125) ** 0.25) < BYTE + 1e-6
    assert relief[0, 0, :2].tolist() == [128, 128]


def density(slope, alpha):
    """Trowbridge and Reitz's distribution over slopes; integrates to 1."""
    return alpha**2 / (np.pi * (alpha**2 + slope) ** 2)


def test_one_rough_texel_reflects_what_the_fine_ones_do_together():
    grid = np.linspace(-3.0, 3.0, 61)
    area = (grid[1] - grid[0]) ** 2
    x, y = np.meshgrid(grid, grid)
    for roughness, steep in ((0.5, 0.3), (0.6, 0.5), (0.7, 0.2)):
        slopes = steep * np.random.default_rng(8).standard_normal((4096, 2))
        alpha = roughness**2
        together = np.mean([density((x - p) ** 2 + (y - q) ** 2, alpha) for p, q in slopes], axis=0)
        mean = slopes.mean(axis=0)
        around = (x - mean[0]) ** 2 + (y - mean[1]) ** 2
        rougher = float(roughened(np.array(roughness), slopes.var(axis=0).mean()))
        filtered, plain = density(around, rougher**2), density(around, alpha)
        error, without = (0.5 * np.abs(each - together).sum() * area for each in (filtered, plain))
        # Half the L1 distance is the share of light that goes elsewhere. A sum of lobes is no lobe of their
        # kind, so some remains; averaging normals alone misplaces far more.
        assert error < 0.13, (roughness, steep)
        assert error < 0.55 * without, (roughness, steep)


def test_decoding_inverts_encoding():
    painted, relief = surface(8, steep=0.3)
    got_painted, got_relief = decoded(*next(mipmaps(painted, relief)))
    assert np.abs(got_painted - painted).max() < 4e-3
    assert np.abs(got_relief[..., 2:] - relief[..., 2:]).max() < BYTE + 1e-6
    assert np.abs(got_relief[..., :2] - relief[..., :2]).max() < 0.03


def test_srgb_colours_become_linear():
    assert np.allclose(linear_of("#000000"), 0.0)
    assert np.allclose(linear_of("#ffffff"), 1.0)
    assert np.allclose(linear_of("#bc8040"), [0.5029, 0.2159, 0.0513], atol=1e-4)
    assert linear(np.array(0.04045)) == pytest.approx(0.04045 / 12.92)
