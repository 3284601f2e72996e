"""Cameras that have no pose: one doubt, with the finding that explains it.

Why a camera could not be registered is a notice of the stage that finds it; here it becomes a part of the doubt, and no doubt of
its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from passerby.core.cameras import Rig
from passerby.findings.finding import Finding, doubt
from passerby.findings.texts import KINDS

CODE = "camera_without_pose"

EXPLAINS = (
    "start_unknown", "clock_unknown", "nobody_seen_whole", "few_walkers", "camera_unregistered", "cameras_share_nobody",
    "pair_failed", "cameras_disconnected",
)  # fmt: skip
"""Codes of notices that explain a missing camera; the most specific comes first."""


def without_pose(cause: Finding) -> Finding:
    """The doubt about the cameras that a cause is about."""
    return doubt(CODE, *cause.cameras, why=cause.as_value())


def with_doubts_of_missing_cameras(rig: Rig, findings: Sequence[Finding]) -> list[Finding]:
    """The findings with one doubt for the cameras that lack a pose for the same cause, first, in place of these causes.

    Args:
        rig: at least one camera has a pose.
        findings: those that explain (`EXPLAINS`), among others. A cause that is not the most specific one is left out.
    """
    causes = [one for code in EXPLAINS for one in findings if one.code == code]
    groups: list[tuple[list[str], list[Finding]]] = []
    for name in (camera.name for camera in rig if camera.pose is None):
        own = [one for one in causes if name in one.cameras][:1]
        names, same = next((group for group in groups if _are_alike(group[1], own)), ([], []))
        if not names:
            groups.append((names, same))
        names.append(name)
        same += [one for one in own if one not in same]
    doubts = [doubt(CODE, *names, why=_joined(same).as_value() if same else None) for names, same in groups]
    said = {name for one in doubts for name in one.cameras}
    return [*doubts, *(one for one in findings if one.code not in EXPLAINS or not said & set(one.cameras))]


def _are_alike(first: Sequence[Finding], own: Sequence[Finding]) -> bool:
    """Whether a cause is one of the first ones, or the same as these of another camera; likewise where there is none."""
    if not first or not own or own[0] in first:
        return bool(first) == bool(own)
    one, other = first[0], own[0]
    return KINDS[one.code].common and (one.code, one.values) == (other.code, other.values)


def _joined(same: Sequence[Finding]) -> Finding:
    """Causes that are the same, as one about all their cameras."""
    return replace(same[0], cameras=tuple(dict.fromkeys(name for one in same for name in one.cameras)))
