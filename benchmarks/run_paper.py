"""The published evaluation anew, as pages: `python benchmarks/run_paper.py [PART ...] [--list] [-o OUT]`."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Annotated

import typer

from passerby.cli.main import main

KEPT = ".kept"  # folder of finished conditions inside the output folder, until the command has ended
MUCH_WORK_BYTES = 10**8  # any part takes long enough for processes to pay


def benchmark(
    parts: Annotated[list[str] | None, typer.Argument(metavar="PART", help="Parts to run (see --list); all.")] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the pages and plots.")] = Path("benchmark"),
    quick: Annotated[bool, typer.Option(help="Few seeds and levels: to see that all works, not to judge.")] = False,
    seeds: Annotated[int | None, typer.Option(min=1, help="Seeds of each condition; as many as a part needs.")] = None,
    data: Annotated[Path | None, typer.Option(exists=True, file_okay=False, help="Folder of the real data sets.")] = None,
    scenes: Annotated[Path | None, typer.Option(help="Folder that keeps rendered videos for the next time.")] = None,
    list_parts: Annotated[bool, typer.Option("--list", help="Tell the parts, and end.")] = False,
) -> None:
    """Measure Passerby anew: its errors under noise, faults and scarcity, beside the paper's figures and other methods.

    Each part is a page of tables and plots. Pages that are finished stay when the command is stopped, and the same command goes
    on where it was. Needs the extra "evidence" of the package.
    """
    from pages.records import publish
    from paper.parts import PARTS, Wanted, chosen_parts
    from paper.plots import check_plots
    from passerby.cli.terminal import stages
    from passerby.common.parallel import open_local_processes
    from passerby.interchange.storage.atomic import make_folder

    if list_parts:
        width = max(map(len, PARTS))
        print("\n".join(f"{name.ljust(width)}  {part.says}" for name, part in PARTS.items()))
        return
    chosen = chosen_parts(parts or [])
    check_plots()
    make_folder(out)
    wanted = Wanted(quick, seeds, data, scenes, out / KEPT)
    with stages() as tell, open_local_processes(MUCH_WORK_BYTES, 0) as executor:
        for name, part in chosen.items():
            found = part.load()(wanted, executor, tell)
            publish(name, name, found, out, _command(name, wanted.quick, wanted.seeds, data is not None), quick=wanted.quick)
    shutil.rmtree(out / KEPT, ignore_errors=True)


def _command(name: str, quick: bool, seeds: int | None, with_data: bool) -> str:
    """What writes the same page again; the folder of the data is the reader's own."""
    options = [" --quick"] * quick + [f" --seeds {seeds}"] * (seeds is not None) + [" --data DATA"] * with_data
    return f"python benchmarks/run_paper.py {name}{''.join(options)}"


app = typer.Typer(
    add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)  # fmt: skip
app.command()(benchmark)

if __name__ == "__main__":
    main(app, "run_paper.py")
