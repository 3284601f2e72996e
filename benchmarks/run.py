"""What needs peers, real data, training or rendering: `python benchmarks/run.py [--quick] [--only NAME ...] [-o FOLDER]`.

The rest is `python benchmarks/run_paper.py`. Prints the tables, and writes a record for each part and the pages. A quick run is
printed only, unless a folder is given. The record of a part that takes long is written after each case.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path

import accuracy
import association
import lenses_page
import local_page_page
import perception
import reid
import scale_page
import sites_page
import sources_page
import speed
from pages.kept import code_digest
from pages.parts import Asked, PartedPage
from pages.records import Found, publish
from peers import page as peers_page


def _run_formats(scratch: Path, quick: bool) -> Found:
    """Imported only where it is wanted: the others need none of it."""
    from formats import run

    return run(scratch, quick)


SINGLE: dict[str, Callable[[Path, bool], Found]] = {
    "speed": speed.run, "association": association.run, "accuracy": accuracy.run, "swaps-real": accuracy.run_swaps,
    "formats": _run_formats,
}  # fmt: skip
"""Pages of one part."""
PARTED: dict[str, tuple[str, PartedPage]] = {
    "lenses": ("lens", lenses_page.PAGE), "scale": ("scale", scale_page.PAGE), "sites": ("site", sites_page.PAGE),
    "sources": ("source", sources_page.page()), "page": ("page", local_page_page.PAGE), "peers": ("peer", peers_page.PUBLIC),
}  # fmt: skip
"""Pages of parts that are kept case by case, with the prefix of their options."""
NAMES = (
    "speed", "association", "accuracy", "swaps-real", "perception", "reid", "lenses", "scale", "sites", "sources", "page",
    "peers", "formats",
)  # fmt: skip
"""In the order of the runs: what is timed comes first, before the runs that fill both cores."""


def main() -> None:
    """Run the pages that are asked for."""
    asked = _parser().parse_args()
    for name in asked.only or NAMES:
        command = f"python benchmarks/run.py --only {name}{' --quick' if asked.quick else ''}"
        with tempfile.TemporaryDirectory(prefix="passerby-bench-") as scratch:
            run_page(name, asked, Path(scratch), command)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="few seeds and repeats; the tables are printed, not written")
    parser.add_argument("--only", nargs="+", choices=NAMES, metavar="NAME", help=f"pages: {', '.join(NAMES)}")
    parser.add_argument("-o", "--out", type=Path, help="folder for pages and records; docs/results and benchmarks/records")
    pixels = parser.add_argument_group("perception and reid")
    pixels.add_argument("--scenes", type=lambda name: Path(name).resolve(), help="folder that keeps rendered videos")
    pixels.add_argument("--seeds", type=int, default=3, help="seeds of each rendered scene; 3")
    for option, parts in (("--parts", perception.PARTS), ("--reid-parts", reid.PARTS)):
        pixels.add_argument(option, nargs="+", choices=parts, metavar="PART", default=(), help=f"of {', '.join(parts)}; all")
    for name, (prefix, page) in PARTED.items():
        group = parser.add_argument_group(name)
        parts = peers_page.PARTS if name == "peers" else tuple(page.parts)
        group.add_argument(
            f"--{prefix}-parts", nargs="+", choices=parts, metavar="PART", default=(), help=f"of {', '.join(parts)}; all"
        )
        group.add_argument(f"--{prefix}-seeds", type=int, help=f"seeds of each scene; {page.seeds}")
        group.add_argument(f"--{prefix}-kept", type=Path, help=f"folder of finished cases; {page.kept}")
        workers = 1 if name in ("sites", "page") else 2
        group.add_argument(f"--{prefix}-workers", type=int, default=workers, help=f"processes; {workers}")
    parser.add_argument(
        "--source-against", default=sources_page.watching.EARLIER, metavar="COMMIT",
        help="version that processing time is compared with; the last one before recordings in pieces",
    )  # fmt: skip
    parser.add_argument(
        "--source-seconds", type=float, default=sources_page.watching.SECONDS, metavar="SECONDS",
        help=f"length of the video of processing time; {sources_page.watching.SECONDS:g}",
    )  # fmt: skip
    return parser


def run_page(name: str, asked: argparse.Namespace, scratch: Path, command: str) -> None:
    """Run one page, or the parts of it that are asked for."""
    out, quick, written = asked.out, asked.quick, asked.out is not None or not asked.quick
    if name in SINGLE:
        found = SINGLE[name](scratch, quick)
        publish(name, name, found, out, command, code=code_digest(), quick=quick, written=written)
        return
    if name in ("perception", "reid"):
        module, parts = (perception, asked.parts) if name == "perception" else (reid, asked.reid_parts)
        module.run(scratch, asked.scenes, asked.seeds, parts, out, command, quick=quick, written=written)
        return
    prefix, page = PARTED[name]
    kept, parts, seeds, workers = (getattr(asked, f"{prefix}_{what}") for what in ("kept", "parts", "seeds", "workers"))
    wanted = Asked(kept, parts, seeds, workers, quick)
    if name == "peers":
        peers_page.run(wanted, scratch, out, command, written=written)
        return
    if name == "sources":
        seconds = min(asked.source_seconds, sources_page.QUICK_S) if quick else asked.source_seconds
        page = sources_page.page(seconds, asked.source_against)
    page.run(wanted, out, command, written=written)


if __name__ == "__main__":
    main()
