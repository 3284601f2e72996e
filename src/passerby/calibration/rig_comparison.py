"""Comparison of two rigs of the same cameras on the people of a recording that was used for neither."""

from __future__ import annotations

from concurrent.futures import Executor
from pathlib import Path

from passerby.calibration.calibrate import calibrate
from passerby.common.errors import EvidenceError
from passerby.common.progress import Progress
from passerby.core.cameras import Rig
from passerby.core.observations import Observations
from passerby.core.quarter_turns import turn_observations, turn_rig
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.core.synchronisation import clocks_of, resample_to_common_steps
from passerby.evaluation.on_people import PeopleComparison, compare_on_people
from passerby.interchange.calibration_json import CALIBRATION_FILE
from passerby.interchange.output_folder import TRACKS_FOLDER
from passerby.report.contents import contents_from
from passerby.scene.scene import Scene


def compare_rigs(
    first: Rig, second: Rig, people: Scene | str | Path, *, shape: bool = False, seed: int = 0,
    progress: Progress | None = None, executor: Executor | None = None,
) -> PeopleComparison:  # fmt: skip
    """Compare two rigs by the people of a recording.

    Args:
        first: a rig, metres, z up, the ground at z = 0.
        second: another rig of the same cameras, by name, in the same form.
        people: a scene, or its file, which is calibrated to find identities and clock offsets (its poses are not used); or
            the output folder of a calibration, whose tracks are used.
        shape: whether the second rig is first moved onto the first by the best similarity.
        seed: seed of the calibration.
        progress: as in `calibrate`.
        executor: as in `calibrate`.

    Raises:
        InputError: a file is missing or broken, or the rigs have fewer than two cameras in common.
        EvidenceError: the scene's people could not be associated, or are too few.
    """
    if not isinstance(people, Scene) and (Path(people) / CALIBRATION_FILE).is_file():
        instants, height_m, turns = _people_of_folder(Path(people))
        return compare_on_people(turn_rig(first, turns), turn_rig(second, turns), instants, height_m, shape=shape)
    found = calibrate(people, seed=seed, progress=progress, executor=executor)
    if found.verdict == "refused":
        raise EvidenceError("; ".join(found.reasons))
    turns = found.scene.turns
    instants = turn_observations(found.instants, found.rig, turns)
    height_m = found.scene.scale.person_height_m
    return compare_on_people(turn_rig(first, turns), turn_rig(second, turns), instants, height_m, shape=shape)


def _people_of_folder(folder: Path) -> tuple[Observations, float, dict[str, int]]:
    """Return the people in a calibration's tracks at common time steps, their typical height in metres, and the rotations of
    the cameras that were mounted on their sides, by camera.
    """
    contents = contents_from(folder)
    seen = contents.observations
    names = [name for name in contents.rig.names if (folder / TRACKS_FOLDER).is_dir()]
    sizes = {camera.name: camera.lens.size for camera in contents.rig}
    stated = contents.document.scene.scale.person_height_m
    turns = {name: table.rotate for name, table in contents.document.scene.cameras.items() if table.rotate}
    return resample_to_common_steps(seen, clocks_of(seen, names), sizes=sizes), stated or PERSON_HEIGHT_M, turns
