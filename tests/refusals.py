"""What all refusals have in common."""

import re
from collections.abc import Callable

import pytest

from sketchterrain.errors import InputError


def refused(pattern: str, call: Callable[..., object], /, *arguments: object, **options: object) -> str:
    """Check that a call is refused in one short line in which a pattern is found; return the line."""
    with pytest.raises(InputError) as caught:
        call(*arguments, **options)
    line = str(caught.value)
    assert re.search(pattern, line), line
    assert line.isprintable()
    assert len(line) < 600
    return line
