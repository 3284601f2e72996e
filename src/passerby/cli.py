"""The command line: parse, call, print. Imports stay inside the commands, so that `passerby --help` is quick.

Exit status: 0 accepted, 1 a bug, 2 bad input, 3 too little evidence, 130 interrupted.
"""

from __future__ import annotations

import os
import sys
import threading
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from passerby import __version__
from passerby.commands.init import init
from passerby.commands.models import models_app
from passerby.errors import InputError, PasserbyError

if TYPE_CHECKING:
    from passerby.pipeline import Calibration

Number = TypeVar("Number", int, float)

INTERRUPTED = 130
BUG = 1

app = typer.Typer(
    name="passerby",
    help="Calibrate a network of cameras from the people who walk through its view.",
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

app.command()(init)
app.add_typer(models_app, name="models")

SceneFile = Annotated[Path, typer.Argument(metavar="SCENE", help="Scene file (TOML).")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Tell more: wall times and figures of the stages.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")]


def main() -> None:
    """The program `passerby`."""
    status = run(sys.argv[1:])
    if status == INTERRUPTED and not _threads_end():
        # The interpreter would wait for the threads of a pool that was left in the middle of its work. Every file is written
        # whole or not at all.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    sys.exit(status)


def _threads_end() -> bool:
    """Whether all other threads end within a second."""
    others = [thread for thread in threading.enumerate() if thread is not threading.current_thread()]
    for thread in others:
        thread.join(timeout=1.0)
    return not any(thread.is_alive() for thread in others)


def run(arguments: Sequence[str]) -> int:
    """Run one command line and return its exit status; errors become one line on standard error."""
    try:
        command = typer.main.get_command(app)
        status = command.main(list(arguments) or ["--help"], prog_name="passerby", standalone_mode=False)
    except PasserbyError as error:
        return _fail(str(error), error.exit_status)
    except (typer.Abort, KeyboardInterrupt):
        status = INTERRUPTED
    except Exception as error:
        # Usage errors are click's or, in newer versions, typer's own: known by what they can do, not by where they live.
        if hasattr(error, "format_message"):
            return _fail(error.format_message(), InputError.exit_status)
        traceback.print_exc()
        return _fail(f"a bug in Passerby: {type(error).__name__}: {error}; please report it with the lines above", BUG)
    if status == INTERRUPTED:
        return _fail("interrupted", INTERRUPTED)
    return status if isinstance(status, int) else 0


def _fail(message: str, status: int) -> int:
    print(f"error: {' '.join(message.split())}", file=sys.stderr)
    return status


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"passerby {__version__}")
        raise typer.Exit


@app.callback()
def options(
    context: typer.Context,
    verbose: Verbose = False,
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and end.")
    ] = False,
) -> None:
    """Options of all commands."""
    context.obj = verbose


@app.command()
def calibrate(
    context: typer.Context,
    scene: SceneFile,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Folder for rig.toml, calibration.json, tracks/, and what was seen in videos.")
    ] = Path("out"),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random numbers; the same seed gives the same files.")] = 0,
    json: AsJson = False,
    verbose: Verbose = False,
) -> None:
    """Calibrate the cameras of a scene.

    What was seen in videos is kept in the output folder: a run that was stopped goes on from there, and one with other options
    makes again only what depends on them.

    Exit status 3: doubtful or refused; what was found is written all the same, with the reasons.
    """
    from passerby.parallel import local_processes
    from passerby.pipeline import calibrate as run_calibration
    from passerby.scene import Scene
    from passerby.tables import show_calibration
    from passerby.terminal import stages

    verbose = verbose or bool(context.obj)
    loaded = Scene.load(scene)
    processes = local_processes(loaded.size_bytes, len(loaded.cameras), loaded.n_videos)
    with stages(verbose) as tell, processes as executor:
        calibration = run_calibration(loaded, seed=seed, progress=tell, executor=executor, keep=out)
        tell("writing")
        calibration.write(out)
    if json:
        _print_json({**calibration.to_dict(), "seconds": calibration.seconds, "out": str(out)})
    else:
        show_calibration(calibration, verbose)
        print(f"written to {out}")
    _tell_reasons(calibration)
    raise typer.Exit(calibration.exit_status)


@app.command()
def evaluate(
    rig: Annotated[Path, typer.Argument(metavar="RIG", help="Rig file to judge (TOML).")],
    truth: Annotated[Path, typer.Argument(metavar="TRUTH", help="Rig file with the true poses (TOML).")],
    reference: Annotated[str | None, typer.Option(help="Camera that coincides in the metric placement; the first.")] = None,
    json: AsJson = False,
) -> None:
    """Compare a rig with the true one: errors of position and orientation, scale, vertical and ground."""
    from passerby.evaluation.metrics import compare
    from passerby.interchange.rig_toml import read_rig
    from passerby.tables import show_comparison

    comparison = compare(read_rig(rig), read_rig(truth), reference)
    if json:
        _print_json(comparison.to_dict())
    else:
        show_comparison(comparison)


@app.command()
def check(scene: SceneFile, json: AsJson = False) -> None:
    """Read everything that a scene names and tell what it holds and all that is wrong.

    Exit status 2: something cannot be used; 3: it can, but does not tie all cameras together.
    """
    from passerby.check import check_scene
    from passerby.tables import show_check

    report = check_scene(scene)
    if json:
        _print_json(report.to_dict())
    else:
        show_check(report)
    for fault in (*report.faults, *report.lacks):
        _fail(fault, report.exit_status)
    raise typer.Exit(report.exit_status)


@app.command()
def simulate(
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder to write; an earlier simulation in it is replaced.")],
    preset: Annotated[str, typer.Option(help="terrace, basketball or construction.")] = "terrace",
    seed: Annotated[int, typer.Option(help="The same options and seed give the same scene.")] = 0,
    cameras: Annotated[int | None, typer.Option(help="Number of cameras; the preset's.")] = None,
    people: Annotated[int | None, typer.Option(help="Number of people; the preset's.")] = None,
    seconds: Annotated[float, typer.Option(help="Length of the recording.")] = 40.0,
    fps: Annotated[float, typer.Option(help="Instants per second.")] = 5.0,
    camera_height_m: Annotated[float | None, typer.Option(help="Height of the cameras; the preset's.")] = None,
    person_height_mean_m: Annotated[float, typer.Option(help="Mean standing height, shoes on.")] = 1.72,
    person_height_sd_m: Annotated[float, typer.Option(help="Its standard deviation.")] = 0.09,
    occlusion: Annotated[bool, typer.Option(help="People hide each other.")] = True,
    box_noise: Annotated[float, typer.Option(help="Sigma of each edge, as a fraction of the box height.")] = 0.0,
    corner_noise_px: Annotated[float, typer.Option(help="Uniform noise of the corners, plus or minus pixels.")] = 0.0,
    box_slack: Annotated[float, typer.Option(help="Fraction of its height by which a box is larger on each side.")] = 0.0,
    missing: Annotated[float, typer.Option(help="Fraction of the boxes that are dropped.")] = 0.0,
    false_boxes: Annotated[float, typer.Option(help="Boxes without a person, as a fraction of the true ones.")] = 0.0,
    identity_swaps: Annotated[float, typer.Option(help="Fraction of each instant's people who exchange identities.")] = 0.0,
    clock_offsets: Annotated[
        str, typer.Option(help="Seconds: a largest offset drawn for each camera, or one for each, parted by commas.")
    ] = "0",
    joint_noise_px: Annotated[float, typer.Option(help="Sigma of the joints' pixels.")] = 0.0,
    unrelated_ids: Annotated[bool, typer.Option(help="Tracklet numbers of each camera's own, not identities.")] = False,
    tracklet_seconds: Annotated[
        float, typer.Option(help="Mean length at which tracklets are cut at random; 0: never. Needs --unrelated-ids.")
    ] = 0.0,
    embeddings: Annotated[
        str, typer.Option(help="Appearance of the boxes: none, distinct (tells people apart) or alike (tells nothing).")
    ] = "none",
    camera_fps: Annotated[str, typer.Option(help="Frames per second of each camera, parted by commas; all --fps.")] = "",
    groups: Annotated[
        str, typer.Option(help="Cameras in groups without common ground: their numbers, parted by commas, as 6,2.")
    ] = "",
    keypoints: Annotated[bool, typer.Option(help="Write joints (COCO) too.")] = False,
) -> None:
    """Simulate people in a scene: boxes, joints on request, true cameras, and a scene file ready to calibrate."""
    from passerby.simulation import SimulationOptions, write_scene
    from passerby.simulation import simulate as run_simulation
    from passerby.terminal import stages

    chosen = SimulationOptions(
        preset=preset,
        seed=seed,
        cameras=cameras,
        people=people,
        seconds=seconds,
        fps=fps,
        camera_height_m=camera_height_m,
        person_height_mean_m=person_height_mean_m,
        person_height_sd_m=person_height_sd_m,
        occlusion=occlusion,
        box_noise=box_noise,
        corner_noise_px=corner_noise_px,
        box_slack=box_slack,
        missing=missing,
        false_boxes=false_boxes,
        identity_swaps=identity_swaps,
        clock_offsets=_clock_offsets(clock_offsets),
        joint_noise_px=joint_noise_px,
        unrelated_ids=unrelated_ids,
        tracklet_seconds=tracklet_seconds,
        embeddings=embeddings,
        camera_fps=_numbers(camera_fps, float, "--camera-fps", "frames per second of each camera"),
        groups=_numbers(groups, int, "--groups", "the number of cameras of each group"),
    )
    with stages() as tell:
        tell("simulating")
        path = write_scene(run_simulation(chosen), out, keypoints=keypoints)
    print(f"written to {out}: passerby calibrate {path} -o {out}-rig")


@app.command()
def demo(
    context: typer.Context,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Keep the scene and its calibration in this folder.")] = None,
    verbose: Verbose = False,
) -> None:
    """Simulate a terrace with four cameras, calibrate it from its boxes, and print the errors."""
    import tempfile

    from passerby.evaluation.metrics import compare
    from passerby.interchange.rig_toml import read_rig
    from passerby.pipeline import calibrate as run_calibration
    from passerby.simulation import SimulationOptions, write_scene
    from passerby.simulation import simulate as run_simulation
    from passerby.tables import show_calibration, show_comparison
    from passerby.terminal import stages

    with tempfile.TemporaryDirectory(prefix="passerby-demo-") as temporary, stages() as tell:
        folder = out or Path(temporary)
        tell("simulating")
        path = write_scene(run_simulation(SimulationOptions(preset="terrace", box_noise=0.02)), folder / "scene")
        calibration = run_calibration(path, progress=tell)
        calibration.write(folder / "out")
        comparison = compare(read_rig(folder / "out" / "rig.toml"), read_rig(path.parent / "truth.toml"))
    print("A simulated terrace of 7 x 11 m: people walk, each box edge is off by 2 % of the box height.\n")
    show_calibration(calibration, verbose or bool(context.obj))
    print()
    show_comparison(comparison)
    if out is not None:
        print(f"\nwritten to {out}: scene/scene.toml and out/rig.toml")
    _tell_reasons(calibration)
    raise typer.Exit(calibration.exit_status)


def _clock_offsets(text: str) -> float | tuple[float, ...]:
    try:
        offsets = tuple(float(part) for part in text.split(","))
    except ValueError:
        raise InputError(
            f"--clock-offsets {text!r}: give seconds, one number or one for each camera parted by commas"
        ) from None
    return offsets[0] if len(offsets) == 1 else offsets


def _numbers(text: str, kind: type[Number], option: str, wanted: str) -> tuple[Number, ...]:
    """Numbers parted by commas; none where the text is empty."""
    try:
        return tuple(kind(part) for part in text.split(",")) if text else ()
    except ValueError:
        raise InputError(f"{option} {text!r}: give {wanted}, parted by commas") from None


def _print_json(value: object) -> None:
    from passerby.interchange.json_text import to_json

    print(to_json(value), end="")


def _tell_reasons(calibration: Calibration) -> None:
    if not calibration.accepted:
        reasons = "; ".join(calibration.reasons) or "no reason given"
        print(f"{calibration.verdict}: {' '.join(reasons.split())}", file=sys.stderr)
