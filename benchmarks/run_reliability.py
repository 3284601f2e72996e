"""`make reliability`: how reliable Passerby is: `python benchmarks/run_reliability.py [--quick] [--only PART ...]`.

Prints the tables, and writes records and `docs/reliability.md` (a quick run: only with `-o FOLDER`). Finished cases are kept in
`build/reliability`: a run that was stopped continues. Parts whose records are whole and of the same code are run again only
where `--only` names them. `--only` alone runs none, and writes the page.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from pages.records import Output, publish, read_records
from pages.render import write_page
from reliability.page import PARTS, is_whole, part_codes
from reliability.runs import ROOT, Wanted

COMMAND = "make reliability"


def main() -> None:
    """Run the parts that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="a few cases of each kind; the tables are printed, not written")
    parser.add_argument(
        "--only", nargs="*", choices=PARTS, metavar="PART", help=f"of {', '.join(PARTS)}; none: write the page anew"
    )
    parser.add_argument("--workers", type=int, default=2, help="processes; 2")
    parser.add_argument("--data", type=Path, help="folder of the real data sets; ../shared/data where it is there")
    parser.add_argument("--kept", type=Path, default=ROOT / "build" / "reliability", help="folder of finished cases")
    parser.add_argument("-o", "--out", type=Path, help="folder of the page; docs")
    asked = parser.parse_args()
    beside = ROOT.parent / "shared" / "data"
    data = asked.data or (beside if beside.is_dir() else None)
    run_parts(asked.only, Wanted(asked.kept, asked.quick, asked.workers, data), asked.out)


def run_parts(names: Sequence[str] | None, wanted: Wanted, out: Path | None) -> None:
    """Run some parts, or those whose records are not of the code as it is; without any, write the page only."""
    output, codes = Output.of("reliability", out), part_codes()
    written = out is not None or not wanted.quick
    known = read_records(output.records, "reliability") if written else {}
    todo = [name for name in PARTS if name not in known or not is_whole(known[name], codes[name])]
    for name in todo if names is None else names:
        began = time.monotonic()
        module, _, run = PARTS[name].partition(".")
        found = getattr(importlib.import_module(f"reliability.{module}"), run)(wanted)
        publish("reliability", name, found, out, COMMAND, code=codes[name], quick=wanted.quick, written=written)
        if name == "verdict" and written:
            write_page("hostile", Output.of("hostile", out))
        print(f"{name}: {(time.monotonic() - began) / 60:.1f} min", file=sys.stderr, flush=True)
    if written:
        write_page("reliability", output)


if __name__ == "__main__":
    main()
