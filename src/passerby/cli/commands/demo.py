"""`passerby demo`: from nothing to a rig, with the truth to compare it with."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from passerby.common.progress import ProgressForm

SECONDS, FPS = 60.0, 10.0
"""A minute, as the documentation asks of a user: half the time leaves twice the error."""


def demo(
    context: typer.Context,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Keep the scene and its calibration in this folder.")] = None,
    detector: Annotated[
        str, typer.Option(help="Detector of people: background, auto, a model's name or a path.")
    ] = "background",
    embedder: Annotated[str, typer.Option(help="Appearance embedding: stripes, none, auto, a name or a path.")] = "stripes",
    keypoints: Annotated[str, typer.Option(help="Keypoints of people: none, auto, a model's name or a path.")] = "none",
    intrinsics: Annotated[bool, typer.Option(help="Use the intrinsics; without them they are estimated too.")] = True,
    progress: Annotated[
        ProgressForm,
        typer.Option("--progress", help="How progress is written on standard error; json: a JSON object a line."),
    ] = ProgressForm.auto,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Print more: wall times and figures of the stages.")] = False,
) -> None:
    """Film a simulated terrace with four cameras, calibrate them from the videos, and print the errors.

    Needs no internet connection and no model files unless you ask for them.
    """
    import tempfile

    from passerby.calibration.calibrate import calibrate
    from passerby.calibration.writing import write_results
    from passerby.cli.tables import show_calibration, show_comparison, tell_reasons
    from passerby.cli.terminal import stages
    from passerby.common.parallel import local_processes
    from passerby.evaluation.metrics import compare
    from passerby.interchange.rig_toml import read_rig
    from passerby.interchange.storage.transaction import folder_lock
    from passerby.scene.scene import Scene
    from passerby.scene.tables import PerceptionTable
    from passerby.simulation import SimulationOptions, simulate, write_scene
    from passerby.simulation.rendering import RenderOptions

    options = SimulationOptions(preset="terrace", seconds=SECONDS, fps=FPS, unrelated_ids=True)
    with tempfile.TemporaryDirectory(prefix="passerby-demo-") as temporary, stages(form=progress) as tell:
        folder = out or Path(temporary)
        processes = local_processes(0, options.n_cameras, options.n_cameras)
        with folder_lock(folder / "out", "passerby demo"), processes as executor:
            tell("simulating")
            path = write_scene(simulate(options), folder / "scene", video=RenderOptions(), executor=executor, tell=tell)
            scene = Scene.load(path).with_perception(PerceptionTable(detector=detector, embedder=embedder, keypoints=keypoints))
            scene = scene if intrinsics else scene.without_intrinsics()
            calibration = calibrate(scene, progress=tell, executor=executor, keep=folder / "out")
            write_results(calibration, folder / "out", report=out is not None, progress=tell)
        comparison = compare(read_rig(folder / "out" / "rig.toml"), read_rig(path.parent / "truth.toml"))
    print(
        f"A simulated terrace of 7 x 11 m, filmed by {options.n_cameras} cameras for {options.seconds:g} s: people walk "
        f"about and are detected by {calibration.perception['detector']}.\n"
    )
    show_calibration(calibration, verbose or bool(context.obj))
    print()
    show_comparison(comparison)
    if out is not None:
        print(f"\nwritten to {out}: the videos and scene.toml in scene/, the rig and the tracks in out/")
        print(f"report: {out / 'out' / 'report.html'}")
    tell_reasons(calibration)
    raise typer.Exit(calibration.exit_status)
