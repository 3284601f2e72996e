"""Writing of a calibration's output folder in another world frame."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from passerby.calibration.alignment.scene_world import scaled_figures
from passerby.calibration.alignment.world import Aligned
from passerby.common.errors import InputError
from passerby.common.progress import Progress, silent
from passerby.interchange.calibration_json import (
    CALIBRATION_FILE,
    CalibrationDocument,
    WorldEntry,
    entry_of,
    write_document,
)
from passerby.interchange.output_folder import (
    REPORT_FILE,
    RIG_FILE,
    TRACKS_FOLDER,
    checksum,
    entries_of,
    read_report,
    remove_report_parts,
    report_files,
)
from passerby.interchange.rig_toml import write_rig
from passerby.interchange.storage.atomic import forget_halves, write_bytes
from passerby.interchange.storage.transaction import transaction, whole_folder

OLD_FRAME = {"trajectories": "passerby track"}
"""Contents of an output folder with world coordinates that other commands wrote -> the command that makes them again."""


def write_aligned(out: Path, target: Path, aligned: Aligned, tell: Progress = silent) -> list[str]:
    """Write a whole output folder in another frame, into a new folder or in place; tracks are in pixels and do not change.

    If there was a report, it is made again.

    Args:
        out: output folder of `passerby calibrate`; if it is the target, the caller must hold its lock (`folder_lock`).
        target: the same folder, a new one or an empty one.
        aligned: its rig in the new frame.
        tell: called with the progress of the report, camera by camera.

    Returns:
        One sentence for each part of the folder, and for each group, that still has the old frame or was not written.

    Raises:
        InputError: `out` is no output folder; or `target` has other contents, or cannot be written.
    """
    document = _in_new_frame(out, read_report(out), aligned)
    with_report = (out / REPORT_FILE).is_file()
    old = [name for name in OLD_FRAME if (out / name).exists()]
    apart = [
        f"group {one.group} keeps its own frame: align {out / one.folder} by itself" for one in document.groups or ()
    ]  # fmt: skip
    if target.resolve() == out.resolve():
        with transaction(out, [path.relative_to(out).as_posix() for path in report_files(out / REPORT_FILE)]) as new:
            _write_moved(new, document, aligned)
            forget_halves(out / REPORT_FILE)
        remove_report_parts(out / REPORT_FILE)
        _report_again(with_report, out, tell)
        again = [f"{out / name} still uses the old frame: write it again with `{OLD_FRAME[name]} {out}`" for name in old]
        return [*again, *apart]
    if target.is_dir() and any(target.iterdir()):
        raise InputError(f"{target}: is not empty: give a new folder, or {out} itself")
    with whole_folder(target, CALIBRATION_FILE, "a calibration") as new:
        for path in sorted((out / TRACKS_FOLDER).glob("*.*")):
            write_bytes(new / TRACKS_FOLDER / path.name, path.read_bytes())
        # Folders of further groups are not copied.
        _write_moved(new, replace(document, groups=None), aligned)
    _report_again(with_report, target, tell)
    again = [f"{out / name} uses the old frame: write it in the new one with `{OLD_FRAME[name]} {target}`" for name in old]
    return [*again, *apart]


def _write_moved(folder: Path, document: CalibrationDocument, aligned: Aligned) -> None:
    """Write the files that change with the frame: the rig, and the document with the rig's checksum."""
    write_rig(folder / RIG_FILE, aligned.rig)
    files = None if document.files is None else {**document.files, RIG_FILE: checksum(folder / RIG_FILE)}
    write_document(folder, replace(document, files=files))


def _report_again(wanted: bool, folder: Path, tell: Progress) -> None:
    """Make the folder's report, if it is wanted."""
    if wanted:
        from passerby.report.contents import contents_from
        from passerby.report.page import write_report

        write_report(contents_from(folder), folder / REPORT_FILE, tell)


def _in_new_frame(out: Path, document: CalibrationDocument, aligned: Aligned) -> CalibrationDocument:
    """Return the contents of `calibration.json` in the new frame."""
    entries, names = entries_of(out, document, aligned.rig), aligned.rig.names
    return replace(
        document,
        cameras=tuple(one.with_pose(aligned.rig[name]) if name in names else one for name, one in entries.items()),
        figures=scaled_figures(document.figures, aligned.motion.scale),
        world=entry_of(WorldEntry, aligned.figures),
    )
