"""Textures on disk: found again, and made anew whenever what is there can't be trusted."""

from __future__ import annotations

from pathlib import Path

import pytest

from sketchterrain.look.texture_cache import cache_folder, kept


class Maker:
    def __init__(self, content=b"some bytes of textures"):
        self.content, self.calls = content, 0

    def __call__(self):
        self.calls += 1
        return self.content


def ask(maker, folder, recipe="recipe", family="materials-8"):
    return bytes(kept(family, recipe, len(maker.content), maker, folder))


def test_what_was_made_is_read_the_next_time(tmp_path):
    maker = Maker()
    assert ask(maker, tmp_path / "new") == ask(maker, tmp_path / "new") == maker.content
    assert maker.calls == 1


def test_another_recipe_is_made_and_takes_the_old_ones_place(tmp_path):
    maker, other = Maker(), Maker(b"others of the family, as many bytes"[:22])
    ask(maker, tmp_path)
    ask(maker, tmp_path, family="materials-16")
    assert ask(other, tmp_path, recipe="another") == other.content
    assert other.calls == 1
    assert len(list(tmp_path.glob("materials-8-*"))) == 1
    assert len(list(tmp_path.glob("materials-16-*"))) == 1


@pytest.mark.parametrize("harm", ["cut", "longer", "changed", "empty"])
def test_a_broken_file_is_made_anew(tmp_path, harm):
    maker = Maker()
    ask(maker, tmp_path)
    path = next(tmp_path.iterdir())
    content = bytearray(path.read_bytes())
    content[-1] ^= harm == "changed"
    content = {"cut": content[:-3], "longer": content + b"x", "empty": b""}.get(harm, content)
    path.write_bytes(bytes(content))
    assert ask(maker, tmp_path) == maker.content
    assert maker.calls == 2
    assert ask(maker, tmp_path) == maker.content
    assert maker.calls == 2


def test_a_folder_that_cannot_be_written_costs_time_alone(tmp_path):
    place = tmp_path / "file"
    place.write_bytes(b"no folder")
    maker = Maker()
    assert ask(maker, place) == ask(maker, place / "below") == maker.content
    assert maker.calls == 2


def test_it_lies_where_the_system_says(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "sketchterrain"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert cache_folder() == Path(tmp_path / "home/.cache/sketchterrain")


def test_no_home_is_no_failure(monkeypatch):
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)

    def homeless(_):
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "expanduser", homeless)
    maker = Maker()
    assert ask(maker, None) == maker.content
