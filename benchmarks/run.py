"""What needs peers, real data, training or rendering: `python benchmarks/run.py [--quick] [--only NAME ...] [-o FOLDER]`.

The rest is `python benchmarks/run_paper.py`. Prints the tables and writes them as Markdown, one file a section. A quick run is
printed only, unless a folder is given. A section that takes long is written as it grows.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterable
from functools import partial
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
import swaps
from datasets import ROOT
from pages.page import Page, publish
from pages.parts import Wanted
from pages.sections import sections_on
from peers import page as peers_page


def _formats(scratch: Path, quick: bool) -> Page:
    """Imported only where it is wanted: the others need none of it."""
    from formats import run

    return run(scratch, quick)


# What is timed comes first, before the runs that fill both cores.
SECTIONS: dict[str, Callable[[Path, bool], Page | Iterable[Page]]] = {
    "speed": speed.run,
    "association": association.run,
    "accuracy": accuracy.run,
    "swaps-real": swaps.run,
    "perception": perception.run,
    "reid": reid.run,
    "lenses": lenses_page.run,
    "scale": scale_page.run,
    "sites": sites_page.run,
    "sources": sources_page.run,
    "page": local_page_page.run,
    "peers": peers_page.run,
    "formats": _formats,
}
RESULTS = ROOT / "docs" / "results"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="few seeds and repeats; the tables are printed, not written")
    parser.add_argument("--only", nargs="+", choices=SECTIONS, metavar="NAME", help=f"sections: {', '.join(SECTIONS)}")
    parser.add_argument("-o", "--out", type=Path, help="folder for the tables; docs/results")
    pixels = parser.add_argument_group("perception and reid")
    pixels.add_argument("--scenes", type=lambda name: Path(name).resolve(), help="folder that keeps rendered videos")
    pixels.add_argument("--seeds", type=int, default=3, help="seeds of each rendered scene; 3")
    pixels.add_argument(
        "--parts",
        nargs="+",
        choices=perception.PARTS,
        metavar="PART",
        default=(),
        help=f"parts of perception to run: {', '.join(perception.PARTS)}; all. The others stay as they are on the page",
    )
    pixels.add_argument(
        "--reid-parts", nargs="+", choices=reid.PARTS, metavar="PART", default=(), help=f"of reid: {', '.join(reid.PARTS)}; all"
    )
    estimated = parser.add_argument_group("lenses")
    estimated.add_argument(
        "--lens-parts",
        nargs="+",
        choices=lenses_page.HEADINGS,
        metavar="PART",
        default=(),
        help=f"of lenses: {', '.join(lenses_page.HEADINGS)}; all",
    )
    estimated.add_argument(
        "--lens-seeds", type=int, default=lenses_page.SEEDS, help=f"seeds of each simulated scene; {lenses_page.SEEDS}"
    )
    estimated.add_argument("--lens-kept", type=Path, default=lenses_page.KEPT, help="folder of finished cases; build/lenses")
    estimated.add_argument("--lens-workers", type=int, default=2, help="processes; 2")
    known = parser.add_argument_group("scale")
    known.add_argument(
        "--scale-parts", nargs="+", choices=scale_page.HEADINGS, metavar="PART", default=(),
        help=f"of scale: {', '.join(scale_page.HEADINGS)}; all",
    )  # fmt: skip
    known.add_argument("--scale-seeds", type=int, default=scale_page.SEEDS, help=f"seeds of each scene; {scale_page.SEEDS}")
    known.add_argument("--scale-kept", type=Path, default=scale_page.KEPT, help="folder of finished cases; build/scale")
    known.add_argument("--scale-workers", type=int, default=2, help="processes; 2")
    many = parser.add_argument_group("sites")
    many.add_argument(
        "--site-parts", nargs="+", choices=tuple(sites_page.PARTS), metavar="PART", default=tuple(sites_page.PARTS),
        help=f"of sites: {', '.join(sites_page.PARTS)}; all",
    )  # fmt: skip
    many.add_argument("--site-seeds", type=int, default=sites_page.SEEDS, help=f"seeds; {sites_page.SEEDS}")
    many.add_argument("--site-kept", type=Path, default=sites_page.KEPT, help="folder of finished cases; build/sites")
    many.add_argument("--site-workers", type=int, default=1, help="processes; 1: the parts use all cores")
    given = parser.add_argument_group("sources")
    given.add_argument(
        "--source-parts", nargs="+", choices=sources_page.HEADINGS, metavar="PART", default=(),
        help=f"of sources: {', '.join(sources_page.HEADINGS)}; all",
    )  # fmt: skip
    given.add_argument("--source-seeds", type=int, default=sources_page.SEEDS, help=f"seeds; {sources_page.SEEDS}")
    given.add_argument("--source-kept", type=Path, default=sources_page.KEPT, help="folder of finished cases; build/sources")
    given.add_argument("--source-workers", type=int, default=2, help="processes; 2")
    given.add_argument(
        "--source-against",
        default=sources_page.Asked.against,
        metavar="COMMIT",
        help="version that processing time is compared with; the last one before recordings in pieces",
    )
    given.add_argument(
        "--source-seconds", type=float, default=sources_page.Asked.watched_s, metavar="SECONDS",
        help=f"length of the video of processing time; {sources_page.Asked.watched_s:g}",
    )  # fmt: skip
    opened = parser.add_argument_group("page")
    opened.add_argument(
        "--page-parts", nargs="+", choices=local_page_page.HEADINGS, metavar="PART", default=(),
        help=f"of page: {', '.join(local_page_page.HEADINGS)}; all",
    )  # fmt: skip
    opened.add_argument(
        "--page-kept", type=Path, default=local_page_page.KEPT, help="folder of finished cases; build/page/kept"
    )
    beside = parser.add_argument_group("peers")
    beside.add_argument(
        "--peer-parts", nargs="+", choices=peers_page.HEADINGS, metavar="PART", default=(),
        help=f"of peers: {', '.join(peers_page.HEADINGS)}; all",
    )  # fmt: skip
    beside.add_argument("--peer-kept", type=Path, default=peers_page.KEPT, help="folder of finished cases; build/peers")
    beside.add_argument("--peer-workers", type=int, default=2, help="processes; 2")
    arguments = parser.parse_args()
    out = arguments.out or (None if arguments.quick else RESULTS)
    earlier = {
        name: sections_on(None if out is None else out / f"{name}.md")
        for name in ("perception", "reid", "lenses", "scale", "sites", "sources", "page", "peers")
    }
    wanted = perception.Wanted(arguments.scenes, arguments.seeds, arguments.parts, earlier["perception"])
    sections = SECTIONS | {
        "perception": partial(perception.run, wanted=wanted),
        "reid": partial(
            reid.run,
            scenes=arguments.scenes,
            seeds=arguments.seeds,
            only=arguments.reid_parts,
            earlier=earlier["reid"],
        ),
        "lenses": partial(
            lenses_page.run,
            wanted=Wanted(
                arguments.lens_kept, arguments.lens_parts, arguments.lens_seeds, arguments.lens_workers, earlier["lenses"]
            ),
        ),
        "scale": partial(
            scale_page.run,
            wanted=Wanted(
                arguments.scale_kept, arguments.scale_parts, arguments.scale_seeds, arguments.scale_workers, earlier["scale"]
            ),
        ),
        "sites": partial(
            sites_page.run,
            wanted=Wanted(
                arguments.site_kept, arguments.site_parts, arguments.site_seeds, arguments.site_workers, earlier["sites"]
            ),
        ),
        "sources": partial(
            sources_page.run,
            wanted=Wanted(
                arguments.source_kept,
                arguments.source_parts,
                arguments.source_seeds,
                arguments.source_workers,
                earlier["sources"],
            ),
            asked=sources_page.Asked(arguments.source_seeds, arguments.source_seconds, arguments.source_against),
        ),
        "peers": partial(
            peers_page.run,
            wanted=Wanted(arguments.peer_kept, arguments.peer_parts, workers=arguments.peer_workers, earlier=earlier["peers"]),
        ),
        "page": partial(
            local_page_page.run,
            wanted=Wanted(arguments.page_kept, arguments.page_parts, workers=1, earlier=earlier["page"]),
        ),
    }
    for name in arguments.only or SECTIONS:
        with tempfile.TemporaryDirectory(prefix="passerby-bench-") as scratch:
            command = f"python benchmarks/run.py --only {name}{' --quick' if arguments.quick else ''}"
            publish(sections[name](Path(scratch), arguments.quick), out, command)


if __name__ == "__main__":
    main()
