"""The parts of `docs/reliability.md`, and the table of goals over all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from pages.kept import code_behind, code_digest
from pages.records import GOALS, Found, Record
from pages.tables import Table, table, yes

PARTS: Mapping[str, str] = MappingProxyType({
    "coverage": "coverage.run",
    "keypoints": "other_inputs.run_keypoints",
    "found": "other_inputs.run_found",
    "freed": "other_inputs.run_freed",
    "videos": "other_inputs.run_videos",
    "bound": "bound.run",
    "verdict": "battery.run",
    "lenses": "lenses.run",
    "monitor": "watch.run",
    "fuzz": "fuzz.run",
    "faults": "faults.run",
    "branches": "branches.run",
})  # fmt: skip
"""Part, as `--only` takes it -> module of `reliability`, and its function that runs the part."""


@dataclass(frozen=True)
class Line:
    """One line of the table over all parts."""

    what: str
    seen: str
    goal: str
    reached: bool


def part_found(lines: Sequence[Line], tables: Mapping[str, Table], notes: Sequence[str] = (), run: str = "") -> Found:
    """What a part found, with its lines of the table over all parts."""
    goals = table(("what", "seen", "goal", "reached"), [(one.what, one.seen, one.goal, yes(one.reached)) for one in lines])
    return Found({**tables, GOALS: goals}, notes, run)


def part_codes() -> dict[str, str]:
    """Part -> digest of the code that its figures depend on: the package, and what measures the part."""
    return {part: code_digest(*code_behind(f"reliability.{run.partition('.')[0]}")) for part, run in PARTS.items()}


def is_whole(record: Record, code: str) -> bool:
    """Whether a part was run with all its cases, on code of this digest."""
    return record.code == code and not record.quick
