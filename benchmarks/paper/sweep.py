"""One condition at several levels: scenes x methods x levels x seeds, as tables and as plots of the errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from types import MappingProxyType

from pages.records import Found
from pages.tables import Table, table
from paper.conditions import Condition, Outcome, run_conditions
from paper.parts import Wanted
from paper.plots import HEAD, Axis, Line, Panel, error_plot, of, spread_cells
from passerby.common.progress import Progress
from passerby.simulation import PRESETS

QUICK_SEEDS = 2

Make = Callable[[str, str, float, int], Condition]  # the condition of a preset, a method, a level and a seed


@dataclass(frozen=True)
class Swept:
    """All outcomes."""

    presets: tuple[str, ...]
    methods: tuple[str, ...]
    levels: tuple[float, ...]
    seeds: int
    outcomes: Mapping[tuple[str, str, float], tuple[Outcome, ...]]  # (preset, method, level) -> outcome by seed

    def tables(self, axis: Axis) -> dict[str, Table]:
        """The spread of the errors by level and method, for each preset."""
        return {preset: self._table(preset, axis) for preset in self.presets}

    def _table(self, preset: str, axis: Axis) -> Table:
        rows = [
            [axis.text(level), method, *spread_cells(self.outcomes[preset, method, level])]
            for level in self.levels
            for method in self.methods
        ]
        return table((axis.head, "method", *HEAD), rows)

    def failures(self, axis: Axis) -> list[str]:
        """What the first failure of each condition with failures says, as one list."""
        lines = []
        for (preset, method, level), outcomes in self.outcomes.items():
            failed = [(seed, outcome) for seed, outcome in enumerate(outcomes) if outcome.failed]
            if failed:
                seed, first = failed[0]
                where = f"{preset}, {axis.text(level)}, {method}: {len(failed)} of {len(outcomes)}"
                what = f"{first.verdict}, {first.registered} of {first.cameras} cameras: {first.reason}"
                lines.append(f"- {where}; seed {seed}, {what}")
        return ["\n".join(lines)] if lines else []

    def panels(self, figure: str, names: Mapping[str, str] | None = None) -> list[Panel]:
        """A panel a preset, a line a method, of one figure of the outcomes."""
        return [
            Panel(
                preset,
                tuple(
                    Line(
                        (names or {}).get(method, method),
                        self.levels,
                        tuple(of(self.outcomes[preset, method, level], figure) for level in self.levels),
                    )
                    for method in self.methods
                ),
            )
            for preset in self.presets
        ]

    def plot(self, figure: str, axis: Axis, y_label: str) -> str:
        """`error_plot` of `panels`."""
        return error_plot(self.panels(figure), axis, y_label)


def curve_found(name: str, swept: Swept, axis: Axis, tables: Mapping[str, Table] = MappingProxyType({})) -> Found:
    """Some tables, those of all scenes, the failures, and plots of both errors, which begin with the page's name."""
    files = {
        f"{name}-similarity.svg": swept.plot("similarity_mm", axis, "similarity error, mm"),
        f"{name}-metric.svg": swept.plot("metric_mm", axis, "metric error, mm"),
    }
    return Found({**tables, **swept.tables(axis)}, swept.failures(axis), f"{swept.seeds} seeds", files)


def sweep(
    make: Make,
    presets: Sequence[str],
    methods: Sequence[str],
    levels: Sequence[float],
    seeds: int,
    wanted: Wanted,
    executor: Executor | None,
    tell: Progress,
    stage: str,
) -> Swept:
    """Work out every condition.

    Args:
        make: gives the conditions; those that are equal are worked out once.
        presets: scenes.
        methods: names that `make` understands.
        levels: of the condition, ascending.
        seeds: how many; what the user wants comes before, and a quick run takes `QUICK_SEEDS`.
        wanted: what the user asks for.
        executor: works on scenes side by side.
        tell: told of every scene that is done.
        stage: its name.
    """
    seeds = seeds_of(wanted, seeds)
    keys = [(preset, method, level) for preset in presets for method in methods for level in levels]
    conditions = {key: [make(*key, seed) for seed in range(seeds)] for key in keys}
    found = run_conditions([one for some in conditions.values() for one in some], executor, tell, stage, wanted.kept)
    outcomes = {key: tuple(found[condition] for condition in some) for key, some in conditions.items()}
    return Swept(tuple(presets), tuple(methods), tuple(levels), seeds, outcomes)


def seeds_of(wanted: Wanted, seeds: int) -> int:
    """How many seeds to take where the part itself takes `seeds`."""
    return wanted.seeds or (QUICK_SEEDS if wanted.quick else seeds)


def presets_of(wanted: Wanted) -> tuple[str, ...]:
    """All presets; the first, which is the quickest, in a quick run."""
    return tuple(PRESETS)[:1] if wanted.quick else tuple(PRESETS)
