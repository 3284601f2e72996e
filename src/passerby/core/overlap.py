"""Who is seen together: people whom two cameras saw at the same instants tie these cameras together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Ints
from passerby.core.observations import UNKNOWN, CameraObservations, Observations
from passerby.findings.finding import Finding, doubt


@dataclass(frozen=True)
class Shared:
    """What two cameras have in common."""

    people: int
    """Identities that both saw at one instant at least."""
    sightings: int
    """Person-instants that both saw."""


def person_instants(seen: CameraObservations) -> Ints:
    """(N, 2) distinct (frame, identity) of the known people in boxes and joints, sorted."""
    rows = np.concatenate(
        [np.column_stack([part.frame, part.identity])[part.identity > UNKNOWN] for part in (seen.boxes, seen.keypoints)]
    )
    return np.asarray(np.unique(rows, axis=0), dtype=np.int64)


def count_shared_observations(observations: Observations) -> dict[str, dict[str, Shared]]:
    """For every camera and every other camera, what they share."""
    instants = {name: person_instants(seen) for name, seen in observations.cameras.items()}
    found: dict[str, dict[str, Shared]] = {name: {} for name in instants}
    names = list(instants)
    for index, first in enumerate(names):
        for second in names[index + 1 :]:
            both, count = np.unique(np.concatenate([instants[first], instants[second]]), axis=0, return_counts=True)
            common = both[count == 2]
            shared = Shared(len(np.unique(common[:, 1])), len(common))
            found[first][second] = found[second][first] = shared
    return found


def connected_groups(shared: Mapping[str, Mapping[str, Shared]]) -> list[list[str]]:
    """The cameras in groups that shared people tie together, the largest group first."""
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
    """One doubt for every group of cameras that shares nobody with the largest group; empty where all hang together.

    What to do depends on whether the identities were `given` or found.
    """
    main, *others = connected_groups(shared)
    if len(main) == 1:
        return [doubt("no_shared_people", given=given)]
    return [doubt("cameras_share_nobody", *group, main=main, given=given) for group in others]
