"""Mutants of the program: small faults, drawn with a fixed seed, that the tests must detect.

``python .ci/mutants.py draw SEED`` adds 24 to ``.ci/mutants.json``. ``run [NUMBER …] -- COMMAND …`` applies
each mutant to this checkout in turn, runs the command (a test run that stops at its first failure) and prints
whether it failed, that is, whether the mutant was killed. ``{rooms}`` in the command stands for the test
folders of the mutant's package and of those that use it. The checkout must be clean.
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
REPLACED: Final[dict[tuple[int, str, int], str]] = {  # draws (seed, room, turn) without a visible effect
    (20261128, "sketchterrain/importing/*.py", 1): "nothing assigns to a frozen instance",
    (20261128, "sketchterrain/export/**/*.py", 1): "the indentation of a JSON file",
}
ROOMS: Final = {  # folder or file pattern: mutants drawn from it
    "kernels/*.cl*": 4,
    "kernels/render/*.glsl": 1,
    "sketchterrain/app/*.py": 1,
    "sketchterrain/app/commands/*.py": 1,
    "sketchterrain/document/*.py": 1,
    "sketchterrain/landforms/placement/*.py": 1,
    "sketchterrain/landforms/hydrology/*.py": 1,
    "sketchterrain/compute/*.py": 1,
    "sketchterrain/landforms/*.py": 1,
    "sketchterrain/generation/*.py": 1,
    "sketchterrain/terrain/*.py": 1,
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
    """A fault: ``before`` at a column (from 1) of the first line with this text becomes ``after``."""

    file: str
    text: str
    column: int
    before: str
    after: str

    def __str__(self) -> str:
        return f"{self.file}: {self.before} → {self.after} in {self.text.strip()!r}"

    def applied(self) -> str:
        """Return the file's text with the fault."""
        lines = (ROOT / self.file).read_text(encoding="utf-8").split("\n")
        if self.text not in lines:
            raise SystemExit(f"{self.file}: expected a line {self.text!r}; draw a mutant instead")
        start = self.column - 1
        lines[lines.index(self.text)] = self.text[:start] + self.after + self.text[start + len(self.before) :]
        return "\n".join(lines)


def _between(lines: list[str], left: ast.AST, right: ast.AST, file: str) -> list[Mutant]:
    """Return swaps of the operator between two operands on one line."""
    if left.end_lineno != right.lineno:
        return []
    gap = lines[left.end_lineno - 1].encode()[left.end_col_offset : right.col_offset].decode()
    word = gap.strip(" ()")
    start = len(lines[left.end_lineno - 1].encode()[: left.end_col_offset].decode()) + gap.find(word)
    return [Mutant(file, lines[right.lineno - 1], start + 1, word, SWAPS[word])] if word in SWAPS else []


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
                found.append(Mutant(file, lines[node.lineno - 1], column, source, after))
            case ast.Call(func=ast.Name(id="min" | "max" as name)):
                column = len(lines[node.lineno - 1].encode()[: node.col_offset].decode()) + 1
                found.append(Mutant(file, lines[node.lineno - 1], column, name, SWAPS[name]))
    return found


def of_kernel(file: str, text: str) -> list[Mutant]:
    """Return all faults that can be planted in OpenCL or GLSL text."""
    found = []
    for line in text.splitlines():
        code = line.split("//")[0]
        if code.lstrip().startswith(("#", "*", "/*")):
            continue
        for match in re.finditer(
            r"(?<= )(<=|>=|<<|>>|==|!=|&&|\|\||[-+*/<>])(?= )|\breal_(?:min|max)\b", code
        ):
            found.append(Mutant(file, line, match.start() + 1, match[0], SWAPS[match[0]]))  # noqa: PERF401
        for match in re.finditer(r"\bR\((\d+\.\d+)\)|(?<![\w.])(\d+\.\d+)(?![\w.])", code):
            number_text = match[1] or match[2]
            column = match.start(1 if match[1] else 2) + 1
            found.append(Mutant(file, line, column, number_text, f"{float(number_text) * 1.25 + 0.01:g}"))
    return found


def draw(seed: int) -> list[Mutant]:
    """Draw the mutants: for each room files by their length, then a place in the file."""
    drawn = []
    for pattern, count in ROOMS.items():
        files = sorted(ROOT.glob(pattern))
        texts = [path.read_text(encoding="utf-8") for path in files]
        wanted, turn = len(drawn) + count, 0
        while len(drawn) < wanted:
            turn += 1
            chance = random.Random(f"{seed} {pattern} {turn}")
            (index,) = chance.choices(range(len(files)), [len(text) for text in texts])
            name = files[index].relative_to(ROOT).as_posix()
            places = (of_python if name.endswith(".py") else of_kernel)(name, texts[index])
            if places and (seed, pattern, turn) not in REPLACED:
                drawn.append(chance.choice(places))
    return drawn


def read() -> list[Mutant]:
    """Return the committed list."""
    return [Mutant(**mutant) for mutant in json.loads(LIST.read_text(encoding="utf-8"))]


USERS: Final = {  # test folders of packages whose name they do not have, and of packages that use them
    "kernels/render": ["render"],
    "kernels": ["terrain", "frozen", "drape", "render"],
    "sketchterrain/app": ["cli"],
    "sketchterrain/jobs": ["cli"],
    "sketchterrain/document": ["document", "ui/test_panels.py", "ui/test_document.py"],
    "sketchterrain/landforms/placement": ["placement", "landforms", "frozen", "terrain", "hydrology"],
    "sketchterrain/landforms/hydrology": ["hydrology", "frozen", "terrain"],
    "sketchterrain/landforms": ["terrain", "hydrology", "landforms", "frozen"],
    "sketchterrain/geometry": ["placement", "hydrology", "terrain", "frozen"],
    "sketchterrain/generation": ["stages", "terrain", "frozen", "batch"],
    "sketchterrain/measure": ["terrain", "cli"],
    "sketchterrain/compute": ["compute", "render/test_vertex_memory.py", "gl_sharing"],
    "sketchterrain/terrain": ["terrain", "frozen", "elevation", "landforms", "batch"],
    "sketchterrain/look": ["render"],
    "sketchterrain/tiles": ["tiles", "render", "drape"],
    "ui": ["ui", "window"],
}


def rooms_of(mutant: Mutant) -> list[str]:
    """Return the test folders of a mutant's package."""
    parts = mutant.file.split("/")
    names = ["/".join(parts[:count]) for count in range(len(parts) - 1, 0, -1)]
    folders = next((USERS[name] for name in names if name in USERS), [parts[1]])
    return [f"tests/{folder}" for folder in folders]


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
            words = [
                word for given in command for word in (rooms_of(mutant) if given == "{rooms}" else [given])
            ]
            done = subprocess.run(words, cwd=ROOT, check=False, capture_output=True, text=True)
        finally:
            path.write_bytes(original)
        failed = next((line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))), "")
        verdict = "killed" if done.returncode else "survived"
        print(f"{number:2} {verdict:8} {time.monotonic() - start:6.0f} s  {mutant} {failed[:99]}", flush=True)


def main() -> None:
    """Run the command line."""
    match sys.argv[1:]:
        case ["draw", seed]:
            mutants = [mutant._asdict() for mutant in read() + draw(int(seed))]
            LIST.write_text(json.dumps(mutants, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        case ["run", *arguments] if "--" in arguments:
            split = arguments.index("--")
            run([int(number) for number in arguments[:split]], arguments[split + 1 :])
        case _:
            raise SystemExit(__doc__)


if __name__ == "__main__":
    main()
