"""The benchmark of batches: which processes are timed, and what ratio follows."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from sketchterrain.benchmarks import batches

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.benchmarks.timing import TimedContext


def test_a_batch_stands_beside_fresh_processes(
    context: TimedContext, tiny: Effort, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, ran = [0.0], []
    wanted = replace(
        tiny, batch_files=("all", "without preview"), batch_jobs=(1, 2), batch_seeds=4, batch_fresh=2
    )

    def run(words: Sequence[str]) -> None:
        ran.append(list(words))
        seeds = words[words.index("--seeds") + 1].split("-") if words[0] == "batch" else ["1", "1"]
        count = int(seeds[1]) - int(seeds[0]) + 1
        each = (3.0 if words[0] == "generate" else 2.0) - ("--no-preview" in words)
        clock[0] += count * each

    monkeypatch.setattr(batches, "_run", run)
    monkeypatch.setattr(batches.time, "perf_counter", lambda: clock[0])
    (table,) = batches.measure(context, wanted).tables
    assert [(row["files"], row["jobs"]) for row in table.rows] == [
        ("all", 1),
        ("all", 2),
        ("without preview", 1),
        ("without preview", 2),
    ]
    for row, ratio in zip(table.rows, (1.5, 1.5, 2.0, 2.0), strict=True):
        assert (row["ratio"], row["worst_ratio"]) == (ratio, ratio)
        assert row["fresh_per_minute"] == pytest.approx(60.0 / (3.0 if row["files"] == "all" else 2.0))
        assert len(row["batch_seconds"]) == wanted.batch_rounds  # type: ignore[arg-type]
    folders = [words[words.index("-o") + 1] for words in ran]
    assert len(set(folders)) == len(folders)  # no batch finds the files of another one
    alone = {words[words.index("--seed") + 1] for words in ran if words[0] == "generate"}
    assert len(alone) == 1 + wanted.batch_rounds * wanted.batch_fresh  # of each kind of files


@pytest.mark.slow
def test_a_process_that_fails_ends_it(context: TimedContext) -> None:
    with pytest.raises(Exception, match="returned non-zero exit status 3"):
        batches._run(["generate", "no such sketch", "-o", "nowhere"])
