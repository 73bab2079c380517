"""Parts of values: what a stage reads of a sketch, and no more."""

from __future__ import annotations

from typing import Any


class Part:
    """Some fields of a value, with the methods and properties of its class; no others can be read."""

    def __init__(self, kind: type, values: dict[str, Any]) -> None:
        self._kind = kind
        self.__dict__.update(values)

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._kind, name, None)
        if isinstance(found, property) and found.fget is not None:
            return found.fget(self)
        if callable(found):
            return found.__get__(self)
        raise AttributeError(f"{name}: expected one of the declared fields, {', '.join(self.__dict__)}")

    def digest_parts(self) -> dict[str, Any]:
        """Return the fields, of which its digest is."""
        return self.__dict__

    def properties(self, layer: str, label: int) -> Any:
        """Return all properties of a label of a layer whose labels are declared."""
        if layer not in self.labelled:
            raise AttributeError(f"labels.{layer}: expected a layer of {', '.join(self.labelled)}")
        return self._kind.properties(self, layer, label)  # type: ignore[attr-defined] # of a sketch

    def replace(self, **changes: Any) -> Part:
        """Return it with other values in the named fields."""
        return Part(self._kind, {**self.__dict__, **changes})


def part_of(sketch: Any, *names: str) -> Any:
    """Return a sketch with some of its fields, of which no others can be read.

    Parameters
    ----------
    names : of fields, of items of theirs (``layers.river``, ``climate.aridity``), of the labels of a layer
        (``labels.river``), or ``size``, the pixels along both sides
    """
    found: dict[str, Any] = {"labels": {}, "labelled": []}
    for name in names:
        outer, _, inner = name.partition(".")
        if name == "size":
            found |= {"width_px": sketch.width_px, "height_px": sketch.height_px}
        elif outer == "labels":
            found["labelled"].append(inner)
            found[outer] |= {key: each for key, each in sketch.labels.items() if key[0] == inner}
        elif inner:
            found.setdefault(outer, {})[inner] = getattr(sketch, outer)[inner]
        else:
            found[outer] = getattr(sketch, outer)
    return Part(sketch._kind if isinstance(sketch, Part) else type(sketch), found)
