"""Caches, profiles and the closing report of all tests."""

import os
import resource
import shutil
import tempfile
from collections import Counter
from hashlib import sha256
from pathlib import Path

import hypothesis
import pytest

from sketchterrain.errors import DeviceError

ROOT = Path(__file__).resolve().parents[1]
SOURCES = {".py", ".cl", ".clh", ".glsl", ".c", ".h", ".json", ".txt"}
TIERS = ("slow", "soak")
COUNTS = pytest.StashKey[Counter[tuple[str, str]]]()

# Deadlines measure the machine's load, not the code.
hypothesis.settings.register_profile("tests", deadline=None, database=None)
hypothesis.settings.load_profile("tests")


def pytest_addoption(parser):
    parser.addoption(
        "--regenerate-goldens",
        action="store_true",
        help="overwrite the golden pictures instead of comparing: inspect each",
    )


def pytest_configure(config):
    # xdist's workers get the environment of the process that starts them.
    if not hasattr(config, "workerinput"):
        os.environ["XDG_CACHE_HOME"] = str(cache_of_sources(config))
        os.environ["SKETCHTERRAIN_TWIN_DEVICE"] = "1"


def cache_of_sources(config) -> Path:
    """Return the cache folder of this state of the sources, which later sessions find again.

    A checkout that cannot be written gets a folder for one session.
    """
    digest = sha256()
    for folder in ("sketchterrain", "kernels", "ui", "benchmarks", ".ci"):
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in SOURCES:
                digest.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    caches = ROOT / "build" / "test-cache"
    folder = caches / digest.hexdigest()[:16]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        temporary = tempfile.TemporaryDirectory(prefix="sketchterrain-cache-", ignore_cleanup_errors=True)
        config.add_cleanup(temporary.cleanup)
        return Path(temporary.name)
    for stale in sorted(caches.iterdir(), key=lambda path: path.stat().st_mtime)[:-3]:
        shutil.rmtree(stale, ignore_errors=True)
    os.utime(folder)
    return folder


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Count the tests of each tier and folder before -m selects, and keep a folder's tests on one worker."""
    counts = config.stash.setdefault(COUNTS, Counter())
    for item in items:
        tier = next((tier for tier in TIERS if item.get_closest_marker(tier)), "default")
        counts[tier, folder_of(item.nodeid)] += 1


def folder_of(node: str) -> str:
    """Return the folder of a test, for example ``terrain``; ``.`` for files beside the folders."""
    parts = node.split("::")[0].split("/")
    return parts[1] if len(parts) > 2 else "."


def cpu_seconds() -> float:
    """Return the CPU time of this process and of its children that have ended."""
    used = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(each.ru_utime + each.ru_stime for each in used)


class CostReport:
    """CPU time by folder and the slowest tests, printed at the end of a run."""

    def __init__(self) -> None:
        self._last = cpu_seconds()
        self._folders: Counter[str] = Counter()
        self._tests: Counter[str] = Counter()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self):
        report = yield
        now = cpu_seconds()
        report.cpu, self._last = now - self._last, now
        return report

    def pytest_runtest_logreport(self, report):
        self._folders[folder_of(report.nodeid)] += report.cpu
        self._tests[report.nodeid] += report.cpu

    def pytest_terminal_summary(self, terminalreporter):
        total = sum(self._folders.values())
        folders = ", ".join(f"{name} {seconds:.0f}" for name, seconds in self._folders.most_common())
        terminalreporter.section(f"CPU seconds: {total:.0f}")
        terminalreporter.line(folders)
        for name, seconds in self._tests.most_common(10):
            terminalreporter.line(f"{seconds:6.1f} {name}")


def pytest_sessionstart(session):
    session.config.pluginmanager.register(CostReport(), "cost-report")


@pytest.fixture(scope="session")
def gl():
    from sketchterrain.render.programs import open_context

    try:
        context = open_context()
    except DeviceError as error:
        pytest.skip(str(error))
    yield context
    context.release()
