"""What a run is worth: its similarity error against the true cameras, or why it counts as a failure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import fmean

from passerby.core.cameras import Rig
from passerby.evaluation.metrics import compare
from peers.runners import Outcome

LARGEST_MM, LARGEST_DEG = 1000.0, 10.0
"""A mean error beyond is a failure: nobody can use such cameras."""


@dataclass(frozen=True)
class Result:
    """One engine on one table of points."""

    mm: float | None
    """Mean position error over all cameras after the best similarity; None where it has none or is a failure's."""
    degrees: float | None
    failure: str | None
    registered: int
    solve_seconds: float
    whole_seconds: float
    peak_mb: float
    version: str


def mean_result(results: Sequence[Result]) -> Result:
    """Several seeds as one: means, the largest memory; a failure where any of them fails, so that none is averaged away."""
    if len(results) == 1:
        return results[0]
    failures = [result.failure for result in results if result.failure]
    return Result(
        mm=None if failures else fmean(result.mm or 0.0 for result in results),
        degrees=None if failures else fmean(result.degrees or 0.0 for result in results),
        failure=f"{len(failures)} of {len(results)}: {failures[0]}" if failures else None,
        registered=min(result.registered for result in results),
        solve_seconds=fmean(result.solve_seconds for result in results),
        whole_seconds=fmean(result.whole_seconds for result in results),
        peak_mb=max(result.peak_mb for result in results),
        version=results[0].version,
    )


def judge(outcome: Outcome, truth: Rig) -> Result:
    """Compare with the truth. A failure is: no result, a camera that is missing, more than 1 m or more than 10 degrees."""
    poses = {name: pose for name, pose in outcome.poses.items() if name in truth.names}
    failure, mm, degrees = outcome.failure, None, None
    if failure is None and len(poses) < len(truth):
        failure = f"{len(poses)} of {len(truth)} cameras"
    if failure is None:
        estimate = Rig(tuple(replace(camera, pose=poses[camera.name], sigma=None) for camera in truth))
        similarity = compare(estimate, truth).similarity
        mm, degrees = similarity.mean_position_mm, similarity.mean_orientation_deg
        if mm is None or degrees is None:
            failure = "no similarity to the truth"
        elif mm > LARGEST_MM or degrees > LARGEST_DEG:
            failure, mm, degrees = f"{mm / 1000:.1f} m {degrees:.0f}°", None, None
    return Result(
        mm, degrees, failure, len(poses), outcome.solve_seconds, outcome.whole_seconds, outcome.peak_mb, outcome.version
    )
