"""Options and cache folder of all tests."""

import os
import tempfile

import pytest

from sketchterrain.errors import DeviceError


def pytest_addoption(parser):
    parser.addoption(
        "--regenerate-goldens",
        action="store_true",
        help="overwrite the golden pictures instead of comparing: inspect each",
    )


def pytest_configure(config):
    # Nothing is written into the user's own cache. xdist's workers get the environment of the process that
    # starts them, so all of a session share one folder and textures are computed once.
    if not hasattr(config, "workerinput"):
        folder = tempfile.TemporaryDirectory(prefix="sketchterrain-cache-", ignore_cleanup_errors=True)
        os.environ["XDG_CACHE_HOME"] = folder.name
        config.add_cleanup(folder.cleanup)


@pytest.fixture(scope="session")
def gl():
    from sketchterrain.render.programs import open_context

    try:
        context = open_context()
    except DeviceError as error:
        pytest.skip(str(error))
    yield context
    context.release()
