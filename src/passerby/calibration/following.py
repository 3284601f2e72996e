"""Trajectories of people on the ground, from the output folder of a calibration."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from passerby.common.errors import InputError, PasserbyError
from passerby.common.progress import Progress, silent
from passerby.core.cameras import Rig
from passerby.core.observations import CameraObservations, Clock, Observations
from passerby.core.quarter_turns import turn_observations, turn_rig, turns_of
from passerby.core.trajectories import Trajectories
from passerby.interchange.calibration_json import CALIBRATION_FILE
from passerby.interchange.output_folder import TRACKS_FOLDER, OutputFolder, read_output
from passerby.people.trajectories.trajectories import METHODS, TrackOptions, trajectories


def trajectories_of_result(folder: OutputFolder, *, fps: float | None = None, tell: Progress = silent) -> Trajectories:
    """Compute the trajectories of all people, as `passerby track` does without options.

    Raises `InputError` if there are no boxes, or if neither the calibration nor `fps` gives the frame rate.
    """
    return trajectories_by_rig(folder, folder.rig, folder_clocks(folder, fps), track_options(folder), tell)


def people_of_folder(folder: OutputFolder | Path, tell: Progress = silent) -> tuple[Trajectories | None, str]:
    """Compute the trajectories of all people in an output folder, without raising an error if there are none.

    Returns:
        The trajectories and an empty text; or None and the reason: the frame rate is not known, there are no boxes, or no box
        has an identity. None and an empty text for a folder that is no output folder: it only contains a rig file.
    """
    if isinstance(folder, Path) and not ((folder / CALIBRATION_FILE).is_file() and (folder / TRACKS_FOLDER).is_dir()):
        return None, ""
    try:
        return trajectories_of_result(read_output(folder) if isinstance(folder, Path) else folder, tell=tell), ""
    except PasserbyError as error:
        return None, str(error)


def track_options(folder: OutputFolder, method: str = "smoothed", max_gap: float = 2.0) -> TrackOptions:
    """Return the options of tracking, with the typical height of the calibration. Raises `InputError` for invalid values."""
    chosen = next((one for one in METHODS if one == method), None)
    if chosen is None:
        raise InputError(f"--method {method!r}: choose one of {', '.join(METHODS)}")
    if not 0 <= max_gap <= 60:
        raise InputError(f"--max-gap {max_gap:g}: give seconds from 0 to 60")
    height = folder.person_height_m
    usual = TrackOptions(chosen, max_gap)
    return usual if height is None else TrackOptions(chosen, max_gap, height)


def folder_clocks(folder: OutputFolder, fps: float | None = None) -> dict[str, Clock]:
    """Return each camera's clock; `fps` is used if the calibration has no frame rate. Raises `InputError` without both."""
    if fps is not None and not 0 < fps <= 1000:
        raise InputError(f"--fps {fps:g}: give frames per second, above 0 and at most 1000")
    if folder.clocks:
        return dict(folder.clocks)
    rate = fps or folder.fps
    if rate is None:
        raise InputError(
            f"{folder.path}: the calibration has no frame rate: give it with --fps, or under [scene] set fps to "
            "it and calibrate again"
        )
    return {name: Clock(rate) for name in folder.rig.names}


def trajectories_by_rig(
    folder: OutputFolder, rig: Rig, clocks: Mapping[str, Clock], options: TrackOptions, tell: Progress = silent
) -> Trajectories:
    """Compute the trajectories from the folder's boxes and a rig, both as filmed. Raises `InputError` without boxes."""
    if not any(len(boxes) for boxes in folder.boxes.values()):
        raise InputError(
            f"{folder.path / 'tracks'}: holds no box: people are tracked by boxes; calibrate with boxes, or with both"
        )
    seen = Observations({name: CameraObservations(boxes) for name, boxes in folder.boxes.items()})
    turns = turns_of(folder.rig)
    seen = turn_observations(seen, folder.rig, turns)
    return trajectories(turn_rig(rig, turns), seen, clocks, options, tell=tell)
