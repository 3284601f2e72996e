"""Drift of the cameras' clocks: a camera's frame rate differs slightly from the stated one.

With a rig, each person is at one ground position for all cameras. Where a camera shows people late, its positions lag behind
along their trajectories. The delay of each camera is fitted as a straight line over time to the people that two cameras see;
its slope is the drift.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.association.camera_tracklets import CameraTracklets
from passerby.association.ground.ground_tracks import Tolerance, ground_tracks
from passerby.association.sampling import STEP_S
from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Pose
from passerby.findings.finding import Finding, Severity
from passerby.geometry.groups import cauchy_weights, group_sums
from passerby.geometry.single_view import Level

TOLERANCE = Tolerance(floor_m=0.08, along=0.04, across=0.008, foot_m=0.25)
"""Tolerances of ground positions by a calibrated rig: the position of a person who is half hidden, crouches or stands on a kerb
is wrong along the ray."""
WALKING = 0.4
"""Metres per second: the positions of slower people do not determine the time."""
WINDOW_S = 4.0
"""Time over which errors of one person's samples are alike, seconds: they count as one sample in the sigma."""
MIN_SAMPLES = 60
MOST_SAMPLES = 3_000
"""Largest number of samples; of more, samples at even steps are taken."""
SIGMAS, LEAST_S = 8.0, 0.2
"""A drift is reported if it exceeds this number of its sigmas, and this number of seconds over the recording, in which a walker
moves 0.3 m. Over simulated scenes with sound clocks it is at most 0.04 s, and scatters by two of its sigmas
(docs/results/limits.md)."""
HARMFUL_S, HARMFUL_RATE, SPOILING_S = 0.5, 0.01, 1.0
"""A drift is a doubt in two cases. In the first it exceeds `HARMFUL_S` over the recording and its rate exceeds `HARMFUL_RATE`,
more than that of a poor clock: then the frame rate is mistaken (25 for 24 is 4 %). In the second it exceeds `SPOILING_S`, which
spoils the rig for any cause. Effects of drifts, and of other limits: docs/results/limits.md."""


@dataclass(frozen=True)
class Drift:
    """Drift of a clock relative to those of the other cameras."""

    rate: float
    """Seconds by which the camera's clock gains in each second of the rig's time."""
    sigma: float
    span_s: float
    """Length of the recording."""

    @property
    def harmful(self) -> bool:
        """Whether the drift is so large that the rig is not reliable."""
        drift = abs(self.seconds)
        return drift > SPOILING_S or (drift > HARMFUL_S and abs(self.rate) > HARMFUL_RATE)

    @property
    def seconds(self) -> float:
        """Drift over the recording, seconds."""
        return self.rate * self.span_s

    @property
    def sure(self) -> bool:
        """Whether the drift is significant, and large enough to move people."""
        return abs(self.rate) > SIGMAS * self.sigma and abs(self.seconds) > LEAST_S


def drift_findings(cameras: Sequence[CameraTracklets], drifts: Mapping[int, Drift]) -> tuple[list[Finding], list[Finding]]:
    """Return the findings on drifting clocks: doubts, and notices.

    Args:
        cameras: all cameras.
        drifts: from `clock_drifts`.
    """
    if len(drifts) == 2:
        (a, one), (b, other) = drifts.items()
        between = Drift(one.rate - other.rate, max(one.sigma, other.sigma), max(one.span_s, other.span_s))
        severity: Severity = "doubt" if between.harmful else "notice"
        both = cameras[a].name, cameras[b].name
        apart = Finding("clock_drifts", severity, both, {"drift_s": abs(between.seconds)})
        found = [apart] if one.sure else []
    else:
        found = [_drifting(cameras[c], drift) for c, drift in drifts.items() if drift.sure]
    return [each for each in found if each.severity == "doubt"], [each for each in found if each.severity == "notice"]


def _drifting(camera: CameraTracklets, drift: Drift) -> Finding:
    """Return the finding on one camera's clock."""
    fps = camera.clock.fps
    values = {"drift_s": abs(drift.seconds), "span_s": drift.span_s, "fits_fps": fps / (1 - drift.rate), "fps": fps}
    return Finding("clock_drifts", "doubt" if drift.harmful else "notice", (camera.name,), values)


def clock_drifts(
    cameras: Sequence[CameraTracklets], poses: Sequence[Pose | None], person: Sequence[Ints], offset_s: Floats
) -> dict[int, Drift]:
    """Estimate the drift of each registered camera relative to the median of all. The result is empty where too few people
    walk, or where fewer than two cameras are registered, as after a refused solve.

    Args:
        cameras: all cameras.
        poses: world z up, ground at z = 0; None for a camera that is not registered.
        person: for each camera (T_c,) the person of each tracklet.
        offset_s: (C,) offset to add to each camera's clock, seconds.
    """
    posed = [c for c, pose in enumerate(poses) if pose is not None]
    if len(posed) < 2:
        return {}
    views = [
        _view(cameras[c], pose, person[c], float(offset_s[c])) for c, pose in enumerate(poses) if pose is not None
    ]  # fmt: skip
    walks = _walks(views)
    if walks is None:
        return {}
    rate, sigma = _slopes(walks)
    ties = (walks.information[:, :, 0, 0] > 0).sum(axis=0) >= MIN_SAMPLES
    span_s = float(np.ptp(walks.seconds))
    return {
        c: Drift(float(r), float(s), span_s) for c, r, s, tied in zip(posed, rate, sigma, ties, strict=True) if tied
    }  # fmt: skip


@dataclass(frozen=True, eq=False)
class _View:
    """One camera's people in the world, each person once a step of the rig's time: N samples."""

    key: Ints
    """(N,) person and step, sorted."""
    place: Floats
    """(N, 2) positions, metres."""
    velocity: Floats
    """(N, 2) metres per second."""
    information: Floats
    """(N, 2, 2) inverse of the covariance of the position."""


_STRIDE = 1 << 32
_UNKNOWNS, _ROUNDS = 8, 8


def _view(camera: CameraTracklets, pose: Pose, person: Ints, offset_s: float) -> _View:
    level = Level(pose.R_cw[:, 2], float(pose.centre[2]), 0.0)
    tracks = ground_tracks(camera.bodies, level, TOLERANCE)
    turn = pose.R_cw.T @ level.R_lc.T
    yaw = complex(turn[0, 0], turn[1, 0])
    late = round(offset_s / STEP_S)
    key, first = np.unique(person[tracks.tracklet] * _STRIDE + tracks.step + late, return_index=True)
    reach, velocity = yaw * tracks.position[first], yaw * tracks.velocity[first]
    # Positions are extrapolated from the sample's time to the rig's grid time.
    place = reach + velocity * (late * STEP_S - offset_s) + complex(*pose.centre[:2])
    ray = _plane(reach / np.maximum(np.abs(reach), 1e-9))
    along, across = (sigma[first] for sigma in tracks.sigma)
    outer = ray[:, :, None] * ray[:, None, :]
    information = outer / along[:, None, None] ** 2 + (np.eye(2) - outer) / across[:, None, None] ** 2
    return _View(key, _plane(place), _plane(velocity), information)


def _plane(points: NDArray[np.complex128]) -> Floats:
    return np.column_stack([points.real, points.imag])


@dataclass(frozen=True, eq=False)
class _Walks:
    """G samples of walkers that two cameras or more see; C cameras."""

    seconds: Floats
    """(G,) the rig's time."""
    cluster: Ints
    """(G,) number of the cluster; errors of one cluster are alike."""
    velocity: Floats
    """(G, 2) metres per second."""
    place: Floats
    """(G, C, 2) positions by each camera, metres."""
    information: Floats
    """(G, C, 2, 2) information of the positions; 0 where a camera does not see the walker."""


def _walks(views: Sequence[_View]) -> _Walks | None:
    key, seen = np.unique(np.concatenate([view.key for view in views]), return_counts=True)
    key = key[seen >= 2]
    if len(key) > MOST_SAMPLES:
        key = key[np.linspace(0, len(key) - 1, MOST_SAMPLES).astype(np.int64)]
    place, velocity = np.zeros((len(key), len(views), 2)), np.zeros((len(key), len(views), 2))
    information = np.zeros((len(key), len(views), 2, 2))
    for c, view in enumerate(views):
        at = np.minimum(np.searchsorted(view.key, key), max(len(view.key) - 1, 0))
        rows = np.flatnonzero(view.key[at] == key) if len(view.key) else np.zeros(0, np.int64)
        place[rows, c], velocity[rows, c] = view.place[at[rows]], view.velocity[at[rows]]
        information[rows, c] = view.information[at[rows]]
    known = information[:, :, 0, 0] > 0
    mean = velocity.sum(axis=1) / np.maximum(known.sum(axis=1), 1)[:, None]
    walking = np.linalg.norm(mean, axis=1) > WALKING
    if np.count_nonzero(walking) < MIN_SAMPLES:
        return None
    person, step = (key + _STRIDE // 2) // _STRIDE, (key + _STRIDE // 2) % _STRIDE - _STRIDE // 2
    seconds = np.asarray(step * STEP_S, dtype=np.float64)
    window = np.column_stack([person, np.floor(seconds / WINDOW_S).astype(np.int64)])[walking]
    _, cluster = np.unique(window, axis=0, return_inverse=True)
    return _Walks(seconds[walking], cluster.ravel(), mean[walking], place[walking], information[walking])


def _slopes(walks: _Walks) -> tuple[Floats, Floats]:
    """Estimate the drifts (C,) of the cameras relative to their median, and their sigmas.

    Camera c sees a walker at x at `x + affine_c(x) - late_c(t) * velocity`, with `late = offset + slope * t`. The affine part
    models errors of the camera's pose, which look like a drift where people first walk in one direction and then in the other.
    The walker's position is eliminated. Reweighted least squares with a Cauchy loss; the sigmas are computed from the scatter
    of the clusters.
    """
    n = walks.place.shape[1]
    length = max(float(np.ptp(walks.seconds)), STEP_S)
    design = _design(walks, (walks.seconds - walks.seconds.mean()) / length)
    known = walks.information[:, :, 0, 0] > 0
    root = np.linalg.cholesky(walks.information + 1e-12 * np.eye(2)).transpose(0, 1, 3, 2)
    weight: Floats = np.ones(known.shape)
    for _ in range(_ROUNDS):
        weighed = np.asarray(weight[:, :, None, None] * walks.information, dtype=np.float64)
        normal, target, off = _eliminated(walks, design, weighed)
        # Only differences are observed: a weak prior keeps the common part of all cameras at 0.
        normal += 1e-9 * np.diag(np.diag(normal)) + 1e-12 * np.trace(normal) * np.eye(len(normal))
        solved = np.linalg.solve(normal, target)
        fitted = np.einsum("gik,ck->gci", design, solved.reshape(n, _UNKNOWNS))
        miss = off - _less_mean(fitted, weighed)
        square = (np.einsum("gcij,gcj->gci", root, miss) ** 2).sum(axis=2)
        weight = cauchy_weights(square / (3.0 * float(np.median(square[known])) + 1e-12))
    score = np.einsum("gik,gcij,gcj->gck", design, weighed, miss, optimize=True).reshape(len(design), -1)
    summed = group_sums(walks.cluster, score, int(walks.cluster.max()) + 1)
    inverse = np.linalg.inv(normal)
    slopes = np.arange(n) * _UNKNOWNS + 1
    covariance = (inverse @ (summed.T @ summed) @ inverse)[np.ix_(slopes, slopes)]
    # The error of the median is about that of the mean.
    against = np.eye(n) - 1.0 / n
    sigma = np.sqrt(np.maximum(np.diag(against @ covariance @ against.T), 0.0))
    return (solved[slopes] - np.median(solved[slopes])) / length, sigma / length


def _design(walks: _Walks, t: Floats) -> Floats:
    """Return the derivatives (G, 2, U) of a position by its camera's unknowns: offset and slope of the clock, affine part."""
    total = walks.information.sum(axis=1)
    mean = np.linalg.solve(total, np.einsum("gcij,gcj->gi", walks.information, walks.place)[:, :, None])[:, :, 0]
    mean = (mean - mean.mean(axis=0)) / max(float(mean.std()), 1e-3)
    design = np.zeros((len(t), 2, _UNKNOWNS))
    design[:, :, 0], design[:, :, 1] = -walks.velocity, -walks.velocity * t[:, None]
    for axis in (0, 1):
        design[:, axis, 2 + 3 * axis] = 1.0
        design[:, axis, 3 + 3 * axis : 5 + 3 * axis] = mean
    return design


def _less_mean(values: Floats, information: Floats) -> Floats:
    """Subtract from values (G, C, 2) their mean over the cameras, weighted by the information (G, C, 2, 2)."""
    summed = np.einsum("gcij,gcj->gi", information, values)
    return np.asarray(values - np.linalg.solve(information.sum(axis=1), summed[:, :, None])[:, None, :, 0])


def _eliminated(walks: _Walks, design: Floats, information: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the normal equations (C * U, C * U), their right side (C * U,), and positions minus the walker's (G, C, 2).

    The walker's position is eliminated: it is the mean of the cameras' positions, weighted by information. Rows over all
    cameras are not stored; with a hundred cameras these would take several gigabytes.
    """
    groups, n = information.shape[:2]
    size = n * _UNKNOWNS
    off = _less_mean(walks.place, information)
    by_camera = np.einsum("gcij,gjk->gick", information, design)
    inverse_root = np.linalg.inv(np.linalg.cholesky(information.sum(axis=1)))
    common = (inverse_root @ by_camera.reshape(groups, 2, size)).reshape(2 * groups, size)
    normal = -(common.T @ common)
    own = np.einsum("gik,gicl->ckl", design, by_camera)
    for c in range(n):
        part = slice(c * _UNKNOWNS, (c + 1) * _UNKNOWNS)
        normal[part, part] += own[c]
    target = np.einsum("gick,gci->ck", by_camera, off).ravel()
    return normal, target, off
