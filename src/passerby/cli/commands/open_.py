"""`passerby open`: the local web page of a scene."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


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
