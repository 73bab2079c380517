"""A virtual X display and a user of the program."""

import os
import shutil
import subprocess

import pytest

from .user import User

SIZE = "1600x1000x24"


@pytest.fixture(scope="session")
def display():
    if shutil.which("Xvfb") is None or shutil.which("xdotool") is None:
        pytest.skip("needs Xvfb and xdotool: apt install xvfb xdotool")
    read, write = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write), "-screen", "0", SIZE, "-nolisten", "tcp", "-noreset"],
        pass_fds=[write],
        stderr=subprocess.DEVNULL,
    )
    os.close(write)
    with os.fdopen(read) as stream:
        number = stream.readline().strip()
    assert number, "Xvfb did not start"
    yield f":{number}"
    server.terminate()
    server.wait(timeout=300)


@pytest.fixture
def user(display, tmp_path):
    created = User(display, tmp_path / "home")
    yield created
    created.close()
