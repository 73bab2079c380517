"""Untrusted TOML: errors on one line, and a bound on the time that parsing takes."""

from __future__ import annotations

import tomllib

from sketchterrain.errors import InputError, one_line

_MAX_DOTS = 250


def load_toml(data: bytes) -> dict[str, object]:
    """Parse TOML (UTF-8, with or without a byte-order mark); raise InputError with the line number."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(f"line {line} is not UTF-8: expected a UTF-8 text file") from None
    # The parser's time and memory grow with the square of a dotted key's depth.
    deep = next((n for n, line in enumerate(text.split("\n"), 1) if line.count(".") > _MAX_DOTS), None)
    if deep is not None:
        raise InputError(f"line {deep} has more than {_MAX_DOTS} dots: it is nested too deeply")
    try:
        return tomllib.loads(text)
    except ValueError as error:  # TOMLDecodeError, or an integer of too many digits
        last = text.rstrip().count("\n") + 1
        reason = one_line(error).replace("at end of document", f"at line {last}, the last one")
        raise InputError(f"not TOML: {reason}") from None
    except RecursionError:
        raise InputError("it is nested too deeply") from None
