"""Pictures wait for one another, and those that wait when a batch is ended are never begun."""

from __future__ import annotations

import threading

import pytest

from sketchterrain.batch import previews
from sketchterrain.batch.previews import Previews

ASKED = {"view": "auto", "weather": None}


class Slow:
    """Takes one picture at a time, as slowly as it is told."""

    def __init__(self, begun, finish):
        self.begun, self.finish, self.taken, self.closed = begun, finish, [], False

    def picture(self, terrain, **_):
        self.begun.set()
        assert self.finish.wait(30.0)
        self.taken.append(terrain)
        return terrain

    def close(self):
        self.closed = True


class EndedError(Exception):
    pass


def test_a_picture_that_waits_is_not_begun_after_the_end(monkeypatch):
    begun, finish, ended = threading.Event(), threading.Event(), threading.Event()
    studio = Slow(begun, finish)
    monkeypatch.setattr(previews, "Studio", lambda: studio)

    def go_on():
        if ended.is_set():
            raise EndedError

    def second():
        with pytest.raises(EndedError):
            taker.take("second", timings={}, go_on=go_on, **ASKED)
        told.append("second")

    told = []
    with Previews() as taker:
        first = threading.Thread(
            target=lambda: told.append(taker.take("first", timings={}, go_on=go_on, **ASKED))
        )
        first.start()
        assert begun.wait(30.0)
        waits = threading.Thread(target=second)
        waits.start()
        ended.set()
        finish.set()
        for thread in (first, waits):
            thread.join(30.0)
    assert sorted(told) == ["first", "second"]
    assert studio.taken == ["first"]
    assert studio.closed
