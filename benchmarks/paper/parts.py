"""The parts of the benchmark by name; a part's module is imported when it is run."""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Protocol

from pages.records import Found
from passerby.common.errors import InputError
from passerby.common.progress import Progress


@dataclass(frozen=True)
class Wanted:
    """What the user asks of the parts of the benchmark."""

    quick: bool = False  # few seeds and few levels: to see that all works, not to judge
    seeds: int | None = None  # seeds of each condition; None: as many as the part takes for its claims
    data: Path | None = None  # folder of the real data sets; None where there is none
    scenes: Path | None = None  # folder that keeps rendered videos for the next time; None: they are rendered anew
    kept: Path | None = None
    """Folder in which finished conditions are kept while the command runs, so that a stopped one goes on; None: nowhere."""


class Run(Protocol):
    """Measures a part of the benchmark."""

    def __call__(self, wanted: Wanted, executor: Executor | None, tell: Progress) -> Found:
        """What the user wants; None for the executor: one thing after the other."""


@dataclass(frozen=True)
class Part:
    """One page of the benchmark."""

    module: str  # module of `paper` whose `run` it is
    says: str  # one line for `python benchmarks/run_paper.py --list`

    curve: str = ""  # of `paper.curves`

    def load(self) -> Run:
        """The function that measures it."""
        run = importlib.import_module(f"paper.{self.module}").run
        return partial(run, self.curve) if self.curve else run


PARTS: Mapping[str, Part] = MappingProxyType(
    {
        "paper": Part("pixels", "Tables 1 and 2 of the paper: picture matchers, annotations, boxes and people, from pixels"),
        "simulated": Part("simulated", "the simulated scenes without faults, against the goals"),
        "noise": Part("noise", "Table 3 of the paper: errors under uniform noise of the boxes' corners"),
        "correspondences": Part(
            "curves", "errors against the number of correspondences of two cameras, 5 to 500", "correspondences"
        ),
        "swaps": Part("curves", "errors when 0 to 50 % of the identities are exchanged", "swaps"),
        "missing": Part("curves", "errors when 0 to 80 % of the boxes are missing", "missing"),
        "clocks": Part("curves", "errors when the cameras' clocks differ by 0 to 1 s", "clocks"),
        "cameras": Part("curves", "errors with 2 to 8 cameras", "cameras"),
        "people": Part("curves", "errors with 1 to 20 people", "people"),
        "seconds": Part("curves", "errors with 10 to 80 s", "seconds"),
        "tracking": Part("tracking", "people's ways over the ground, by estimated and by true cameras"),
    }
)
"""In the order in which they are run."""


def chosen_parts(names: Sequence[str]) -> dict[str, Part]:
    """The named parts in the order given, each once; all of them where none is named. Raises `InputError` for another name."""
    for name in names:
        if name not in PARTS:
            close = difflib.get_close_matches(name, PARTS, n=1, cutoff=0.5)
            mend = f"did you mean '{close[0]}'?" if close else f"choose of {', '.join(PARTS)}"
            raise InputError(f"part '{name}' of the benchmark does not exist: {mend}")
    return {name: PARTS[name] for name in names or PARTS}
