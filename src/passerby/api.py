"""Functions that `import passerby` offers besides `calibrate`: rigs of other tools, the world frame, errors, trajectories."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

from passerby.calibration.alignment.world import Aligned, align_to_camera, align_to_points, align_to_positions
from passerby.calibration.calibration import Calibration
from passerby.calibration.following import folder_clocks, people_of_folder, track_options, trajectories_by_rig
from passerby.calibration.rig_comparison import compare_rigs as on_people
from passerby.common.errors import EvidenceError, InputError, PasserbyError
from passerby.common.progress import Progress
from passerby.core.cameras import Rig
from passerby.core.observations import Clock
from passerby.core.scale_cues import KnownPoint, KnownPosition
from passerby.core.trajectories import Trajectories
from passerby.evaluation.metrics import Comparison, compare_measuring
from passerby.evaluation.on_people import PeopleComparison
from passerby.interchange.formats import Export, Given, export, find_format, read_rig_as
from passerby.interchange.output_folder import OutputFolder, read_output, read_rig_at, read_tracks_at
from passerby.interchange.world_files import read_known_points, read_known_positions
from passerby.monitoring.given_rig import GivenRig, read_given
from passerby.monitoring.monitor import monitor as watch_rig
from passerby.monitoring.result import MonitoringResult
from passerby.monitoring.watched import WatchOptions
from passerby.people.trajectories import trajectories as following
from passerby.people.trajectories.trajectories import METHODS, Method, TrackOptions
from passerby.scene.scene import Scene

RigLike = Rig | Calibration | OutputFolder | str | Path


def read_calibration(folder: str | Path) -> OutputFolder:
    """Read a calibration that was written into a folder: its rig, verdict, boxes and clocks.

        passerby.read_calibration("out").rig["C1"].centre

    Raises:
        InputError: a file is missing or broken; the message has its name and the remedy.
        EvidenceError: the calibration was refused, or no camera has a pose.
    """
    return read_output(Path(folder))


def export_rig(rig: RigLike, format: str, path: str | Path, *, name: str = "rig", lossy: bool = False) -> tuple[str, ...]:
    """Write a rig for another tool, as `passerby export` does.

        passerby.export_rig("out", "colmap", "for_colmap")

    PLY and glTF also draw the people, if `rig` is a calibration or an output folder with tracks.

    Args:
        rig: a rig, a calibration, or the path of a rig file or an output folder.
        format: name of a format that `passerby formats` lists.
        path: the file or folder to write.
        name: name of the scene, for formats that have a place for it.
        lossy: continue where the format cannot hold everything.

    Returns:
        One sentence for each loss of information.

    Raises:
        InputError: the format is unknown or cannot hold the rig, or the path cannot be written.
    """
    people, why = _people(rig) if find_format(format).draws_people else (None, "")
    lost = export(Export(_rig(rig), name, people), format, path, lossy=lossy)
    return (*lost, f"no people are drawn: {why}") if why else lost


def import_rig(
    path: str | Path, format: str, *, size: tuple[int, int] | None = None, metres_per_unit: float | None = None,
    lossy: bool = False,
) -> Rig:  # fmt: skip
    """Read cameras from another tool's file or folder, as `passerby import` does.

        passerby.import_rig("for_colmap", "colmap")

    Args:
        path: the file or folder.
        format: name of a format that `passerby formats` lists.
        size: (width, height) of the images, pixels, if the file does not state it.
        metres_per_unit: length of the file's unit, if the file does not state lengths in metres.
        lossy: continue where not everything in the file can be kept; a warning (`UserWarning`) lists the losses.

    A warning also lists data of the file that a rig has no place for, such as residuals.

    Raises:
        InputError: the format is unknown, or the file cannot be read in this format.
    """
    given = Given(size, metres_per_unit)
    rig, losses = read_rig_as(format, Path(path), given, lossy=lossy)
    for told in (*(f"lost: {loss}" for loss in losses), *given.unread.told):
        warnings.warn(f"{path}: {told}", stacklevel=2)
    return rig


def evaluate(
    rig: RigLike, truth: RigLike, reference: str | None = None, *, people: str | Path | None = None
) -> Comparison:  # fmt: skip
    """Compute the errors of a rig against the true rig, as `passerby evaluate` does.

        passerby.evaluate("out", "truth.toml", people="out").measured.points.median_mm

    Args:
        rig: the rig to evaluate: a rig, a calibration, or the path of a rig file or an output folder.
        truth: the rig with the true poses, given in the same ways.
        reference: the camera at which the rigs are aligned with the scale kept; None: the first.
        people: an output folder, or its folder `tracks`: points are measured where people walked. None: on a grid.

    Raises:
        InputError: no camera has a pose in both rigs, the reference has none, or `people` holds neither boxes nor keypoints.
    """
    return compare_measuring(_rig(rig), _rig(truth), reference, None if people is None else read_tracks_at(Path(people)))


def compare_rigs(
    first: RigLike, second: RigLike, people: Scene | str | Path, *, shape: bool = False, seed: int = 0,
    progress: Progress | None = None,
) -> PeopleComparison:  # fmt: skip
    """Find which of two rigs of the same cameras places people more consistently, as `passerby compare` does.

        passerby.compare_rigs("out", "last_year.toml", "today.toml").better

    Args:
        first: a rig, a calibration, or the path of a rig file or an output folder.
        second: the other rig, given in the same ways.
        people: a scene, or its file, of a recording from which neither rig was made; or the output folder of its calibration.
        shape: first move the second rig onto the first by the best similarity, so that its frame and scale do not count.
        seed: random seed of the calibration of the scene.
        progress: as in `calibrate`.

    Raises:
        InputError: a file is missing or broken, or the rigs have fewer than two cameras in common.
        EvidenceError: there are too few people, or their identities could not be found.
    """
    return on_people(_rig(first), _rig(second), people, shape=shape, seed=seed, progress=progress)


def trajectories(
    calibration: Calibration | OutputFolder | str | Path, *, method: Method = "smoothed", max_gap_s: float = 2.0,
    fps: float | None = None,
) -> Trajectories:  # fmt: skip
    """Compute the trajectory of every person on the ground, as `passerby track` does.

        found = passerby.trajectories("out")
        found.xyz[found.identity == found.people[0]]

    Args:
        calibration: a calibration, or the output folder into which it was written, or the path of this folder.
        method: smoothed, or pairwise as in the paper.
        max_gap_s: longest gap between observations of a person that is bridged, seconds.
        fps: frame rate, frames per second, if the calibration does not state it.

    Raises:
        InputError: the frame rate is unknown, or an option is out of range.
        EvidenceError: no camera has a pose, or no box has an identity.
    """
    if method not in METHODS:
        raise InputError(f"method {method!r} does not exist: choose one of {', '.join(METHODS)}")
    if not isinstance(calibration, Calibration):
        folder = calibration if isinstance(calibration, OutputFolder) else read_output(Path(calibration))
        return trajectories_by_rig(folder, folder.rig, folder_clocks(folder, fps), track_options(folder, method, max_gap_s))
    names = calibration.rig.posed().names
    if not names:
        raise EvidenceError("no camera has a pose: no person can be tracked")
    told = calibration.association.clocks if calibration.association else {}
    rate = fps or calibration.scene.scene.fps
    if not told and rate is None:
        raise InputError("the calibration has no frame rate: give fps")
    clocks = {name: told[name] if told else Clock(rate or 1.0) for name in names}
    options = TrackOptions(method, max_gap_s, calibration.scene.scale.person_height_m)
    return following.trajectories(calibration.rig, calibration.observations, clocks, options)


def monitor(
    rig: RigLike, scene: Scene | str | Path, *, every_s: float = 60.0, budget_s: float | None = None, in_step: bool = False,
    keep: str | Path | None = None, progress: Progress | None = None,
) -> MonitoringResult:  # fmt: skip
    """Test whether cameras have moved since they were calibrated, as `passerby monitor` does.

        found = passerby.monitor("out", "today.toml")
        found.sentences()
        passerby.write_rig("new.toml", found.rig)

    Args:
        rig: a rig, a calibration, or the path of a rig file or an output folder.
        scene: new footage of its cameras, under the same names: a scene, or the path of a scene file.
        every_s: seconds of footage that are tested at once.
        budget_s: processor seconds for each camera and minute of recording; None: 1 for rigs of more than twelve cameras.
        in_step: whether the clocks of the footage are synchronised, independent of those of the calibration.
        keep: folder that caches the detections in videos. If it has the `monitor.json` and `rig.toml` of an earlier run,
            cameras without new footage are not read again.
        progress: called with each stage.

    Raises:
        InputError: the scene cannot be read, its cameras are not the rig's, or `every_s` or `budget_s` is out of range.
    """
    return watch_rig(
        _given(rig), scene, WatchOptions(every_s=every_s, budget_s=budget_s), in_step=in_step, keep=keep, progress=progress
    )


def _given(rig: RigLike) -> GivenRig:
    """Return the rig with the data of its calibration that monitoring uses, such as the time offsets of the clocks."""
    if isinstance(rig, Rig):
        return GivenRig(rig)
    if isinstance(rig, Calibration):
        clocks = rig.association.clocks if rig.association else {}
        return GivenRig(rig.rig, {name: clock.offset_s for name, clock in clocks.items()})
    return read_given(rig.path if isinstance(rig, OutputFolder) else Path(rig))


def align(
    rig: RigLike, *, camera: str | None = None, towards: str | None = None,
    points: str | Path | Sequence[KnownPoint] | None = None, positions: str | Path | Sequence[KnownPosition] | None = None,
    geodetic: bool = False, scale: bool = False, tilt: bool = False,
) -> Aligned:  # fmt: skip
    """Transform a rig into another world frame, as `passerby align` does.

        aligned = passerby.align("out", camera="C1")
        passerby.write_rig("aligned.toml", aligned.rig)

    Args:
        rig: a rig, a calibration, or the path of a rig file or an output folder.
        camera: origin on the ground below this camera, x axis along its viewing direction.
        towards: with `camera`: x axis towards this other camera.
        points: points with known coordinates, or a file of them.
        positions: known positions of cameras, or a file of them.
        geodetic: whether positions that are not a file are latitude, longitude and altitude.
        scale: whether points or positions also set the scale.
        tilt: whether they also set the up direction and the height.

    Raises:
        InputError: not exactly one of camera, points and positions is given; the rig does not have a named camera; or the
            coordinates are left-handed.
        EvidenceError: the points or positions do not determine the frame, or a camera has no pose.
    """
    if sum(way is not None for way in (camera, points, positions)) != 1:
        raise InputError("give one of camera, points, positions")
    if camera is not None:
        if scale or tilt:
            raise InputError("scale and tilt need points or positions: a camera determines neither")
        return align_to_camera(_rig(rig), camera, towards)
    if towards is not None:
        raise InputError("towards needs camera")
    if points is not None:
        known = read_known_points(points) if isinstance(points, str | Path) else points
        return align_to_points(_rig(rig), known, with_scale=scale, tilt=tilt)
    assert positions is not None
    if isinstance(positions, str | Path):
        places, geodetic = read_known_positions(positions)
    else:
        places = tuple(positions)
    return align_to_positions(_rig(rig), places, geodetic=geodetic, with_scale=scale, tilt=tilt)


def _people(given: RigLike) -> tuple[Trajectories | None, str]:
    """Return the trajectories of the people of a calibration, or None and the reason; None and "" for a rig without people."""
    if isinstance(given, Calibration):
        try:
            return trajectories(given), ""
        except PasserbyError as error:
            return None, str(error)
    if isinstance(given, Rig) or (not isinstance(given, OutputFolder) and not Path(given).is_dir()):
        return None, ""
    return people_of_folder(given if isinstance(given, OutputFolder) else Path(given))


def _rig(given: RigLike) -> Rig:
    """Return the rig of a calibration or an output folder, the rig itself, or the rig that is read from a path."""
    if isinstance(given, Calibration | OutputFolder):
        return given.rig
    if isinstance(given, Rig):
        return given
    return read_rig_at(Path(given))
