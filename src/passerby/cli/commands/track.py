"""`passerby track`: the trajectories of all people on the ground, from the output folder of a calibration."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from passerby.common.errors import InputError
from passerby.common.progress import ProgressForm

if TYPE_CHECKING:
    from passerby.common.progress import Progress
    from passerby.core.cameras import Rig
    from passerby.core.observations import Clock
    from passerby.core.trajectories import Trajectories
    from passerby.evaluation.trajectories import GroundTruth
    from passerby.interchange.output_folder import OutputFolder
    from passerby.people.trajectories.trajectories import TrackOptions

FOLDER, CSV_FILE, HTML_FILE = "trajectories", "trajectories.csv", "trajectories.html"


def track(
    context: typer.Context,
    calibrated: Annotated[Path, typer.Argument(metavar="OUT", help="Output folder of `passerby calibrate`.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder for trajectories.csv and trajectories.html; default: OUT/trajectories."),
    ] = None,
    method: Annotated[
        str, typer.Option(help="smoothed: bodies on the ground, smoothed over time; pairwise: mean of pairwise triangulations.")
    ] = "smoothed",
    max_gap: Annotated[
        float, typer.Option("--max-gap", help="Longest gap between observations of a person that is bridged, in seconds.")
    ] = 2.0,
    fps: Annotated[float | None, typer.Option(help="Frames per second, if the calibration does not state them.")] = None,
    truth: Annotated[
        Path | None, typer.Option(help="True ground positions (CSV: frame, id, x_m, y_m) to compare with.")
    ] = None,
    true_rig: Annotated[
        Path | None, typer.Option("--true-rig", help="Rig file with the true poses: aligns the world frame with --truth.")
    ] = None,
    truth_fps: Annotated[
        float | None, typer.Option("--truth-fps", help="Frames per second of --truth; default: the first camera's.")
    ] = None,
    reference: Annotated[
        str | None, typer.Option(help="Camera at which the rigs are aligned with the scale kept; default: the first.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")] = False,
    progress: Annotated[
        ProgressForm,
        typer.Option("--progress", help="How progress is written on standard error; json: a JSON object a line."),
    ] = ProgressForm.auto,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Print more: each person, and the stages.")] = False,
) -> None:
    """Estimate the trajectory of every person on the ground: the position at each time step, with its uncertainty.

    Positions between observations, which no camera saw, have 0 cameras. With --truth and --true-rig: the distance of the
    trajectories to the truth, with the estimated and with the true cameras.
    """
    from passerby.calibration.following import folder_clocks, track_options, trajectories_by_rig
    from passerby.cli.terminal import stages
    from passerby.interchange.output_folder import read_output
    from passerby.interchange.rig_toml import read_rig
    from passerby.interchange.storage.atomic import write_text
    from passerby.interchange.storage.text_formats import to_json
    from passerby.interchange.storage.transaction import folder_lock, transaction
    from passerby.interchange.trajectories_csv import read_ground_positions, write_trajectories
    from passerby.report.page import trajectories_page

    if truth is not None and true_rig is None:
        raise InputError("--truth needs --true-rig: the true cameras align the estimated world frame with the true one")
    verbose = verbose or bool(context.obj)
    with stages(verbose, progress) as tell:
        tell("reading")
        folder = read_output(calibrated)
        options, clocks = track_options(folder, method, max_gap), folder_clocks(folder, fps)
        rig = read_rig(true_rig) if true_rig is not None else None
        places = read_ground_positions(truth) if truth is not None else None
        found = trajectories_by_rig(folder, folder.rig, clocks, options, tell)
        figures: dict[str, Any] = {"verdict": folder.verdict, **found.figures}
        if rig is not None and places is not None:
            known = _ground_truth(places.identity, places.frame, places.xy, truth_fps or next(iter(clocks.values())).fps)
            figures["truth"] = _evaluate_tracks(folder, clocks, options, found, rig, known, reference, tell)
        tell("writing")
        target = out or calibrated / FOLDER
        name = str(folder.document.name or calibrated.resolve().name)
        page = trajectories_page(found, folder.rig, f"{name}: trajectories on the ground", _note(figures))
        with folder_lock(target, "passerby track"), transaction(target) as new:
            write_trajectories(new / CSV_FILE, found)
            write_text(new / HTML_FILE, page)
    if json:
        print(to_json({**figures, "out": str(target)}), end="")
    else:
        _show(figures, verbose)
        print(f"written to {target}")
    for reason in folder.reasons:
        print(f"note: the calibration is {folder.verdict}: {' '.join(reason.split())}", file=sys.stderr)


def _ground_truth(identity: Any, frame: Any, xy: Any, fps: float) -> GroundTruth:
    """Return the true positions with times of the rig's clock."""
    from passerby.core.observations import Clock
    from passerby.evaluation.trajectories import GroundTruth

    return GroundTruth.of(identity, Clock(fps).seconds(frame), xy)


def _evaluate_tracks(
    folder: OutputFolder, clocks: dict[str, Clock], options: TrackOptions, found: Trajectories, true_rig: Rig,
    truth: GroundTruth, reference: str | None, tell: Progress,
) -> dict[str, Any]:  # fmt: skip
    """Compute the errors with the estimated cameras, aligned in two ways, and with the true cameras."""
    from passerby.calibration.following import trajectories_by_rig
    from passerby.core.cameras import Rig
    from passerby.evaluation.trajectories import compare_places, judge, placements

    tell("comparing")
    same = folder.identities_given
    motions = placements(folder.rig, true_rig, reference)
    out: dict[str, Any] = {name: judge(found, truth, motion, same_ids=same).to_dict() for name, motion in motions.items()}
    shared = Rig(tuple(camera for camera in true_rig.posed() if camera.name in folder.rig.names))
    by_true = trajectories_by_rig(folder, shared, clocks, options, tell)
    out["true_cameras"] = judge(by_true, truth, same_ids=same).to_dict()
    out["from_true_cameras"] = {name: compare_places(found, by_true, motion).to_dict() for name, motion in motions.items()}
    return out


def _note(figures: dict[str, Any]) -> str:
    """Describe the trajectories in two sentences."""
    from passerby.cli.terminal import number

    return (
        f"{figures['people']} people, {figures['places']} positions in {number(figures['seconds'])} s; position std "
        f"{number(figures['median_sigma_m'], 2)} m (median); z is the body centre. Calibration: {figures['verdict']}."
    )


def _show(figures: dict[str, Any], verbose: bool) -> None:
    """Print the tables of cameras and errors, and with `verbose` of people."""
    from passerby.cli.terminal import number, show_table

    print(_note(figures))
    rows = [[one["name"], str(one["boxes"]), str(one["used"]), number(one["disagreement_m"], 3)] for one in figures["cameras"]]
    show_table("cameras", ["camera", "boxes", "used", "ray residual m"], rows)
    if verbose:
        people = [
            [str(one["id"]), number(one["from_s"]), number(one["to_s"]), str(one["parts"]), number(one["length_m"]),
             number(one["median_sigma_m"], 2)] for one in figures["ways"]
        ]  # fmt: skip
        show_table("people", ["person", "from s", "to s", "parts", "length m", "std m"], people)
    if "truth" not in figures:
        return
    judged = figures["truth"]
    names = {"metric": "aligned at the reference camera", "similarity": "similarity alignment", "true_cameras": "true cameras"}
    errors = [
        [title, str(judged[key]["places"]), *(number(judged[key][column], 3) for column in ("mean_m", "median_m", "p95_m"))]
        for key, title in names.items()
        if key in judged
    ]
    show_table("distance to the truth", ["cameras", "positions", "mean m", "median m", "95 % m"], errors)
