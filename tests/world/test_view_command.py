"""`sketchterrain view`: pictures of worlds that were written, and what it says of those that are broken."""

import shutil

import numpy as np
import pytest
from PIL import Image

from sketchterrain.app.cli import main

pytestmark = pytest.mark.gl

SMALL = ["--size", "160x90", "--quality", "0", "--without", "trees"]


def picture(path):
    with Image.open(path) as image:
        assert image.format == "PNG"
        return np.asarray(image.convert("RGB"))


def said(capsys):
    lines = capsys.readouterr().err.strip().splitlines()
    return [line for line in lines if line.startswith("sketchterrain: ")]


@pytest.mark.slow
def test_a_picture_of_a_world(finished_world, tmp_path, capsys):
    file = tmp_path / "new" / "view.png"
    eye = ["--eye", "200,252,90", "--look-at", "330,252,10"]
    assert main(["view", str(finished_world), "-o", str(file), *SMALL, *eye]) == 0
    assert capsys.readouterr().out.strip() == str(file)
    seen = picture(file)
    assert seen.shape == (90, 160, 3)
    # A strip of ground 4 m wide before the air: only in the middle it is seen.
    ground = np.abs(seen[70].astype(int) - seen[70, 0]).max(axis=-1) > 12
    assert ground.any()
    assert not ground[:30].any()
    assert not ground[-30:].any()


def test_a_broken_chunk_ends_a_picture_with_its_file(finished_world, tmp_path, capsys):
    broken = tmp_path / "broken.zarr"
    shutil.copytree(finished_world, broken)
    for shard in (broken / "0" / "height" / "c").rglob("*"):
        if shard.is_file():
            data = bytearray(shard.read_bytes())
            for place in range(0, len(data) * 3 // 4, 500):  # in every chunk of it
                data[place] ^= 1
            shard.write_bytes(data)
    file = tmp_path / "view.png"
    arguments = ["view", str(broken), "-o", str(file), *SMALL, "--eye", "200,252,9", "--look-at", "330,252,0"]
    code = main(arguments)
    (line,) = said(capsys)
    assert code == 3
    assert "height/c/" in line
    assert "broken" in line
    assert not file.exists()


@pytest.mark.parametrize(
    ("options", "said_of_it"),
    [
        (["-o", "view.svg"], "expected the name of a .png file, got 'view.svg'"),
        (["--eye", "0,0,9"], "--eye needs -o: it is for pictures"),
        (["-o", "v.png", "--look-at", "0,0,0"], "--look-at needs an --eye at another place"),
        (["-o", "v.png", "--eye", "0,0,9", "--view", "air"], "--view with --eye"),
    ],
)
def test_options_that_cannot_be_meant(options, said_of_it, capsys):
    assert main(["view", "world.zarr", *options]) == 2
    assert said_of_it in capsys.readouterr().err
