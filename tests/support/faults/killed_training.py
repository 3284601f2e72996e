"""Trainings in a process of their own that is killed at a moment of one's choice."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

Moment = tuple[str, int]
"""What happens, and at which time that it happens: ("batch", 5)."""


def _until(event: str, moment: Moment, function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, which ends the process instead when the moment has come."""
    seen = 0

    def told(*arguments: Any, **named: Any) -> Any:
        nonlocal seen
        seen += 1
        if moment == (event, seen):
            os.kill(os.getpid(), signal.SIGKILL)
        return function(*arguments, **named)

    return told


def _run(data: Path, out: Path, chosen: dict[str, Any], moment: Moment) -> None:
    """In the new process."""
    import torch

    from passerby.interchange.storage import atomic
    from passerby.training import training
    from passerby.training.data import read_all
    from passerby.training.network import ReidLoss
    from passerby.training.options import train_options
    from passerby.training.runs import train_run

    torch.set_num_threads(1)
    ReidLoss.forward = _until("batch", moment, ReidLoss.forward)  # type: ignore[method-assign]
    training.save_checkpoint = _until("checkpoint", moment, training.save_checkpoint)
    atomic.os = _Os(moment)  # type: ignore[assignment]
    train_run(read_all([data], out / "crops"), train_options("small", **chosen), out, device="cpu")
    os._exit(0)


class _Os:
    """The module `os`, but the process may end before a file that is whole gets its name."""

    def __init__(self, moment: Moment) -> None:
        self.replace = _until("name", moment, os.replace)

    def __getattr__(self, name: str) -> Any:
        return getattr(os, name)


def train_until(data: Path, out: Path, chosen: dict[str, Any], moment: Moment) -> None:
    """Train in a process of its own until the moment has come; it must come."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["passerby.training.runs", "passerby.training.data"])
    process = context.Process(target=_run, args=(data, out, chosen, moment))
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL
