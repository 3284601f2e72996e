"""Geometry of clicks with a rig: epipolar lines, points on the ground, the x axis, and the same person in other cameras.

World: z up, ground at z = 0, metres. Pixels follow OpenCV: (0, 0) is the centre of the first pixel.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from passerby.calibration.alignment.places import CLICK_SD_PX, angle_sd, position_sds
from passerby.common.arrays import Floats
from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Camera, Pose, Rig
from passerby.core.observations import Boxes, CameraObservations, Clock
from passerby.core.pointing import find_nearest_frame, find_pointed
from passerby.geometry.rotations import exp_rotation
from passerby.interchange.calibration_json import CALIBRATION_FILE
from passerby.interchange.output_folder import OutputFolder, read_output

NEAREST_M, FARTHEST_M, SAMPLES = 0.3, 300.0, 160
"""Range and number of the distances along a ray that are drawn in other pictures, evenly spaced in their logarithm."""
BAND_SIGMAS = 2.0
"""Half of the band's width in sigmas: it contains 95 % of all clicks and rigs."""
SAME_RAY = 1e-3
"""Largest angle, radians, between a point's ray and the ray of its pixel. Points that a lens model folds into the picture from
beyond its range exceed it, and are not drawn."""
NEAREST_AXIS_M = 0.5
"""Smallest distance between the two clicks of an axis: closer clicks give no heading."""
STEP = 1e-4
"""Step of numerical derivatives, metres and radians."""
Pixel = tuple[float, float]
MOST_SHOWN = 12
"""Most other cameras whose pictures are shown at the same time: each picture has to be decoded."""


@dataclass(frozen=True)
class EpipolarLine:
    """The possible positions in another picture of a point in one picture."""

    camera: str
    line: tuple[tuple[Pixel, float], ...]
    """Pixels along the curve, each with the half width of the band, pixels perpendicular to the curve."""


@dataclass(frozen=True)
class MeasuredAxis:
    """An axis by two clicks on the ground, as the current rig measures it."""

    metres: float
    """Distance between the clicks."""
    heading_sigma_deg: float
    """Sigma of the direction from the first to the second click, from the errors of the clicks alone."""


def epipolar_lines(rig: Rig, name: str, at: Pixel) -> tuple[EpipolarLine, ...]:
    """Compute the epipolar lines of a pixel in all other cameras with poses, with the distortion of their lenses.

    The half width is `BAND_SIGMAS` sigma of the click (2 px) and of both poses, without the common uncertainty of the scale.

    Raises `InputError` for a camera without a pose or a pixel that its lens cannot see.
    """
    camera = _camera(rig, name)
    ray_c = _ray(camera, at)
    own = position_sds(rig, True)
    distances = np.geomspace(NEAREST_M, FARTHEST_M, SAMPLES)
    lines = []
    for other in rig.posed():
        if other.name == name:
            continue
        pixels = _project_along_ray(camera, other, ray_c, distances)
        variance = np.zeros(len(distances))
        across = _find_normals(pixels)
        for moved, seen_by, turned, sd in _perturb_cameras(camera, other, ray_c, own):
            shift = (_project_along_ray(moved, seen_by, turned, distances) - pixels) / STEP * sd
            with np.errstate(invalid="ignore"):
                variance += np.nan_to_num((shift * across).sum(axis=1)) ** 2
        width, height = other.lens.size
        inside = (pixels > -0.05 * width).all(axis=1) & (pixels < [1.05 * width, 1.05 * height]).all(axis=1)
        line = tuple(
            ((round(float(u), 2), round(float(v), 2)), round(BAND_SIGMAS * float(np.sqrt(var)), 2))
            for (u, v), var in zip(pixels[inside], variance[inside], strict=True)
        )
        lines.append(EpipolarLine(other.name, line))
    return tuple(lines)


def ground_point(rig: Rig, name: str, at: Pixel) -> Floats:
    """Return the point (3,) where the ray of a pixel meets the ground, metres.

    Raises `InputError` for a camera without a pose, or a pixel at or above the horizon.
    """
    camera = _camera(rig, name)
    assert camera.pose is not None
    ray = camera.pose.R_cw.T @ _ray(camera, at)
    if ray[2] > -1e-3:
        raise InputError(f"camera {name}: [{at[0]:.1f}, {at[1]:.1f}] is not on the ground but above the horizon: click lower")
    centre = camera.centre
    return np.asarray(centre - ray * (centre[2] / ray[2]))


def measure_axis(rig: Rig, clicks: Sequence[tuple[str, Pixel]]) -> MeasuredAxis:
    """Measure the x axis from one click on the ground, (camera, pixel), to another one.

    Raises as `ground_point` does, and `InputError` for clicks that are too close.
    """

    def between(moved: Sequence[tuple[str, Pixel]]) -> Floats:
        first, second = (ground_point(rig, name, at)[:2] for name, at in moved)
        return np.asarray(second - first)

    along = between(clicks)
    metres = float(np.linalg.norm(along))
    if metres < NEAREST_AXIS_M:
        raise InputError(f"the two clicks are {100 * metres:.0f} cm from each other: click a point of the x axis farther away")
    variance = 0.0
    for number in range(2):
        for axis in range(2):
            moved = list(clicks)
            name, (u, v) = clicks[number]
            moved[number] = name, (u + 0.5, v) if axis == 0 else (u, v + 0.5)
            there = between(moved)
            turn = np.arctan2(along[0] * there[1] - along[1] * there[0], float(along @ there))
            variance += (float(turn) / 0.5 * CLICK_SD_PX) ** 2
    return MeasuredAxis(metres, float(np.degrees(np.sqrt(variance))))


def _camera(rig: Rig, name: str) -> Camera:
    """Return a camera with a pose. Raises `EvidenceError` if it has none."""
    if name not in rig.names or rig[name].pose is None:
        raise EvidenceError(f"camera {name} has no pose yet: calibrate first")
    return rig[name]


def _ray(camera: Camera, at: Pixel) -> Floats:
    """Return the unit ray (3,) of a pixel in the camera's frame."""
    ray = np.asarray(camera.lens.bearings(np.array([at]))[0])
    if not np.isfinite(ray).all():
        raise InputError(f"camera {camera.name}: [{at[0]:.1f}, {at[1]:.1f}] is outside what its lens can see: choose another")
    return ray


def _project_along_ray(camera: Camera, other: Camera, ray_c: Floats, distances: Floats) -> Floats:
    """Return the pixels (N, 2) in `other` of points at distances (N,) along a ray of `camera`; NaN where it sees none."""
    assert camera.pose is not None
    assert other.pose is not None
    points = camera.centre + distances[:, None] * (camera.pose.R_cw.T @ ray_c)
    pixels = other.project(points)
    local = points @ other.pose.R_cw.T + other.pose.t_cw
    local /= np.linalg.norm(local, axis=1, keepdims=True)
    with np.errstate(invalid="ignore"):
        seen = other.lens.bearings(np.where(np.isfinite(pixels), pixels, 0.0))
        good = np.isfinite(pixels).all(axis=1) & (np.linalg.norm(seen - local, axis=1) < SAME_RAY)
    return np.where(good[:, None], pixels, np.nan)


def _find_normals(pixels: Floats) -> Floats:
    """Return the unit normals (N, 2) of a curve of pixels (N, 2)."""
    along = np.gradient(pixels, axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        along = along / np.linalg.norm(along, axis=1, keepdims=True)
    return np.column_stack([-along[:, 1], along[:, 0]])


def _perturb_cameras(
    camera: Camera, other: Camera, ray_c: Floats, own: Mapping[str, float]
) -> list[tuple[Camera, Camera, Floats, float]]:
    """Return, for each unknown, both cameras and the ray with this unknown moved by `STEP`, and the unknown's sigma."""
    click = CLICK_SD_PX / camera.lens.focal
    found = []
    helper = np.eye(3)[int(np.argmin(np.abs(ray_c)))]
    first = np.cross(ray_c, helper) / np.linalg.norm(np.cross(ray_c, helper))
    for axis in (first, np.cross(ray_c, first)):
        found.append((camera, other, ray_c + STEP * axis, click))
    for axis in np.eye(3):
        found.append((_shift_camera(camera, axis), other, ray_c, own[camera.name]))
        found.append((camera, _shift_camera(other, axis), ray_c, own[other.name]))
        found.append((_turn_camera(camera, axis), other, ray_c, angle_sd(camera)))
        found.append((camera, _turn_camera(other, axis), ray_c, angle_sd(other)))
    return found


def _shift_camera(camera: Camera, axis: Floats) -> Camera:
    assert camera.pose is not None
    return replace(camera, pose=Pose.from_centre(camera.pose.R_cw, camera.centre + STEP * axis))


def _turn_camera(camera: Camera, axis: Floats) -> Camera:
    assert camera.pose is not None
    return replace(camera, pose=Pose.from_centre(exp_rotation(STEP * axis) @ camera.pose.R_cw, camera.centre))


@dataclass(frozen=True)
class SeenPerson:
    """The person in one camera, at the time nearest to that of the click."""

    camera: str
    frame: int
    box: tuple[float, float, float, float]
    """Left, top, width, height, pixels."""
    size: tuple[int, int]
    """Width and height of the whole picture, pixels."""
    late_s: float | None
    """Time after the click, seconds; None if the cameras have the same frame numbers and no clocks."""
    late_frames: int
    """Time after the click in frames of this camera."""


@dataclass(frozen=True)
class SamePerson:
    """One identity of the last calibration."""

    identity: int | None
    """None if no identified person is at the pixel."""
    seen: tuple[SeenPerson, ...] = ()
    """The camera of the click, then at most `MOST_SHOWN` others, the nearest in time first."""
    further: tuple[str, ...] = ()
    """Further cameras that saw the person."""
    unseen: tuple[str, ...] = ()
    """Cameras that never saw the person."""

    def to_dict(self) -> dict[str, object]:
        """Return the fields as plain values for JSON."""
        return asdict(self)


@dataclass(eq=False)
class IdentifiedPeople:
    """All people that the calibration in a folder identified; read once for each calibration."""

    out: Path
    _read: tuple[tuple[int, int], OutputFolder] | None = None
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def find(self, camera: str, frame: int, at: tuple[float, float]) -> SamePerson:
        """Find the person at a pixel of a camera's frame.

        Raises `InputError` if there is no calibration, or the camera has no pose in it.
        """
        folder = self._folder()
        if camera not in folder.boxes:
            raise InputError(
                f"camera {camera} has no pose in the last calibration, so it has no identified people: solve again"
            )
        return find_same_person(folder, camera, frame, at)

    def _folder(self) -> OutputFolder:
        """Return the current calibration; it is read again after a change."""
        with self._lock:
            try:
                stat = (self.out / CALIBRATION_FILE).stat()
            except OSError:
                raise InputError("no person is identified yet: calibrate first") from None
            stamp = stat.st_mtime_ns, stat.st_size
            if self._read is None or self._read[0] != stamp:
                self._read = stamp, read_output(self.out)
            return self._read[1]


def find_same_person(folder: OutputFolder, camera: str, frame: int, at: tuple[float, float]) -> SamePerson:
    """Find the person at a pixel of a camera's frame, in all cameras.

    The frame nearest to the given one with boxes is used, as for a known height at this pixel. Pixels follow OpenCV.
    """
    own, clock = folder.boxes[camera], folder.clocks.get(camera)
    near = find_nearest_frame(CameraObservations(own), frame, None if clock is None else clock.fps)
    pointed = None if near is None else find_pointed(CameraObservations(own), near, at)
    if near is None or pointed is None:
        return SamePerson(None)
    row = pointed[1]
    identity = int(own.identity[row])
    first = _compare_row(folder, camera, own, row, near, clock)
    others, unseen = [], []
    for name in folder.rig.names:
        found = None if name == camera else _find_nearest(folder, name, identity, near, clock)
        if found is not None:
            others.append(found)
        elif name != camera:
            unseen.append(name)
    others.sort(key=lambda one: abs(one.late_frames if one.late_s is None else one.late_s))
    further = tuple(one.camera for one in others[MOST_SHOWN:])
    return SamePerson(identity, (first, *others[:MOST_SHOWN]), further, tuple(unseen))


def _find_nearest(folder: OutputFolder, name: str, identity: int, frame: int, clock: Clock | None) -> SeenPerson | None:
    """Find the box of an identity in another camera that is nearest in time to `frame` of the camera with this `clock`."""
    boxes, other = folder.boxes[name], folder.clocks.get(name)
    rows = np.flatnonzero(boxes.identity == identity)
    if not len(rows):
        return None
    wanted = float(frame)
    if clock is not None and other is not None:
        wanted = float(other.frames(clock.seconds(np.array([frame])))[0])
    row = int(rows[np.argmin(np.abs(boxes.frame[rows] - wanted))])
    return _compare_row(folder, name, boxes, row, wanted, other)


def _compare_row(folder: OutputFolder, name: str, boxes: Boxes, row: int, wanted: float, clock: Clock | None) -> SeenPerson:
    """Return a row of a camera's boxes with its delay after the wanted frame."""
    late = float(boxes.frame[row]) - wanted
    left, top, width, height = (round(float(value), 1) for value in boxes.ltwh[row])
    late_s = None if clock is None else round(late / clock.fps, 3)
    return SeenPerson(name, int(boxes.frame[row]), (left, top, width, height), folder.rig[name].lens.size, late_s, round(late))
