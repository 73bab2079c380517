"""Journal and ledger: round trips, truncation, invalid content, locks."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from sketchterrain.errors import InputError
from sketchterrain.io.system import exclusive_run
from sketchterrain.world.job import Task, WrittenFile
from sketchterrain.world.journal import Header, Journal, Ledger, read_journal, read_ledger
from tests.refusals import refused

HEADER = Header("f" * 64, "1.0")
FILES = some.lists(
    some.builds(
        WrittenFile,
        some.text("abc/é\"'", min_size=1).map(lambda name: f"0/{name}".replace("//", "/-").rstrip("/")),
        some.integers(0, 1 << 40),
        some.text("0123456789abcdef", min_size=64, max_size=64),
    ),
    min_size=1,
    max_size=3,
).map(tuple)
NUMBERS = some.integers(0, 1 << 30)
TASKS = some.builds(Task, some.sampled_from(["ground", "plants"]), NUMBERS, NUMBERS, NUMBERS)


def done(number: int) -> tuple[Task, tuple[WrittenFile, ...]]:
    return Task("ground", 0, number, 0), (WrittenFile(f"0/height/c/{number}/0", number, "0" * 64),)


@settings(max_examples=40)
@given(tasks=some.dictionaries(TASKS, FILES, max_size=6), others=FILES)
def test_ledger_round_trip_is_order_independent(
    tasks: dict[Task, tuple[WrittenFile, ...]], others: tuple[WrittenFile, ...]
) -> None:
    text = Ledger(HEADER, tasks, others).text()
    found = read_ledger(text, "ledger")
    assert (found.header, found.done, sorted(found.others)) == (HEADER, tasks, sorted(others))
    assert Ledger(HEADER, dict(reversed(tasks.items())), tuple(reversed(others))).text() == text


@settings(max_examples=40)
@given(cut=some.integers(0, 330))
def test_truncated_journal_preserves_complete_lines(
    cut: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("cut") / "journal.jsonl"
    with Journal(path, Ledger(HEADER, {})) as journal:
        for number in range(3):
            journal.add(*done(number))
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) - cut])
    ends = [place for place, byte in enumerate(whole) if byte == ord("\n")]  # the newline may be lost
    found = read_journal(path)
    assert found is not None
    assert len(found.done) == sum(len(whole) - cut >= end for end in ends[2:])
    with Journal(path, found) as journal:
        journal.add(*done(7))
    again = read_journal(path)
    assert again is not None
    assert (again.done, again.unreadable) == (found.done | dict([done(7)]), 0)


def test_lock_is_exclusive(tmp_path: Path) -> None:
    output = tmp_path / "folder" / "world.zarr"
    with exclusive_run(output), pytest.raises(InputError, match="another run is writing it"):
        exclusive_run(output).__enter__()
    with exclusive_run(output):
        pass
    assert not list(output.parent.iterdir())


@pytest.mark.parametrize(
    "text", ["", "\n", "[1, 2]\n", '{"fingerprint": "f"}\n', '{"fingerprint":"f","version":"1","format":2}\n']
)
def test_invalid_header_is_refused(text: str) -> None:
    refused(r"here: expected a ledger of a world's files", read_ledger, text, "here")


@pytest.mark.parametrize("name", ["../x", "/etc/x", "a//b", "a/../../b", "a\\b", ""])
def test_names_outside_the_folder_are_refused(name: str) -> None:
    text = Ledger(HEADER, {done(1)[0]: (WrittenFile(name, 1, "0" * 64),)}).text()
    refused("file name outside the world's folder", read_ledger, text, "here")


def test_missing_journal_is_none(tmp_path: Path) -> None:
    assert read_journal(tmp_path / "journal.jsonl") is None
    refused("cannot be read", read_journal, tmp_path)
