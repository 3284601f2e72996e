"""Errors of people's trajectories on the ground against the true ones.

The estimated world is placed on the true one as in the comparison of cameras (`passerby.evaluation.metrics`): *metric*, the
reference camera coincides, and *similarity*, which also removes the error of the scale. Distances are measured on the ground
plane.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.core.trajectories import Trajectories
from passerby.evaluation.metrics import place
from passerby.geometry.rotations import Similarity

REACH_M = 2.0
"""Places of the same person are nearer than this: people are matched by the instants at which places are nearer."""
LONGEST_STEP_S = 1.0
"""Maximum time between two true places for an interpolation; a longer median step of a person's true places raises it."""
ROWS_AT_ONCE = 20_000
WITHIN_M = (0.15, 0.26, 0.59)
"""The goal of Passerby on simulated scenes, and the paper's best and worst mean distance on its three real scenes."""


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """M true places, sorted by identity, then by time. True world: z up, ground at z = 0, metres."""

    identity: Ints
    """(M,) true identities."""
    time_s: Floats
    """(M,) times on the clock of the trajectories, seconds."""
    xy: Floats
    """(M, 2) places on the ground, metres."""

    @classmethod
    def of(cls, identity: Ints, time_s: Floats, xy: Floats) -> GroundTruth:
        """Return the places, sorted by identity and time."""
        order = np.lexsort((time_s, identity))
        return cls(identity[order], time_s[order], xy[order])


@dataclass(frozen=True)
class Distances:
    """Distances of places from the true ones, metres; None if there is nothing to compare."""

    places: int
    mean_m: float | None
    median_m: float | None
    p95_m: float | None
    within: dict[str, float]
    """Distance of `WITHIN_M`, as a text -> share of the places within it."""
    within_sigma: float | None
    """Share of the places whose distance is at most their own sigma."""

    def to_dict(self) -> dict[str, Any]:
        """Return the distances as plain values for JSON."""
        return {
            "places": self.places, "mean_m": self.mean_m, "median_m": self.median_m, "p95_m": self.p95_m,
            "within_m": self.within, "within_sigma": self.within_sigma,
        }  # fmt: skip


@dataclass(frozen=True)
class Judgement:
    """Errors of trajectories against the truth, in one placement."""

    distances: Distances
    by_cameras: dict[str, Distances]
    """Distances of places that several cameras saw ("several"), one camera ("one") or no camera ("none")."""
    matched: dict[int, int]
    """Identity -> true identity."""
    unmatched: tuple[int, ...]
    """Identities without a true identity: a second identity of a person, or no person."""
    missing: tuple[int, ...]
    """True identities without an identity."""
    covered: float | None
    """Share of the true places, between the first and the last instant, at which the person has an estimate."""

    def to_dict(self) -> dict[str, Any]:
        """Return the errors as plain values for JSON."""
        return {
            **self.distances.to_dict(), "by_cameras": {name: part.to_dict() for name, part in self.by_cameras.items()},
            "matched": len(self.matched), "unmatched": list(self.unmatched), "missing": list(self.missing),
            "covered": self.covered,
        }  # fmt: skip


def placements(estimate: Rig, truth: Rig, reference: str | None = None) -> dict[str, Similarity]:
    """Compute the motions from the estimated world to the true one: `metric`, and `similarity` if it is defined.

    Args:
        estimate: cameras with poses.
        truth: cameras with poses, with the same names.
        reference: camera that coincides in the metric placement; None: the truth's first camera that has both poses.

    Raises:
        InputError: no camera has a pose in both, or the reference has none.
    """
    names = [camera.name for camera in truth.posed() if camera.name in estimate.posed().names]
    if not names:
        raise InputError(
            f"no camera has a pose in both rigs: the estimate has {', '.join(estimate.posed().names) or 'none'}, "
            f"the truth {', '.join(truth.posed().names) or 'none'}; the names must be the same"
        )
    if reference is not None and reference not in names:
        raise InputError(f"reference camera {reference} has no pose in both rigs: choose one of {', '.join(names)}")
    own, true = estimate[reference or names[0]].pose, truth[reference or names[0]].pose
    assert own is not None
    assert true is not None
    turn = true.R_cw.T @ own.R_cw
    found = {"metric": Similarity(1.0, turn, true.centre - turn @ own.centre)}
    pairs = [(estimate[name].pose, truth[name].pose) for name in names]
    similarity = place([e for e, _ in pairs if e is not None], [t for _, t in pairs if t is not None])
    return found if similarity is None else found | {"similarity": similarity}


def judge(found: Trajectories, truth: GroundTruth, placement: Similarity | None = None, *, same_ids: bool = False) -> Judgement:
    """Compare trajectories with the truth.

    Args:
        found: trajectories in their own world.
        truth: true places in the true world, on the same clock.
        placement: motion from the first world to the second; None: the worlds are the same.
        same_ids: identities are those of the truth. Otherwise people are matched one to one so that the sum of
            1 - distance / `REACH_M` over all nearer places is as large as possible.
    """
    ground = np.column_stack([found.xyz[:, :2], np.zeros(len(found))])
    own = (placement.apply(ground) if placement else ground)[:, :2]
    scale = placement.scale if placement else 1.0
    people, who = np.unique(found.identity, return_inverse=True)
    true_people = np.unique(truth.identity)
    matched = (
        {int(one): int(one) for one in people if one in true_people}
        if same_ids
        else _match_people(people, who.ravel(), true_people, own, found.time_s, truth)
    )
    distance = np.full(len(found), np.nan)
    for identity, true in matched.items():
        rows = np.flatnonzero(found.identity == identity)
        distance[rows] = np.linalg.norm(own[rows] - _interpolate_truth(truth, true, found.time_s[rows]), axis=1)
    sigma = scale * found.sigma_m
    kinds = {"several": found.cameras > 1, "one": found.cameras == 1, "none": found.cameras == 0}
    return Judgement(
        _distances(distance, sigma),
        {name: _distances(distance[rows], sigma[rows]) for name, rows in kinds.items()},
        matched,
        tuple(int(one) for one in people if int(one) not in matched),
        tuple(int(one) for one in true_people if int(one) not in set(matched.values())),
        _measure_cover(found, truth, matched),
    )


def compare_places(found: Trajectories, other: Trajectories, placement: Similarity) -> Distances:
    """Compute the distances between places of the same people by two rigs, which are due to the cameras alone.

    Args:
        found: trajectories in their own world.
        other: trajectories from the same boxes in the other world.
        placement: motion from the first world to the second.
    """
    ground = np.column_stack([found.xyz[:, :2], np.zeros(len(found))])
    own = placement.apply(ground)[:, :2]
    key, other_key = (np.column_stack([one.identity, one.frame]) for one in (found, other))
    _, index = np.unique(np.concatenate([other_key, key]), axis=0, return_inverse=True)
    index = index.ravel()
    row = np.full(int(index.max(initial=-1)) + 1, -1)
    row[index[: len(other)]] = np.arange(len(other))
    partner = row[index[len(other) :]]
    distance = np.where(partner >= 0, np.linalg.norm(own - other.xyz[partner, :2], axis=1), np.nan)
    return _distances(distance, placement.scale * found.sigma_m)


def _distances(distance: Floats, sigma: Floats) -> Distances:
    """Summarise distances (N,), which are NaN where there is no truth."""
    known = np.isfinite(distance)
    distance, sigma = distance[known], sigma[known]
    if not len(distance):
        return Distances(0, None, None, None, {}, None)
    sure = np.isfinite(sigma)
    return Distances(
        len(distance), float(distance.mean()), float(np.median(distance)), float(np.percentile(distance, 95)),
        {f"{limit:g}": float((distance <= limit).mean()) for limit in WITHIN_M},
        float((distance[sure] <= sigma[sure]).mean()) if sure.any() else None,
    )  # fmt: skip


def _interpolate_truth(truth: GroundTruth, identity: int, seconds: Floats) -> Floats:
    """Interpolate a person's true places (N, 2) at the given times; NaN where the truth has none."""
    low, high = np.searchsorted(truth.identity, [identity, identity + 1])
    known, xy = truth.time_s[low:high], truth.xy[low:high]
    after = np.clip(np.searchsorted(known, seconds - 1e-6), 0, len(known) - 1)
    before = np.maximum(after - 1, 0)
    longest = max(LONGEST_STEP_S, 1.01 * float(np.median(np.diff(known)))) if len(known) > 1 else 0.0
    on = np.abs(known[after] - seconds) <= 1e-6
    step = known[after] - known[before]
    inside = on | ((known[before] <= seconds) & (seconds <= known[after]) & (step <= longest + 1e-6))
    share = np.where(on, 1.0, np.divide(seconds - known[before], step, out=np.ones(len(seconds)), where=step > 0))
    out = (1 - share)[:, None] * xy[before] + share[:, None] * xy[after]
    return np.asarray(np.where(inside[:, None], out, np.nan))


def _match_people(
    people: Ints, who: Ints, true_people: Ints, own: Floats, seconds: Floats, truth: GroundTruth
) -> dict[int, int]:
    """Match identities one to one to true identities (see `judge`)."""
    near = np.zeros((len(people), len(true_people)))
    for column, true in enumerate(true_people):
        for first in range(0, len(own), ROWS_AT_ONCE):
            rows = slice(first, first + ROWS_AT_ONCE)
            apart = np.linalg.norm(own[rows] - _interpolate_truth(truth, int(true), seconds[rows]), axis=1)
            worth = np.where(np.isfinite(apart), np.maximum(0.0, 1 - apart / REACH_M), 0.0)
            near[:, column] += np.bincount(who[rows], worth, minlength=len(people))
    rows_, columns = linear_sum_assignment(-near)
    return {
        int(people[row]): int(true_people[column]) for row, column in zip(rows_, columns, strict=True) if near[row, column] > 0
    }


def _measure_cover(found: Trajectories, truth: GroundTruth, matched: dict[int, int]) -> float | None:
    """Compute the share of the true places at which the matched person has a place within half a frame in time."""
    if not len(found) or not len(truth.identity):
        return None
    first, last = found.time_s.min() - 1e-6, found.time_s.max() + 1e-6
    asked, hit = 0, 0
    back = {true: identity for identity, true in matched.items()}
    for true in np.unique(truth.identity):
        seconds = truth.time_s[truth.identity == true]
        seconds = seconds[(first <= seconds) & (seconds <= last)]
        asked += len(seconds)
        if int(true) not in back:
            continue
        known = found.time_s[found.identity == back[int(true)]]
        after = np.clip(np.searchsorted(known, seconds), 0, len(known) - 1)
        nearest = np.minimum(np.abs(known[after] - seconds), np.abs(known[np.maximum(after - 1, 0)] - seconds))
        hit += int(np.count_nonzero(nearest <= 0.5 / found.clock.fps + 1e-6))
    return hit / asked if asked else None
