"""Test of footage window by window until a camera has moved, and test of the footage as a whole.

A camera that was turned before the footage began is turned in every window alike. If no single window shows this, the quiet
windows become the baseline with which later ones are compared, so that these do not show it either. So at the end, all the
footage since the last move is compared with the rig at once.

Both tests use a sum of squares that is quadratic in small changes of the poses. Its minimum is an estimate of the rig, which
`comparison.compare` compares with the earlier knowledge.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.common.progress import Progress
from passerby.core.cameras import PoseSigma, Rig
from passerby.geometry.rotations import exp_rotation
from passerby.monitoring.comparison import FEWEST_STRETCHES, Comparison, Displacement, Estimate
from passerby.monitoring.evidence import Baseline, ChangePoint, MotionTest, estimate_change_point, model_covariance
from passerby.monitoring.watched import Move, Watched, WatchOptions, Window
from passerby.people.held_cameras import GroundPlane
from passerby.people.resection import FEWEST_CLUSTERS, cluster_robust_covariance
from passerby.people.scores import Scores
from passerby.people.sightings import Sightings

STAGE = "monitoring"
PIECE_S = 600.0
"""Length of the footage that is processed at once, seconds: memory stays at some 100 MB."""
FIRST_S = 15.0
"""A move in this time after the beginning of the footage, seconds, cannot be distinguished from one before it."""
RIDGE = 1e-6
"""Share of the diagonal that is added to it, since position, heading and scale of the whole rig are free."""


def span_of(seen: Sightings) -> tuple[float, float]:
    """Return the first time at which a person was seen and the time just after the last, seconds; zeros without people."""
    if not seen.n_blocks:
        return 0.0, 0.0
    return float(seen.block_seconds.min()), float(seen.block_seconds.max()) + 1e-6


class WindowRun(ABC):
    """Sequential test of footage; the poses are updated when cameras move."""

    def __init__(
        self, rig: Rig, seen: Sightings, options: WatchOptions, ground: GroundPlane, tell: Progress,
        span: tuple[float, float] | None = None,
    ) -> None:  # fmt: skip
        self.rig, self.seen, self.options, self.ground, self.tell = rig, seen, options, ground, tell
        self.names = seen.names
        self.lost: tuple[str, ...] = ()
        self.moves: list[Move] = []
        self.windows: list[Window] = []
        self.start, self.end = span or span_of(seen)
        self.baseline = Baseline.of_rig(rig, self.names)
        self.prior, self.since = self.baseline, self.start
        """Knowledge before the footage since the last move, or before all footage, and the begin of this footage, seconds."""

    @abstractmethod
    def _test_cameras(self, from_s: float, until_s: float) -> list[MotionTest]:
        """Test the cameras with the footage of a window."""

    @abstractmethod
    def _learn(self, found: Sequence[MotionTest]) -> None:
        """Add a quiet window to the baseline."""

    @abstractmethod
    def _record_move(self, found: Sequence[MotionTest], from_s: float, until_s: float) -> float:
        """Find the cameras that moved, the times and the sizes; return the time at which the next window begins."""

    @abstractmethod
    def _compare_since(self, from_s: float) -> Comparison | None:
        """Compare the earlier knowledge with all the footage from a time on; None without enough footage."""

    def result(self) -> Watched:
        """Test the footage window by window, then as a whole, and return the result."""
        every, step = self.options.every_s, self.options.step_s
        origin, until, full = self.start, min(self.start + every, self.end), self.start + every
        total = max(1, int(np.ceil((self.end - self.start) / every)))
        while True:
            self.tell(STAGE, min(len(self.windows), total), total)
            found = self._test_cameras(max(origin, until - every), until)
            last = until >= self.end
            if max((test.score for test in found), default=0.0) >= self.options.threshold:
                origin = self._record_move(found, max(origin, until - every), until)
                self.windows.append(Window(max(self.start, until - every), until, tuple(found)))
                self.prior, self.since = self.baseline, origin
                until, full = min(origin + every, self.end), origin + every
                if last or origin >= self.end:
                    break
                continue
            if until >= full - 1e-9 or last:
                self.windows.append(Window(max(origin, until - every), until, tuple(found)))
                self._learn(found)
                full += every
            if last:
                break
            until = min(until + step, self.end)
        whole = self._join_footage()
        self.tell(STAGE, total, total)
        return Watched(self.names, tuple(self.moves), tuple(self.windows), self.start, self.end, whole=whole)

    def _join_footage(self) -> tuple[Window, ...]:
        """Compare all the footage since the last move at once."""
        found = self._compare_since(self.since)
        if found is None:
            return ()
        self.baseline = self.prior
        self._settle_displaced(found.moved, self.since, self.end, self._compare_since)
        return (Window(self.since, self.end, found.tests),)

    def _settle_displaced(
        self, moved: Sequence[Displacement], from_s: float, until_s: float, again: Callable[[float], Comparison | None]
    ) -> float:
        """Date the moves that a stretch of footage shows, and set the new poses; return the time from which these hold.

        Args:
            moved: the cameras that moved.
            from_s: begin of the stretch, seconds.
            until_s: end of the stretch, seconds.
            again: function that compares the footage from a time on, for cameras that moved within the stretch.
        """
        moments = self._date_moves(moved, from_s, until_s)
        after = max([from_s, *(moment.seconds for moment in moments.values())])
        if after > from_s + FIRST_S:
            # A part of the stretch shows the cameras before their moves.
            late = again(after)
            if late is not None and late.moved:
                moved, moments = late.moved, self._date_moves(late.moved, from_s, until_s)
        for one in moved:
            self._settle_one(one, moments.get(one.camera), until_s)
        return after

    def _date_moves(self, moved: Sequence[Displacement], from_s: float, until_s: float) -> dict[int, ChangePoint]:
        """Find the times at which cameras moved; none for a camera whose people no camera at rest saw."""
        cameras, found = [one.camera for one in moved], dict[int, ChangePoint]()
        for camera in cameras:
            seen = self._drop_movers(camera, cameras, from_s, until_s)
            several = np.bincount(seen.block, minlength=seen.n_blocks)[seen.block] > 1
            if several[seen.camera == camera].any() and (moment := self._moment(camera, seen)) is not None:
                found[camera] = moment
        return found

    def _settle_one(self, one: Displacement, moment: ChangePoint | None, noticed: float) -> None:
        """Record a move, and set the camera's new pose."""
        name = self.names[one.camera]
        if moment is not None and moment.seconds - self.start < FIRST_S:
            moment = None
        sigma = PoseSigma.from_covariance(one.pose_covariance)
        others = tuple(self.names[c] for c in one.others)
        self.moves.append(Move(name, noticed, moment, one.score, one.shift, one.covariance, one.pose, sigma, others))
        self.baseline = self.baseline.replaced(one.camera, one.pose_covariance)
        cameras = [replace(c, pose=one.pose, sigma=sigma) if c.name == name else c for c in self.rig.cameras]
        self.rig = replace(self.rig, cameras=tuple(cameras))

    def _moments(self, cameras: Sequence[int], from_s: float, until_s: float) -> list[ChangePoint]:
        """Find the time at which each camera moved, by those at rest; the whole window if these saw none of its people."""
        whole = ChangePoint(from_s, from_s, until_s)
        return [self._moment(camera, self._drop_movers(camera, cameras, from_s, until_s)) or whole for camera in cameras]

    def _drop_movers(self, camera: int, moved: Sequence[int], from_s: float, until_s: float) -> Sightings:
        """Return the sightings around a window by a camera and by those that did not move."""
        every = self.options.every_s
        seen = self.seen.between(max(self.start, from_s - every), min(until_s + every / 2, self.end))
        if until_s - from_s > PIECE_S:
            step = np.unique(seen.block_seconds, return_inverse=True)[1]
            seen = seen.of_blocks(step % int(np.ceil((until_s - from_s) / PIECE_S)) == 0)
        return seen.without(np.isin(self.names, [*self.lost, *(self.names[c] for c in moved if c != camera)]))

    def _moment(self, camera: int, seen: Sightings) -> ChangePoint | None:
        """Find the time at which a camera moved; None if no person was seen by two cameras."""
        return estimate_change_point(self.rig, seen, self.names[camera], self.baseline, self.ground)


@dataclass(frozen=True, eq=False)
class Part:
    """Result of a window that was adjusted: the poses of C cameras, relative to the rig's poses."""

    from_s: float
    until_s: float
    shift: Floats
    """(6 C,) changes of the poses."""
    information: Floats
    """(6 C, 6 C) information on `shift`; 0 along similarities."""
    stretches: Floats
    """(C,) number of stretches of people."""


def estimate_by_scores(R: Floats, centre: Floats, scores: Scores) -> Estimate | None:
    """Estimate the poses from boxes. Each stretch of a person counts once, and their scatter is in the covariance.

    Args:
        R: (C, 3, 3) rotations, world to camera, of the poses about which the scores are.
        centre: (C, 3) centres of these poses, metres.
        scores: scores of the footage.

    Returns:
        The estimate; None if fewer than two cameras have enough stretches.
    """
    stretches = np.count_nonzero(scores.counts, axis=0)
    cameras = np.flatnonzero(stretches >= FEWEST_CLUSTERS)
    if len(cameras) < 2:
        return None
    normal = _add_ridge(scores.information.sum(axis=0), cameras)
    own = _rows(cameras)
    gradient = scores.gradient[:, own]
    shift = np.linalg.solve(normal, gradient.sum(axis=0))
    residual = gradient - scores.information[:, own][:, :, own] @ shift
    inverse = np.linalg.inv(normal)
    covariance = inverse @ cluster_robust_covariance(residual, normal)[0] @ inverse
    return _estimate(R, centre, cameras, shift, covariance, stretches)


def estimate_by_parts(R: Floats, centre: Floats, parts: Sequence[Part]) -> Estimate | None:
    """Estimate the poses from adjusted windows. If they differ by more than their sigmas, the covariance is increased.

    Args:
        R: (C, 3, 3) rotations, world to camera, of the poses to which the windows' shifts are relative.
        centre: (C, 3) centres of these poses, metres.
        parts: windows without overlap.

    Returns:
        The estimate; None if fewer than two cameras have enough stretches.
    """
    stretches = np.floor(np.sum([one.stretches for one in parts], axis=0) + 1e-9).astype(np.int64)
    cameras = np.flatnonzero(stretches >= FEWEST_STRETCHES)
    if len(cameras) < 2:
        return None
    own = _rows(cameras)
    information = [one.information[np.ix_(own, own)] for one in parts]
    normal = _add_ridge(np.sum([one.information for one in parts], axis=0), cameras)
    shift = np.linalg.solve(
        normal, np.sum([known @ one.shift[own] for known, one in zip(information, parts, strict=True)], axis=0)
    )
    inverse = np.linalg.inv(normal)
    misfit = sum(
        float((one.shift[own] - shift) @ known @ (one.shift[own] - shift))
        for known, one in zip(information, parts, strict=True)
    )
    left = sum(np.linalg.matrix_rank(known, hermitian=True, tol=RIDGE * np.trace(known)) for known in information)
    left -= int(np.linalg.matrix_rank(np.sum(information, axis=0), hermitian=True, tol=RIDGE * np.trace(normal)))
    return _estimate(R, centre, cameras, shift, max(1.0, misfit / max(left, 1)) * inverse, stretches)


def _rows(cameras: Ints) -> Ints:
    """Return the indices (6 K,) of the unknowns of cameras (K,)."""
    return np.asarray((6 * cameras[:, None] + np.arange(6)).ravel())


def _add_ridge(information: Floats, cameras: Ints) -> Floats:
    """Return the information (6 K, 6 K) of some cameras (K,), made invertible by a ridge."""
    own = _rows(cameras)
    known = information[np.ix_(own, own)]
    return np.asarray(known + RIDGE * np.diag(np.diag(known)))


def _estimate(
    R: Floats, centre: Floats, cameras: Ints, shift: Floats, covariance: Floats, stretches: Ints
) -> Estimate:  # fmt: skip
    """Return the poses after small changes (6 K,) of the cameras (K,)."""
    n, change = len(cameras), shift.reshape(-1, 6)
    turned = np.array([exp_rotation(own[3:]) @ old for own, old in zip(change, R[cameras], strict=True)])
    placed = centre[cameras] + change[:, :3]
    # The errors by which people seem to move a camera do not average out over the footage.
    return Estimate(cameras, turned, placed, covariance + np.kron(np.eye(n), model_covariance()), stretches[cameras])
