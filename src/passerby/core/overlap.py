"""Overlap of cameras: people that two cameras saw at the same instants connect these cameras."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Ints
from passerby.core.observations import UNKNOWN, CameraObservations, Observations
from passerby.findings.finding import Finding, notice, refusal


@dataclass(frozen=True)
class Shared:
    """People that two cameras have in common."""

    people: int
    """Number of identities that both saw at one instant at least."""
    sightings: int
    """Number of person-instants (a person at an instant) that both saw."""


def person_instants(seen: CameraObservations) -> Ints:
    """Return the distinct rows (N, 2) of frame and identity of the known people in boxes and joints, sorted."""
    rows = np.concatenate(
        [np.column_stack([part.frame, part.identity])[part.identity > UNKNOWN] for part in (seen.boxes, seen.keypoints)]
    )
    return np.asarray(np.unique(rows, axis=0), dtype=np.int64)


def count_shared_observations(observations: Observations) -> dict[str, dict[str, Shared]]:
    """Count the people that every camera shares with every other camera."""
    names = list(observations.cameras)
    instants = [person_instants(seen) for seen in observations.cameras.values()]
    camera = np.repeat(np.arange(len(names)), [len(own) for own in instants])
    rows = np.concatenate([np.zeros((0, 2), np.int64), *instants])
    order = np.argsort(rows[:, 1], kind="stable")
    people, common = np.zeros((2, len(names), len(names)), np.int64)
    # Person by person: few cameras see each person, so the time grows with the rows and not with the pairs of cameras.
    for one in np.split(order, np.flatnonzero(np.diff(rows[order, 1])) + 1):
        cameras, row = np.unique(camera[one], return_inverse=True)
        frames, column = np.unique(rows[one, 0], return_inverse=True)
        there = np.zeros((len(cameras), len(frames)))
        there[row, column] = 1.0
        together = (there @ there.T).astype(np.int64)
        common[np.ix_(cameras, cameras)] += together
        people[np.ix_(cameras, cameras)] += together > 0
    return {
        first: {second: Shared(int(people[a, b]), int(common[a, b])) for b, second in enumerate(names) if b != a}
        for a, first in enumerate(names)
    }


def find_connected_groups(shared: Mapping[str, Mapping[str, Shared]]) -> list[list[str]]:
    """Return the cameras in groups that shared people connect, the largest group first."""
    left = list(shared)
    groups: list[list[str]] = []
    while left:
        group = [left.pop(0)]
        for name in group:
            reached = [other for other in left if shared[name][other].people]
            group += reached
            left = [other for other in left if other not in reached]
        groups.append([name for name in shared if name in group])
    return sorted(groups, key=len, reverse=True)


def missing_overlap(shared: Mapping[str, Mapping[str, Shared]], *, given: bool = True) -> list[Finding]:
    """Find the cameras that shared people do not connect: a refusal where no two cameras share people, else a notice for every
    group that shares no people with the largest one. Empty where all cameras are connected.

    The remedy in the texts depends on whether the identities were `given` or found.
    """
    main, *others = find_connected_groups(shared)
    if len(main) == 1:
        return [refusal("no_shared_people", given=given)]
    return [notice("cameras_share_nobody", *group, main=main, given=given) for group in others]
