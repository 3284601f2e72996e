"""The commands: parse arguments, call functions, print results. Imports are inside the commands, so `passerby --help` is fast.

Exit status: 0 accepted, 1 a bug, 2 bad input, 3 too little evidence, 130 interrupted.
"""

from __future__ import annotations

import errno
import os
import sys
import threading
import time
import traceback
from collections.abc import Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from passerby._version import __version__
from passerby.cli.commands.align import align, compare
from passerby.cli.commands.formats import export, formats, import_
from passerby.cli.commands.init import init
from passerby.cli.commands.models import models_app
from passerby.cli.commands.monitor import monitor
from passerby.cli.commands.record import record
from passerby.cli.commands.reid import reid_app
from passerby.cli.commands.report import open_, report
from passerby.cli.commands.simulate import dataset, demo, simulate
from passerby.cli.commands.track import track
from passerby.common.errors import InputError, PasserbyError
from passerby.common.progress import ProgressForm
from passerby.common.text import remove_credentials

if TYPE_CHECKING:
    from passerby.calibration.effort import Effort

INTERRUPTED = 130
BEGAN = time.perf_counter()
"""Time of this module's import: the beginning of the wall time."""
BUG = 1
UNREAD = 141
"""Exit status if standard output is no longer read, as for a program that SIGPIPE ends."""
FAILING = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG, errno.EIO, errno.EMFILE, errno.ENFILE, errno.EPIPE)

app = typer.Typer(
    name="passerby",
    help="Calibrate a network of cameras from the people who walk through its view.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # rich would interpret "[scale]" as markup and omit it
    context_settings={"help_option_names": ["-h", "--help"]},
)


SceneFile = Annotated[Path, typer.Argument(metavar="SCENE", help="Scene file (TOML).")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Print more: wall times and figures of the stages.")]
Form = Annotated[
    ProgressForm, typer.Option("--progress", help="How progress is written on standard error; json: a JSON object a line.")
]
Scheduler = Annotated[
    str | None, typer.Option("--scheduler", help="Address of a Dask scheduler whose workers do the work, as tcp://host:8786.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")]


def main(program: typer.Typer = app, name: str = "passerby") -> None:
    """Run a program of commands, `passerby` or another one, and end the process with its exit status."""
    status = run(sys.argv[1:], program, name)
    if status == INTERRUPTED and not _threads_end():
        # The interpreter would wait for the threads of an interrupted pool, so the process exits at once. This is safe, because
        # every file is written atomically. The pool's semaphores are released first: otherwise Python prints a warning.
        # Python itself calls this function at exit; it has no public name.
        from multiprocessing.util import _run_finalizers  # type: ignore[attr-defined]

        _run_finalizers(0)
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    sys.exit(status)


def _threads_end() -> bool:
    """Wait a second for each other thread to end, and return whether all have ended."""
    others = [thread for thread in threading.enumerate() if thread is not threading.current_thread()]
    for thread in others:
        thread.join(timeout=1.0)
    return not any(thread.is_alive() for thread in others)


def run(arguments: Sequence[str], program: typer.Typer = app, name: str = "passerby") -> int:
    """Run one command line and return its exit status; errors become one line on standard error."""
    try:
        command = typer.main.get_command(program)
        status = command.main(list(arguments) or ["--help"], prog_name=name, standalone_mode=False)
        sys.stdout.flush()
    except PasserbyError as error:
        return _fail(str(error), error.exit_status)
    except (typer.Abort, KeyboardInterrupt):
        status = INTERRUPTED
    except Exception as error:
        if type(error).__name__ == "NoArgsIsHelpError":
            # A group was given without a command. Its help was already printed, or it is the message of the error.
            print(str(error), end="")
            return 0
        # The class of usage errors is click's or, in newer versions, typer's own: so it is recognised by a method.
        if hasattr(error, "format_message"):
            return _fail(error.format_message(), InputError.exit_status)
        if isinstance(error, OSError) and error.errno in FAILING:
            return _machine_fails(error)
        print(remove_credentials(traceback.format_exc()), end="", file=sys.stderr)
        return _fail(f"a bug in Passerby: {type(error).__name__}: {error}; please report it with the lines above", BUG)
    if status == INTERRUPTED:
        return _fail("interrupted", INTERRUPTED)
    return status if isinstance(status, int) else 0


def _fail(message: str, status: int) -> int:
    print(f"error: {' '.join(remove_credentials(message).split())}", file=sys.stderr)
    return status


def _machine_fails(error: OSError) -> int:
    """Report a failure that is not a bug of the program: a full or broken disk, or output that is no longer read."""
    _forget_output()
    if error.errno == errno.EPIPE:
        return UNREAD
    what = error.filename or "standard output or a temporary file"
    why = error.strerror or str(error)
    return _fail(
        f"{what}: cannot be written or read ({why}): check the disk and run the same command again", InputError.exit_status
    )


def _forget_output() -> None:
    """Discard output that cannot be written, so that Python does not try to write it again at the end of the process."""
    with suppress(OSError, ValueError, AttributeError):
        sys.stdout.flush()
        return
    with suppress(OSError, ValueError, AttributeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"passerby {__version__}")
        raise typer.Exit


@app.callback()
def options(
    context: typer.Context,
    verbose: Verbose = False,
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Options of all commands."""
    context.obj = verbose


@app.command()
def calibrate(
    context: typer.Context,
    scene: SceneFile,
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", help="Folder for rig.toml, report.html, calibration.json, tracks/ and cached results of videos."
        ),
    ] = Path("out"),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random numbers; the same seed gives the same files.")] = 0,
    report: Annotated[bool, typer.Option("--report/--no-report", help="Whether to write report.html.")] = True,
    target: Annotated[
        str | None,
        typer.Option(
            metavar="LENGTH",
            help="Uncertainty of points and of positions on the ground, such as 2cm, at which no more of the "
            "videos is watched; 5cm by default.",
        ),
    ] = None,
    budget: Annotated[
        str | None, typer.Option(metavar="TIME", help="Time, such as 2min, after which no more of the videos is begun.")
    ] = None,
    everything: Annotated[bool, typer.Option("--all", help="Watch all of the videos at once.")] = False,
    scheduler: Scheduler = None,
    json: AsJson = False,
    progress: Form = ProgressForm.auto,
    verbose: Verbose = False,
) -> None:
    """Calibrate the cameras of a scene. Streams are recorded first if the scene has a table [recording].

    The most informative parts of long videos are watched first. The rest is not watched once the rig measures as well as
    --target, or if it would barely improve the rig. Ctrl-C after the first rig writes the current rig.

    The output folder caches what was detected in videos: an interrupted run continues from there, and a run with other
    options repeats only what depends on them.

    Exit status 3: the verdict is doubtful (unreliable) or refused (failed); the results are written with the reasons.
    """
    from passerby.calibration.calibrate import CalibrationInterrupted
    from passerby.calibration.calibrate import calibrate as run_calibration
    from passerby.calibration.writing import WORK, write_results
    from passerby.cli.commands.record import record_if_needed
    from passerby.cli.tables import describe_rig_so_far, show_calibration, tell_reasons
    from passerby.cli.terminal import StageTimes, stages
    from passerby.common.cluster import cluster_workers
    from passerby.common.parallel import open_local_processes
    from passerby.common.progress import tell_warning
    from passerby.interchange.output_folder import REPORT_FILE
    from passerby.interchange.storage.transaction import folder_lock
    from passerby.recording.scene_streams import read_streamed
    from passerby.scene.scene import Scene

    verbose = verbose or bool(context.obj)
    effort = _effort_of(target, budget, everything=everything)
    streamed = read_streamed(scene)
    loaded = Scene.load(scene) if streamed is None else record_if_needed(streamed, out, verbose, progress)
    processes: AbstractContextManager[Executor | None] = (
        open_local_processes(loaded.size_bytes, len(loaded.cameras), loaded.n_videos)
        if scheduler is None
        else cluster_workers(scheduler, out, loaded.shared_paths)
    )
    interrupted = False
    with stages(verbose, progress) as shown, folder_lock(out, WORK):
        tell = StageTimes(shown, BEGAN)
        try:
            with processes as executor:
                calibration = run_calibration(
                    loaded, seed=seed, progress=tell, executor=executor, keep=out, effort=effort,
                    show=lambda found: tell_warning(tell, describe_rig_so_far(found)),
                )  # fmt: skip
        except CalibrationInterrupted as stopped:
            calibration, interrupted = stopped.calibration, True
        tell("writing")
        write_results(calibration, out, report=report, progress=tell)
    if json:
        _print_json(
            {
                **calibration.to_dict(),
                "seconds": calibration.seconds,
                "out": str(out),
                **({"report": str(out / REPORT_FILE)} if report else {}),
            }
        )
    else:
        show_calibration(calibration, verbose)
        if verbose:
            tell.show()
        print(f"written to {out}" + (f"; report: {out / REPORT_FILE}" if report else ""))
    tell_reasons(calibration)
    raise typer.Exit(INTERRUPTED if interrupted else calibration.exit_status)


def _effort_of(target: str | None, budget: str | None, *, everything: bool) -> Effort:
    """Return the effort that the options of `calibrate` state. Raises `InputError` for options that contradict each other."""
    from passerby.calibration.effort import TARGET_M, Effort
    from passerby.cli.quantities import parse_length, parse_seconds

    if everything and (target is not None or budget is not None):
        raise InputError("--all watches all of the videos: leave out --target and --budget, or --all")
    usual_m = None if everything else TARGET_M
    return Effort(
        usual_m if target is None else parse_length(target, "--target"),
        None if budget is None else parse_seconds(budget, "--budget"),
    )


@app.command()
def evaluate(
    rig: Annotated[Path, typer.Argument(metavar="RIG", help="Rig file (TOML) to evaluate, or an output folder.")],
    truth: Annotated[Path, typer.Argument(metavar="TRUTH", help="Rig file (TOML) with the true poses, or an output folder.")],
    reference: Annotated[
        str | None, typer.Option(help="Camera at which the rigs are aligned with the scale kept; default: the first.")
    ] = None,
    people: Annotated[
        Path | None,
        typer.Option(help="Output folder, or its folder tracks: measure points where people walked; default: on a grid."),
    ] = None,
    json: AsJson = False,
) -> None:
    """Compare a rig with the true one: errors of measured points, position and orientation, scale, up direction and ground."""
    from passerby.cli.tables import show_comparison
    from passerby.evaluation.metrics import compare_measuring
    from passerby.interchange.output_folder import read_rig_at, read_tracks_at

    tracks = None if people is None else read_tracks_at(people)
    comparison = compare_measuring(read_rig_at(rig), read_rig_at(truth), reference, tracks)
    if json:
        _print_json(comparison.to_dict())
    else:
        show_comparison(comparison)


@app.command()
def check(scene: SceneFile, json: AsJson = False) -> None:
    """Read every file that a scene names, and report what it contains and every problem.

    Exit status 2: something cannot be used; 3: everything can be used, but it does not connect all cameras.
    """
    from passerby.cli.commands.record import check_streams
    from passerby.cli.tables import show_check

    report = check_streams(scene)
    if json:
        _print_json(report.to_dict())
    else:
        show_check(report)
    for fault in (*report.faults, *report.lacks):
        _fail(fault, report.exit_status)
    raise typer.Exit(report.exit_status)


def _print_json(value: object) -> None:
    from passerby.interchange.storage.text_formats import to_json

    print(to_json(value), end="")


app.command()(init)
app.command("open")(open_)
app.command()(record)
app.command()(simulate)
app.command()(demo)
app.command()(track)
app.command()(report)
app.command()(monitor)
app.command()(align)
app.command()(compare)
app.command()(dataset)
app.command()(export)
app.command("import")(import_)
app.command()(formats)
for group in (models_app, reid_app):
    app.add_typer(group, name=group.info.name, short_help=group.info.help)
for commands in (app, models_app, reid_app):
    for command in commands.registered_commands:
        # The full first paragraph for the list of commands: click would cut it after the first line.
        command.short_help = " ".join((command.callback.__doc__ or "").split("\n\n")[0].split())
