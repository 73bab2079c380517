"""Contact sheets of batches."""

from pathlib import Path

import numpy as np
from PIL import Image

from sketchterrain.batch.manifest import Entry, File
from sketchterrain.batch.sheet import PAGE, write_sheets


def entry(name: str, *, preview: bool = True, error: str = "") -> Entry:
    files = (File("preview.png", 1, ""),) if preview else ()
    return Entry(name, "s", 1, state="failed" if error else "done", files=files, error=error)


def written(folder: Path, name: str, colour: tuple[int, int, int]) -> None:
    (folder / name).mkdir(parents=True)
    Image.fromarray(np.full((72, 128, 3), colour, np.uint8)).save(folder / name / "preview.png")


def test_a_sheet_shows_each_preview_in_its_place(tmp_path):
    colours = [(40 * number, 200, 30) for number in range(6)]
    for number, colour in enumerate(colours):
        written(tmp_path, f"s/{number}", colour)
    names = write_sheets(
        tmp_path, [*(entry(f"s/{number}") for number in range(6)), entry("bad", preview=False, error="no")]
    )
    assert names == ["sheet.png"]
    with Image.open(tmp_path / "sheet.png") as picture:
        page = np.asarray(picture)
    places = [(12 + 112 + 259 * (number // 4), 12 + 200 + 412 * (number % 4)) for number in range(6)]
    assert [tuple(page[place].tolist()) for place in places] == colours
    red = (page[:, :, 0] > 150) & (page[:, :, 1] < 60) & (page[:, :, 2] < 60)
    assert red[271:, 836:].any()  # why the last one failed


def test_one_that_failed_does_not_show_its_older_picture(tmp_path):
    written(tmp_path, "s/0", (0, 200, 0))
    failed = Entry("s/0", "s", 1, state="failed", files=(File("preview.png", 1, ""),), error="no")
    assert write_sheets(tmp_path, [failed]) == []
    assert write_sheets(tmp_path, [failed, entry("s/0")]) == ["sheet.png"]
    with Image.open(tmp_path / "sheet.png") as page:
        assert page.getpixel((212, 124)) != (0, 200, 0) == page.getpixel((624, 124))


def test_sheets_have_pages_and_none_without_previews(tmp_path):
    assert write_sheets(tmp_path, [entry("s/0", preview=False)]) == []
    assert write_sheets(tmp_path, []) == []
    assert list(tmp_path.iterdir()) == []

    written(tmp_path, "s/0", (1, 2, 3))
    entries = [entry("s/0") for _ in range(PAGE + 1)]
    assert write_sheets(tmp_path, entries) == ["sheet.png", "sheet-2.png"]
    with Image.open(tmp_path / "sheet-2.png") as page:
        assert page.size == (424, 271)


def test_a_missing_preview_or_a_long_name_leaves_the_sheet_readable(tmp_path):
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / "preview.png").write_bytes(b"no picture")
    assert write_sheets(tmp_path, [entry("s"), entry("gone")]) == ["sheet.png"]

    written(tmp_path, "s/0", (1, 2, 3))
    assert write_sheets(tmp_path, [entry("s/0"), entry("x" * 300, preview=False, error="long " * 90)]) == [
        "sheet.png"
    ]
