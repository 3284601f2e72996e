"""`python -m passerby.cli.ready`: a process that imports the modules of a calibration, and waits for its command line.

It takes one line of JSON on standard input, `{"arguments": [...], "output": FILE, "errors": FILE}`. Then it runs the program
with these arguments, and with its standard output and error in the files. If its input ends without a line, the process ends.
"""

from __future__ import annotations

import json
import os
import sys


def wait_for_command() -> None:
    """Import the modules, wait for a command and run it; the process ends with the exit status of the command."""
    from passerby.calibration import calibrate, calibration
    from passerby.cli import tables, terminal
    from passerby.cli.commands import record
    from passerby.cli.main import main
    from passerby.recording import scene_streams
    from passerby.report import page

    del calibrate, calibration, record, tables, terminal, scene_streams, page
    line = sys.stdin.buffer.readline()
    if not line.endswith(b"\n"):
        return
    asked = json.loads(line)
    for number, name in ((1, asked["output"]), (2, asked["errors"])):
        file = os.open(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666)
        os.dup2(file, number)
        os.close(file)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    sys.argv = ["passerby", *asked["arguments"]]
    main()


if __name__ == "__main__":
    wait_for_command()
