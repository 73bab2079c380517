"""The journal and the ledger: what they tell survives what may happen to a file."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from sketchterrain.errors import InputError
from sketchterrain.world.ledger import Header, Journal, Ledger, ledger_text, read_journal, read_ledger
from sketchterrain.world.lock import held
from sketchterrain.world.made import Task, WrittenFile

if TYPE_CHECKING:
    from pathlib import Path

HEADER = Header("f" * 64, "1.0")
files = some.lists(
    some.builds(
        WrittenFile,
        some.text("abc/é\"'", min_size=1).map(lambda name: f"0/{name}".replace("//", "/-").rstrip("/")),
        some.integers(0, 1 << 40),
        some.text("0123456789abcdef", min_size=64, max_size=64),
    ),
    min_size=1,
    max_size=3,
).map(tuple)
tasks = some.builds(
    Task,
    some.sampled_from(["ground", "plants"]),
    some.integers(0, 20),
    some.integers(0, 1 << 30),
    some.integers(0, 1 << 30),
)


def made(number: int) -> tuple[Task, tuple[WrittenFile, ...]]:
    return Task("ground", 0, number, 0), (WrittenFile(f"0/height/c/{number}/0", number, "0" * 64),)


def journal_of(path: Path, *, tasks: int) -> None:
    with held(path, path.parent) as stream:
        journal = Journal(path, stream)
        journal.begin(Ledger(HEADER, {}))
        for number in range(tasks):
            journal.add(*made(number))


@settings(max_examples=40)
@given(done=some.dictionaries(tasks, files, max_size=6), others=files)
def test_a_ledger_is_read_back_and_does_not_depend_on_the_order(
    done: dict[Task, tuple[WrittenFile, ...]], others: tuple[WrittenFile, ...]
) -> None:
    text = ledger_text(Ledger(HEADER, done, others))
    found = read_ledger(text, "ledger")
    assert (found.header, found.done, sorted(found.others)) == (HEADER, done, sorted(others))
    turned = Ledger(HEADER, dict(reversed(done.items())), tuple(reversed(others)))
    assert ledger_text(turned) == text


@settings(max_examples=40)
@given(cut=some.integers(0, 400))
def test_a_journal_cut_off_anywhere_tells_of_what_came_before(
    cut: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("cut") / "journal.jsonl"
    journal_of(path, tasks=3)
    whole = path.read_bytes()
    lines = whole.splitlines(keepends=True)
    path.write_bytes(whole[: len(whole) - cut])
    left = sum(map(len, lines)) - cut
    ends = [sum(map(len, lines[: number + 1])) - 1 for number in range(len(lines))]  # the newline may be lost
    found = read_journal(path)
    if left <= ends[0]:
        assert found is None
        return
    assert found is not None
    assert len(found.done) == max(sum(left >= end for end in ends) - 2, 0)
    with held(path, path.parent) as stream:
        journal = Journal(path, stream)
        journal.go_on(())
        journal.add(*made(7))
    again = read_journal(path)
    assert again is not None
    assert again.done == found.done | dict([made(7)])


def test_a_task_that_is_undone_is_done_no_more(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    journal_of(path, tasks=2)
    with held(path, tmp_path) as stream:
        Journal(path, stream).add(made(0)[0], ())
    found = read_journal(path)
    assert found is not None
    assert list(found.done) == [made(1)[0]]


def test_a_second_run_finds_it_held_until_the_first_ends(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "journal.jsonl"
    with held(path, tmp_path), pytest.raises(InputError, match="another run is at work there"):
        held(path, tmp_path).__enter__()
    with held(path, tmp_path) as stream:
        assert stream.writable()
    assert not path.parent.exists()  # nothing was told in it


@pytest.mark.parametrize(
    "text", ["", "\n", "[1, 2]\n", '{"fingerprint": "f"}\n', '{"fingerprint":"f","version":"1","format":2}\n']
)
def test_what_is_no_ledger_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"here: expected a list of a world's files"):
        read_ledger(text, "here")


@pytest.mark.parametrize("name", ["../x", "/etc/x", "a//b", "a/../../b", "a\\b", ""])
def test_names_that_lead_out_are_refused(name: str) -> None:
    task, _ = made(1)
    text = ledger_text(Ledger(HEADER, {task: (WrittenFile(name, 1, "0" * 64),)}))
    with pytest.raises(InputError, match="names a file that is not in the world's folder"):
        read_ledger(text, "here")


def test_no_journal_is_none(tmp_path: Path) -> None:
    assert read_journal(tmp_path / "journal.jsonl") is None
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError, match="cannot be read"):
        read_journal(tmp_path / "folder")
