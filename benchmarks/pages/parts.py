"""Pages of several parts: the cases of a part run in parallel, and its record is written after each finished case."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from pages.cases import Outcomes, run_cases
from pages.kept import Kept, code_digest
from pages.records import GOALS, Found, publish
from pages.tables import Table, load, table

GOAL_HEAD = ("case", "measured", "acceptable", "aim", "reached")

Result = TypeVar("Result")
Cases = Mapping[str, Any]
Tabulate = Callable[[Cases, Outcomes], Found]
"""Of all cases and the outcomes of the finished ones."""


@dataclass(frozen=True)
class Part:
    """A part of a page."""

    cases: Callable[[int], Cases]
    """By key, for a number of seeds or repetitions."""
    work: Callable[[Any], Mapping[str, Any]]
    """Runs one case."""
    tabulate: Tabulate
    alone: bool = False
    """Whether cases run one after the other, because their time counts."""
    seeds: int | None = None
    """Instead of the page's number."""


@dataclass(frozen=True)
class Asked:
    """What the user asks of a page."""

    kept: Path | None = None
    """The folder of finished cases; the page's own unless given."""
    parts: Sequence[str] = ()
    """All unless given."""
    seeds: int | None = None
    workers: int = 2
    quick: bool = False


@dataclass(frozen=True)
class PartedPage:
    """A page, its parts in their order, and what their outcomes depend on."""

    name: str
    parts: Mapping[str, Part]
    code: Sequence[str]
    """Folders of the benchmarks that the outcomes depend on, besides the package."""
    kept: Path
    seeds: int
    quick_seeds: int = 1

    def find(self, name: str, asked: Asked) -> Iterator[Found]:
        """A part after each finished case."""
        part = self.parts[name]
        count = self.quick_seeds if asked.quick else asked.seeds or part.seeds or self.seeds
        cases = part.cases(count)
        store = Kept(asked.kept or self.kept, self.code)
        for done in run_cases(store, name, cases, part.work, 1 if part.alone else asked.workers):
            yield part.tabulate(cases, done)

    def run(self, asked: Asked, out: Path | None, command: str, *, written: bool = True) -> None:
        """Run the parts that are asked for, and write their records and the page."""
        digest = code_digest(*self.code)
        for name in asked.parts or self.parts:
            found = self.find(name, asked)
            publish(self.name, name, found, out, command, code=digest, quick=asked.quick, written=written)


def found_of(
    cases: Cases, done: Outcomes, tables: Mapping[str, Table], goals: Sequence[Sequence[str]] = (), notes: Sequence[str] = ()
) -> Found:
    """A part with the number of finished cases, their processor time, and the rows of its goals."""
    run = f"{len(done)} of {len(cases)} cases"
    if done and all("cpu_s" in case for case in done.values()):
        run += f"; {sum(case['cpu_s'] for case in done.values()) / 60:.1f} minutes of processor time"
    return Found({**tables, **({GOALS: table(GOAL_HEAD, goals)} if goals else {})}, [note for note in notes if note], run)


def time_part(found: Iterable[Found]) -> Iterator[Found]:
    """A part again and again, with the minutes that it has taken and the load of the machine."""
    began = time.perf_counter()
    for one in found:
        minutes = (time.perf_counter() - began) / 60
        yield replace(one, run=f"{minutes:.1f} minutes; mean load at the end {load():.1f}")


def run_two(jobs: Sequence[Callable[[], Result]]) -> list[Result]:
    """Run jobs two at a time; each runs its programs in processes of its own."""
    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(lambda job: job(), jobs))
