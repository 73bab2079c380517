from __future__ import annotations

from sketchterrain.export.typed_settings import Row, typed_rows


def test_settings_become_rows_and_vectors_share_one() -> None:
    settings = {"Depth": "Bit 16", "Resolution": 65, "Flip Vertically": False, "scale": 1 / 3, "crs": None}
    assert typed_rows(settings) == [
        Row(0, "Depth", "Bit 16"),
        Row(0, "Resolution", "65"),
        Row(0, "Flip Vertically", "no"),
        Row(0, "scale", "0.3333333333"),
        Row(0, "crs", "none"),
    ]

    assert typed_rows({"Scale": {"X": 100.0, "Y": -2.5, "Z": 87.28125}}) == [
        Row(0, "Scale", "X 100  Y -2.5  Z 87.28125")
    ]
    assert typed_rows({"bands": [1, 2]}) == [Row(0, "bands", "1, 2")]


def test_many_tiles_are_cut_short_and_groups_have_headings() -> None:
    tiles = [{"file": f"a_{number}.raw", "Position": {"X": 0.5 * number}} for number in range(6)]
    rows = typed_rows({"tiles": tiles})
    assert rows[:3] == [Row(0, "tile 1", ""), Row(1, "file", "a_0.raw"), Row(1, "Position", "X 0")]
    assert len(rows) == 4 * 3 + 1
    assert rows[-1] == Row(0, "tiles", "2 more in terrain.json")
    assert typed_rows({"tiles": tiles[:1]})[0] == Row(0, "tile", "")

    rows = typed_rows({"texture": {"file": "a.exr", "plane": {"size": 1.0, "place": {"x": 1.0}}}})
    assert [(row.depth, row.name, row.value) for row in rows] == [
        (0, "texture", ""),
        (1, "file", "a.exr"),
        (1, "plane", ""),
        (2, "size", "1"),
        (2, "place", "x 1"),
    ]
