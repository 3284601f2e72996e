"""Runs of `passerby` on a machine that fails: killed, or out of disk, at the k-th time that a file or a folder is changed.

The run is a process of its own. What it does to files below a folder is counted: creating, renaming and deleting files and
folders, and every fsync. At the k-th the process is killed, or the disk is full from then on.
"""

from __future__ import annotations

import errno
import io
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from passerby.calibration.kept_tracklets import FOLDER
from passerby.scene.video_inputs import KEPT_FOLDER

Fault = Literal["none", "kill", "full"]
CHANGING = ("os.rename", "os.mkdir", "os.remove", "os.rmdir")
FREEING = ("os.remove", "os.rmdir")
"""What a full disk does not stop."""
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT
SEGMENT = 16
"""Pictures kept at once in these runs, so that short videos have several segments."""
KEPT = (KEPT_FOLDER, FOLDER)
"""Folders of the output folder that only save time."""
PRELOADED = [
    "passerby.cli.main",
    "passerby.calibration.calibrate",
    "passerby.cli.tables",
    "passerby.simulation",
    "passerby.calibration.alignment.folder",
    "passerby.report.page",
    "passerby.perception.background",
    "passerby.scene.start.start",
]


@dataclass(frozen=True)
class Ended:
    """How a run ended."""

    status: int | None
    """None: it was killed."""
    errors: str = ""
    """What it wrote to standard error."""
    events: int = 0
    """So many times it changed a file or a folder."""

    @property
    def told(self) -> bool:
        """Whether it ended as it should on a machine that fails: with a line of its own, and no trace of a bug."""
        return self.status in (0, 2, 3) and "Traceback" not in self.errors


@dataclass(eq=False)
class _Failing:
    """Counts what happens to the files below a folder, and lets it fail."""

    root: str
    fault: Fault
    at: int
    events: int = 0

    def happens(self, freeing: bool = False) -> None:
        """Something is about to change."""
        self.events += 1
        if self.fault == "kill" and self.events == self.at:
            os.kill(os.getpid(), signal.SIGKILL)
        if self.fault == "full" and self.events >= self.at and not freeing:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def audit(self, event: str, arguments: tuple[Any, ...]) -> None:
        """Told by Python of all that it does."""
        if event != "open" and event not in CHANGING:
            return
        path = arguments[0]
        if not isinstance(path, str | os.PathLike) or not os.path.abspath(path).startswith(self.root):
            return
        if event != "open" or (isinstance(arguments[2], int) and arguments[2] & WRITING):
            self.happens(event in FREEING)

    def before(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, which may fail."""

        def told(*arguments: Any, **named: Any) -> Any:
            self.happens()
            return function(*arguments, **named)

        return told


def _run(arguments: Sequence[str], root: str, fault: Fault, at: int, channel: Any) -> None:
    """In the new process."""
    from passerby.cli.main import run
    from passerby.common import parallel
    from passerby.perception import watching

    # One process, so that what happens is counted in one place.
    parallel.pays = lambda *measures: False
    watching.SEGMENT = SEGMENT
    sys.stdout, sys.stderr = io.StringIO(), io.StringIO()
    failing = _Failing(root, fault, at)
    sys.addaudithook(failing.audit)
    os.fsync = failing.before(os.fsync)
    status = run(arguments)
    channel.send((status, sys.stderr.getvalue(), failing.events))
    channel.close()
    os._exit(0)


def passerby(arguments: Sequence[str | Path], root: Path, fault: Fault = "none", at: int = 0) -> Ended:
    """Run a command line in a process of its own.

    Args:
        arguments: of `passerby`.
        root: the folder below which things fail.
        fault: what fails.
        at: at which change of a file or a folder, from 1 on.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(PRELOADED)
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=_run, args=([*map(str, arguments)], os.path.abspath(root), fault, at, there))
    process.start()
    there.close()
    try:
        ended = Ended(*here.recv())
    except EOFError:
        ended = Ended(None)
    process.join()
    return ended


def tree(folder: Path) -> dict[str, bytes]:
    """All files below a folder by name, but for what is kept for the next run: of videos, and tracklets."""
    files = ((path.relative_to(folder), path) for path in sorted(folder.rglob("*")) if path.is_file())
    return {name.as_posix(): path.read_bytes() for name, path in files if name.parts[0] not in KEPT}
