"""Heights of people named by a pixel, given to the identities that association finds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Ints
from passerby.core.observations import UNKNOWN, CameraObservations, Observations
from passerby.core.pointing import PointedPerson, Sighting, StatedIdentities, find_pointed
from passerby.core.scale_cues import PersonHeight
from passerby.findings.finding import Finding, doubt, notice

SAME_SIGMAS = 4.0
"""Heights of one person that differ by more sigmas contradict each other: as of a scale cue that contradicts the rest."""

Identify = Callable[[PointedPerson], int | None]


@dataclass(frozen=True)
class PointedHeights:
    """What the pointed-at people tell about the scale."""

    people: tuple[PersonHeight, ...] = ()
    findings: tuple[Finding, ...] = ()
    """Heights that are not used, and those of one person that differ."""


def pointed_heights(pointed: Sequence[PointedPerson], identify: Identify) -> PointedHeights:
    """The heights of the identities to which pointed-at people belong; `identify` has None for who belongs to none."""
    people: list[PersonHeight] = []
    findings: list[Finding] = []
    first: dict[int, PointedPerson] = {}
    for one in pointed:
        identity = identify(one)
        if identity is None:
            values = {"number": one.number, "frame": one.frame, "at": list(one.at)}
            findings.append(notice("pointed_person_unmatched", one.camera, **values))
            continue
        other = first.setdefault(identity, one)
        if abs(one.metres - other.metres) > SAME_SIGMAS * np.hypot(one.sd_m, other.sd_m):
            numbers, heights = [other.number, one.number], [other.metres, one.metres]
            findings.append(doubt("pointed_heights_differ", other.camera, one.camera, numbers=numbers, heights_m=heights))
        people.append(PersonHeight(identity, one.metres, one.sd_m, f"[[scale.people]] {one.number}"))
    return PointedHeights(tuple(people), tuple(findings))


def unfulfilled(stated: StatedIdentities, identify: Callable[[Sighting], int | None]) -> list[Finding]:
    """A notice for each statement of the user that the identities found do not follow."""
    findings = []
    for groups, one_person in ((stated.same, True), (stated.different, False)):
        for group in groups:
            found = [(one, identity) for one in group if (identity := identify(one)) is not None]
            distinct = len({identity for _, identity in found})
            if distinct != (1 if one_person else len(found)) and len(found) > 1:
                cameras = dict.fromkeys(one.camera for one in group)
                values = {"place": group[0].place, "same": one_person, "found": distinct, "boxes": len(group)}
                findings.append(notice("stated_identity_unfulfilled", *cameras, **values))
    return findings


def identity_in(observations: Observations) -> Identify:
    """Identifies people by the identities of their boxes or keypoints."""
    return lambda one: identity_at(
        one, observations[one.camera], observations[one.camera].boxes.identity, observations[one.camera].keypoints.identity
    )


def identity_at(one: PointedPerson | Sighting, seen: CameraObservations, boxes: Ints, keypoints: Ints) -> int | None:
    """The identity of a pointed-at person.

    Where association left that very row out, the identity of its tracklet's row nearest in time.

    Args:
        one: whom.
        seen: what the camera saw, with tracklet numbers.
        boxes: (N,) identities of its boxes, -1 for nobody.
        keypoints: (M,) those of its keypoints.
    """
    found = find_pointed(seen, one.frame, one.at)
    if found is None:
        return None
    kind, row = found
    part, identity = (seen.boxes, boxes) if kind == "boxes" else (seen.keypoints, keypoints)
    if identity[row] > UNKNOWN:
        return int(identity[row])
    if part.identity[row] == UNKNOWN:
        return None
    own = np.flatnonzero((part.identity == part.identity[row]) & (identity > UNKNOWN))
    if not len(own):
        return None
    return int(identity[own[np.argmin(np.abs(part.frame[own] - one.frame))]])
