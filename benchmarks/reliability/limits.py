"""Where limits of the verdict come from: `python benchmarks/reliability/limits.py [--only PART ...] [--seeds N] [-o OUT]`.

Simulated scenes and rendered films, ordinary ones and such with a fault. No real data, and seeds that no page of results uses.
Finished cases are kept in `build/limits`: a run that was stopped goes on. Parts that are not run keep their records.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType, ModuleType

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))


from datasets import ROOT
from pages.cases import run_cases
from pages.kept import Kept, code_behind, code_digest
from pages.records import Found, publish
from reliability import (
    clock_figures,
    effect_figures,
    joint_figures,
    lens_figures,
    move_figures,
    prediction_figures,
    refined_figures,
    stature_figures,
    unusual_figures,
    verdict_figures,
)

KEPT = ROOT / "build" / "limits"
SEEDS = 4
PARTS: Mapping[str, ModuleType] = MappingProxyType({
    "prediction": prediction_figures,
    "moves": move_figures,
    "clocks": clock_figures,
    "lenses": lens_figures,
    "refined": refined_figures,
    "statures": stature_figures,
    "unusual": unusual_figures,
    "joints": joint_figures,
    "effects": effect_figures,
    "figures": verdict_figures,
})  # fmt: skip
"""Each has cases by key for so many seeds, measures one, and tabulates their outcomes."""
COMMAND = "python benchmarks/reliability/limits.py"


def main() -> None:
    """Run the parts that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--only", nargs="*", choices=PARTS, metavar="PART", help=f"of {', '.join(PARTS)}; all")
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("-o", "--out", type=Path, default=None, help="folder of the page; it is printed where none is given")
    asked = parser.parse_args()
    for name in PARTS if asked.only is None else asked.only:
        digest = code_digest(*code_behind(PARTS[name].__name__))
        publish("limits", name, find(name, asked.seeds), asked.out, COMMAND, code=digest, written=asked.out is not None)


def find(name: str, seeds: int) -> Iterator[Found]:
    """What a part found, as it grows."""
    figures = PARTS[name]
    cases = figures.cases(seeds)
    for done in run_cases(Kept(KEPT, code_behind(figures.__name__)), name, cases, figures.measure, 2):
        yield figures.tabulate(done, cases)


if __name__ == "__main__":
    main()
