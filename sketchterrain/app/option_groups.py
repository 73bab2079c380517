"""Options of commands in groups, and combinations of options that are refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import wraps
from inspect import Parameter, Signature, signature
from typing import Any, cast, get_type_hints

import typer


def with_option_groups(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command as typer expects it: options of its own in place of each dataclass of options."""
    groups: dict[str, type] = {}
    parameters: list[Parameter] = []
    hints = get_type_hints(command, include_extras=True)
    for parameter in signature(command).parameters.values():
        kind = hints[parameter.name]
        if is_dataclass(kind):
            groups[parameter.name] = cast("type", kind)
            types = get_type_hints(kind, include_extras=True)
            parameters += [
                parameter.replace(name=field.name, annotation=types[field.name], default=field.default)
                for field in fields(kind)
            ]
        else:
            parameters.append(parameter.replace(annotation=kind))

    @wraps(command)
    def grouped(**values: Any) -> None:
        for name, kind in groups.items():
            values[name] = kind(**{field.name: values.pop(field.name) for field in fields(kind)})
        command(**values)

    grouped.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    grouped.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    return grouped


def reject_combination(option: str, others: dict[str, object], why: str) -> None:
    """Raise a usage error if any of the other options (values by name) is given together with an option."""
    for name, value in others.items():
        if value is not None and value is not False and value != []:
            raise typer.BadParameter(f"{name} with {option}: {why}")
