"""`passerby monitor`: detect cameras of a rig that have moved since its calibration."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from passerby.common.errors import InputError
from passerby.common.progress import ProgressForm

if TYPE_CHECKING:
    from collections.abc import Sequence

    from passerby.monitoring.monitor import MonitoredGroup
    from passerby.monitoring.result import MonitoringResult


def monitor(
    context: typer.Context,
    rig: Annotated[Path, typer.Argument(metavar="RIG", help="Rig file (TOML), or output folder of `passerby calibrate`.")],
    scene: Annotated[Path, typer.Argument(metavar="SCENE", help="Scene file of new footage, cameras named as in RIG.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for rig.toml with the new poses, and monitor.json.")
    ] = None,
    every: Annotated[float, typer.Option(help="Length of a window of footage that is tested at once, in seconds.")] = 60.0,
    budget: Annotated[
        float | None,
        typer.Option(
            help="Processor seconds for each camera and minute of recording: less of the footage is used to stay within. "
            "Default: 1 for rigs of more than twelve cameras, else none."
        ),
    ] = None,
    in_step: Annotated[
        bool,
        typer.Option("--in-step", help="The clocks of the footage are synchronised, whatever they were in the calibration."),
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")] = False,
    progress: Annotated[
        ProgressForm,
        typer.Option("--progress", help="How progress is written on standard error; json: a JSON object a line."),
    ] = ProgressForm.auto,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Print more: each window, and the stages.")] = False,
) -> None:
    """Detect whether a camera has moved: which one, when, and by how much. Only that camera gets a new pose.

    The people in the footage are the evidence, as in the calibration. Their identities need not be known.

    Of a calibration in groups all groups are monitored, each with its own rig.

    Exit status 3: a camera has moved, or there are too few people to decide.
    """
    from passerby.cli.terminal import stages
    from passerby.common.parallel import open_local_processes
    from passerby.interchange.calibration_json import CALIBRATION_FILE
    from passerby.interchange.storage.text_formats import to_json
    from passerby.monitoring.monitor import monitor_groups, read_groups
    from passerby.monitoring.watched import LEAST_BUDGET_S, MOST_BUDGET_S, WatchOptions
    from passerby.scene.scene import Scene

    verbose = verbose or bool(context.obj)
    if not 10 <= every <= 3600:
        raise InputError(f"--every {every:g}: give 10 to 3600 seconds")
    if out is not None and (out / CALIBRATION_FILE).exists():
        raise InputError(f"{out}: holds a calibration, which would no longer fit its rig: give another folder")
    if budget is not None and not LEAST_BUDGET_S <= budget <= MOST_BUDGET_S:
        raise InputError(f"--budget {budget:g}: give {LEAST_BUDGET_S:g} to {MOST_BUDGET_S:g} seconds")
    groups, loaded = read_groups(rig), Scene.load(scene)
    processes = open_local_processes(loaded.size_bytes, len(loaded.cameras), loaded.n_videos)
    options = WatchOptions(every_s=every, budget_s=budget)
    with stages(verbose, progress) as tell, processes as executor:
        done = monitor_groups(groups, loaded, options, in_step=in_step, keep=out, tell=tell, executor=executor)
        if out is not None:
            for one in done:
                one.write(out)
    if json:
        print(to_json({**_values(done), "out": None if out is None else str(out)}), end="")
    else:
        for one in done:
            _show(one.found, verbose, f"group {one.number}: " if len(groups) > 1 else "")
        if out is not None:
            print(f"written to {out}")
    for note in dict.fromkeys(note for one in done for note in one.found.notes):
        print(f"note: {' '.join(note.split())}", file=sys.stderr)
    raise typer.Exit(max(one.found.exit_status for one in done))


def _values(done: Sequence[MonitoredGroup]) -> dict[str, Any]:
    """Return the first group's values, which contain those of the other groups, as in an output folder."""
    first, *others = done
    values = first.found.to_dict()
    if first.folder:
        values |= {"group": first.number, "folder": first.folder}
    if others:
        values["groups"] = [{"group": one.number, "folder": one.folder, **one.found.to_dict()} for one in others]
    return values


def _show(found: MonitoringResult, verbose: bool, group: str) -> None:
    """Print a line for each camera, and sentences about the moves; `group` is the beginning of the heading."""
    from passerby.cli.terminal import MISSING, number, show_table
    from passerby.monitoring.result import clock_time

    watched, rows = found.watched, []
    for name in found.cameras:
        one = found.camera(name)
        clear = MISSING if one.carried else f"{one.windows_told} of {one.windows}"
        row = [name, one.state, clear, number(one.worst_shift_m, 2), number(one.worst_turn_deg, 1)]
        rows.append([*row, (one.as_of or MISSING) if one.carried else ""] if found.carried else row)
    span = f"{clock_time(watched.from_s)} to {clock_time(watched.until_s)}"
    show_table(
        f"{group}monitored from {span}{', by joints and boxes' if watched.by_joints else ''}",
        [
            "camera",
            "state",
            f"windows of {found.options.every_s:g} s",
            "detection limit m",
            "limit deg",
            *(["no news since"] if found.carried else []),
        ],
        rows,
    )
    for sentence in found.sentences():
        print(sentence)
    if verbose:
        columns = ["until", *(f"{name} score" for name in found.names)]
        scores = []
        for window in watched.windows:
            own = {test.camera: test for test in window.tests}
            cells = [number(own[c].score) if c in own and window.clear(c) else MISSING for c in range(len(found.names))]
            scores.append([clock_time(window.until_s), *cells])
        show_table(f"windows (moved from {found.options.threshold:g})", columns, scores)
