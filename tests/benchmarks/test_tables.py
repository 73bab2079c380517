"""Tables as text."""

from __future__ import annotations

import io

from rich.console import Console

from sketchterrain.benchmarks.outcome import Column, Table
from sketchterrain.benchmarks.tables import markdown, shown, terminal

TABLE = Table(
    "Speed",
    (Column("method", "method"), Column("rate", "M/s"), Column("more", "more")),
    ({"method": "a|b", "rate": 1234.5, "seconds": [1.0]}, {"method": "c", "rate": 0.01234, "more": 3}),
)


def test_numbers_are_shown_with_three_significant_digits() -> None:
    for cell, text in (
        (None, "–"),
        ("word", "word"),
        (7, "7"),
        (0.0, "0"),
        (1234.5, "1234"),
        (12.345, "12.3"),
        (0.98765, "0.988"),
        (0.001234, "0.00123"),
        (0.0001234, "1.23e-04"),
        (-12.345, "-12.3"),
        (2.5e6, "2.50e+06"),
        (float("nan"), "nan"),
    ):
        assert shown(cell) == text, cell


def test_tables_as_markdown_and_in_the_terminal() -> None:
    assert markdown(TABLE).splitlines() == [
        "### Speed",
        "",
        "| method | M/s | more |",
        "| :--- | ---: | ---: |",
        "| a\\|b | 1234 | – |",
        "| c | 0.0123 | 3 |",
    ]
    stream = io.StringIO()
    Console(width=80, file=stream).print(terminal(TABLE))
    text = stream.getvalue()
    for word in ("Speed", "method", "a|b", "1234", "0.0123"):
        assert word in text
