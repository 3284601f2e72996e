"""Writing of a calibration into its output folder, with the folders of further groups."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Protocol, Self

from passerby.common.errors import InputError
from passerby.common.progress import Progress
from passerby.core.cameras import Rig
from passerby.core.observations import CameraObservations, Observations
from passerby.interchange.calibration_json import CALIBRATION_FILE, CalibrationDocument, read_document, write_document
from passerby.interchange.coco import write_keypoints
from passerby.interchange.motchallenge import write_boxes
from passerby.interchange.output_folder import (
    GROUPS_FOLDER,
    REPORT_FILE,
    RIG_FILE,
    TRACKS_FOLDER,
    checksums,
    group_folder,
    remove_report_parts,
    report_files,
)
from passerby.interchange.rig_toml import write_rig
from passerby.interchange.storage.atomic import forget_halves
from passerby.interchange.storage.transaction import folder_lock, transaction
from passerby.report.contents import Contents

WORK = "passerby calibrate"

WHOLE = "all other results in {0} are complete and can be used; `passerby report {0}` writes the report again"


class Writable(Protocol):
    """The parts of a calibration from which its files are written."""

    @property
    def rig(self) -> Rig:
        """All cameras."""
        ...

    @property
    def observations(self) -> Observations:
        """Observations of the people, with their identities."""
        ...

    @property
    def group(self) -> int:
        """Number among the groups of cameras; 1 is the main rig."""
        ...

    @property
    def groups(self) -> Sequence[Self]:
        """Further groups."""
        ...

    def document(self, files: Mapping[str, str] | None = None) -> CalibrationDocument:
        """Return its `calibration.json`, with the checksums of the files beside it."""
        ...

    def contents(self) -> Contents:
        """Return the contents of its report."""
        ...


def write_calibration(calibration: Writable, folder: Path, *, report: bool = True, progress: Progress | None = None) -> None:
    """Lock the folder for this process and write a calibration as `write_results` does.

    Raises `InputError` if the folder is not writable, or if another process works in it.
    """
    with folder_lock(folder, WORK):
        write_results(calibration, folder, report=report, progress=progress)


def write_results(calibration: Writable, folder: Path, *, report: bool = True, progress: Progress | None = None) -> None:
    """Write a calibration into a folder that is locked for this process.

    The rig, the tracks and `calibration.json` change together, all or none, including those of further groups (`groups/2`,
    ...). `calibration.json` has the checksums of the other files. The reports are written last and can be made again from these
    files. A report of an earlier run is removed. The same input, seed and libraries give the same bytes. Raises `InputError` if
    the folder is not writable.
    """
    cameras = [camera.name for camera in calibration.rig]
    gone = [*_earlier_report(folder, folder), *_earlier_tracks(folder, cameras), *_earlier_groups(folder)]
    with transaction(folder, gone) as new:
        _write_files(calibration, new)
        for one in calibration.groups:
            _write_files(one, new / group_folder(one.group))
        forget_halves(folder / REPORT_FILE)
    _remove_empty_folders(folder)
    if report:
        _write_report(calibration, folder, folder, progress)
        for one in calibration.groups:
            _write_report(one, folder / group_folder(one.group), folder, progress)


def _write_files(calibration: Writable, folder: Path) -> None:
    """Write the tracks, the rig and `calibration.json` of one group of cameras."""
    for camera in calibration.rig:
        _write_seen(folder / TRACKS_FOLDER, camera.name, calibration.observations[camera.name])
    write_rig(folder / RIG_FILE, calibration.rig)
    write_document(folder, calibration.document(checksums(folder)))


def _write_report(calibration: Writable, folder: Path, whole: Path, progress: Progress | None) -> None:
    """Write the report of one group; an error states which results are complete without it."""
    from passerby.report.page import write_report

    try:
        write_report(calibration.contents(), folder / REPORT_FILE, progress)
    except InputError as error:
        raise InputError(f"{error}; {WHOLE.format(whole)}") from error
    except Exception as error:
        error.add_note(WHOLE.format(whole))
        raise


def _write_seen(folder: Path, name: str, seen: CameraObservations) -> None:
    """Write a camera's boxes and joints, if it has any."""
    if len(seen.boxes):
        write_boxes(folder / f"{name}.txt", seen.boxes)
    if len(seen.keypoints):
        write_keypoints(folder / f"{name}.json", seen.keypoints)


def _earlier_tracks(folder: Path, cameras: Iterable[str]) -> list[str]:
    """Return the track files that an earlier run may have left: of these cameras, and those its `calibration.json` lists."""
    ours = [f"{TRACKS_FOLDER}/{name}{ending}" for name in cameras for ending in (".txt", ".json")]
    try:
        files = read_document(folder).files or {}
    except InputError:  # there is no `calibration.json`, or it is broken
        return ours
    return ours + [name for name in files if name.startswith(f"{TRACKS_FOLDER}/") and name.count("/") == 1]


def _earlier_report(group: Path, folder: Path) -> list[str]:
    """Return the paths of a group's report files, relative to the folder."""
    return [path.relative_to(folder).as_posix() for path in report_files(group / REPORT_FILE)]


def _earlier_groups(folder: Path) -> Iterator[str]:
    """Yield the paths of the files of further groups that an earlier run wrote, relative to the folder."""
    for group in (folder / GROUPS_FOLDER).glob("[0-9]*"):
        if not (group / CALIBRATION_FILE).is_file():
            continue  # a folder of the user
        yield from _earlier_report(group, folder)
        for name in (RIG_FILE, CALIBRATION_FILE, *_earlier_tracks(group, ())):
            if (group / name).is_file():
                yield (group / name).relative_to(folder).as_posix()


def _remove_empty_folders(folder: Path) -> None:
    """Remove folders that are now empty, including those of reports; folders with files of the user stay."""
    remove_report_parts(folder / REPORT_FILE)
    for group in (folder / GROUPS_FOLDER).glob("[0-9]*"):
        remove_report_parts(group / REPORT_FILE)
        for place in (group / TRACKS_FOLDER, group):
            with suppress(OSError):
                place.rmdir()
    with suppress(OSError):
        (folder / GROUPS_FOLDER).rmdir()
