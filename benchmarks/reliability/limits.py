"""Where limits of the verdict come from: `python benchmarks/reliability/limits.py [--only PART ...] [--seeds N] [-o OUT]`.

Simulated scenes and rendered films, ordinary ones and such with a fault. No real data, and seeds that no page of results uses.
Finished cases are kept in `build/limits`: a run that was stopped goes on. Parts that are not run stay on the page as they are.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType, ModuleType

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from datasets import ROOT
from pages.cases import run_cases
from pages.commit import commit
from pages.kept import Kept, code_behind, code_digest
from pages.page import publish
from pages.sections import Found, Heading, Section, SectionedPage, sections_on
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
"""Each has cases by key for so many seeds, measures one, and makes a section of the page of their outcomes."""
HEADINGS: Mapping[str, Heading] = {
    "prediction": Heading("Predicted people"),
    "moves": Heading("Cameras that move or zoom"),
    "clocks": Heading("Clocks that drift"),
    "lenses": Heading("Stated lenses that are wrong"),
    "refined": Heading("Refined lenses"),
    "statures": Heading("How tall people are, and look"),
    "unusual": Heading("Unusual people"),
    "joints": Heading("Joints of little confidence"),
    "effects": Heading("Errors that last"),
    "figures": Heading("Figures of the verdict"),
}


def main() -> None:
    """Run the parts that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--only", nargs="*", choices=PARTS, metavar="PART", help=f"of {', '.join(PARTS)}; all")
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("-o", "--out", type=Path, default=None, help="folder of the page; it is printed where none is given")
    arguments = parser.parse_args()
    earlier = sections_on(None if arguments.out is None else arguments.out / "limits.md")
    names = PARTS if arguments.only is None else arguments.only
    page = limits_page()
    publish(page.grow({name: partial(_run, name, arguments.seeds) for name in names}, earlier), arguments.out, COMMAND)


COMMAND = "python benchmarks/reliability/limits.py"


def limits_page() -> SectionedPage:
    """The page of all parts. What took time may have been kept from an earlier run."""
    codes = {part: code_digest(*_behind(module)) for part, module in PARTS.items()}
    return SectionedPage("limits", _head, HEADINGS, codes, timed=False)


def _behind(module: ModuleType) -> tuple[str, ...]:
    """The files that a part's figures rest on, beside the package."""
    return code_behind(module.__name__)


def _run(name: str, seeds: int) -> Iterator[Found]:
    """What a part found, as it grows."""
    figures = PARTS[name]
    wanted, of = figures.cases(seeds), commit()
    for done in run_cases(Kept(KEPT, _behind(figures)), name, wanted, figures.measure, 2):
        yield Found(f"Code of commit {of}.\n\n{figures.section(done, wanted)}")


def _head(_: Sequence[Section]) -> str:
    return """# Limits of the verdict

Each from simulated scenes and rendered films alone, on seeds that no other page uses; each part on the commit that it names."""


if __name__ == "__main__":
    main()
