"""Cameras that have no pose: one doubt, with the finding that explains it.

Why a camera could not be registered is a notice of the stage that finds it. Here it becomes a part of the doubt.
"""

from __future__ import annotations

from collections.abc import Sequence

from passerby.core.cameras import Rig
from passerby.findings.finding import Finding, doubt

CODE = "camera_without_pose"

EXPLAINS = (
    "start_unknown", "clock_unknown", "nobody_seen_whole", "few_walkers", "camera_unregistered", "cameras_share_nobody",
    "pair_failed", "cameras_disconnected",
)  # fmt: skip
"""Codes of notices that explain a missing camera; the most specific comes first."""


def without_pose(cause: Finding, names: Sequence[str] | None = None) -> Finding:
    """The doubt about cameras that a cause leaves without a pose: these, or all that it is about."""
    return doubt(CODE, *(cause.cameras if names is None else names), why=cause.as_value())


def with_doubts_of_missing_cameras(rig: Rig, findings: Sequence[Finding]) -> list[Finding]:
    """The findings, first a doubt for each cause that leaves cameras without a pose, in place of what explains these cameras.

    Args:
        rig: at least one camera has a pose.
        findings: those that explain (`EXPLAINS`) or earlier doubts of this kind, among others. Of several causes about a camera
            the most specific one is kept.
    """
    before = [Finding.of_value(one.values["why"]) for one in findings if one.code == CODE and one.values["why"]]
    findings = [*before, *(one for one in findings if one.code != CODE)]
    missing = [camera.name for camera in rig if camera.pose is None]
    left, doubts = missing, list[Finding]()
    for cause in (one for code in EXPLAINS for one in findings if one.code == code):
        if names := [name for name in left if name in cause.cameras]:
            doubts.append(without_pose(cause, names))
            left = [name for name in left if name not in names]
    doubts += [doubt(CODE, name, why=None) for name in left]
    others = [one for one in findings if one.code not in EXPLAINS or not set(missing) & set(one.cameras)]
    return [*doubts, *others]
