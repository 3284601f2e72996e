"""How much of the videos is watched: ever more stretches, until the rig measures as well as is wanted."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from passerby.calibration.calibration import Calibration
from passerby.core.figures import adjusted
from passerby.findings.finding import Finding, notice

WORTH = 0.1
"""Twice as much video is worth its time where it lowers an uncertainty by this share or more. One that falls with the number of
people alone falls by 29 %; one that barely falls is of something else: of a lens, of where a foot is in a box."""


TARGET_M = 0.05
"""The usual target."""
LEAST_S = 180.0
"""So much of the scene's time is used at least where the rig is not accepted or points miss the target: a camera's people may
come later, and errors that no uncertainty shows, such as a detector's at one place, still fall."""


@dataclass(frozen=True)
class Effort:
    """What is wanted; without a target and a budget the videos are watched as a whole."""

    target_m: float | None = TARGET_M
    """Uncertainty, one sigma, of points by several cameras and of positions on the ground by one, metres, at which no more
    of the videos is watched."""
    budget_s: float | None = None
    """Seconds after which no further stretches are begun, if they would take longer; None: no limit."""

    @property
    def limited(self) -> bool:
        """Whether less than all of the videos may be enough."""
        return self.target_m is not None or self.budget_s is not None


@dataclass(frozen=True)
class Step:
    """What a rig from a part of the videos came to."""

    used_s: float
    """Of the scene's time."""
    ended_s: float
    """After the beginning of the run."""
    verdict: str
    points_m: float | None
    ground_m: float | None
    """None where there is no rig, or no camera sees the ground."""

    @classmethod
    def of(cls, found: Calibration, used_s: float, ended_s: float) -> Step:
        """What a calibration came to."""
        measuring = adjusted(found.figures).measuring
        points = None if measuring is None else measuring.points.median_mm / 1000
        ground = None if measuring is None or measuring.ground is None else measuring.ground.median_mm / 1000
        return cls(used_s, ended_s, found.verdict, points, ground)


def sizes(count: int) -> Iterator[int]:
    """How many of so many stretches are watched in each step: one, and always twice as many."""
    size = 1
    while size < count:
        yield size
        size *= 2
    yield count


def is_enough(steps: Sequence[Step], effort: Effort) -> bool:
    """Whether further stretches are not worth their time, or would take more than there is.

    The first step is never enough for a target: what it says of itself is confirmed by twice as much video.
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
    """What points and positions on the ground would be uncertain by after so many seconds of video, metres; None: unknown.

    The variance of the last two steps, as a constant and a part that falls with the time used.
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
    """How much of the videos was used, and what the rest would bring; None where all was used."""
    last = steps[-1]
    if last.used_s >= recorded_s:
        return None
    points, ground = foresee(steps, recorded_s)
    return notice(
        "videos_used_in_part", used_s=last.used_s, recorded_s=recorded_s, points_m=points, ground_m=ground,
        now_points_m=last.points_m, now_ground_m=last.ground_m,
    )  # fmt: skip
