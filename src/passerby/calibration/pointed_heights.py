"""Assignment of the known heights of people, each named by a pixel, to the identities that association finds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Ints
from passerby.core.figures import CueFigures
from passerby.core.observations import UNKNOWN, CameraObservations, Observations
from passerby.core.pointing import PointedPerson, Sighting, StatedIdentities, find_pointed
from passerby.core.scale_cues import PersonHeight
from passerby.findings.finding import Finding, notice
from passerby.solver.cue_agreement import check_cue_consistency

Identify = Callable[[PointedPerson], int | None]


@dataclass(frozen=True)
class PointedHeights:
    """Known heights by identity, and findings about them."""

    people: tuple[PersonHeight, ...] = ()
    findings: tuple[Finding, ...] = ()
    """Findings about heights that are not used, and about those of one person that contradict each other."""


def pointed_heights(pointed: Sequence[PointedPerson], identify: Identify) -> PointedHeights:
    """Return the heights of the identities of people named by pixels; `identify` returns None for a person without one."""
    people: list[PersonHeight] = []
    findings: list[Finding] = []
    cues: dict[int, list[CueFigures]] = {}
    for one in pointed:
        identity = identify(one)
        if identity is None:
            values = {"number": one.number, "frame": one.frame, "at": list(one.at)}
            findings.append(notice("pointed_person_unmatched", one.camera, **values))
            continue
        place = f"[[scale.people]] {one.number}"
        people.append(PersonHeight(identity, one.metres, one.sd_m, place))
        cues.setdefault(identity, []).append(_as_cue(people[-1]))
    findings += [finding for own in cues.values() for finding in check_cue_consistency(own)[1]]
    return PointedHeights(tuple(people), tuple(findings))


def _as_cue(one: PersonHeight) -> CueFigures:
    """Return a stated height as a cue, to compare with others of the same person; its scale is relative to a height of 1 m."""
    return CueFigures(
        cue=f"height of person {one.identity}, {one.place}", kind="person", identity=one.identity, stated_m=one.metres,
        measured_m=1.0, sd_m=one.sd_m, residual_sigmas=0.0, share=0.0, own_scale=one.metres, own_sigma=one.sd_m / one.metres,
    )  # fmt: skip


def unfulfilled(stated: StatedIdentities, identify: Callable[[Sighting], int | None]) -> list[Finding]:
    """Return a notice for each statement of the user that the identities found do not fulfil."""
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
    """Return a function that identifies people by the identities of their boxes or keypoints."""
    return lambda one: identity_at(
        one, observations[one.camera], observations[one.camera].boxes.identity, observations[one.camera].keypoints.identity
    )


def identity_at(one: PointedPerson | Sighting, seen: CameraObservations, boxes: Ints, keypoints: Ints) -> int | None:
    """Return the identity of a person named by a pixel; None if it has none.

    If association left out the row at the pixel, the identity is that of its tracklet's row nearest in time.

    Args:
        one: the person.
        seen: observations of the camera, with tracklet numbers.
        boxes: (N,) identities of its boxes, -1 for no person.
        keypoints: (M,) identities of its keypoints.
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
