"""`make reliability`: how honest Passerby is, measured: `python benchmarks/run_reliability.py [--quick] [--only PART ...]`.

Prints the table, and writes `docs/reliability.md` (a quick run: only with `-o FOLDER`). Finished cases are kept in
`build/reliability`: a run that was stopped goes on. Parts that are not run stay on the page as they are there; those that
stand there whole, of the same code, are run again only where `--only` names them. `--only` alone runs none: the head of the
page then says which are of the code as it is.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from pages.page import publish
from pages.sections import Found, sections_on
from reliability.page import PARTS, is_whole, reliability_page
from reliability.runs import ROOT, Wanted

COMMAND = "make reliability"


def main() -> None:
    """Run the parts that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="a few cases of each kind; the table is printed, not written")
    parser.add_argument(
        "--only", nargs="*", choices=PARTS, metavar="PART", help=f"of {', '.join(PARTS)}; none: write the page anew"
    )
    parser.add_argument("--workers", type=int, default=2, help="processes; 2")
    parser.add_argument("--data", type=Path, help="folder of the real data sets; ../shared/data where it is there")
    parser.add_argument("--kept", type=Path, default=ROOT / "build" / "reliability", help="folder of finished cases")
    parser.add_argument("-o", "--out", type=Path, help="folder of the page; docs")
    arguments = parser.parse_args()
    beside = ROOT.parent / "shared" / "data"
    data = arguments.data or (beside if beside.is_dir() else None)
    wanted = Wanted(arguments.kept, arguments.quick, arguments.workers, data)
    out = arguments.out or (None if arguments.quick else ROOT / "docs")
    earlier = sections_on(None if out is None else out / "reliability.md")
    todo = [name for name in PARTS if name not in earlier or not is_whole(earlier[name])]
    names = todo if arguments.only is None else arguments.only
    publish(reliability_page().grow({name: partial(_run, name, wanted) for name in names}, earlier), out, COMMAND)


def _run(name: str, wanted: Wanted) -> Iterator[Found]:
    """What a part found, when it is whole."""
    began = time.monotonic()
    module, _, run = PARTS[name].partition(".")
    yield getattr(importlib.import_module(f"reliability.{module}"), run)(wanted)
    print(f"{name}: {(time.monotonic() - began) / 60:.1f} min", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
