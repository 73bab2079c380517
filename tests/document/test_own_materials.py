import numpy as np
import pytest
from PIL import Image

from sketchterrain.document.material_rules import RuleChange
from sketchterrain.document.own_materials import MAX_MATERIALS
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch, save_sketch
from sketchterrain.generation.building import build
from sketchterrain.schema.materials import BUILT_IN
from tests import terrains
from tests.refusals import refused


def pictures(folder, *names):
    """Write pictures of 4 × 4 px."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        Image.fromarray(np.full((4, 4, 3), 120, np.uint8)).save(folder / name)
    return str(folder)


def paved(materials, **changes):
    """Return a sketch whose west is painted with its first own material."""
    image = np.zeros((64, 64), np.uint8)
    image[:, :32] = 1
    labels = {("material", 1): {"material": next(iter(materials))}}
    ground = {"relief": 0.0}
    return Sketch(
        extent=256.0, ground=ground, layers={"material": image}, labels=labels, materials=materials, **changes
    )


@pytest.mark.parametrize("count", [pytest.param(1, marks=pytest.mark.slow), MAX_MATERIALS - len(BUILT_IN)])
def test_own_materials_have_weights(count):
    materials = {f"paving_{number}": {"colour": "#804020"} for number in range(count)}
    last = list(materials)[-1]
    sketch = paved(materials, material_rules=(RuleChange("dry_soil", material=last),))
    terrain = build(sketch)
    raster = terrain.raster(65)
    assert terrain.material_names == (*BUILT_IN.names, *materials)
    np.testing.assert_allclose(raster.materials.sum(axis=-1), 1.0, atol=1e-6)
    assert (raster.materials[:, :24, len(BUILT_IN)] > 0.99).all()
    assert raster.materials[:, 40:, len(BUILT_IN)].max() == 0.0 or count == 1
    store = terrain.vertex_store(1)
    terrain.write_tiles([(0, 0, 0)], [0], [-1], store)
    weights = store.download()["weights"][0]
    assert np.abs(weights[..., : len(terrain.materials)].sum(axis=-1, dtype=int) - 255).max() <= 4
    assert not weights[..., len(terrain.materials) :].any()


def test_weights_of_the_programs_materials_do_not_depend_on_others():
    terrain = terrains.plain()
    plain = terrain.raster(65).materials
    more = build(terrain.sketch.replace(materials={"paving": {}})).raster(65).materials
    np.testing.assert_array_equal(more[..., : plain.shape[-1]], plain)


def test_own_materials_survive_saving(tmp_path):
    folder = pictures(
        tmp_path / "mine/textures", "Bricks_Color.png", "Bricks_NormalGL.png", "Bricks_NormalDX.png"
    )
    sketch = paved({"brick": {"folder": folder, "size": 2.0}, "lava": {"like": "rock", "colour": "#401510"}})
    for target in (tmp_path / "mine", tmp_path / "mine.sketch"):
        save_sketch(sketch, target)
        assert load_sketch(target).materials == sketch.materials
        assert load_sketch(target).properties("material", 1)["material"] == "brick"
    assert 'folder = "textures"' in (tmp_path / "mine/sketch.toml").read_text(encoding="utf-8")
    assert load_sketch(tmp_path / "mine").material_table.materials[-1].texture.name == "rock"


def test_bad_materials_are_one_line_each(tmp_path):
    empty = pictures(tmp_path / "empty")
    twice = pictures(tmp_path / "twice", "a_color.png", "b_albedo.png")
    for materials, expected in (
        ({"Lava": {}}, "expected a name of at most 40 small letters"),
        ({"rock": {}}, r"expected a new name, the program has this material: see \[look.rock\]"),
        ({"lava": {"like": "magma"}}, "materials.lava.like = 'magma'|'magma'"),
        ({"lava": {"colour": "red"}}, 'expected a colour as "#rrggbb"'),
        ({"lava": {"shine": 1}}, "shine"),
        ({f"m{n}": {} for n in range(MAX_MATERIALS)}, f"expected at most {MAX_MATERIALS - len(BUILT_IN)}"),
    ):
        refused(expected, Sketch, materials=materials)
    for folder, expected in (
        (str(tmp_path / "none"), "expected a folder of pictures"),
        (empty, "expected a picture named albedo, color or diffuse"),
        (twice, "expected one picture of albedo, got a_color.png, b_albedo.png"),
    ):
        save_sketch(Sketch(materials={"lava": {"folder": folder}}), tmp_path / "sketch")
        refused(expected, load_sketch, tmp_path / "sketch")
    refused("expected grass, soil", Sketch, material_rules=(RuleChange("new", material="lava"),))
