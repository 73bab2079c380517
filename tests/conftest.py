"""Caches, profiles and the closing report of all tests."""

import os
import resource
import tempfile
from collections import Counter
from pathlib import Path

import hypothesis
import pytest

from sketchterrain.errors import DeviceError
from tests.warm_up import cache_of_sources, warm_up

ROOT = Path(__file__).resolve().parents[1]
TIERS = ("slow", "soak")
ONE_WORKER = {
    "terrain",
    "render",
    "drape",
    "ui",
    "cli",
    "export",
    "world",
    "tiles",
    "benchmarks",
}
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
    if hasattr(config, "workerinput"):
        return  # xdist's workers get the environment of the process that starts them
    cache = cache_of_sources()
    if cache is None:
        temporary = tempfile.TemporaryDirectory(prefix="sketchterrain-cache-", ignore_cleanup_errors=True)
        config.add_cleanup(temporary.cleanup)
        cache = Path(temporary.name)
    elif config.option.numprocesses and not config.option.collectonly:
        warm_up(cache)
    os.environ["XDG_CACHE_HOME"] = str(cache)
    os.environ["SKETCHTERRAIN_TWIN_DEVICE"] = "1"
    if config.option.numprocesses:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # idle threads spin beside the other workers


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Keep the tests of a folder in `ONE_WORKER`, and those of any file, on one worker."""
    from xdist.scheduler import LoadScopeScheduling

    class FolderScheduling(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            folder = folder_of(nodeid)
            return folder if folder in ONE_WORKER else nodeid.partition("::")[0]

    return FolderScheduling(config, log)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Count the tests of each tier and folder before -m selects."""
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

    def pytest_collection_finish(self):
        self._last = cpu_seconds()

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
def opengl():
    from sketchterrain.render.programs import open_context

    try:
        context = open_context()
    except DeviceError as error:
        pytest.skip(str(error))
    yield context
    context.release()


@pytest.fixture(scope="module")
def gl(opengl):
    """The shared context, made current: another module may have left its own."""
    opengl.__enter__()
    return opengl
