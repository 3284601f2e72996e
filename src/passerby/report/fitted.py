"""Positions of people at a sample of time steps, fitted with the rig and the identities, and the residuals of the observations.

The sample is bounded, evenly spread and the same for the same calibration. People are fitted again at each instant, with the
cameras held fixed: as upright bodies if there are boxes, by their joints if there are only joints.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.core.cameras import Rig
from passerby.core.figures import AdjustedFigures, heights_of
from passerby.core.observations import MIN_JOINT_SCORE, MIN_JOINTS, Observations, find_inside_picture
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.geometry.groups import group_numbers, group_sums
from passerby.geometry.ray_consensus import vote_points
from passerby.people.model import Noise, Priors
from passerby.people.sightings import Sightings
from passerby.people.trajectories.smoothing import smooth
from passerby.people.upright_bodies import BodyModel, UprightBodies, fit_bodies, predict_boxes
from passerby.report.contents import Contents
from passerby.report.sampling import MOST_SIGHTINGS, Sample, sample_observations

SURE_M = 0.7
"""Largest sigma of a body's position in the trajectories. It is larger if only one camera saw the body, far away or cut off."""
GAP_S, GAP_STEPS = 2.0, 1.5
"""A trajectory is split where a person was not seen for longer than both, in seconds and in steps of the sample."""
LEAST_SD_M = 0.05
"""Lower limit of the standard deviation of a body's position: arms, stride and load move its middle."""
FEWEST_JOINTS = 4
"""Fewest joints in space from which a person's position is computed."""
TOLERANCE_PX, TOLERANCE_SHARE = 2.0, 0.05
"""Largest residual of a joint that agrees: the sum of these pixels and this share of the person's height in the picture. It is
five times the usual error of joints."""
SLACK_RANGE = 0.7
"""Largest absolute slack that is accepted: boxes are at most twice as tall as people, and at least half as tall."""


@dataclass(frozen=True, eq=False)
class FittedBoxes:
    """M boxes of identified people and the model's boxes for them, pixels. Sorted by camera, then by frame."""

    camera: Ints
    """(M,) rows of `Fitted.rig`."""
    body: Ints
    """(M,) rows of `Fitted.bodies`."""
    identity: Ints
    """(M,)"""
    frame: Ints
    """(M,) frames of the clock of `Fitted.sample`."""
    seen: Floats
    """(M, 4) observed box: left, top, width, height."""
    model: Floats
    """(M, 4) projection of the fitted body: left, top, width, height; the width is that of the observed box."""
    top: Floats
    """(M, 2) projection of the body's highest point."""
    foot: Floats
    """(M, 2) projection of the body's lowest visible point."""
    agrees: Bools
    """(M,) whether the box agrees with the body and is not cut off by the picture's border."""

    def __len__(self) -> int:
        return len(self.camera)

    @property
    def centre_px(self) -> Floats:
        """(M, 2) offset of the observed box's centre from the model's."""
        return (self.seen - self.model)[:, :2] + (self.seen - self.model)[:, 2:] / 2

    @property
    def top_px(self) -> Floats:
        """(M,) distance by which the observed upper edge is below the model's."""
        return np.asarray((self.seen - self.model)[:, 1])

    @property
    def bottom_px(self) -> Floats:
        """(M,) distance by which the observed lower edge is below the model's."""
        return np.asarray((self.seen - self.model)[:, [1, 3]].sum(axis=1))


@dataclass(frozen=True, eq=False)
class FittedTrajectories:
    """N positions of people on the ground, sorted by identity, then by time. World of the rig, metres."""

    identity: Ints
    """(N,)"""
    seconds: Floats
    """(N,) the rig's time."""
    xy: Floats
    """(N, 2)"""
    part: Ints
    """(N,) number of the stretch without long gaps; numbers ascend over all people."""

    def __len__(self) -> int:
        return len(self.identity)


@dataclass(frozen=True, eq=False)
class Joints:
    """K joints observed by cameras, and J joints in space."""

    camera: Ints
    """(K,) rows of the sample's rig."""
    frame: Ints
    """(K,) frames of the sample's clock."""
    identity: Ints
    """(K,)"""
    kind: Ints
    """(K,) joint of the body, by its number in the files."""
    seen: Floats
    """(K, 2) observed position, pixels."""
    model: Floats
    """(K, 2) projection of the joint in space, pixels; NaN where no two cameras agree on a joint in space."""
    agrees: Bools
    """(K,) whether the joint in space is computed from this observation."""
    point: Ints
    """(K,) rows of `xyz`."""
    xyz: Floats
    """(J, 3) position, world, metres; NaN where no two cameras agree."""

    def __len__(self) -> int:
        return len(self.camera)


@dataclass(frozen=True, eq=False)
class Fitted:
    """People, fitted at the instants of a sample."""

    rig: Rig
    """The cameras that have a pose and observations. The columns `camera` are rows of this rig."""
    model: BodyModel
    sample: Sample | None
    """None if no camera with a pose saw an identified person."""
    bodies: UprightBodies
    sightings: FittedBoxes
    joints: Joints
    ways: FittedTrajectories

    def place(self, name: str) -> int | None:
        """Return the row of a camera; None for a camera without a pose or without observations."""
        return self.rig.names.index(name) if name in self.rig.names else None


def fit_people(contents: Contents, most: int = MOST_SIGHTINGS) -> Fitted:
    """Fit people at a bounded sample of instants; no people if no camera has a pose, as after a refused calibration.

    Args:
        contents: of the report.
        most: approximate largest number of sightings.
    """
    return fit_sample(contents, sample_observations(contents, most))


def fit_sample(contents: Contents, sample: Sample | None) -> Fitted:
    """Fit people at the instants of a sample; None gives no people."""
    model = body_model(contents.figures, contents.document.scene.scale.person_height_m)
    rig = sample.rig if sample is not None else Rig(())
    boxes = _boxes(sample)
    bodies, body, agrees = fit_bodies(rig, boxes, model)
    rows = np.flatnonzero(body >= 0)
    camera, body, seen = boxes.camera[rows], body[rows], boxes.ltwh[rows]
    ltwh, top, foot = predict_boxes(rig, camera, bodies, body, seen[:, 2], model)
    sightings = FittedBoxes(
        camera,
        body,
        boxes.identity[rows],
        boxes.step[rows],
        seen,
        ltwh,
        top,
        foot,
        agrees[rows] & ~_find_cut_boxes(rig, camera, seen),
    )
    joints = joints_of(rig, sample.seen) if sample is not None else _no_joints()
    return Fitted(rig, model, sample, bodies, sightings, joints, _fit_trajectories(sample, bodies, joints))


def _boxes(sample: Sample | None) -> Sightings:
    """Return the boxes of all cameras, sorted by camera, then by frame."""
    columns: list[tuple[Ints, Ints, Ints]] = [(np.zeros(0, np.int64),) * 3]
    ltwh = [np.zeros((0, 4))]
    for number, name in enumerate(sample.rig.names if sample is not None else ()):
        assert sample is not None
        boxes = sample.seen[name].boxes
        order = np.lexsort((boxes.identity, boxes.frame))
        columns.append((np.full(len(order), number), boxes.identity[order], boxes.frame[order]))
        ltwh.append(boxes.ltwh[order])
    camera, identity, frame = (np.concatenate(parts).astype(np.int64) for parts in zip(*columns, strict=True))
    return Sightings(camera, frame, identity, ltwh=np.concatenate(ltwh))


def _find_cut_boxes(rig: Rig, camera: Ints, ltwh: Floats) -> Bools:
    """Return (M,) whether the picture's border cuts off each box."""
    size = np.array([one.lens.size for one in rig], dtype=np.float64).reshape(-1, 2)[camera]
    return ~find_inside_picture(ltwh, size)


def _no_joints() -> Joints:
    nothing = np.zeros(0, np.int64)
    none = np.zeros((0, 2))
    return Joints(nothing, nothing, nothing, nothing, none, none, np.zeros(0, bool), nothing, np.zeros((0, 3)))


def _fit_trajectories(sample: Sample | None, bodies: UprightBodies, joints: Joints) -> FittedTrajectories:
    """Return the smoothed trajectories of all people; joints give the positions at instants without a well-placed body."""
    sure = (bodies.cameras > 0) & (bodies.sigma_m < SURE_M)
    by_box = np.column_stack([bodies.identity, bodies.frame])[sure]
    key, middle = _joint_places(joints)
    more = ~_find_rows(key, by_box)
    key = np.concatenate([by_box, key[more]])
    xy = np.concatenate([bodies.xy[sure], middle[more]])
    sd = np.concatenate([bodies.sigma_m[sure], np.full(np.count_nonzero(more), LEAST_SD_M)])
    if sample is None or not len(key):
        return FittedTrajectories(np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 2)), np.zeros(0, np.int64))
    order = np.lexsort((key[:, 1], key[:, 0]))
    key, xy, sd = key[order], xy[order], np.hypot(sd[order], LEAST_SD_M)
    seconds = sample.clock.seconds(key[:, 1])
    gap = max(GAP_S if sample.timed else 0.0, GAP_STEPS * sample.step_s) + 1e-9
    part = np.cumsum((np.diff(key[:, 0], prepend=key[:1, 0]) != 0) | (np.diff(seconds, prepend=seconds[:1]) > gap))
    if sample.timed:
        xy = smooth(seconds, xy, (sd**2 / 2)[:, None, None] * np.eye(2), part)[0]
    return FittedTrajectories(key[:, 0], seconds, xy, part)


def _joint_places(joints: Joints) -> tuple[Ints, Floats]:
    """Return (N, 2) identity and frame, and (N, 2) positions, metres: the means of each person's joints in space."""
    first = np.unique(joints.point, return_index=True)[1]
    xyz = joints.xyz[joints.point[first]]
    known = np.isfinite(xyz[:, 0])
    rows = first[known]
    number = group_numbers(joints.identity[rows], joints.frame[rows])
    first, count = np.unique(number, return_index=True, return_counts=True)[1:]
    key = np.column_stack([joints.identity[rows], joints.frame[rows]])[first]
    total = group_sums(number, xyz[known, :2], len(first))
    enough = count >= FEWEST_JOINTS
    return key[enough], (total / np.maximum(count, 1)[:, None])[enough]


def _find_rows(rows: Ints, others: Ints) -> Bools:
    """Return (N,) whether each of the rows (N, 2) is one of the others (M, 2)."""
    number = group_numbers(*np.concatenate([others, rows]).T)
    return np.asarray(np.isin(number[len(others) :], number[: len(others)]))


def joints_of(rig: Rig, observations: Observations) -> Joints:
    """Triangulate the joints of all people with identities at each instant.

    Args:
        rig: cameras with poses.
        observations: at instants that the cameras share.
    """
    parts = [_rows(index, observations, camera.name) for index, camera in enumerate(rig)]
    index = np.concatenate([rows for rows, _ in parts])
    values = np.concatenate([found for _, found in parts])
    camera, frame, identity, kind = index.T
    xy, size = values[:, :2], values[:, 2]
    point = group_numbers(identity, frame, kind)
    n_points = int(point.max(initial=-1)) + 1
    xyz, agrees = np.full((n_points, 3), np.nan), np.zeros(len(camera), bool)
    bearing, tangent = np.full((len(camera), 3), np.nan), np.zeros((len(camera), 2, 3))
    for number, one in enumerate(rig):
        rows = np.flatnonzero(camera == number)
        bearing[rows] = one.lens.bearings(xy[rows])
        tangent[rows] = one.lens.tangents(bearing[rows])
    known = np.flatnonzero(np.isfinite(bearing).all(axis=1))
    if len(known):
        R = np.array([one.pose.R_cw for one in rig if one.pose is not None])
        centre = np.array([one.centre for one in rig])
        found = vote_points(
            camera[known], point[known], bearing[known], tangent[known], TOLERANCE_PX + TOLERANCE_SHARE * size[known], n_points,
            R, centre,
        )  # fmt: skip
        xyz, agrees[known] = found.points, found.inlier
    model = np.full((len(camera), 2), np.nan)
    for number, one in enumerate(rig):
        rows = np.flatnonzero((camera == number) & np.isfinite(xyz[point, 0]))
        model[rows] = one.project(xyz[point[rows]])
    return Joints(camera, frame, identity, kind, xy, model, agrees, point, xyz)


def _rows(camera: int, observations: Observations, name: str) -> tuple[Ints, Floats]:
    """Return one camera's joints: (K, 4) camera, frame, identity, kind; (K, 3) x, y and the person's height, pixels."""
    keypoints = observations[name].keypoints
    found = keypoints.score > MIN_JOINT_SCORE
    found &= (found.sum(axis=1) >= MIN_JOINTS)[:, None]
    row, kind = np.nonzero(found)
    y = keypoints.xy[:, :, 1]
    low, high = np.where(found, y, np.inf).min(axis=1, initial=np.inf), np.where(found, y, -np.inf).max(axis=1, initial=-np.inf)
    index = np.column_stack([np.full(len(row), camera), keypoints.frame[row], keypoints.identity[row], kind])
    return index.astype(np.int64), np.column_stack([keypoints.xy[row, kind], (high - low)[row]])


def body_model(figures: AdjustedFigures, person_height_m: float | None) -> BodyModel:
    """Return the model with the solver's figures that are in plausible ranges; other values are the solver's defaults.

    Args:
        figures: of the solver.
        person_height_m: the assumed height of people; None if it was not written.
    """
    usually = Noise()
    noise = figures.noise
    slack = {one.name: _choose_value(one.slack, 0.0, -SLACK_RANGE, SLACK_RANGE) for one in figures.cameras}
    heights = {int(who): height for who, height in heights_of(figures).items() if who.isdecimal() and 0.3 <= height <= 3.0}
    assumed = _choose_value(person_height_m, PERSON_HEIGHT_M, 0.5, 2.5)
    usual = float(np.mean(list(heights.values()))) if heights else assumed
    return BodyModel(
        Noise(
            floor_px=_choose_value(noise.box_px, usually.box_px, 0.01, 100.0),
            centre=_choose_value(noise.centre, usually.centre, 1e-3, 1.0),
            height=_choose_value(noise.height, usually.height, 1e-3, 1.0),
        )
        if noise is not None
        else Noise(floor_px=usually.box_px),
        _choose_value(figures.foot_shift, Priors().foot_shift, -0.5, 0.5),
        slack,
        heights,
        usual,
    )


def _choose_value(value: float | None, otherwise: float, low: float, high: float) -> float:
    """Return the value if it is within the range from `low` to `high`, and `otherwise` if not."""
    return otherwise if value is None or not low <= value <= high else value
