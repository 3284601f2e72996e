"""From boxes and joints to moves: each window's cameras are adjusted anew, all of them, and held against the rig.

The test of `watching` holds all cameras but one. That is quick and works for hours of boxes; but it is blind where the others
have moved as well, and knows no joints, of which half a minute is enough to calibrate by.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from passerby.common.progress import Progress, silent
from passerby.core.cameras import Rig
from passerby.core.observations import UNKNOWN, CameraObservations, Clock, Observations
from passerby.monitoring.comparison import FEWEST_STRETCHES, Comparison, Estimate, compare, sigma_share, untestable
from passerby.monitoring.evidence import Baseline, MotionTest, model_covariance
from passerby.monitoring.watched import Watched, WatchOptions
from passerby.monitoring.windows import Part, WindowRun, estimate_by_parts
from passerby.people.held_cameras import GroundPlane
from passerby.people.rig_observations import RigObservations, poses_of
from passerby.people.scores import STRETCH_S
from passerby.solver.readjustment import readjust

SEED = 0
"""Of the draw among too many observations."""
ENOUGH = 0.05
"""Of the people whom two cameras see at once, the share whose joints both have found: below, joints are the exception."""


def joints_are_shared(observations: Observations) -> bool:
    """Whether cameras found joints of the same people at the same time steps, and not just now and then."""
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
    """Whether `joints_are_shared` may hold once it is known who is who: there are joints, and not just now and then."""
    boxes, joints = (sum(len(getattr(seen, part)) for seen in observations.cameras.values()) for part in ("boxes", "keypoints"))
    return joints > 0 and joints >= ENOUGH * boxes


def watch_adjusted(
    rig: Rig, observations: Observations, seen: RigObservations, options: WatchOptions | None = None, *,
    ground: GroundPlane | None = None, tell: Progress = silent, span: tuple[float, float] | None = None,
) -> Watched:  # fmt: skip
    """Watch footage with joints.

    Args:
        rig: poses, and their sigmas, as they were calibrated.
        observations: people with identities over all cameras, at common time steps.
        seen: the same people as rays (`gather_rig_observations`): they date a move.
        options: see `WatchOptions`.
        ground: where feet are; z = 0 where None.
        tell: told how many windows are done.
        span: as of `watching.watch`.
    """
    run = _AdjustedRun(rig, observations, seen, options or WatchOptions(), ground or GroundPlane(), tell, span)
    return replace(run.result(), by_joints=True)


class _AdjustedRun(WindowRun):
    """Windows tested by adjusting all cameras to each."""

    def __init__(
        self, rig: Rig, observations: Observations, seen: RigObservations, options: WatchOptions, ground: GroundPlane,
        tell: Progress, span: tuple[float, float] | None,
    ) -> None:  # fmt: skip
        super().__init__(rig, seen, options, ground, tell, span)
        self.observations = observations
        self.clock = next(iter(observations.clocks.values()), None) or Clock(observations.fps or 1.0)
        self.comparison: Comparison | None = None
        self.tested = self.start, self.start
        """From when to when `comparison` is,"""
        self.quiet: list[Part] = []
        """and those windows in which nothing moved."""
        self.weighed = False

    def _test_cameras(self, from_s: float, until_s: float) -> list[MotionTest]:
        self.comparison, self.tested = self._compare_stretch(from_s, until_s), (from_s, until_s)
        if self.comparison is None:
            return [untestable(camera) for camera in range(len(self.names))]
        return list(self.comparison.tests)

    def _learn(self, found: Sequence[MotionTest]) -> None:
        if self.comparison is not None:
            from_s, until_s = self.tested
            # The last window may overlap with the one before.
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
            """When a window ends that begins after a move."""
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
        """The rig against what a stretch of footage shows; None where that is nothing."""
        use = list(range(len(self.names)))
        seen = self._cut_observations(from_s, until_s)
        while len(use) > 1:
            found = readjust(self._level(use), seen, np.random.default_rng(SEED), stretch_s=STRETCH_S)
            if found is None:
                return None
            kept = [k for k in range(len(use)) if found.stretches[k] >= FEWEST_STRETCHES and k not in found.loose]
            if len(kept) == len(use):
                # In every stretch of time people walk elsewhere, and are seen otherwise.
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
        """The footage at times of [from, until)."""

        def part(seen: CameraObservations) -> CameraObservations:
            rows = [(s >= from_s) & (s < until_s) for s in map(self.clock.seconds, (seen.boxes.frame, seen.keypoints.frame))]
            return CameraObservations(seen.boxes.take(rows[0]), seen.keypoints.take(rows[1]))

        return replace(self.observations, cameras={name: part(seen) for name, seen in self.observations.cameras.items()})

    def _level(self, use: Sequence[int]) -> Rig:
        """Some of the cameras where the baseline has them, the ground under them at about z = 0."""
        cameras = tuple(self.rig[self.names[c]] for c in use)
        places = np.array([camera.pose.centre[:2] for camera in cameras if camera.pose is not None])
        height = float(self.ground.at(places.mean(axis=0)[None])[0])
        return Rig(cameras).moved(np.eye(3), np.array([0.0, 0.0, -height]))
