"""`passerby align`: transform a calibration to the user's world frame; `passerby compare`: compare two rigs on people."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from passerby.common.errors import EvidenceError, InputError

if TYPE_CHECKING:
    from passerby.calibration.alignment.world import Aligned
    from passerby.scene.world_tables import WorldTable


def align(
    rig: Annotated[Path, typer.Argument(metavar="RIG", help="Rig file (TOML), or output folder of `passerby calibrate`.")],
    out: Annotated[
        Path,
        typer.Option("--out", "-o", help="Rig file to write (.toml), or folder for the whole calibration; may be RIG itself."),
    ],
    camera: Annotated[
        str | None, typer.Option(help="Origin on the ground below this camera, x axis along its viewing direction.")
    ] = None,
    towards: Annotated[str | None, typer.Option(help="With --camera: x axis towards this other camera.")] = None,
    points: Annotated[
        Path | None, typer.Option(help="Points with known coordinates: camera, u, v, x, y[, z][, point][, sd_m] (CSV or TOML).")
    ] = None,
    positions: Annotated[
        Path | None,
        typer.Option(help="Known positions of cameras: camera, x, y[, z][, sd_m], or camera, lat, lon[, alt] (CSV or TOML)."),
    ] = None,
    plan: Annotated[
        Path | None, typer.Option(help="Floor plan or satellite picture with cameras or points placed on it (TOML).")
    ] = None,
    scale: Annotated[bool, typer.Option("--scale", help="Points, positions or plan also set the scale.")] = False,
    tilt: Annotated[bool, typer.Option("--tilt", help="Points or positions also set the up direction and the height.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")] = False,
) -> None:
    """Set the origin and heading of the world frame by a camera, clicked points, known positions of cameras, or a plan.

    The ground stays at z = 0, and the up direction and the scale stay as they are, unless --tilt or --scale is given.
    Uncertainties and the verdict are kept. Residuals are reported for each point and camera. One gross error among enough
    points or positions is reported and left out.
    """
    from passerby.calibration.alignment.folder import write_aligned
    from passerby.calibration.alignment.scene_world import align_rig
    from passerby.cli.terminal import stages
    from passerby.interchange.calibration_json import CALIBRATION_FILE
    from passerby.interchange.output_folder import RIG_FILE, read_folder_rig
    from passerby.interchange.rig_toml import read_rig, write_rig
    from passerby.interchange.storage.text_formats import to_json
    from passerby.interchange.storage.transaction import folder_lock

    wanted = _read_options(camera, towards, points, positions, plan, scale, tilt)
    folder = rig if rig.is_dir() else rig.parent if (rig.parent / CALIBRATION_FILE).is_file() and rig.name == RIG_FILE else None
    source = rig / RIG_FILE if rig.is_dir() else rig
    to_file = out.suffix.lower() == ".toml" and not out.is_dir()
    _check_target(source, out, folder, to_file)
    in_place = not to_file and folder is not None and out.resolve() == folder.resolve()
    with folder_lock(out, "passerby align") if in_place else nullcontext():
        try:
            aligned = align_rig(read_rig(source) if folder is None else read_folder_rig(folder), wanted)
        except EvidenceError as error:
            raise EvidenceError(f"{points or positions or plan or source}: {error}", error.reasons) from None
        notes = list(aligned.notes)
        if to_file:
            write_rig(out, aligned.rig)
        else:
            assert folder is not None
            with stages() as tell:
                notes += write_aligned(folder, out, aligned, tell)
    if json:
        print(to_json({**aligned.figures, "notes": notes, "out": str(out)}), end="")
    else:
        _show(aligned)
        print(f"written to {out}")
    for note in notes:
        print(f"note: {' '.join(note.split())}", file=sys.stderr)


def _read_options(
    camera: str | None,
    towards: str | None,
    points: Path | None,
    positions: Path | None,
    plan: Path | None,
    scale: bool,
    tilt: bool,
) -> WorldTable:
    """Return the world frame that the options state. Raises `InputError` if they contradict each other."""
    from passerby.scene.world_tables import WorldTable, read_plan

    options = {"--camera": camera, "--points": points, "--positions": positions, "--plan": plan}
    given = [name for name, value in options.items() if value is not None]
    if len(given) != 1:
        raise InputError(f"{' and '.join(given) or 'nothing'} given: give one of {', '.join(options)}")
    if towards is not None and camera is None:
        raise InputError("--towards needs --camera: name the camera at the origin")
    if towards is not None and towards == camera:
        raise InputError("--towards names the camera of --camera itself: name another one")
    if camera is not None and (scale or tilt):
        raise InputError("--scale and --tilt need --points or --positions: a camera determines neither")
    if plan is not None and tilt:
        raise InputError("--tilt needs --points or --positions: a plan knows no heights")
    return WorldTable(
        camera=camera, towards=towards, points=points, positions=positions, plan=None if plan is None else read_plan(plan),
        scale=scale, tilt=tilt,
    )  # fmt: skip


def _check_target(source: Path, out: Path, folder: Path | None, to_file: bool) -> None:
    """Check the target. Raises `InputError` if a folder would contain files in two frames, or there is no folder to write."""
    from passerby.interchange.calibration_json import CALIBRATION_FILE
    from passerby.interchange.output_folder import RIG_FILE

    if to_file and folder is not None and out.resolve() == source.resolve():
        raise InputError(
            f"{out}: {CALIBRATION_FILE} beside it would stay in the old frame: give -o {folder} to align the whole folder, or "
            "another file"
        )
    if not to_file and folder is None:
        raise InputError(
            f"{out}: is not a .toml file, and {source} is not the {RIG_FILE} of an output folder: give a file that ends in "
            f".toml"
        )


def _show(aligned: Aligned) -> None:
    """Print the residuals, and the motion of the world frame with its sigmas."""
    import numpy as np

    from passerby.cli.terminal import number, show_table

    figures, motion = aligned.figures, aligned.motion
    if aligned.residuals:
        of_points = any("point" in row for row in aligned.residuals)
        rows = [_row(row, of_points) for row in aligned.residuals]
        last = ("residual px", "height residual m", "used") if of_points else ("height residual m", "used")
        columns = ("point", "camera") if of_points else ("camera",)
        show_table(f"aligned by {figures['by']}", (*columns, "residual m", *last), rows)
    turn = float(np.degrees(np.linalg.norm(figures["rotation"])))
    shift = float(np.linalg.norm(motion.translation))
    grown = f", and scaled by {motion.scale:.4f}" if figures.get("scale_fitted") else ""
    print(f"world frame rotated by {turn:.2f} degrees, translated by {shift:.3f} m{grown}")
    if aligned.residuals:
        scale = f", scale {100 * figures['scale_sigma']:.1f} %" if figures.get("scale_fitted") else ""
        place = number(figures["place_sigma_mm"] / 1000, 3)
        print(f"uncertainty (1 sigma): heading {number(figures['turn_sigma_deg'], 2)} degrees, position {place} m{scale}")
    if "geodetic_origin" in figures:
        latitude, longitude, altitude = figures["geodetic_origin"]
        print(f"origin: latitude {latitude:.7f}, longitude {longitude:.7f}, altitude {altitude:.2f} m; x east, y north")


def _row(row: dict[str, Any], of_points: bool) -> list[str]:
    """Return one row of the table of residuals."""
    from passerby.cli.terminal import MISSING, number

    names = [row.get("point", MISSING), row["camera"]] if of_points else [row["camera"]]
    pixels = [number(row["off_px"])] if of_points else []
    return [*names, number(row["off_m"], 3), *pixels, number(row["height_off_m"], 3), "yes" if row["used"] else "no"]


def compare(
    context: typer.Context,
    first: Annotated[Path, typer.Argument(metavar="A", help="Rig file (TOML), or output folder of `passerby calibrate`.")],
    second: Annotated[Path, typer.Argument(metavar="B", help="The other rig, of the same cameras by name.")],
    people: Annotated[
        Path,
        typer.Argument(
            metavar="PEOPLE",
            help="Scene file of a recording that neither rig was made from, or the output folder of its calibration.",
        ),
    ],
    shape: Annotated[
        bool, typer.Option("--shape", help="Move B onto A by the best similarity first: its frame and scale do not count.")
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random numbers.")] = 0,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")] = False,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Print the stages.")] = False,
) -> None:
    """Compare two rigs on people: which of them places the people of a recording more consistently, and by how much.

    Each camera's people are compared with where the other cameras put them. A scene file is calibrated first to associate its
    people; the poses from that are not used. Both rigs need z up and the ground at z = 0, in metres, unless --shape is given.
    """
    from passerby.calibration.rig_comparison import compare_rigs
    from passerby.cli.tables import show_people_comparison
    from passerby.cli.terminal import stages
    from passerby.common.parallel import open_local_processes
    from passerby.interchange.calibration_json import CALIBRATION_FILE
    from passerby.interchange.output_folder import read_rig_at
    from passerby.interchange.storage.text_formats import to_json
    from passerby.scene.scene import Scene

    rigs = read_rig_at(first), read_rig_at(second)
    source = people if (people / CALIBRATION_FILE).is_file() else Scene.load(people)
    size = (source.size_bytes, len(source.cameras), source.n_videos) if isinstance(source, Scene) else (0, 0, 0)
    with stages(verbose or bool(context.obj)) as tell, open_local_processes(*size) as executor:
        found = compare_rigs(*rigs, source, shape=shape, seed=seed, progress=tell, executor=executor)
    if json:
        print(to_json(found.to_dict()), end="")
    else:
        show_people_comparison(found)
