"""Choice of a part of the footage, so that the work stays within a budget of processor time.

The time is predicted from the number of boxes, and never measured during the run: the same footage is thinned alike on every
computer. The detection of people in videos is not included.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from passerby.common.arrays import Bools, Ints
from passerby.core.observations import CameraObservations, Clock, Observations
from passerby.core.synchronisation import sampling_distance
from passerby.findings.finding import Finding, notice
from passerby.monitoring.watched import STEPS, WatchOptions
from passerby.monitoring.watching import joints_are_frequent
from passerby.people.sightings import EVERY_S

SITE_BUDGET_S = 1.0
"""Default budget for a rig of many cameras, processor seconds for each camera and minute: 1,000 cameras that record all the
time then need some 17 cores at most. Boxes of five people at once, five times a second, are then not thinned."""
READ_S, TRACK_S, BODY_S = 2e-5, 1.9e-4, 3.4e-4
"""Processor time for a box, seconds: to read and check it; to put it into a tracklet and compare it with those of the
neighbours; and, at the instants that are tested, to test it. Measured on airports of 24 and 50 cameras (seeds 821 and 810,
three and two minutes, 5 frames a second, 2 % noise) while other work ran in parallel; `benchmarks/sites/monitoring.py` measures
more."""
ADJUST_S = 3.2
"""Processor time to adjust a camera and its partners to the keypoints of one window: 0.4 s for each of eight cameras."""
SPACINGS_S = (0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
"""Times between samples that are tried. With more than a second, people can no longer be followed: whole windows are left out
instead."""
MOST_LEFT_OUT = 1000


@dataclass(frozen=True)
class Thinning:
    """The part of the footage that is used."""

    every_s: float = 0.0
    """Least time between samples, seconds; 0: all are used."""
    one_window_in: int = 1
    """One window in this number is used."""
    predicted_s: float = 0.0
    """Predicted processor time for each camera and minute of recording, seconds."""

    @property
    def is_thinned(self) -> bool:
        """Whether any footage is left out."""
        return self.every_s > 0 or self.one_window_in > 1

    def finding(self, budget_s: float) -> Finding:
        """Return the notice that footage is left out."""
        return notice(
            "monitoring_thinned", budget_s=budget_s, predicted_s=self.predicted_s, every_s=self.every_s,
            one_window_in=self.one_window_in,
        )  # fmt: skip


def plan_thinning(observations: Observations, options: WatchOptions, budget_s: float) -> Thinning:
    """Find the least thinning that stays within a budget, or else the strongest one.

    Args:
        observations: observations of the cameras to test, with a clock for each.
        options: see `WatchOptions`.
        budget_s: processor seconds for each camera and minute of recording.
    """
    footage = [_Footage.of(seen, observations.clocks[name]) for name, seen in observations.cameras.items()]
    minutes = sum(one.minutes for one in footage)
    if minutes <= 0:
        return Thinning()
    # For rigs with keypoints, an adjustment in each window is added.
    tests = minutes * STEPS * 60.0 / options.every_s * ADJUST_S if joints_are_frequent(observations) else 0.0
    reading = sum(one.rows for one in footage) * READ_S
    found = Thinning()
    for every_s in (0.0, *SPACINGS_S):
        work = tests + sum(one.work_s(every_s) for one in footage)
        found = Thinning(every_s, 1, (reading + work) / minutes)
        if found.predicted_s <= budget_s:
            return found
    left = budget_s * minutes - reading
    windows = MOST_LEFT_OUT if left <= 0 else min(MOST_LEFT_OUT, int(np.ceil(work / left)))
    return replace(found, one_window_in=windows, predicted_s=(reading + work / windows) / minutes)


def thin(observations: Observations, thinning: Thinning, window_s: float) -> Observations:
    """Select the observations that are used.

    Args:
        observations: observations with a clock for each camera.
        thinning: from `plan_thinning`.
        window_s: length of a window, seconds; the first one begins when a person is first seen.
    """
    starts = [
        float(observations.clocks[name].seconds(frames.min()))
        for name, seen in observations.cameras.items()
        if len(frames := _frames(seen))
    ]
    origin = min(starts, default=0.0)
    cameras = {}
    for name, seen in observations.cameras.items():
        clock = observations.clocks[name]
        step = sampling_distance(_frames(seen)) if len(_frames(seen)) else 1
        skip = _samples_in(thinning.every_s, step / clock.fps)

        def kept(frame: Ints, clock: Clock = clock, step: int = step, skip: int = skip) -> Bools:
            window = np.floor((clock.seconds(frame) - origin) / window_s + 1e-9)
            return np.asarray(((frame - 1) // step % skip == 0) & (window % thinning.one_window_in == 0))

        cameras[name] = CameraObservations(
            seen.boxes.take(kept(seen.boxes.frame)), seen.keypoints.take(kept(seen.keypoints.frame))
        )
    return replace(observations, cameras=cameras)


@dataclass(frozen=True)
class _Footage:
    """Amount of one camera's observations."""

    rows: int
    minutes: float
    spacing_s: float
    """Time between its samples, seconds."""

    @classmethod
    def of(cls, seen: CameraObservations, clock: Clock) -> _Footage:
        frames = _frames(seen)
        if not len(frames):
            return cls(0, 0.0, 1.0)
        return cls(len(frames), float(np.ptp(frames)) / clock.fps / 60, sampling_distance(frames) / clock.fps)

    def work_s(self, every_s: float) -> float:
        """Return the processor time to follow and test its people with samples `every_s` apart, seconds."""
        spacing_s = self.spacing_s * _samples_in(every_s, self.spacing_s)
        used = self.rows * self.spacing_s / spacing_s
        return used * TRACK_S + used * min(1.0, spacing_s / EVERY_S) * BODY_S


def _frames(seen: CameraObservations) -> Ints:
    """Return the frames (N,) of a camera's boxes or, without any, of its keypoints."""
    return seen.boxes.frame if len(seen.boxes) else seen.keypoints.frame


def _samples_in(every_s: float, spacing_s: float) -> int:
    """Return n for which every n-th sample is used."""
    return max(1, int(np.floor(every_s / spacing_s + 1e-6)))
