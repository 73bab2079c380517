"""What a person does with the settings of the world: the sketch's own, and those of its tables."""

from __future__ import annotations

from collections.abc import Mapping

from sketchterrain.errors import InputError
from sketchterrain.sketch import SKETCH, TABLES, Parameter, Sketch
from sketchterrain.sketch.parameter import Value

WORLD = "sketch"
"""Stands for the keys at the top of the file where the name of a table is expected."""


def declared(table: str) -> Mapping[str, Parameter]:
    """Return what can be set in a table: `WORLD` or a name of ``TABLES``."""
    if table == WORLD:
        return SKETCH
    if table not in TABLES:
        raise InputError(f"no table {table!r}: expected {', '.join((WORLD, *TABLES))}")
    return TABLES[table]


def settings(sketch: Sketch, table: str) -> dict[str, Value]:
    """Return all values of a table, in the order of their declaration."""
    parameters = declared(table)
    given = getattr(sketch, table) if table != WORLD else {name: getattr(sketch, name) for name in SKETCH}
    return {name: given[name] for name in parameters}


def setting(sketch: Sketch, table: str, name: str) -> Value:
    """Return one value of a table."""
    return settings(sketch, table)[name]


def set_setting(sketch: Sketch, table: str, name: str, value: Value) -> Sketch:
    """Return a sketch with another value in a table."""
    parameters = declared(table)
    if name not in parameters:
        raise InputError(f"no setting {name!r} in {table}: expected {', '.join(parameters)}")
    if setting(sketch, table, name) == value:
        return sketch
    if table == WORLD:
        return sketch.replace(**{name: value})
    return sketch.replace(**{table: {**getattr(sketch, table), name: value}})


def reset_setting(sketch: Sketch, table: str, name: str) -> Sketch:
    """Return a sketch with the default of a value in a table."""
    return set_setting(sketch, table, name, declared(table)[name].default)
