"""Macros by which shaders know a sketch's materials: counts, and expressions over their weights."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from sketchterrain.document.materials import BEDROCK, Material, MaterialTable, Variation, weight_words


def material_macros(table: MaterialTable) -> dict[str, int | str]:
    """Return the macros of a table for programs that shade the terrain and what lies and grows on it."""
    layers, materials = list(table.layers), table.materials
    distant = [
        (index, layers.index(far.name)) for index, each in enumerate(materials) if (far := each.distant)
    ]
    bedded = [index for index, texture in enumerate(table.layers.values()) if texture.bedded]
    return {
        "WEIGHT_WORDS": weight_words(len(table)),
        "LAYERS": len(layers),
        "BEDROCK": layers.index(BEDROCK),
        "MEADOW_KINDS": _meadow_kinds(table),
        "IS_BEDDED(layer)": _is_any("layer", bedded),
        "DISTANT_LAYER(layer)": _choice("layer", distant),
        "VARIATIONS": _variations(table),
        "WOODED(w)": wooded_share(table),
        "MEADOW_SHARE(w)": _sum(table, lambda material: material.meadow),
        "UNDERGROWTH_SHARE(w)": _sum(table, lambda material: material.undergrowth),
        "WET_SHARE(w)": _sum(table, lambda material: material.wet),
        "BUNCH_SHARE(w)": _sum(table, lambda material: material.bunches),
        "STONES_ANYWHERE(w)": _sum(table, lambda material: material.stones.anywhere),
        "STONES_IN_HEAPS(w)": _sum(table, lambda material: material.stones.heaps),
        "STONES_IN_MIDDLES(w)": _sum(table, lambda material: material.stones.middles),
        "PAVED(w)": _sum(table, lambda material: float(material.is_paved)),
        "STONE_COLOURS": _stone_colours(table),
        "STONE_WEAR(w)": _stone_wear(table),
    }


def wooded_share(table: MaterialTable) -> str:
    """Return an expression of the weight of ground under trees, from the weights w."""
    return _sum(table, lambda material: float(material.is_wooded))


def _weight(index: int, name: str = "w") -> str:
    """Return the weight of a material in an array of words."""
    return f"{name}[{index // 4}][{index % 4}]"


def _sum(table: MaterialTable, value: Callable[[Material], float]) -> str:
    """Return the sum of a property over the materials."""
    terms = [f"{value(each)} * {_weight(index)}" for index, each in enumerate(table) if value(each)]
    return f"({' + '.join(terms) or '0.0'})"


def _is_any(name: str, values: Sequence[int]) -> str:
    return f"({' || '.join(f'{name} == {value}' for value in values) or 'false'})"


def _choice(name: str, pairs: Sequence[tuple[int, int]]) -> str:
    """Return the second of the pair whose first a variable equals, or the variable."""
    return f"({''.join(f'{name} == {one} ? {other} : ' for one, other in pairs)}{name})"


def _variations(table: MaterialTable) -> str:
    """Return statements that vary ``colour`` by the texture's ``layer``."""
    varied: dict[Variation, list[int]] = {}
    for index, texture in enumerate(table.layers.values()):
        for variation in texture.variations:
            varied.setdefault(variation, []).append(index)
    return " ".join(
        f"if ({_is_any('layer', layers)}) colour *= mix(vec3{each.low}, vec3{each.high}, "
        f"smoothstep({each.start}, {each.full}, {each.noise}));"
        for each, layers in varied.items()
    )


def _meadow_kinds(table: MaterialTable) -> str:
    """Return statements that set a tuft's ``layer`` and ``sward`` to those at ``pick`` of the shares."""
    return " ".join(
        f"if (pick > 0.0) {{ layer = {index}; sward = {each.sward}; }} "
        f"pick -= {each.meadow} * {_weight(index, 'weights')};"
        for index, each in enumerate(table)
        if each.meadow
    )


def _stone_colours(table: MaterialTable) -> str:
    """Return statements that give stones, ``lying``, the colours of materials with stones of their own."""
    return " ".join(
        f"lying = mix(lying, stone_albedo({index}, wide, middle, small), "
        f"smoothstep({each.stones.colours[0]}, {each.stones.colours[1]}, {_weight(index, 'weights')}));"
        for index, each in enumerate(table)
        if each.stones.colours
    )


def _stone_wear(table: MaterialTable) -> str:
    """Return how much water has rounded stones."""
    terms = [
        f"smoothstep({each.stones.colours[0]}, {each.stones.colours[1]}, {_weight(index)})"
        for index, each in enumerate(table)
        if each.stones.worn and each.stones.colours
    ]
    return f"({' + '.join(terms) or '0.0'})"
