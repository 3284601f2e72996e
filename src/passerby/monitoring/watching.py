"""Detection of moves in footage: windows are tested or adjusted; moves are found, dated and measured, with the new poses.

The test by scores (`watch`) holds all cameras but one. It is quick and works for hours of boxes. But it fails if the others
have moved as well, and does not use joints, of which half a minute is enough to calibrate (`watch_adjusted`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.progress import Progress, silent
from passerby.core.cameras import PoseSigma, Rig
from passerby.core.observations import UNKNOWN, CameraObservations, Clock, Observations
from passerby.geometry.rotations import log_rotation
from passerby.monitoring.comparison import FEWEST_STRETCHES, Comparison, Estimate, compare, sigma_share, untestable
from passerby.monitoring.evidence import (
    Baseline,
    ChangePoint,
    MotionTest,
    model_covariance,
    rig_covariance_of,
    run_motion_tests,
)
from passerby.monitoring.watched import Move, Watched, WatchOptions
from passerby.monitoring.windows import FIRST_S, PIECE_S, Part, WindowRun, estimate_by_parts, estimate_by_scores
from passerby.people.held_cameras import GroundPlane, fit_people
from passerby.people.resection import Resection, resect_observations
from passerby.people.scores import STRETCH_S, Scores, cluster_scores
from passerby.people.sightings import Sightings, poses_of
from passerby.solver.readjustment import readjust

__all__ = ["WatchOptions", "Watched", "watch"]

BEFORE_WINDOWS = 5
"""Largest number of windows before a move, from which the pose before it is measured."""
UNLIKELY, CLEARER = 1.5, 1.2
"""A removed camera did not move if the score of the rest is at least the first number (one case in thirty), and exceeds that
without the best camera by the second (sixteen times less likely)."""
MOST_SETS = 130
"""Largest number of sets of cameras that are tried as those that moved together: all threes of ten cameras."""
SEED = 0
"""Seed of the sample where there are too many observations."""
ENOUGH = 0.05
"""Least share, of the people whom two cameras see at once, whose joints both have found; below it, joints are the exception."""


def watch(
    rig: Rig,
    seen: Sightings,
    options: WatchOptions | None = None,
    *,
    ground: GroundPlane | None = None,
    tell: Progress = silent,
    span: tuple[float, float] | None = None,
) -> Watched:
    """Test footage for moves, with the cameras held.

    Args:
        rig: poses, and their sigmas, as they were calibrated.
        seen: people with identities over all cameras.
        options: see `WatchOptions`.
        ground: plane of the feet; None: z = 0.
        tell: called with the number of windows that are done.
        span: begin of the first window and end of the last one, seconds; None: the times at which people were seen.
    """
    run = _ScoreRun(rig, seen, options or WatchOptions(), ground or GroundPlane(), tell, span)
    return run.result()


class _ScoreRun(WindowRun):
    """Test of windows by the scores of people on the poses, with the cameras held."""

    def __init__(
        self, rig: Rig, seen: Sightings, options: WatchOptions, ground: GroundPlane, tell: Progress,
        span: tuple[float, float] | None,
    ) -> None:  # fmt: skip
        super().__init__(rig, seen, options, ground, tell, span)
        self.known = self.start
        self.scores = self._scores(self.start)

    def _test_cameras(self, from_s: float, until_s: float) -> list[MotionTest]:
        # A stretch is used as soon as it has ended.
        over = until_s if until_s >= self.end else until_s - STRETCH_S + 1e-9
        window, quiet = self.scores.between(from_s, over), self.scores.between(self.known, from_s)
        self.baseline, self.known = self.baseline.with_quiet(quiet), max(self.known, from_s)
        return run_motion_tests(window, self.baseline, (), self.options.threshold)

    def _learn(self, found: Sequence[MotionTest]) -> None:
        self.baseline = self.baseline.with_scatter(found)

    def _compare_since(self, from_s: float) -> Comparison | None:
        R, centre = poses_of(self.rig, self.names)
        estimate = estimate_by_scores(R, centre, self.scores.between(from_s, np.inf))
        return None if estimate is None else compare(R, centre, self.prior.estimate(), estimate, self.options.threshold)

    def _scores(self, from_s: float) -> Scores:
        """Compute the clusters from a time on, by the present poses."""
        seen = self.seen.without(np.isin(self.names, self.lost)) if self.lost else self.seen
        edges = np.append(np.arange(from_s, self.end, PIECE_S), np.inf)
        rotation, centre = poses_of(self.rig, self.names)
        parts = []
        for low, high in pairwise(edges.tolist()):
            piece = seen.between(low, high)
            if piece.n_blocks:
                parts.append(cluster_scores(piece, fit_people(piece, rotation, centre, ground=self.ground)))
        n = 6 * len(self.names)
        nothing = Scores(np.zeros(0), np.zeros((0, n)), np.zeros((0, n, n)), np.zeros((0, len(self.names)), np.int64))
        return Scores.joined(parts) if parts else nothing

    def _record_move(self, found: Sequence[MotionTest], from_s: float, until_s: float) -> float:
        every = self.options.every_s
        cameras, others = self._culprits(found, self.scores.between(from_s, until_s))
        moments = self._moments(cameras, from_s, until_s)
        after = max(from_s - every, min(moment.seconds for moment in moments))
        high = min(max(after + every, until_s), self.end)
        again, others = self._find_culprits(after, high, cameras, others)
        if again != cameras:
            cameras, moments = again, self._moments(again, from_s, until_s)
        score = max(test.score for test in found)
        for camera, moment in zip(cameras, moments, strict=True):
            self._settle(camera, cameras, others, moment, until_s, high, score)
        self.scores, self.known = self._scores(high), high
        return high

    def _find_culprits(
        self, from_s: float, until_s: float, cameras: list[int], others: list[int]
    ) -> tuple[list[int], list[int]]:
        """Find the cameras that moved by the footage after the move, within a window."""
        window = self.scores.between(from_s, until_s)
        found = run_motion_tests(window, self.baseline, (), self.options.threshold)
        if max((test.score for test in found), default=0.0) < self.options.threshold:
            return cameras, others
        return self._culprits(found, window)

    def _culprits(self, found: Sequence[MotionTest], window: Scores) -> tuple[list[int], list[int]]:
        """Find the fewest cameras without which all others agree, and those that may have moved in place of a single one."""
        limit, strength = self.options.threshold, {test.camera: test.score for test in found}
        cameras = sorted(strength, key=lambda c: -strength[c])
        best: tuple[int, ...] = (cameras[0],)
        for size in range(1, max(2, len(self.names) - 1)):
            sets = list(combinations(cameras, size))[:MOST_SETS]
            # Two cameras that agree are needed to show that a third one does not.
            rest = {
                freed: max((t.score for t in run_motion_tests(window, self.baseline, freed, limit)), default=0.0)
                for freed in sets
            }
            best = min(
                sets, key=lambda freed: (max(rest[freed], limit / 2 if size == 1 else 0.0), -min(strength[c] for c in freed))
            )
            if rest[best] < limit:
                doubtful = max(UNLIKELY, rest[best] + CLEARER)
                others = [c for (c, *more) in sets if not more and (c,) != best and rest[(c,)] < min(doubtful, limit)]
                return list(best), others
        return list(best), []

    def _settle(
        self, camera: int, cameras: list[int], others: list[int], moment: ChangePoint, noticed: float, until: float,
        score: float,
    ) -> None:  # fmt: skip
        """Measure and record a camera's move, and set its new pose."""
        name, every = self.names[camera], self.options.every_s
        gone = (*self.lost, *(self.names[c] for c in cameras if c != camera))
        after = self.seen.between(moment.seconds, max(until, moment.seconds + every))
        new = resect_observations(self.rig, after, name, without=gone, ground=self.ground)
        early = moment.seconds - self.start < FIRST_S
        before = None
        if not early:
            span = self.seen.between(moment.from_s - BEFORE_WINDOWS * every, moment.from_s)
            before = resect_observations(self.rig, span, name, without=self.lost, ground=self.ground)
        told = tuple(self.names[c] for c in others)
        if new is None:
            test = Move(
                name, noticed, None if early else moment, score, np.full(6, np.nan), np.full((6, 6), np.nan), None, None
            )
            self.moves.append(replace(test, others=told))
            self.lost = (*self.lost, name)
            return
        shift, covariance = _difference(self.rig, new, before)
        sigma = _add_rig_sigma(self.rig, new)
        self.moves.append(Move(name, noticed, None if early else moment, score, shift, covariance, new.pose, sigma, told))
        self.baseline = self.baseline.replaced(camera, new.covariance)
        self.rig = replace(
            self.rig, cameras=tuple(replace(c, pose=new.pose, sigma=sigma) if c.name == name else c for c in self.rig.cameras)
        )


def _difference(rig: Rig, new: Resection, before: Resection | None) -> tuple[Floats, Floats]:
    """Return a move (6,) and its covariance (6, 6), from the pose that was measured before it, or else from the rig's pose."""
    if before is None:
        return new.shift, new.covariance + rig_covariance_of(rig, new.camera)
    turn = log_rotation(new.pose.R_cw @ before.pose.R_cw.T)
    shift = np.concatenate([new.pose.centre - before.pose.centre, turn])
    rotate = np.eye(6)
    rotate[3:, 3:] = new.pose.R_cw @ before.pose.R_cw.T
    return shift, new.covariance + rotate @ before.covariance @ rotate.T


def _add_rig_sigma(rig: Rig, new: Resection) -> PoseSigma:
    """Return the sigma of a new pose, from that of its measurement and the errors of the rig's other cameras."""
    others = [rig_covariance_of(rig, camera.name) for camera in rig.posed() if camera.name != new.camera]
    return PoseSigma.from_covariance(new.covariance + (np.mean(others, axis=0) / max(len(others), 1) if others else 0.0))


def joints_are_shared(observations: Observations) -> bool:
    """Check whether two cameras have joints of the same people at the same time steps, often enough compared with boxes."""
    both = {"boxes": 0, "keypoints": 0}
    for part in both:
        rows = [
            np.column_stack([p.frame, p.identity]) for seen in observations.cameras.values() for p in (getattr(seen, part),)
        ]
        rows = [np.unique(own[own[:, 1] != UNKNOWN], axis=0) for own in rows]
        if rows:
            both[part] = int(np.count_nonzero(np.unique(np.concatenate(rows), axis=0, return_counts=True)[1] > 1))
    return both["keypoints"] > 0 and both["keypoints"] >= ENOUGH * both["boxes"]


def joints_are_frequent(observations: Observations) -> bool:
    """Check whether `joints_are_shared` may hold when identities are known: joints are frequent compared with boxes."""
    boxes, joints = (sum(len(getattr(seen, part)) for seen in observations.cameras.values()) for part in ("boxes", "keypoints"))
    return joints > 0 and joints >= ENOUGH * boxes


def watch_adjusted(
    rig: Rig, observations: Observations, seen: Sightings, options: WatchOptions | None = None, *,
    ground: GroundPlane | None = None, tell: Progress = silent, span: tuple[float, float] | None = None,
) -> Watched:  # fmt: skip
    """Test footage with joints for moves, by an adjustment of all cameras to each window.

    Args:
        rig: poses, and their sigmas, as they were calibrated.
        observations: people with identities over all cameras, at common time steps.
        seen: the same people as rays (`gather_sightings`), from which moves are dated.
        options: see `WatchOptions`.
        ground: plane of the feet; None: z = 0.
        tell: called with the number of windows that are done.
        span: as in `watch`.
    """
    run = _AdjustedRun(rig, observations, seen, options or WatchOptions(), ground or GroundPlane(), tell, span)
    return replace(run.result(), by_joints=True)


class _AdjustedRun(WindowRun):
    """Test of windows by an adjustment of all cameras to each window."""

    def __init__(
        self, rig: Rig, observations: Observations, seen: Sightings, options: WatchOptions, ground: GroundPlane,
        tell: Progress, span: tuple[float, float] | None,
    ) -> None:  # fmt: skip
        super().__init__(rig, seen, options, ground, tell, span)
        self.observations = observations
        self.clock = next(iter(observations.clocks.values()), None) or Clock(observations.fps or 1.0)
        self.comparison: Comparison | None = None
        self.tested = self.start, self.start
        """Begin and end of the footage of `comparison`, seconds."""
        self.quiet: list[Part] = []
        """The windows in which nothing moved."""
        self.weighed = False

    def _test_cameras(self, from_s: float, until_s: float) -> list[MotionTest]:
        self.comparison, self.tested = self._compare_stretch(from_s, until_s), (from_s, until_s)
        if self.comparison is None:
            return [untestable(camera) for camera in range(len(self.names))]
        return list(self.comparison.tests)

    def _learn(self, found: Sequence[MotionTest]) -> None:
        if self.comparison is not None:
            from_s, until_s = self.tested
            # The last window may overlap with the one before it.
            fresh = max([from_s, *(one.until_s for one in self.quiet)])
            share = (until_s - fresh) / max(until_s - from_s, 1e-9)
            shift, information = self.comparison.shift, share * self.comparison.information
            stretches = np.array([test.clusters for test in self.comparison.tests])
            self.quiet.append(Part(fresh, until_s, shift, information, stretches * share))
            self.baseline = self.baseline.with_estimate(shift, information)

    def _record_move(self, found: Sequence[MotionTest], from_s: float, until_s: float) -> float:
        assert self.comparison is not None
        end = self.end

        def until(after: float) -> float:
            """Return the end of a window that begins after a move."""
            return min(max(after + self.options.every_s, until_s), end)

        return until(
            self._settle_displaced(
                self.comparison.moved, from_s, until_s, lambda after: self._compare_stretch(after, until(after))
            )
        )

    def _compare_since(self, from_s: float) -> Comparison | None:
        parts = [one for one in self.quiet if one.from_s >= from_s - 1e-9]
        if not parts:
            return None
        R, centre = poses_of(self.rig, self.names)
        estimate = estimate_by_parts(R, centre, parts)
        if estimate is None:
            return None
        if self.since <= self.start:
            share = sigma_share(centre, Baseline.of_rig(self.rig, self.names).estimate()[1], estimate)
            self.prior = Baseline.of_rig(self.rig, self.names, share)
        return compare(R, centre, self.prior.estimate(), estimate, self.options.threshold)

    def _compare_stretch(self, from_s: float, until_s: float) -> Comparison | None:
        """Compare the rig with an adjustment to a stretch of footage; None without enough people."""
        use = list(range(len(self.names)))
        seen = self._cut_observations(from_s, until_s)
        while len(use) > 1:
            found = readjust(self._level(use), seen, np.random.default_rng(SEED), stretch_s=STRETCH_S)
            if found is None:
                return None
            kept = [k for k in range(len(use)) if found.stretches[k] >= FEWEST_STRETCHES and k not in found.loose]
            if len(kept) == len(use):
                # The errors of people differ between stretches of time: they walk in other places.
                covariance = found.covariance + np.kron(np.eye(len(use)), model_covariance())
                estimate = Estimate(np.array(use), found.R, found.centre, covariance, found.stretches)
                R, centre = poses_of(self.rig, self.names)
                if not self.weighed:
                    share = sigma_share(centre, self.baseline.estimate()[1], estimate)
                    self.baseline, self.weighed = Baseline.of_rig(self.rig, self.names, share), True
                return compare(R, centre, self.baseline.estimate(), estimate, self.options.threshold)
            use = [use[k] for k in kept]
        return None

    def _cut_observations(self, from_s: float, until_s: float) -> Observations:
        """Return the observations at times in [from, until)."""

        def part(seen: CameraObservations) -> CameraObservations:
            rows = [(s >= from_s) & (s < until_s) for s in map(self.clock.seconds, (seen.boxes.frame, seen.keypoints.frame))]
            return CameraObservations(seen.boxes.take(rows[0]), seen.keypoints.take(rows[1]))

        return replace(self.observations, cameras={name: part(seen) for name, seen in self.observations.cameras.items()})

    def _level(self, use: Sequence[int]) -> Rig:
        """Return some of the cameras with the rig's poses, moved so that the ground under them is at about z = 0."""
        cameras = tuple(self.rig[self.names[c]] for c in use)
        places = np.array([camera.pose.centre[:2] for camera in cameras if camera.pose is not None])
        height = float(self.ground.at(places.mean(axis=0)[None])[0])
        return Rig(cameras).moved(np.eye(3), np.array([0.0, 0.0, -height]))
