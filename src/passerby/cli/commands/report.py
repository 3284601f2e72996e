"""`passerby report`: the page that tells whether a calibration is good, made again from its output folder."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer


def report(
    context: typer.Context,
    calibrated: Annotated[Path, typer.Argument(metavar="OUT", help="Output folder of `passerby calibrate`.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="HTML file to write; default: OUT/report.html.")] = None,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Print the stages.")] = False,
) -> None:
    """Write report.html again, also for a calibration that was refused or that an older Passerby wrote.

    Frames are taken from the videos that the scene file names, if they still exist.
    """
    from passerby.cli.terminal import stages
    from passerby.interchange.output_folder import REPORT_FILE
    from passerby.interchange.storage.atomic import forget_halves
    from passerby.interchange.storage.transaction import folder_lock
    from passerby.report.contents import contents_from
    from passerby.report.page import write_report

    path = calibrated / REPORT_FILE if out is None else out
    alone = folder_lock(calibrated, "passerby report") if out is None and calibrated.is_dir() else nullcontext()
    with stages(verbose or bool(context.obj)) as tell, alone:
        tell("reading")
        contents = contents_from(calibrated)
        if out is None:
            forget_halves(path)
        write_report(contents, path, tell)
    print(f"written to {path}")
