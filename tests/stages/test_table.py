"""A stage has what it declares, runs when that differs, and otherwise its result is the same object."""

import dataclasses
from contextlib import suppress

import numpy as np
import pytest

from sketchterrain.document.edits import Edit
from sketchterrain.document.material_rules import RuleChange
from sketchterrain.document.sketch import TABLES, Sketch
from sketchterrain.generation import building
from sketchterrain.generation.building import make_recipe
from sketchterrain.generation.stages import STAGES
from sketchterrain.schema.layers import LAYERS, PAINTED_LAYERS
from sketchterrain.schema.parameters import SKETCH
from sketchterrain.stages.digests import digest_of
from sketchterrain.stages.parts import part_of
from sketchterrain.stages.runner import Results, Runner
from sketchterrain.stages.table import Evaluation, StageTable
from sketchterrain.terrain.recipe import difference
from tests.conftest import ROOT
from tests.sample_roads import sketch_with

SIDE = 48


def painted(layer, *boxes):
    image = np.zeros((SIDE, SIDE), np.uint8)
    for top, left, bottom, right in boxes:
        image[top:bottom, left:right] = 1
    return {layer: image}


def base():
    layers = (
        painted("mountain", (4, 4, 14, 16))
        | painted("hill", (20, 30, 28, 40))
        | painted("forest", (36, 6, 42, 14))
        | painted("lake", (30, 18, 36, 26))
        | painted("river", (16, 2, 18, 30))
        | painted("plateau", (38, 32, 46, 44))
        | painted("material", (2, 34, 8, 44))
    )
    road = sketch_with(("road", [(100, 900), (900, 950)]), extent=2048.0).vectors["road"]
    labels = {(name, 1): {} for name in layers} | {("road", 1): {}}
    density = {"forest": 0.5, "dune": 0.1}
    return Sketch(
        extent=2048.0, layers=layers, vectors={"road": road}, labels=labels, density=density, seed=3
    )


class LoggedRunner(Runner):
    """Notes the stages that it runs."""

    def __init__(self, results):
        self.ran: list[str] = []
        super().__init__(results)

    def __call__(self, function, *inputs, **options):
        if getattr(STAGES.get(function.__name__), "function", None) is not function:
            return super().__call__(function, *inputs, **options)
        if digest_of((function, inputs)) not in self.results:
            self.ran.append(function.__name__)
        return super().__call__(function, *inputs, **options)


def changed_value(parameter, value):
    if parameter.choices:
        return next(each for each in parameter.choices if each != value)
    if parameter.kind is str:
        return None
    low, high = parameter.soft_range or (parameter.low, parameter.high)
    for other in (value + (high - low) / 7.0, value - (high - low) / 7.0, high, low):
        other = parameter.kind(other)
        if low <= other <= high and other != value:
            return other
    return None


def changes(sketch):
    """Yield names of fields as stages declare them, and sketches that differ in them alone."""
    for name, parameter in SKETCH.items():
        if name not in ("name", "extent"):
            yield name, sketch.replace(**{name: changed_value(parameter, getattr(sketch, name))})
    for table, parameters in TABLES.items():
        for name, parameter in parameters.items():
            value = changed_value(parameter, getattr(sketch, table)[name])
            if table != "frame" and value is not None:
                yield f"{table}.{name}", sketch.replace(**{table: {**getattr(sketch, table), name: value}})
    for (layer, label), values in sketch.labels.items():
        for name, parameter in LAYERS[layer].parameters.items():
            value = changed_value(parameter, sketch.properties(layer, label)[name])
            if value is not None:
                labels = {**sketch.labels, (layer, label): {**values, name: value}}
                yield f"labels.{layer}", sketch.replace(labels=labels)
    for name in PAINTED_LAYERS:
        image = sketch.layers[name].copy()
        image[24, 44] = 1 - min(image[24, 44], 1)
        yield f"layers.{name}", sketch.replace(layers={**sketch.layers, name: image})
    road = sketch.vectors["road"]
    moved = dataclasses.replace(road, vertices=road.vertices + np.array([[0.0, 0.0], [10.0, 5.0]]))
    yield "vectors.road", sketch.replace(vectors={**sketch.vectors, "road": moved})
    edit = Edit("add", type="hill", x=600.0, y=700.0, radius=90.0, strength=30.0)
    yield "edits", sketch.replace(edits=(edit,))
    yield "material_rules", sketch.replace(material_rules=(RuleChange("dry_soil", material="rock"),))


def reads(stage, field):
    """Return whether a stage declares a field, painted layers included."""
    outer, _, inner = field.partition(".")
    names = {each.replace("painted.", "layers.") for each in stage.reads}
    return field in names or (bool(inner) and outer in names) or (field == "labels" and "labels" in names)


def check(before, field, sketch, results, seen):
    run = LoggedRunner(results)
    after = Evaluation(STAGES, sketch, run)
    after["recipe"]
    for stage in STAGES.values():
        if stage.fresh:
            continue
        declared = [digest_of(each._part(stage.reads)) for each in (before, after)] if stage.reads else [0, 0]
        inputs = [name for name in stage.inputs if digest_of(before[name]) != digest_of(after[name])]
        assert reads(stage, field) or declared[0] == declared[1], (field, stage.name)
        if declared[0] == declared[1] and not inputs:
            assert stage.name not in run.ran, (field, stage.name)
            assert after[stage.name] is before[stage.name], (field, stage.name)
        else:  # unless an earlier case had the same inputs
            key = stage.name, declared[1], *(digest_of(after[name]) for name in stage.inputs)
            assert (stage.name in run.ran) == (key not in seen), (field, stage.name)
            seen.add(key)


def cases(step):
    sketch, results = base(), Results(max_bytes=1 << 32)
    before = Evaluation(STAGES, sketch, Runner(results))
    before["recipe"]
    found = list(changes(sketch))
    assert len(found) > 70
    seen = set()
    for field, changed in found[::step]:
        check(before, field, changed, results, seen)
    again = LoggedRunner(results)
    assert Evaluation(STAGES, base(), again)["recipe"] is before["recipe"]
    assert again.ran == []


def test_stored_results_are_read_by_the_next_process_unless_damaged_or_of_other_code(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    plain, stored = make_recipe(base()), sorted(each.name for each in STAGES.values() if each.stored)

    def computed():
        results, names = building.stored_results(), []

        def on_disk(key, compute, read=results.on_disk):
            return read(key, lambda: names.append(compute.func.__name__) or compute())

        results.on_disk = on_disk
        change = difference(plain, make_recipe(base(), memory=results))
        assert change is not None
        assert change.layers == {}
        return sorted(names)

    assert computed() == stored
    assert computed() == []
    damaged, *_ = files = sorted(tmp_path.rglob("stages-*"))
    damaged.write_bytes(damaged.read_bytes()[:-1])
    assert len(computed()) == 1
    assert len(files) == len(stored)
    total = sum(each.stat().st_size for each in files)
    monkeypatch.setattr(building, "code_digest", lambda: "other")
    monkeypatch.setattr(building, "_STORED_BYTES", total)
    assert computed() == stored
    assert sum(each.stat().st_size for each in tmp_path.rglob("stages-*")) <= total


def test_some_fields_run_the_stages_that_declare_them_and_what_differs_after():
    cases(17)


@pytest.mark.slow
def test_each_field_runs_the_stages_that_declare_it_and_what_differs_after():
    cases(1)


class WholeStages(Runner):
    """Reports no shares within stages."""

    progress = property(lambda _: lambda _: None, lambda *_: None)


def shares_of(sketch, results, stop=2.0):
    """Return the shares done that are reported after stages until one reaches a limit, which cancels."""
    shares = []

    def report(share):
        shares.append(share)
        if share >= stop:
            raise InterruptedError

    with suppress(InterruptedError):
        Evaluation(STAGES, sketch, WholeStages(results), report)["recipe"]
    assert shares == sorted(shares)
    return shares


def test_shares_done_are_by_costs_of_stages_that_run_each_once():
    sketch, results = base(), Results(max_bytes=1 << 32)
    costs = [stage.cost for stage in STAGES.values()]
    shares = shares_of(sketch, results)
    np.testing.assert_allclose(sorted(np.diff([0.0, *shares]) * sum(costs)), sorted(costs), rtol=1e-9)
    changed = dict(changes(sketch))["vectors.road"]
    shares = shares_of(changed, results)
    assert (len(shares), shares[-1]) == (len(STAGES), 1.0)
    assert np.diff(shares).max() > 0.95  # of roads: results of the others are stored, but for the recipe's
    assert shares_of(changed, results)[-1] == 1.0


def test_a_cancelled_evaluation_leaves_valid_results():
    sketch, results = base(), Results(max_bytes=1 << 32)
    shares = shares_of(sketch, results, stop=0.5)
    assert 0.5 <= shares[-1] < 1.0
    run = LoggedRunner(results)
    recipe = Evaluation(STAGES, sketch, run)["recipe"]
    assert len(run.ran) <= len(STAGES) - len(shares)
    assert digest_of(recipe) == digest_of(Evaluation(STAGES, sketch, Runner())["recipe"])


def test_a_stage_has_no_access_to_what_it_does_not_declare():
    table, stage = StageTable(), None
    stage = table.stage

    @stage("extent", "labels.hill")
    def one(sketch):
        return sketch.seed

    @stage("layers.hill")
    def two(sketch):
        return sketch.layers["mountain"]

    @stage("labels.hill", "extent")
    def three(sketch):
        return sketch.properties("mountain", 1)

    @stage("extent")
    def four(sketch):
        return sketch.pixel_size

    for name in ("one", "two", "three", "four"):
        with pytest.raises((AttributeError, KeyError)):
            table[name].function(part_of(base(), *table[name].reads))
    with pytest.raises(TypeError, match="declared before it, got \\['later'\\]"):

        @stage()
        def early(later):
            return later


def test_the_architecture_names_the_stages_in_their_order():
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    rows = [row.split(" | ") for row in text.splitlines() if row.count(" | ") == 3 and row.startswith("| ")]
    found = [(name[2:], after) for name, _, after, _ in rows if name[2:] in STAGES]
    assert found == [(stage.name, ", ".join(stage.inputs)) for stage in STAGES.values()]


def test_shares_within_stages_are_reported():
    shares, run = [], Runner()
    run.progress = shares.append
    assert list(run.steps("abcd")) == [*"abcd"]
    assert shares == [0.0, 0.25, 0.5, 0.75]
    shares.clear()
    Evaluation(STAGES, base(), Runner(), shares.append)["recipe"]
    assert shares == sorted(shares)
    assert len(shares) > len(STAGES)
