"""Who was seen by which cameras at one instant, as rays in each camera's own frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Rig
from passerby.core.observations import UNKNOWN, Boxes, CameraObservations, Clock, Keypoints, Observations
from passerby.people.model import HEIGHT_PER_CENTRE, Noise, Priors
from passerby.people.upright_rays import upright_rays

Mask = NDArray[np.bool_]

NOISE = Noise(floor_px=0.7)
"""One sigma of a body's middle and of its size: the solver's own noise."""
EVERY_S = 0.4
"""Instants that follow sooner are left out: a body's box errs alike for seconds, so that they say little that is new."""


@dataclass(frozen=True, eq=False)
class RigObservations:
    """N sightings, sorted by group; G groups, each one person at one instant."""

    names: tuple[str, ...]
    """The C cameras."""
    camera: Ints
    """(N,) rows of `names`."""
    group: Ints
    """(N,) 0 to G - 1."""
    person: Ints
    """(G,) identities."""
    seconds: Floats
    """(G,) the rig's time."""
    top: Floats
    """(N, 3) unit rays to the highest point, camera frame."""
    bottom: Floats
    """(N, 3) unit rays to the lowest."""
    fractions: Floats
    """(N, 2) heights of both, as shares of the body's."""
    foot_shift: Floats
    """(N,) how much nearer to the camera than the body's axis the lowest point is, as a share of the body's height."""
    size: Floats
    """(N,) angle between both rays."""
    middle_sd: Floats
    """(N,) one sigma of the middle's direction, radians."""
    size_sd: Floats
    """(N,) of the size."""

    @property
    def n_groups(self) -> int:
        """People-instants."""
        return len(self.person)

    def of_groups(self, wanted: Mask) -> RigObservations:
        """The sightings of some groups (G,), numbered anew."""
        return self._of(np.flatnonzero(wanted[self.group]))

    def between(self, from_s: float, until_s: float) -> RigObservations:
        """The sightings at times of [from, until)."""
        return self.of_groups((self.seconds >= from_s) & (self.seconds < until_s))

    def without(self, cameras: Mask) -> RigObservations:
        """The sightings by other cameras than those marked (C,)."""
        return self._of(np.flatnonzero(~cameras[self.camera]))

    def of_cameras(self, names: tuple[str, ...], rows: Ints) -> RigObservations:
        """Some rows (in order), all of them by the named cameras, which are the only ones of the result."""
        number = np.full(len(self.names), UNKNOWN)
        number[[self.names.index(name) for name in names]] = np.arange(len(names))
        part = self._of(rows)
        return replace(part, names=names, camera=number[part.camera])

    def _of(self, rows: Ints) -> RigObservations:
        """Some rows (in order), and the groups that they belong to."""
        kept, group = np.unique(self.group[rows], return_inverse=True)
        columns = {name: getattr(self, name)[rows] for name in BY_SIGHTING}
        return RigObservations(self.names, group=group.ravel(), person=self.person[kept], seconds=self.seconds[kept], **columns)


BY_SIGHTING = "camera", "top", "bottom", "fractions", "foot_shift", "size", "middle_sd", "size_sd"
FOOT_SHIFT = Priors().foot_shift
"""Of a box: it ends at the nearer foot."""


def gather_rig_observations(
    rig: Rig, observations: Observations, *, every_s: float = EVERY_S, fps: float = 1.0
) -> RigObservations:
    """Sightings of the cameras with poses.

    Args:
        rig: lenses; cameras without a pose are left out.
        observations: people with identities over all cameras, at common instants; bodies that the border cuts are left out.
        every_s: instants nearer to the one before are left out.
        fps: of the frame numbers, where the observations do not know it.
    """
    posed = rig.posed()
    clock = next(iter(observations.clocks.values()), None) or Clock(observations.fps or fps)
    columns: dict[str, list[NDArray[np.generic]]] = {}
    kept = _kept_frames(observations, posed.names, clock.fps, every_s)
    for number, camera in enumerate(posed):
        if camera.name not in observations.cameras:
            continue
        seen = upright_rays(_at(observations[camera.name], kept), camera.lens, clock)
        seen = seen.take(seen.tracklet != UNKNOWN)
        size = 2 * np.arcsin(np.clip(np.linalg.norm(seen.top - seen.bottom, axis=1) / 2, 1e-5, 1.0))
        whole = size / np.maximum(seen.top_fraction - seen.bottom_fraction, 0.2)
        floor = size * NOISE.floor_px / seen.extent_px
        for name, values in {
            "camera": np.full(len(seen), number), "frame": seen.frame, "who": seen.tracklet, "top": seen.top,
            "bottom": seen.bottom, "fractions": np.column_stack([seen.top_fraction, seen.bottom_fraction]),
            "foot_shift": np.where(seen.from_joints, 0.0, FOOT_SHIFT), "size": size,
            "middle_sd": np.hypot(floor, NOISE.centre * whole),
            "size_sd": np.hypot(HEIGHT_PER_CENTRE * floor, NOISE.height * whole),
        }.items():  # fmt: skip
            columns.setdefault(name, []).append(values)
    joined = {name: np.concatenate(parts) for name, parts in columns.items()}
    if not joined:
        return _nothing(posed.names)
    key, group = np.unique(np.column_stack([joined.pop("frame"), joined.pop("who")]), axis=0, return_inverse=True)
    order = np.argsort(group.ravel(), kind="stable")
    frame, person = key.T.astype(np.int64)
    return RigObservations(
        posed.names, group=group.ravel()[order], person=person, seconds=clock.seconds(frame),
        **{name: values[order] for name, values in joined.items()},
    )  # fmt: skip


def _kept_frames(observations: Observations, names: tuple[str, ...], fps: float, every_s: float) -> Ints:
    """The frames that are used, ascending: none sooner than `every_s` after the one before."""
    seen = [observations[name] for name in names if name in observations.cameras]
    frames = np.unique(np.concatenate([np.zeros(0, np.int64), *(p.frame for s in seen for p in (s.boxes, s.keypoints))]))
    step = max(1, int(np.ceil(every_s * fps - 1e-9)))
    return frames if step == 1 else frames[frames % step == frames[:1] % step]


def _at(seen: CameraObservations, frames: Ints) -> CameraObservations:
    """What was seen in some frames."""
    boxes: Boxes = seen.boxes.take(np.isin(seen.boxes.frame, frames))
    joints: Keypoints = seen.keypoints.take(np.isin(seen.keypoints.frame, frames))
    return CameraObservations(boxes, joints)


def _nothing(names: tuple[str, ...]) -> RigObservations:
    none, whole = np.zeros(0), np.zeros(0, np.int64)
    rays = np.zeros((0, 3))
    return RigObservations(names, whole, whole, whole, none, rays, rays, np.zeros((0, 2)), none, none, none, none)


def poses_of(
    rig: Rig, names: tuple[str, ...], changed: Mapping[str, tuple[Floats, Floats]] | None = None
) -> tuple[Floats, Floats]:
    """(C, 3, 3) rotations, world to camera, and (C, 3) centres of the named cameras."""
    poses = [rig[name].pose for name in names]
    assert all(pose is not None for pose in poses)
    rotation = np.array([pose.R_cw for pose in poses if pose is not None]).reshape(-1, 3, 3)
    centre = np.array([pose.centre for pose in poses if pose is not None]).reshape(-1, 3)
    for name, (turn, place) in (changed or {}).items():
        rotation[names.index(name)], centre[names.index(name)] = turn, place
    return rotation, centre
