"""Runs of `passerby calibrate` in a process of their own that end at a moment of one's choice."""

from __future__ import annotations

import io
import multiprocessing
import os
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

SEGMENT = 16
"""Pictures kept at once in these runs, so that short videos have several segments."""

Moment = tuple[str, int]
"""What happens, and at which time that it happens: ("detection", 40)."""


@dataclass
class Fate:
    """Counts what happens, and ends the process when the moment has come; or makes a file, and waits until that is gone."""

    moment: Moment | None = None
    sign: int = signal.SIGKILL
    gate: Path | None = None
    seen: Counter[str] = field(default_factory=Counter)

    def __call__(self, event: str) -> None:
        self.seen[event] += 1
        if self.moment != (event, self.seen[event]):
            return
        if self.gate is None:
            os.kill(os.getpid(), self.sign)
            return
        self.gate.touch()
        while self.gate.exists():
            time.sleep(0.02)

    def before(self, event: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def told(*arguments: Any, **named: Any) -> Any:
            self(event)
            return function(*arguments, **named)

        return told

    def while_reading(self, event: str, iterate: Callable[..., Iterator[Any]]) -> Callable[..., Iterator[Any]]:
        def told(reader: Any) -> Iterator[Any]:
            for item in iterate(reader):
                self(event)
                yield item

        return told


def _watch_over(fate: Fate) -> None:
    """Let the fate know what happens in this process."""
    from passerby.calibration import writing
    from passerby.cli import terminal
    from passerby.common import parallel
    from passerby.interchange.storage import atomic
    from passerby.perception import opening, watching
    from passerby.perception.background import BackgroundDetector
    from passerby.perception.reid import StripesEmbedder
    from passerby.perception.video import VideoReader

    parallel.pays = lambda *measures: False
    watching.SEGMENT = SEGMENT
    # All that is decoded: pictures that the background is learnt from, then those that are looked at.
    VideoReader.__iter__ = fate.while_reading("picture", VideoReader.__iter__)
    BackgroundDetector.__call__ = fate.before("detection", BackgroundDetector.__call__)
    StripesEmbedder.__call__ = fate.before("embedding", StripesEmbedder.__call__)
    opening.learn_background = fate.before("background", opening.learn_background)
    # In the middle of a file, behind it, and between those of the result.
    atomic.os = _Os(fate)
    writing.write_rig = fate.before("rig", writing.write_rig)
    writing.write_boxes = fate.before("tracks", writing.write_boxes)
    terminal._Log = lambda: lambda stage, done=0, total=0, *, part="": fate(stage) if not part else None


class _Os:
    """The module `os`, but a fate is told when files are written."""

    def __init__(self, fate: Fate) -> None:
        self.fsync, self.replace = fate.before("file", os.fsync), fate.before("name", os.replace)

    def __getattr__(self, name: str) -> Any:
        return getattr(os, name)


def _run(scene: Path, out: Path, fate: Fate, channel: Any) -> None:
    """In the new process."""
    _watch_over(fate)
    from passerby.cli.main import run

    sys.stdout, sys.stderr = io.StringIO(), io.StringIO()
    status = run(["calibrate", str(scene), "-o", str(out)])
    channel.send((status, sys.stderr.getvalue(), fate.seen))
    channel.close()
    os._exit(0)


@dataclass
class Ended:
    """How a run ended."""

    killed: bool
    status: int | None = None
    errors: str = ""
    seen: Counter[str] = field(default_factory=Counter)


def calibrate(
    scene: Path, out: Path, moment: Moment | None = None, sign: int = signal.SIGKILL, gate: Path | None = None
) -> Ended:
    """Calibrate in a process of its own until the moment comes, or to the end; with a gate to the end, but through the gate."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(
        ["passerby.calibration.calibrate", "passerby.cli.main", "passerby.perception.background", "passerby.cli.tables"]
    )
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=_run, args=(scene, out, Fate(moment, sign, gate), there))
    process.start()
    there.close()
    try:
        ended = Ended(False, *here.recv())
    except EOFError:
        ended = Ended(True)
    process.join()
    assert process.exitcode == (-sign if ended.killed else 0)
    return ended


def content(out: Path) -> dict[str, bytes]:
    """The files of a result; half a file is none of them."""
    names = [out / "rig.toml", out / "calibration.json", *sorted((out / "tracks").glob("*"))]
    return {str(path.relative_to(out)): path.read_bytes() for path in names if path.exists()}
