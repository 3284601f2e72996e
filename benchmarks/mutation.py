"""What the tests notice: seeded faults, one at a time, in a copy of the sources, and the tests of their room run on each.

`python benchmarks/mutation.py [-o FOLDER]` draws the faults by the seed, runs the quick tests of the fault's room until one
fails, then, where none did, the quick tests of other rooms that name the fault's module, and the smokes of all rooms:
together what `make test` notices, or a little less. `--slow` then runs the slow tests of the room on what is left. What is
finished is kept in `build/mutation`, for the same sources: a fault that a test noticed as long as the file of that test is
the same, one that none noticed as long as all tests that ran are. `--list` only shows the faults. The tests run with the
interpreter that runs this.
"""

from __future__ import annotations

import argparse
import ast
import copy
import hashlib
import os
import random
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from command import ONE_THREAD
from datasets import ROOT
from pages.cases import run_cases
from pages.kept import Kept
from pages.records import Found, publish
from pages.tables import table, yes

SOURCE, TESTS = ROOT / "src" / "passerby", ROOT / "tests"
ROOMS = ("solver", "association", "geometry", "people", "interchange", "scene", "calibration")
TESTED_BY = {"people": ["people", "monitoring", "solver"]}
"""Rooms whose tests are a room's too: most of what it does is seen in what they make of it."""
WHERE = {"room": "quick tests of the room", "elsewhere": "other quick tests", "slow": "slow tests of the room"}
STAGES = tuple(WHERE)  # the tests that a fault meets in turn, until one notices it
CPU_S = 900  # processor time after which a fault that makes the tests run on and on counts as noticed
OPPOSITE: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
}  # fmt: skip
NEXT: dict[type[ast.AST], type[ast.AST]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt,
}  # fmt: skip
REVERSED: dict[type[ast.AST], type[ast.AST]] = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
}  # fmt: skip
GOAL_PERCENT = 85
FAILED = ("FAILED", "ERROR")  # begin a line of pytest that names a test
COMMUTING = ("max", "min", "maximum", "minimum", "fmax", "fmin", "hypot", "isinstance")
ONE_SIDED = (ast.Sub, ast.Div, ast.MatMult)


@dataclass(frozen=True)
class Fault:
    """One change of one expression."""

    room: str
    path: str  # below src/passerby
    line: int
    kind: str
    before: str
    after: str
    start: int  # characters of the file that `after` takes the place of
    end: int

    @property
    def name(self) -> str:
        """What is changed, and where."""
        return f"{self.path}:{self.line}: {self.kind}: {self.before} -> {self.after}"


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("-o", "--out", type=Path, help="folder of the page; it is printed where none is given")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=300, help="faults, spread over the rooms")
    parser.add_argument("--rooms", nargs="*", default=ROOMS, choices=ROOMS)
    parser.add_argument("--list", action="store_true", help="show the faults only")
    parser.add_argument("--slow", action="store_true", help="run the slow tests too on what no quick one noticed")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes")
    wanted = parser.parse_args()
    faults = drawn(wanted.seed, wanted.count, wanted.rooms)
    if wanted.list:
        print("\n".join(fault.name for fault in faults))
        return
    stages = STAGES if wanted.slow else STAGES[:2]
    store = Answers(ROOT / "build" / "mutation", ())
    command = f"python benchmarks/mutation.py --seed {wanted.seed} --count {wanted.count} --rooms {' '.join(wanted.rooms)}"
    command += " --slow" if wanted.slow else ""
    found = find(faults, stages, store, wanted.workers)
    publish("mutation", "mutation", found, wanted.out, command, written=wanted.out is not None)


def drawn(seed: int, count: int, rooms: Sequence[str]) -> list[Fault]:
    """So many faults of some rooms in turn, the same for the same seed, rooms and sources."""
    rng = random.Random(seed)
    stocks = {room: sorted(faults_in(room), key=lambda fault: (fault.path, fault.start, fault.kind)) for room in rooms}
    chosen: list[Fault] = []
    for number in range(count):
        room = rooms[number % len(rooms)]
        kinds = sorted({fault.kind for fault in stocks[room]})
        # Every kind as likely as another; else most faults would be of constants.
        kind = rng.choice(kinds)
        fault = rng.choice([fault for fault in stocks[room] if fault.kind == kind])
        stocks[room] = [other for other in stocks[room] if (other.path, other.line) != (fault.path, fault.line)]
        chosen.append(fault)
    return chosen


def faults_in(room: str) -> Iterator[Fault]:
    """All faults that one room's modules can be given."""
    for path in sorted((SOURCE / room).rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        lines = [0]
        for line in text.splitlines(keepends=True):
            lines.append(lines[-1] + len(line.encode()))
        for node in calculations(ast.parse(text)):
            start = lines[node.lineno - 1] + node.col_offset
            end = lines[(node.end_lineno or node.lineno) - 1] + (node.end_col_offset or 0)
            for kind, changed in changes(node):
                yield Fault(
                    room, path.relative_to(SOURCE).as_posix(), node.lineno, kind, ast.unparse(node),
                    f"({ast.unparse(changed)})", start, end,
                )  # fmt: skip


def calculations(tree: ast.AST) -> Iterator[ast.expr]:
    """Expressions inside functions, but for annotations, messages, and what raises errors."""
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef):
            for statement in function.body:
                yield from _expressions(statement)


def _expressions(node: ast.AST) -> Iterator[ast.expr]:
    if isinstance(node, ast.Raise | ast.JoinedStr | ast.FunctionDef | ast.ClassDef | ast.Assert):
        return
    if isinstance(node, ast.Subscript):
        # Indices and slices are left: numpy refuses most faults in them at once.
        yield from _expressions(node.value)
        return
    if isinstance(node, ast.expr):
        yield node
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from _expressions(child)


def changes(node: ast.expr) -> Iterator[tuple[str, ast.expr]]:
    """(kind, expression) of every fault that an expression can be given."""
    if isinstance(node, ast.BinOp):
        if type(node.op) in OPPOSITE:
            yield "sign or inverse", _with(node, op=OPPOSITE[type(node.op)]())
        if isinstance(node.op, ast.Add | ast.Sub) and not isinstance(node.right, ast.Constant) and "'" not in ast.unparse(node):
            yield "dropped term", node.left
        if isinstance(node.op, ONE_SIDED):
            yield "swapped operands", _with(node, left=node.right, right=node.left)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
        yield "sign or inverse", node.operand
    elif isinstance(node, ast.Compare) and len(node.ops) == 1:
        if type(node.ops[0]) in NEXT and any(_counts(side) for side in (node.left, node.comparators[0])):
            yield "off by one", _with(node, ops=[NEXT[type(node.ops[0])]()])
        if type(node.ops[0]) in REVERSED:
            yield "reversed condition", _with(node, ops=[REVERSED[type(node.ops[0])]()])
    elif isinstance(node, ast.BoolOp):
        yield "dropped condition", _with(node, values=node.values[:-1]) if len(node.values) > 2 else node.values[0]
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        yield "wrong constant", ast.Constant(node.value + 1 if isinstance(node.value, int) else node.value * 1.5 + 1e-3)
    elif isinstance(node, ast.IfExp):
        yield "swapped operands", _with(node, body=node.orelse, orelse=node.body)
    elif isinstance(node, ast.Call) and len(node.args) == 2 and not _commutes(node):
        yield "swapped operands", _with(node, args=node.args[::-1])


def _counts(node: ast.expr) -> bool:
    """Whether this is a number of things: of real numbers `<` and `<=` hardly differ."""
    text = ast.unparse(node)
    return (isinstance(node, ast.Constant) and isinstance(node.value, int)) or text.startswith("len(")


def _commutes(node: ast.Call) -> bool:
    name = ast.unparse(node.func).rsplit(".", 1)[-1]
    return name in COMMUTING or any(isinstance(arg, ast.Starred) for arg in node.args)


def _with(node: ast.expr, **fields: object) -> ast.expr:
    changed = copy.copy(node)
    for name, value in fields.items():
        setattr(changed, name, value)
    return changed


def find(faults: Sequence[Fault], stages: Sequence[str], store: Kept, workers: int) -> Iterator[Found]:
    """The tables, again and again as one stage after the other is run on every fault that none before noticed."""
    found: dict[Fault, str] = {}
    for stage in stages:
        left = [fault for fault in faults if fault not in found]
        cases = {fault.name: (fault, stage) for fault in left}
        for outcomes in run_cases(store, f"mutation {stage}", cases, work, workers):
            noticed = {fault: bool(outcomes[fault.name]["test"]) for fault in left if fault.name in outcomes}
            found |= {fault: stage if seen else "" for fault, seen in noticed.items() if seen or stage == stages[-1]}
            yield tabulate(found, len(faults), stages)


def work(case: tuple[Fault, str]) -> dict[str, Any]:
    """Run the tests of a stage on a copy of the sources with the fault, until one fails: `test`, None where none did.

    Raises `RuntimeError`: the test that fails does so without the fault as well.
    """
    fault, stage = case
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    failed = None
    with tempfile.TemporaryDirectory() as folder:
        sources = Path(folder) / "src"
        shutil.copytree(SOURCE, sources / "passerby", ignore=shutil.ignore_patterns("__pycache__"))
        path = sources / "passerby" / fault.path
        text = path.read_bytes()
        path.write_bytes(text[: fault.start] + fault.after.encode() + text[fault.end :])
        for number, (tests, marked) in enumerate(tests_of(fault, stage)):
            failed = failed or _first_failure(tests, marked, sources, Path(folder) / str(number))
        path.write_bytes(text)
        kind, _, test = (failed or "").partition(" ")
        if kind in FAILED and (_first_failure([test], "", sources, Path(folder) / "again") or "").startswith(FAILED):
            raise RuntimeError(f"{test} fails without the fault as well: {fault.name}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = round(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    print(f"{stage if failed else '':9}", cpu_s, "s", fault.name, "|", failed, flush=True, file=sys.stderr)
    folders = tuple(TESTED_BY.get(fault.room, [fault.room])) if stage != "elsewhere" else ()
    return {"test": failed, "folders": folders, "tests": tests_behind(failed, folders), "cpu_s": cpu_s}


class Answers(Kept):
    """What is finished and still holds with the tests as they are."""

    def get(self, what: str) -> dict[str, Any] | None:
        """The answer of `work` that is kept under a name, unless the tests that it rests on were changed."""
        answer = super().get(what)
        holds = answer is not None and answer["tests"] == tests_behind(answer["test"], tuple(answer["folders"]))
        return answer if holds else None


@cache
def tests_behind(test: str | None, folders: tuple[str, ...]) -> str:
    """A digest of the tests that an answer rests on: of the file of the test that failed, of all that ran where none did.

    Args:
        test: as pytest names it (`FAILED tests/a.py::test_b`); None, or an exit status, for no single test.
        folders: below `tests`, of those that ran; none: of all.
    """
    own = ROOT / (test or "").partition(" ")[2].partition("::")[0]
    ran = [path for folder in folders for path in (TESTS / folder).rglob("*.py")] if folders else TESTS.rglob("*.py")
    shared = [*TESTS.rglob("conftest.py"), *(TESTS / "support").rglob("*.py")]
    paths = {own, *TESTS.rglob("conftest.py")} if own.is_file() else {*ran, *shared}
    digest = hashlib.sha256()
    for path in sorted(paths):
        digest.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def tests_of(fault: Fault, stage: str) -> Iterator[tuple[list[str], str]]:
    """Folders or files of tests, and which marks of them, that a stage runs in turn: what is likely to fail first."""
    rooms = [f"tests/{room}" for room in TESTED_BY.get(fault.room, [fault.room])]
    within = tuple(f"{room}/" for room in rooms)
    files = naming(f"passerby.{fault.path.removesuffix('.py').replace('/', '.')}")
    own, others = [file for file in files if file.startswith(within)], [file for file in files if not file.startswith(within)]
    if stage == "slow":
        yield from (([room], "slow") for room in rooms)
    elif stage == "room":
        yield from (([file], "not slow") for file in own)
        yield from (([room, *(f"--ignore={file}" for file in own)], "not slow") for room in rooms)
    else:
        yield from (([file], "not slow") for file in others)
        yield ["tests"], "smoke"


def naming(module: str) -> list[str]:
    """The files of tests that import a module."""
    package, _, name = module.rpartition(".")
    named = re.compile(rf"\b({re.escape(module)}\b|from {re.escape(package)} import .*\b{name}\b)")
    files = [path for path in sorted(TESTS.rglob("test_*.py")) if named.search(path.read_text(encoding="utf-8"))]
    return [path.relative_to(ROOT).as_posix() for path in files]


def _first_failure(tests: list[str], marked: str, sources: Path, place: Path) -> str | None:
    command = [
        sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "--tb=no", "--no-header", "-m", marked,
        f"--basetemp={place}", *tests,
    ]  # fmt: skip
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, preexec_fn=limit,
        env=os.environ | {"PYTHONPATH": str(sources), "PYTHONDONTWRITEBYTECODE": "1"} | ONE_THREAD,
    )  # fmt: skip
    if done.returncode in (0, 5):  # 5: no test of that kind
        return None
    first = [line for line in done.stdout.splitlines() if line.startswith(FAILED)]
    return first[0].split(" - ")[0] if first else f"exit status {done.returncode}"


def limit() -> None:
    """In the process of the tests."""
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S))


def tabulate(found: Mapping[Fault, str], count: int, stages: Sequence[str]) -> Found:
    """How many faults each stage noticed, and those that none did.

    Args:
        found: the stage that noticed a fault, empty where none did; of those that are finished.
        count: faults drawn.
        stages: those that are run.
    """
    head = ("room", "faults", *(WHERE[stage] for stage in stages), "noticed", f"{GOAL_PERCENT} % or more")
    rows = []
    for room in (*sorted({fault.room for fault in found}), "all"):
        counts = Counter(stage for fault, stage in found.items() if room in (fault.room, "all"))
        n = counts.total()
        share = 100 * (n - counts[""]) / n if n else 0.0
        rows.append((room, str(n), *(str(counts[stage]) for stage in stages), f"{share:.1f} %", yes(share >= GOAL_PERCENT)))
    survivors = [(f"`{fault.path}:{fault.line}`", fault.kind, _code(fault.before), _code(fault.after))
                 for fault, stage in found.items() if not stage]  # fmt: skip
    tables = {"Rooms": table(head, rows), "Not noticed": table(("where", "kind", "before", "after"), survivors)}
    return Found(tables, run=f"{len(found)} of the {count} faults are finished")


def _code(text: str) -> str:
    """As a cell of a table."""
    escaped = text.replace("|", "\\|")
    return f"`{escaped}`"


if __name__ == "__main__":
    main()
