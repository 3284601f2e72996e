"""Every figure that Passerby states, measured: `python benchmarks/run.py [--quick] [--only NAME ...] [-o FOLDER]`.

Prints the tables and writes them as Markdown, one file a section. A quick run is printed only, unless a folder is given.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import accuracy
import simulated
import speed
import swaps
from datasets import ROOT
from tables import Section, machine_note

import association

# What is timed comes first, before the runs that fill both cores.
SECTIONS = {
    "speed": speed.run,
    "association": association.run,
    "accuracy": accuracy.run,
    "simulated": simulated.run,
    "swaps": swaps.run,
}
RESULTS = ROOT / "docs" / "results"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="few seeds and repeats; the tables are printed, not written")
    parser.add_argument("--only", nargs="+", choices=SECTIONS, metavar="NAME", help=f"sections: {', '.join(SECTIONS)}")
    parser.add_argument("-o", "--out", type=Path, help="folder for the tables; docs/results")
    arguments = parser.parse_args()
    out = arguments.out or (None if arguments.quick else RESULTS)
    for name in arguments.only or SECTIONS:
        with tempfile.TemporaryDirectory(prefix="passerby-bench-") as scratch:
            section = SECTIONS[name](Path(scratch), arguments.quick)
        _publish(section, out, arguments.quick)


def _publish(section: Section, out: Path | None, quick: bool) -> None:
    command = f"python benchmarks/run.py --only {section.name}{' --quick' if quick else ''}"
    text = f"{section.text}\nWritten by `{command}` on: {machine_note()}\n"
    print(text, flush=True)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        (out / f"{section.name}.md").write_text(text)


if __name__ == "__main__":
    main()
