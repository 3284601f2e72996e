"""Choice of how much of the videos is processed: more and more stretches, until the rig has the wanted accuracy."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from passerby.calibration.calibration import Calibration
from passerby.core.figures import adjusted
from passerby.findings.finding import Finding, notice

WORTH = 0.1
"""Twice as much video is worth its time if it lowers a sigma by this share or more. A sigma that depends on the number of
people alone falls by 29 %. One that barely falls has another cause, such as a lens or the place of a foot in a box."""


TARGET_M = 0.05
"""Default target, metres."""
LEAST_S = 180.0
"""Least part of the scene's time, seconds, that is used if the rig is not accepted or points miss the target. A camera's people
may come later, and errors that no sigma includes, such as those of a detector at one place, still fall."""


@dataclass(frozen=True)
class Effort:
    """The wanted accuracy, and the limit of the time; without both, the videos are processed as a whole."""

    target_m: float | None = TARGET_M
    """One sigma of points by several cameras and of positions on the ground by one, metres, at which no further stretches are
    processed; None: no target."""
    budget_s: float | None = None
    """Time of the run, seconds; no further stretches are begun that would probably exceed it; None: no limit."""

    @property
    def limited(self) -> bool:
        """Whether a part of the videos may be enough."""
        return self.target_m is not None or self.budget_s is not None


@dataclass(frozen=True)
class Step:
    """Uncertainties of a rig from a part of the videos."""

    used_s: float
    """Part of the scene's time that was used, seconds."""
    ended_s: float
    """Time of the result, seconds after the beginning of the run."""
    verdict: str
    points_m: float | None
    ground_m: float | None
    """Median sigmas of points and of positions on the ground, metres; None without a rig, or if no camera sees the ground."""

    @classmethod
    def of(cls, found: Calibration, used_s: float, ended_s: float) -> Step:
        """Return the step of a calibration."""
        measuring = adjusted(found.figures).measuring
        points = None if measuring is None else measuring.points.median_mm / 1000
        ground = None if measuring is None or measuring.ground is None else measuring.ground.median_mm / 1000
        return cls(used_s, ended_s, found.verdict, points, ground)


def sizes(count: int) -> Iterator[int]:
    """Yield the number of stretches that are used in each step: one, then twice as many each time, up to `count`."""
    size = 1
    while size < count:
        yield size
        size *= 2
    yield count


def is_enough(steps: Sequence[Step], effort: Effort) -> bool:
    """Check whether further stretches are not worth their time, or would exceed the budget.

    The first step is never enough for a target: twice as much video has to confirm its uncertainties.
    """
    last, before = steps[-1], steps[-2] if len(steps) > 1 else None
    spent_s = last.ended_s - (before.ended_s if before else 0.0)
    if effort.budget_s is not None and last.ended_s + 2 * spent_s > effort.budget_s:
        return True
    target_m = effort.target_m
    if target_m is None or before is None or last.points_m is None or before.verdict != last.verdict:
        return False
    if last.used_s < LEAST_S and (last.verdict != "accepted" or last.points_m > target_m):
        return False

    def suffices(now: float | None, was: float | None) -> bool:
        reached = now is None or (now <= target_m and last.verdict == "accepted")
        return reached or (now is not None and was is not None and now > (1 - WORTH) * was)

    return suffices(last.points_m, before.points_m) and suffices(last.ground_m, before.ground_m)


def foresee(steps: Sequence[Step], seconds: float) -> tuple[float | None, float | None]:
    """Predict the sigmas of points and of positions on the ground after so many seconds of video, metres; None: unknown.

    A constant and a part that is inversely proportional to the time used are fitted to the variances of the last two steps.
    """
    if len(steps) < 2:
        return None, None
    last, before = steps[-1], steps[-2]

    def of(now: float | None, was: float | None) -> float | None:
        if now is None or was is None:
            return None
        falls = max(0.0, was**2 - now**2) / (1 / before.used_s - 1 / last.used_s)
        return math.sqrt(max(now**2 - falls * (1 / last.used_s - 1 / seconds), 0.0))

    return of(last.points_m, before.points_m), of(last.ground_m, before.ground_m)


def note_of_effort(steps: Sequence[Step], recorded_s: float) -> Finding | None:
    """Return a notice on the used part of the videos and the predicted gain from the rest; None if all was used."""
    last = steps[-1]
    if last.used_s >= recorded_s:
        return None
    points, ground = foresee(steps, recorded_s)
    return notice(
        "videos_used_in_part", used_s=last.used_s, recorded_s=recorded_s, points_m=points, ground_m=ground,
        now_points_m=last.points_m, now_ground_m=last.ground_m,
    )  # fmt: skip
