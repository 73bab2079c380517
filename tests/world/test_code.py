"""Which code a world's bytes follow from."""

from __future__ import annotations

from pathlib import Path

from sketchterrain.world import code


def test_a_change_of_code_or_kernels_is_another_digest_and_other_files_are_none(
    tmp_path, monkeypatch
) -> None:
    for room in ("sketch", "features", "compute", "terrain", "export", "world", "kernels"):
        (tmp_path / room).mkdir()
    kernel, page = tmp_path / "kernels" / "noise.clh", tmp_path / "kernels" / "noise.md"
    kernel.write_text("1")
    monkeypatch.setattr(code, "files", lambda name: Path(tmp_path, name.rpartition(".")[2]))
    found = code.code_digest.__wrapped__
    before = found()
    page.write_text("what it is")
    assert found() == before
    kernel.write_text("2")
    assert found() != before
    kernel.rename(kernel.with_name("other.clh"))
    kernel.with_name("other.clh").write_text("1")
    assert found() != before
