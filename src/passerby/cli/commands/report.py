"""`passerby report`: write the report page again from an output folder; `passerby open`: the local web page of a scene."""

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


def open_(
    opened: Annotated[
        Path,
        typer.Argument(
            metavar="PATH", help="Output folder of `passerby calibrate` or `passerby monitor`, scene file, or folder of videos."
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="Output folder; default: PATH, or the folder out beside the scene file.", show_default=False
        ),
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port on 127.0.0.1; 0: any free one.")] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Whether to open the page in your browser.")] = True,
) -> None:
    """Open a web page on this computer: calibrate, mark a length, set the world frame, by clicks instead of TOML.

    Everything that you say is written into the scene file. A folder of videos without a scene file gets one, as by
    `passerby init`. The folder of `passerby monitor` shows which cameras moved, and each one then and now. The page ends
    with Ctrl-C; a calibration that it has started goes on. Needs the extra `page`.
    """
    from importlib.util import find_spec

    from passerby.common.errors import InputError
    from passerby.page.server import find_opened, serve

    for needed in ("starlette", "uvicorn", "tomlkit"):
        if find_spec(needed) is None:
            raise InputError(f"the page needs {needed}: pip install 'passerby[page]'")
    found = find_opened(opened, out)
    print(found)
    serve(found, port, lambda address: print(f"open {address}", flush=True), browser=browser)
