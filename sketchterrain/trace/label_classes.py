"""Few labels for many features: those that nearly agree share one."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.sketch.parameter import Value

    Properties = dict[str, Value]

__all__ = ["LabelClasses", "classed"]


class LabelClasses(NamedTuple):
    """Which features share a label.

    Attributes
    ----------
    of : tuple of int
        For each feature the index of its class.
    properties : tuple of dict
        Of each class.
    error : float
        How far a number of a feature is from its class's, over itself, at most.
    """

    of: tuple[int, ...]
    properties: tuple[Properties, ...]
    error: float


def classed(wanted: Sequence[Properties], most: int) -> LabelClasses:
    """Return classes of features by their properties, in the order in which they appear.

    Properties that are equal share a class. Where these would be too many, numbers that lie in one step of a
    geometric scale do, as fine a one as there may be, and a class has their mean.

    Parameters
    ----------
    wanted
        Of each feature.
    most
        Classes, ≥ 1.
    """
    steps = math.inf
    while True:
        keys = [tuple((name, _step(value, steps)) for name, value in sorted(each.items())) for each in wanted]
        order = {key: index for index, key in enumerate(dict.fromkeys(keys))}
        if len(order) <= most:
            break
        if steps < 1 / 64:  # texts, signs and what is said at all make too many
            return LabelClasses((0,) * len(wanted), ({},), math.inf)
        steps = 64.0 if steps == math.inf else steps / 2.0
    of = tuple(order[key] for key in keys)
    members: list[list[Properties]] = [[] for _ in order]
    for index, each in zip(of, wanted, strict=True):
        members[index].append(each)
    properties = tuple(_mean(each) for each in members)
    error = max((_off(each, properties[index]) for index, each in zip(of, wanted, strict=True)), default=0.0)
    return LabelClasses(of, properties, error)


def _step(value: Value, steps: float) -> Value:
    """Return what is equal for values in one of so many steps an octave."""
    if isinstance(value, str) or value == 0 or steps == math.inf:
        return value
    return f"{'-' if value < 0 else '+'} {round(math.log2(abs(value)) * steps)}"


def _mean(members: Sequence[Properties]) -> Properties:
    first = members[0]
    if all(each == first for each in members):
        return first
    return {
        name: value if isinstance(value, str) else _rounded([each[name] for each in members], value)
        for name, value in first.items()
    }


def _rounded(values: Sequence[Value], like: Value) -> Value:
    mean = math.fsum(float(each) for each in values) / len(values)
    return round(mean) if isinstance(like, int) else float(f"{mean:.4g}")


def _off(wanted: Properties, got: Properties) -> float:
    return max(
        (
            abs(float(got[name]) / float(value) - 1.0)
            for name, value in wanted.items()
            if value and not isinstance(value, str)
        ),
        default=0.0,
    )
