"""The published evaluation anew, as pages: `python benchmarks/run_paper.py [PART ...] [--list] [-o OUT]`."""

from __future__ import annotations

import typer

from paper.command import benchmark
from passerby.cli.main import main

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command()(benchmark)

if __name__ == "__main__":
    main(app, "run_paper.py")
