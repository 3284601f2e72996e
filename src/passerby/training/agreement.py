"""Check of identities by geometry, instant by instant: the boxes that two or more cameras confirm for one person only.

At one instant the boxes of an identity must show one place on the ground; the place by each camera is compared with that by
the others. The result must be unambiguous: in each camera all other people's boxes must fit clearly worse, and none of the
boxes may fit a place where other cameras see another person. Boxes that fail are left out, the worst first, as long as two
remain.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.core.observations import UNKNOWN
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.geometry.groups import group_sums, least_of_groups, rows_of_equal
from passerby.people.ground_positions import Places

FITS = 9.2
"""Maximum squared sigmas on the plane between a box and the person's place by the other cameras: 99 of 100 boxes are within."""
OTHER, MARGIN = 16.0, 9.0
"""Minimum squared sigmas between another person's box and this place, and how many more than for the person's own box."""
SAME_BOX_IOU = 0.7
"""Boxes of one camera with a larger overlap show one person, detected twice."""
SPREADS = (0.6, 2.0)
"""Limits of the factor on the usual sigmas; outside of them, the rig or the labels are too wrong for an estimate."""
USUAL_MEDIAN = 1.386
"""Median of squared sigmas on a plane (chi-square with two degrees of freedom)."""
NEAR_M = 1.0
"""People nearer to each other on the ground may exchange their labels."""
CROWDED = 6.0
"""Squared sigmas within which two people may be at the same place."""
BLOCK_ROWS = 50_000
"""Number of boxes that are compared at once, to limit memory."""

HALF_WIDTH_M = 0.3
"""Half width of a body with its arms, including the error of a place on the ground."""
BEHIND_M = 0.5
"""A person who is farther from the camera by more than this hides no other."""
FAR_BEHIND = 2.0
"""A person who is farther from the camera by this factor is too small to have an effect."""
COVERED = 0.2
"""Maximum share of a body, from the feet up, that a nearer person may hide."""

SURE, CUT, ALONE, MISFIT, AMBIGUOUS, BEHIND, NEAR, DISPUTED, UNIDENTIFIED = range(9)
REASONS = ("sure", "cut off by the border", "in one camera only", "does not meet", "another fits as well",
           "behind another person", "near another person", "cameras disagree", "without identity")  # fmt: skip


@dataclass(frozen=True, eq=False)
class GeometricAgreement:
    """Results of N boxes, and places of G groups. A group is one identity at one instant."""

    reason: Ints
    """(N,) `SURE`, or the reason of the rejection: an index of `REASONS`."""
    group: Ints
    """(N,) group of each box; -1 without identity."""
    step: Ints
    """(G,) instants; groups are sorted by identity, then by instant."""
    identity: Ints
    """(G,) identity of each group."""
    place: Floats
    """(G, 2) place on the ground, metres; NaN if only one camera sees the person."""
    sure: NDArray[np.bool_]
    """(G,) whether two cameras or more confirm the group."""
    near: NDArray[np.bool_]
    """(G,) whether another person is within `NEAR_M`."""
    spread: float
    """Factor on the usual sigmas."""


def verify_boxes(places: Places) -> GeometricAgreement:
    """Check all boxes that have an identity."""
    spread = _spread(places)
    places = replace(places, covariance=spread**2 * places.covariance)
    parts = [_verify_block(places.take(rows)) for rows in _blocks(places.step)] or [_verify_block(places)]
    offsets = np.cumsum([0, *(len(part.step) for part in parts)])
    group = np.concatenate([np.where(p.group >= 0, p.group + start, -1) for p, start in zip(parts, offsets, strict=False)])
    step, identity, place, sure, near = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("step", "identity", "place", "sure", "near")
    )
    order = np.lexsort((step, identity))
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    group = np.where(group >= 0, rank[group] if len(rank) else -1, -1)
    reason = np.concatenate([part.reason for part in parts])
    return GeometricAgreement(reason, group, step[order], identity[order], place[order], sure[order], near[order], spread)


def pairs_within(key: Ints) -> tuple[Ints, Ints]:
    """Return all ordered pairs of different rows with the same key; the keys (N,) are sorted."""
    i, j = rows_of_equal(key, key)
    return i[i != j], j[i != j]


def _blocks(step: Ints) -> list[Ints]:
    """Divide the rows into blocks of whole instants with about `BLOCK_ROWS` rows."""
    edges = [0]
    while edges[-1] < len(step):
        end = min(edges[-1] + BLOCK_ROWS, len(step)) - 1
        edges.append(int(np.searchsorted(step, step[end], side="right")))
    return [np.arange(low, high, dtype=np.int64) for low, high in pairwise(edges)]


@dataclass(frozen=True, eq=False)
class _Groups:
    """The group of each box (an identity at an instant), and sums over groups."""

    places: Places
    group: Ints
    count: int
    information: Floats
    """(N, 2, 2) inverse covariance of each place."""
    pull: Floats
    """(N, 2) information times place."""

    @classmethod
    def of(cls, places: Places) -> tuple[_Groups, Ints, Ints]:
        """Return the groups, and their instants and identities, (G,) each."""
        known = np.flatnonzero(places.identity != UNKNOWN)
        pairs = np.column_stack([places.step[known], places.identity[known]])
        named, which = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
        group = np.full(len(places), -1)
        group[known] = which.ravel()
        information = _inverse(places.covariance)
        pull = np.einsum("nij,nj->ni", information, places.place)
        return cls(places, group, len(named), information, pull), named[:, 0], named[:, 1]

    def sums(self, rows: Ints) -> tuple[Ints, Floats, Floats]:
        """Return number (G,), and sums of information (G, 2, 2) and pull (G, 2), of the given rows by group."""
        number = np.bincount(self.group[rows], minlength=self.count)
        information, pull = (group_sums(self.group[rows], part[rows], self.count) for part in (self.information, self.pull))
        return number, information, pull

    def elsewhere(self, rows: Ints) -> tuple[Floats, Floats]:
        """Compute place (R, 2) and covariance (R, 2, 2) by the other rows of each row's group; a group needs two rows."""
        _, information, pull = self.sums(rows)
        covariance = _inverse(information[self.group[rows]] - self.information[rows])
        return np.einsum("nij,nj->ni", covariance, pull[self.group[rows]] - self.pull[rows]), covariance


def _spread(places: Places) -> float:
    """Estimate the factor on the usual sigmas by the median distance between boxes of one identity, without distant boxes."""
    some = places.take(slice(None, BLOCK_ROWS))  # type: ignore[arg-type]
    groups, _, _ = _Groups.of(some)
    rows = _find_shared(groups, np.flatnonzero((groups.group >= 0) & some.whole))
    if len(rows) < 50:
        return 1.0
    place, covariance = groups.elsewhere(rows)
    squared = _square_lengths(some.place[rows] - place, covariance + some.covariance[rows])
    near = squared[squared < 4 * FITS * SPREADS[1] ** 2]
    return float(np.clip(np.sqrt(np.median(near) / USUAL_MEDIAN) if len(near) else 1.0, *SPREADS))


def _find_shared(groups: _Groups, rows: Ints) -> Ints:
    """Return the rows whose group has at least two of the given rows."""
    number = np.bincount(groups.group[rows], minlength=groups.count)
    return rows[number[groups.group[rows]] > 1]


def _verify_block(places: Places) -> GeometricAgreement:
    """Do the work of `verify_boxes` for one block; groups are sorted by instant."""
    groups, step, identity = _Groups.of(places)
    reason = np.where(groups.group < 0, UNIDENTIFIED, np.where(places.whole, SURE, CUT))
    mine, theirs = _rivals(places)
    _leave_out(groups, step, reason, mine, theirs)
    # Hidden people can be found only after all positions are known.
    hidden = _hidden(groups, step, reason)
    reason[(reason == SURE) & hidden] = BEHIND
    _leave_out(groups, step, reason, mine, theirs)
    _mark_disputed(groups, reason)
    place, near = _positions(groups, step, reason, 2)
    crowded = _crowded(groups, reason, mine, theirs)
    _overrule(groups, reason, crowded, NEAR)
    _overrule(groups, reason, near, NEAR)
    sure = np.bincount(groups.group[reason == SURE], minlength=groups.count) > 1
    return GeometricAgreement(reason, groups.group, step, identity, place, np.asarray(sure), near, 1.0)


def _leave_out(groups: _Groups, step: Ints, reason: Ints, mine: Ints, theirs: Ints) -> None:
    """Write into `reason` (N,) why rows fail, the worst of each group first, until all remaining rows agree."""
    while True:
        active = np.flatnonzero(reason == SURE)
        alone = np.setdiff1d(active, _find_shared(groups, active), assume_unique=True)
        reason[alone] = ALONE
        active = np.flatnonzero(reason == SURE)
        why, worse = _failures(groups, step, active, mine, theirs)
        failed = why != SURE
        if not failed.any():
            break
        rows = active[failed]
        worst = rows[least_of_groups(groups.group[rows], -worse[failed])]
        why_of = np.full(len(reason), SURE)
        why_of[active] = why
        reason[worst] = why_of[worst]


def _hidden(groups: _Groups, step: Ints, reason: Ints) -> NDArray[np.bool_]:
    """Return whether another person hides the person of each row from the row's camera, (N,).

    The person in front may have no box in this camera: a detector may find one of two people, and it is unknown which.
    """
    places = groups.places
    where, _ = _positions(groups, step, reason, 1)
    rows = np.flatnonzero(reason == SURE)
    which, other = rows_of_equal(places.step[rows], step)
    row = rows[which]
    row, other = row[groups.group[row] != other], other[groups.group[row] != other]
    has_box = np.zeros((groups.count, len(places.centre)), dtype=np.bool_)
    known = np.flatnonzero(groups.group >= 0)
    has_box[groups.group[known], places.camera[known]] = True
    centre = places.centre[places.camera[row]]
    to_own, to_other = where[groups.group[row]] - centre[:, :2], where[other] - centre[:, :2]
    reach = np.linalg.norm(to_own, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.einsum("ni,ni->n", to_own, to_other) / reach
        across = np.sqrt(np.maximum((to_other**2).sum(axis=1) - depth**2, 0.0))
        shaded_m = centre[:, 2] - (centre[:, 2] - PERSON_HEIGHT_M) * reach / depth
        # Of two people on one line the farther one is hidden; a single box may contain both.
        two_boxes = has_box[other, places.camera[row]]
        before = (depth > 0) & (depth < np.where(two_boxes, reach + BEHIND_M, FAR_BEHIND * reach))
        before &= (across < HALF_WIDTH_M * (1 + depth / reach)) & (shaded_m > COVERED * PERSON_HEIGHT_M)
    hidden = np.zeros(len(places), dtype=np.bool_)
    hidden[row[before]] = True
    return hidden


def _rivals(places: Places) -> tuple[Ints, Ints]:
    """Return pairs of boxes of one camera at one instant that show two people; the first box has an identity."""
    _, key = np.unique(np.column_stack([places.step, places.camera]), axis=0, return_inverse=True)
    i, j = pairs_within(key.ravel())
    i, j = i[places.identity[i] != UNKNOWN], j[places.identity[i] != UNKNOWN]
    other = _iou(places.ltwh[i], places.ltwh[j]) < SAME_BOX_IOU
    return i[other], j[other]


def _failures(groups: _Groups, step: Ints, active: Ints, mine: Ints, theirs: Ints) -> tuple[Ints, Floats]:
    """Return, for each active row, `SURE` or the reason of a failure (R,), and a measure of the failure (R,)."""
    places = groups.places
    place, covariance = groups.elsewhere(active)
    own = _square_lengths(places.place[active] - place, covariance + places.covariance[active])
    at = np.full(len(places), -1)
    at[active] = np.arange(len(active))
    pairs = at[mine] >= 0
    row, rival = at[mine[pairs]], theirs[pairs]
    limit = np.maximum(OTHER, own + MARGIN)
    # Distance from another person's box in the same camera.
    nearest = np.full(len(active), np.inf)
    np.minimum.at(nearest, row, _square_lengths(places.place[rival] - place[row], covariance[row] + places.covariance[rival]))
    # Distance from a place where two other cameras see another person.
    row, squared = _elsewhere_another(groups, step, active)
    np.minimum.at(nearest, row, squared)
    lack = limit - nearest
    why = np.where(own > FITS, MISFIT, np.where(lack > 0, AMBIGUOUS, SURE))
    return why, np.where(own > FITS, 1e3 + own, lack)


def _elsewhere_another(groups: _Groups, step: Ints, active: Ints) -> tuple[Ints, Floats]:
    """Return rows of `active`, and squared sigmas from each to another person that two other cameras see at the instant."""
    places = groups.places
    number, information, pull = groups.sums(active)
    seen = np.flatnonzero(number > 1)  # sorted by instant
    row, place = rows_of_equal(places.step[active], step[seen])
    other = seen[place]
    foreign = groups.group[active[row]] != other
    row, other = row[foreign], other[foreign]
    # The other person's box in the row's own camera is no independent evidence, so it is taken out; two others must remain.
    by_camera = np.full((groups.count, int(places.camera.max(initial=0)) + 1), -1)
    by_camera[groups.group[active], places.camera[active]] = active
    there = by_camera[other, places.camera[active[row]]]
    left = number[other] - (there >= 0) > 1
    row, other, there = row[left], other[left], there[left]
    has = (there >= 0)[:, None]
    remaining = information[other] - np.where(has[..., None], groups.information[there], 0.0)
    covariance = _inverse(remaining)
    place = np.einsum("nij,nj->ni", covariance, pull[other] - np.where(has, groups.pull[there], 0.0))
    mine = active[row]
    return row, _square_lengths(places.place[mine] - place, covariance + places.covariance[mine])


def _mark_disputed(groups: _Groups, reason: Ints) -> None:
    """Mark groups with at least as many contradicting as agreeing cameras: it is unknown which of them are right."""
    agree = np.bincount(groups.group[reason == SURE], minlength=groups.count)
    against = np.bincount(groups.group[reason == MISFIT], minlength=groups.count)
    _overrule(groups, reason, np.asarray(agree <= against), DISPUTED)


def _overrule(groups: _Groups, reason: Ints, doubtful: NDArray[np.bool_], why: int) -> None:
    """Give the confirmed boxes of doubtful groups (G,) a reason of rejection, in place."""
    sure = np.flatnonzero(reason == SURE)
    reason[sure[doubtful[groups.group[sure]]]] = why


def _positions(groups: _Groups, step: Ints, reason: Ints, fewest: int) -> tuple[Floats, NDArray[np.bool_]]:
    """Compute places (G, 2) of groups with at least `fewest` boxes, confirmed or not; (G,) whether another person is near."""
    place = np.full((groups.count, 2), np.nan)
    for rows in (np.flatnonzero((groups.group >= 0) & groups.places.whole), np.flatnonzero(reason == SURE)):
        number, information, pull = groups.sums(rows)
        two = number >= fewest
        place[two] = np.einsum("nij,nj->ni", _inverse(information[two]), pull[two])
    near = np.zeros(groups.count, dtype=np.bool_)
    i, j = pairs_within(step)
    with np.errstate(invalid="ignore"):
        near[i[np.linalg.norm(place[i] - place[j], axis=1) < NEAR_M]] = True
    return place, near


def _crowded(groups: _Groups, reason: Ints, mine: Ints, theirs: Ints) -> NDArray[np.bool_]:
    """Return whether a camera with a person's box has another person's box that fits the same place, (G,).

    This happens if the cameras look from one side: together they determine the distance to a person no better than one does.
    """
    places = groups.places
    number, information, pull = groups.sums(np.flatnonzero(reason == SURE))
    # If a camera's label moved to another person, the other box shows the person, so it is no contradiction.
    told = (number[groups.group[mine]] > 1) & (reason[mine] != MISFIT)
    mine, theirs = mine[told], theirs[told]
    group = groups.group[mine]
    covariance = _inverse(information[group])
    place = np.einsum("nij,nj->ni", covariance, pull[group])
    close = _square_lengths(places.place[theirs] - place, covariance + places.covariance[theirs]) < CROWDED
    crowded = np.zeros(groups.count, dtype=np.bool_)
    crowded[group[close]] = True
    return crowded


def _square_lengths(difference: Floats, covariance: Floats) -> Floats:
    """Compute the squared Mahalanobis lengths (N,) of differences (N, 2)."""
    return np.asarray(np.einsum("ni,nij,nj->n", difference, _inverse(covariance), difference))


def _inverse(matrix: Floats) -> Floats:
    """Invert symmetric matrices (N, 2, 2)."""
    a, b, c = matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 1]
    determinant = a * c - b * b
    return np.stack([np.stack([c, -b], -1), np.stack([-b, a], -1)], -2) / determinant[:, None, None]


def _iou(a: Floats, b: Floats) -> Floats:
    """Compute the intersection over union (N,) of boxes (N, 4), pair by pair."""
    low, high = np.maximum(a[:, :2], b[:, :2]), np.minimum(a[:, :2] + a[:, 2:], b[:, :2] + b[:, 2:])
    both = np.maximum(high - low, 0.0).prod(axis=1)
    return np.asarray(both / (a[:, 2:].prod(axis=1) + b[:, 2:].prod(axis=1) - both))
