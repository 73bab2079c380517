"""A world whose process is killed at any moment, again and again, ends with the same bytes."""

import os
import pickle
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from sketchterrain.document.store import save_sketch

KILLS = 4
SCRIPT = """
import pickle, sys
from pathlib import Path
from sketchterrain.world.run import run_world

class Watcher:
    def started(self, tasks, done):
        print("started", flush=True)
    def __getattr__(self, name):
        return lambda *_: None

run_world(pickle.loads(Path(sys.argv[1]).read_bytes()), resume=True, reporter=Watcher())
"""


@pytest.mark.soak
def test_killed_and_resumed_to_the_same_bytes(job, tmp_path: Path, finished_world, tree) -> None:
    (tmp_path / "job").write_bytes(pickle.dumps(job))
    command = [sys.executable, "-c", SCRIPT, str(tmp_path / "job")]
    chance, killed = random.Random(8), 0
    for number in range(KILLS + 1):
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True) as process:
            assert process.stdout is not None
            if process.stdout.readline() != "started\n" or number == KILLS:
                assert process.wait(timeout=300) == 0
                break
            time.sleep(chance.uniform(0.0, 0.4))
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
            killed += process.wait() == -signal.SIGKILL
    assert killed >= 1
    assert tree(job.output) == tree(finished_world)


@pytest.mark.soak
def test_sigterm_ends_the_program_with_130(small_job, tmp_path: Path, tree) -> None:
    save_sketch(small_job.sketch, tmp_path / "hill")
    command = [sys.executable, "-m", "sketchterrain", "world", str(tmp_path / "hill"), "--cell", "0.125"]
    command += ["--bounds=0,250,3000,254"]
    out = tmp_path / "out.zarr"
    process = subprocess.Popen(
        [*command, "-o", out], stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    journal = out / "ledger" / "journal.jsonl"
    while process.poll() is None and not (journal.exists() and journal.read_bytes().count(b"\n") > 4):
        time.sleep(0.01)
    process.terminate()
    told = process.communicate(timeout=120)[1]
    assert process.returncode == 130, told
    assert told.splitlines()[-1] == "sketchterrain: error: interrupted"
    assert "Traceback" not in told
    assert not [path for path in out.rglob("*") if path.name.startswith(".")]
    assert 4 < journal.read_bytes().count(b"\n") < 25
    assert subprocess.run([*command, "-o", out, "--resume"], check=False, timeout=300).returncode == 0
    assert subprocess.run([*command, "-o", tmp_path / "b.zarr"], check=False, timeout=300).returncode == 0
    assert tree(out) == tree(tmp_path / "b.zarr")
