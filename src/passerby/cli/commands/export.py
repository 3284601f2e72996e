"""`passerby export`: a rig for another tool."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from passerby.common.errors import InputError

if TYPE_CHECKING:
    from passerby.core.trajectories import Trajectories


def export(
    rig: Annotated[Path, typer.Argument(metavar="RIG", help="Rig file (TOML), or the output folder of `passerby calibrate`.")],
    form: Annotated[str, typer.Option("--format", "-f", metavar="FORMAT", help="A format that `passerby formats` lists.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="File or folder to write, depending on the format.")],
    tracks: Annotated[
        Path | None,
        typer.Option(
            help="People's trajectories: trajectories.csv, or an output folder. Default for PLY and glTF: those of RIG, if "
            "it is one."
        ),
    ] = None,
    name: Annotated[str | None, typer.Option(help="Name of the scene in the file; default: the rig file's name.")] = None,
    lossy: Annotated[
        bool, typer.Option("--lossy", help="Continue where the format cannot hold everything; losses are reported.")
    ] = False,
) -> None:
    """Write a rig in the format of another tool.

    What the format cannot hold, such as a lens model or a camera without a pose, is an error unless --lossy is given.
    Uncertainties and the verdict are dropped without a message: no other tool has a place for them.
    """
    from passerby.interchange.formats import Export, find_format
    from passerby.interchange.formats import export as write
    from passerby.interchange.output_folder import RIG_FILE, read_rig_at

    path = rig / RIG_FILE if rig.is_dir() else rig
    loaded = read_rig_at(rig)
    title = name or (rig.resolve().name if rig.is_dir() else rig.stem)
    ways = None
    if tracks is not None:
        ways = _ways(tracks)
    elif rig.is_dir() and find_format(form).draws_people:
        ways = _own_people(rig)
    for loss in write(Export(loaded, title, ways), form, out, lossy=lossy):
        print(f"note: lost: {' '.join(loss.split())}", file=sys.stderr)
    verdict = f", which is {loaded.verdict}" if loaded.verdict not in (None, "accepted") else ""
    if verdict:
        print(f"note: {path} is from a calibration{verdict}: do not rely on it", file=sys.stderr)
    print(f"written to {out}")


def _own_people(folder: Path) -> Trajectories | None:
    """The people of the output folder that the rig is from; None, with a message, if it has none to follow."""
    from passerby.calibration.following import people_of_folder
    from passerby.cli.terminal import stages

    with stages() as tell:
        found, why = people_of_folder(folder, tell)
    if why:
        print(f"note: no people are drawn: {' '.join(why.split())}", file=sys.stderr)
    return found


def _ways(tracks: Path) -> Trajectories:
    """People's trajectories from a CSV file or an output folder."""
    from passerby.calibration.following import trajectories_of_result
    from passerby.cli.terminal import stages
    from passerby.interchange.output_folder import read_output
    from passerby.interchange.trajectories_csv import read_trajectories

    if not tracks.exists():
        raise InputError(f"{tracks}: no such file: give trajectories.csv of `passerby track`, or an output folder")
    if tracks.is_file():
        return read_trajectories(tracks)
    with stages() as tell:
        return trajectories_of_result(read_output(tracks), tell=tell)
