"""Cache of textures on disk: read again, replaced whenever a file cannot be trusted."""

from __future__ import annotations

from pathlib import Path

from sketchterrain.disk import cache_folder
from sketchterrain.look.texture_cache import kept


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
