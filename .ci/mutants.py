"""Mutants of the program: small faults, drawn with a fixed seed, that the tests must detect.

``python .ci/mutants.py draw`` writes ``.ci/mutants.json``. ``run [NUMBER …] -- COMMAND …`` applies each
mutant to this checkout in turn, runs the command (a test run that stops at its first failure) and prints
whether it failed, that is, whether the mutant was killed. The checkout must be clean.
"""

from __future__ import annotations

import ast
import json
import random
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).resolve().parents[1]
LIST: Final = Path(__file__).with_suffix(".json")
SEED: Final = 20261122
REPLACED: Final[dict[tuple[str, int], str]] = {  # draws that change nothing that a caller could see, and why
    ("sketchterrain/terrain/*.py", 1): "a cache holds one entry more",
    ("sketchterrain/terrain/*.py", 3): "nothing assigns to a frozen instance",
    ("sketchterrain/export/**/*.py", 1): "rows at once change no value",
    ("sketchterrain/importing/*.py", 1): "a limit on vertices is one higher",
    ("sketchterrain/importing/*.py", 2): "one row or column broadcasts into none",
    ("sketchterrain/world/*.py", 1): "a check of equal lengths that hold",
    ("ui/**/*.py", 1): "how long a benchmark sleeps at a time",
}
ROOMS: Final = {  # folder or file pattern: mutants drawn from it
    "kernels/*.cl*": 4,
    "kernels/render/*.glsl": 1,
    "sketchterrain/app/*.py": 1,
    "sketchterrain/app/commands/*.py": 1,
    "sketchterrain/document/*.py": 1,
    "sketchterrain/placement/*.py": 1,
    "sketchterrain/hydrology/*.py": 1,
    "sketchterrain/compute/*.py": 1,
    "sketchterrain/terrain/*.py": 3,
    "sketchterrain/tiles/*.py": 1,
    "sketchterrain/look/*.py": 1,
    "sketchterrain/render/*.py": 2,
    "sketchterrain/export/**/*.py": 1,
    "sketchterrain/importing/*.py": 1,
    "sketchterrain/batch/*.py": 1,
    "sketchterrain/world/*.py": 1,
    "ui/**/*.py": 2,
}
SWAPS: Final = {
    "<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "==",
    "+": "-", "-": "+", "*": "/", "/": "*", "<<": ">>", ">>": "<<",
    "&&": "||", "||": "&&", "and": "or", "or": "and", "is": "is not", "in": "not in",
    "min": "max", "max": "min", "real_min": "real_max", "real_max": "real_min",
    "True": "False", "False": "True",
}  # fmt: skip


class Mutant(NamedTuple):
    """A fault: the text ``before`` at a line and column (both from 1) becomes ``after``."""

    file: str
    line: int
    column: int
    before: str
    after: str

    def applied(self) -> str:
        """Return the file's text with the fault."""
        lines = (ROOT / self.file).read_text(encoding="utf-8").splitlines(keepends=True)
        text, at = lines[self.line - 1], self.column - 1
        if not text.startswith(self.before, at):
            raise SystemExit(f"{self.file}:{self.line}:{self.column}: expected {self.before!r}: {text!r}")
        lines[self.line - 1] = text[:at] + self.after + text[at + len(self.before) :]
        return "".join(lines)


def _between(lines: list[str], left: ast.AST, right: ast.AST, file: str) -> list[Mutant]:
    """Return swaps of the operator between two operands on one line."""
    if left.end_lineno != right.lineno:
        return []
    gap = lines[left.end_lineno - 1].encode()[left.end_col_offset : right.col_offset].decode()
    word = gap.strip(" ()")
    start = len(lines[left.end_lineno - 1].encode()[: left.end_col_offset].decode()) + gap.find(word)
    return [Mutant(file, right.lineno, start + 1, word, SWAPS[word])] if word in SWAPS else []


def of_python(file: str, text: str) -> list[Mutant]:
    """Return all faults that can be planted in a Python file."""
    lines, found = text.splitlines(), []
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.Compare(left=left, comparators=[right, *_]) | ast.BinOp(left=left, right=right):
                found += _between(lines, left, right, file)
            case ast.BoolOp(values=[left, right, *_]):
                found += _between(lines, left, right, file)
            case ast.Constant(value=bool() | int() | float() as value):
                source = ast.get_source_segment(text, node) or ""
                column = len(lines[node.lineno - 1].encode()[: node.col_offset].decode()) + 1
                after = SWAPS.get(source) or (
                    f"{source} + 1" if isinstance(value, int) else f"({source} * 1.25)"
                )
                found.append(Mutant(file, node.lineno, column, source, after))
            case ast.Call(func=ast.Name(id="min" | "max" as name)):
                column = len(lines[node.lineno - 1].encode()[: node.col_offset].decode()) + 1
                found.append(Mutant(file, node.lineno, column, name, SWAPS[name]))
    return found


def of_kernel(file: str, text: str) -> list[Mutant]:
    """Return all faults that can be planted in OpenCL or GLSL text."""
    found = []
    for number, line in enumerate(text.splitlines(), 1):
        code = line.split("//")[0]
        if code.lstrip().startswith(("#", "*", "/*")):
            continue
        for match in re.finditer(
            r"(?<= )(<=|>=|<<|>>|==|!=|&&|\|\||[-+*/<>])(?= )|\breal_(?:min|max)\b", code
        ):
            found.append(Mutant(file, number, match.start() + 1, match[0], SWAPS[match[0]]))  # noqa: PERF401
        for match in re.finditer(r"\bR\((\d+\.\d+)\)|(?<![\w.])(\d+\.\d+)(?![\w.])", code):
            number_text = match[1] or match[2]
            column = match.start(1 if match[1] else 2) + 1
            found.append(Mutant(file, number, column, number_text, f"{float(number_text) * 1.25 + 0.01:g}"))
    return found


def draw() -> list[Mutant]:
    """Draw the mutants: for each room files by their length, then a place in the file."""
    drawn = []
    for pattern, count in ROOMS.items():
        files = sorted(ROOT.glob(pattern))
        texts = [path.read_text(encoding="utf-8") for path in files]
        wanted, turn = len(drawn) + count, 0
        while len(drawn) < wanted:
            turn += 1
            chance = random.Random(f"{SEED} {pattern} {turn}")
            (index,) = chance.choices(range(len(files)), [len(text) for text in texts])
            name = files[index].relative_to(ROOT).as_posix()
            places = (of_python if name.endswith(".py") else of_kernel)(name, texts[index])
            if places and (pattern, turn) not in REPLACED:
                drawn.append(chance.choice(places))
    return drawn


def read() -> list[Mutant]:
    """Return the committed list."""
    return [Mutant(**mutant) for mutant in json.loads(LIST.read_text(encoding="utf-8"))]


def run(numbers: list[int], command: list[str]) -> None:
    """Plant each mutant, run the command and print one line about it."""
    if subprocess.run(["git", "diff", "--quiet", "HEAD"], cwd=ROOT, check=False).returncode:
        raise SystemExit("expected a checkout without uncommitted changes")
    mutants = read()
    for number in numbers or range(1, len(mutants) + 1):
        mutant = mutants[number - 1]
        path = ROOT / mutant.file
        original, start = path.read_bytes(), time.monotonic()
        path.write_text(mutant.applied(), encoding="utf-8")
        try:
            done = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True)
        finally:
            path.write_bytes(original)
        failed = next((line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))), "")
        verdict = "killed" if done.returncode else "survived"
        print(f"{number:2} {verdict:8} {time.monotonic() - start:6.0f} s  {mutant} {failed[:99]}", flush=True)


def main() -> None:
    """Run the command line."""
    match sys.argv[1:]:
        case ["draw"]:
            LIST.write_text(json.dumps([m._asdict() for m in draw()], indent=1) + "\n", encoding="utf-8")
        case ["run", *arguments] if "--" in arguments:
            split = arguments.index("--")
            run([int(number) for number in arguments[:split]], arguments[split + 1 :])
        case _:
            raise SystemExit(__doc__)


if __name__ == "__main__":
    main()
