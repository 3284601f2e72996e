"""The output folder of a calibration in another frame of the world."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from passerby.calibration.alignment.scene_world import scaled_figures
from passerby.calibration.alignment.world import Aligned
from passerby.common.errors import InputError
from passerby.common.progress import Progress, silent
from passerby.interchange.output_folder import (
    CALIBRATION_FILE,
    FILES,
    REPORT_FILE,
    RIG_FILE,
    TRACKS_FOLDER,
    camera_tables,
    checksum,
    pose_figures,
    read_report,
    unlike,
)
from passerby.interchange.rig_toml import write_rig
from passerby.interchange.storage.atomic import forget_halves, write_text
from passerby.interchange.storage.json_text import plain, to_json
from passerby.interchange.storage.transaction import transaction
from passerby.interchange.storage.whole_folder import whole_folder

OLD_FRAME = {"trajectories": "passerby track"}
"""What other commands leave in an output folder that holds places in the world, and the command that makes it again."""


def write_aligned(out: Path, target: Path, aligned: Aligned, tell: Progress = silent) -> list[str]:
    """Write a whole output folder in another frame, into a new folder or in place; tracks are in pixels and stay as they are.

    The report is made again where there was one.

    Args:
        out: output folder of `passerby calibrate`; locked for this process where it is the target (`together.working_in`).
        target: the same folder, a new one or an empty one.
        aligned: its rig in the new frame.
        tell: told of the report, camera by camera.

    Returns:
        What in the target still shows the old frame, or is not there, one sentence each.

    Raises:
        InputError: `out` is no output folder; `target` holds something else, or cannot be written.
    """
    report = _in_new_frame(out, read_report(out), aligned)
    with_report = (out / REPORT_FILE).is_file()
    old = [name for name in OLD_FRAME if (out / name).exists()]
    if target.resolve() == out.resolve():
        with transaction(out, [REPORT_FILE]) as new:
            _write_moved(new, report, aligned)
            forget_halves(out / REPORT_FILE)
        _report_again(with_report, out, tell)
        return [f"{out / name} still shows the old frame: make it again by `{OLD_FRAME[name]} {out}`" for name in old]
    if target.is_dir() and any(target.iterdir()):
        raise InputError(f"{target}: is not empty: give a new folder, or {out} itself")
    with whole_folder(target, CALIBRATION_FILE, "a calibration") as new:
        if (out / TRACKS_FOLDER).is_dir():
            shutil.copytree(out / TRACKS_FOLDER, new / TRACKS_FOLDER)
        _write_moved(new, report, aligned)
    _report_again(with_report, target, tell)
    return [f"{out / name} shows the old frame: make it in the new one by `{OLD_FRAME[name]} {target}`" for name in old]


def _write_moved(folder: Path, report: Mapping[str, Any], aligned: Aligned) -> None:
    """What changes with the frame: the rig, and the report with the rig's checksum."""
    write_rig(folder / RIG_FILE, aligned.rig)
    files = {FILES: {**report[FILES], RIG_FILE: checksum(folder / RIG_FILE)}} if FILES in report else {}
    write_text(folder / CALIBRATION_FILE, to_json({**report, **files}))


def _report_again(wanted: bool, folder: Path, tell: Progress) -> None:
    """Make the folder's report, if it is wanted."""
    if wanted:
        from passerby.report.contents import contents_from
        from passerby.report.page import write_report

        write_report(contents_from(folder), folder / REPORT_FILE, tell)


def _in_new_frame(out: Path, report: Mapping[str, Any], aligned: Aligned) -> dict[str, Any]:
    """What `calibration.json` tells, in the new frame."""
    tables = camera_tables(out, report)
    missing = [name for name in aligned.rig.names if name not in tables]
    if missing:
        raise unlike(out, f"it has no camera {missing[0]}, which {RIG_FILE} has")
    moved = {camera.name: plain(pose_figures(camera)) for camera in aligned.rig}
    figures = report.get("figures")
    return {
        **report,
        "cameras": [{**table, **moved.get(name, {})} for name, table in tables.items()],
        "figures": scaled_figures(figures, aligned.motion.scale) if isinstance(figures, Mapping) else figures,
        "world": plain(aligned.figures),
    }
