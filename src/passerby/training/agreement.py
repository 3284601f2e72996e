"""Which boxes of one identity the geometry confirms: instant by instant, in two cameras or more, and no other person's as well.

At one instant the boxes of an identity must show one place on the ground, each camera's compared with where the others see it.
And that must tell: in each camera every other person's box must fit clearly worse, and none of the boxes may fit a place where
others are seen. Boxes that fail are left out, the worst first, as long as two remain.
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
"""Squared sigmas on the plane within which a box is where the others see the person: 99 of 100 of them are."""
OTHER, MARGIN = 16.0, 9.0
"""Another person's box is at least so many squared sigmas away, and by so many more than the person's own."""
SAME_BOX_IOU = 0.7
"""Boxes of one camera that overlap more show one person, found twice."""
SPREADS = (0.6, 2.0)
"""Sigmas are believed between these multiples of the usual ones; beyond, the rig or the labels are too bad to tell."""
USUAL_MEDIAN = 1.386
"""Median of squared sigmas on a plane (chi-square with two degrees of freedom)."""
NEAR_M = 1.0
"""People nearer to each other on the ground may exchange their labels."""
CROWDED = 6.0
"""Squared sigmas within which a person may be at the very place where another is."""
BLOCK_ROWS = 50_000
"""Boxes that are compared at once, so that memory stays flat."""

HALF_WIDTH_M = 0.3
"""Of a body with its arms, and of what a place on the ground is off by."""
BEHIND_M = 0.5
"""A person who is farther away by more than that covers no other."""
FAR_BEHIND = 2.0
"""Who is so many times farther away is too small to matter."""
COVERED = 0.2
"""Share of a body, from the feet up, that a nearer person may cover."""

SURE, CUT, ALONE, MISFIT, AMBIGUOUS, BEHIND, NEAR, DISPUTED, UNIDENTIFIED = range(9)
REASONS = ("sure", "cut off by the border", "in one camera only", "does not meet", "another fits as well",
           "behind another person", "near another person", "cameras disagree", "without identity")  # fmt: skip


@dataclass(frozen=True, eq=False)
class GeometricAgreement:
    """What became of N boxes, and where G people are at their instants."""

    reason: Ints
    """(N,) `SURE`, or why not: a row of `REASONS`."""
    group: Ints
    """(N,) rows of the people at instants; -1 without identity."""
    step: Ints
    """(G,) instants, sorted by identity, then by instant."""
    identity: Ints
    """(G,)"""
    place: Floats
    """(G, 2) metres; NaN where only one camera sees the person."""
    sure: NDArray[np.bool_]
    """(G,) whether two cameras or more confirm it."""
    near: NDArray[np.bool_]
    """(G,) whether another person is within `NEAR_M`."""
    spread: float
    """By how much the usual sigmas were multiplied."""


def verify_boxes(places: Places) -> GeometricAgreement:
    """Judge all boxes that have an identity."""
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
    """All ordered pairs of different rows with the same key (N,), which is sorted."""
    i, j = rows_of_equal(key, key)
    return i[i != j], j[i != j]


def _blocks(step: Ints) -> list[Ints]:
    """Rows in parts, whole instants each, about `BLOCK_ROWS` of them."""
    edges = [0]
    while edges[-1] < len(step):
        end = min(edges[-1] + BLOCK_ROWS, len(step)) - 1
        edges.append(int(np.searchsorted(step, step[end], side="right")))
    return [np.arange(low, high, dtype=np.int64) for low, high in pairwise(edges)]


@dataclass(frozen=True, eq=False)
class _Groups:
    """The rows of people at instants, and how they are summed."""

    places: Places
    group: Ints
    count: int
    information: Floats
    """(N, 2, 2)"""
    pull: Floats
    """(N, 2) information times place."""

    @classmethod
    def of(cls, places: Places) -> tuple[_Groups, Ints, Ints]:
        """The groups, and (G,) their instants and identities."""
        known = np.flatnonzero(places.identity != UNKNOWN)
        pairs = np.column_stack([places.step[known], places.identity[known]])
        named, which = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
        group = np.full(len(places), -1)
        group[known] = which.ravel()
        information = _inverse(places.covariance)
        pull = np.einsum("nij,nj->ni", information, places.place)
        return cls(places, group, len(named), information, pull), named[:, 0], named[:, 1]

    def sums(self, rows: Ints) -> tuple[Ints, Floats, Floats]:
        """(G,) number, (G, 2, 2) information and (G, 2) pull of the given rows, added up by group."""
        number = np.bincount(self.group[rows], minlength=self.count)
        information, pull = (group_sums(self.group[rows], part[rows], self.count) for part in (self.information, self.pull))
        return number, information, pull

    def elsewhere(self, rows: Ints) -> tuple[Floats, Floats]:
        """(R, 2) and (R, 2, 2) where the other rows of each row's group see the person; two rows a group at least."""
        _, information, pull = self.sums(rows)
        covariance = _inverse(information[self.group[rows]] - self.information[rows])
        return np.einsum("nij,nj->ni", covariance, pull[self.group[rows]] - self.pull[rows]), covariance


def _spread(places: Places) -> float:
    """How much wider than usual the boxes of one identity lie, by the median of those that are near each other."""
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
    """Those rows whose group has two at least."""
    number = np.bincount(groups.group[rows], minlength=groups.count)
    return rows[number[groups.group[rows]] > 1]


def _verify_block(places: Places) -> GeometricAgreement:
    """`verify_boxes` of a block; groups are sorted by instant."""
    groups, step, identity = _Groups.of(places)
    reason = np.where(groups.group < 0, UNIDENTIFIED, np.where(places.whole, SURE, CUT))
    mine, theirs = _rivals(places)
    _leave_out(groups, step, reason, mine, theirs)
    # Whether a person is hidden is known once all positions are known.
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
    """Write into `reason` (N,) why rows fail, the worst of each group first, until all that are left agree."""
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
    """(N,) rows of people before whom another person stands, seen from the row's camera.

    The one in front need not have a box there: a detector finds one person of two, and it is unknown which.
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
        # Of two on one line the farther one is hidden, and a box that is the only one there may hold both.
        two_boxes = has_box[other, places.camera[row]]
        before = (depth > 0) & (depth < np.where(two_boxes, reach + BEHIND_M, FAR_BEHIND * reach))
        before &= (across < HALF_WIDTH_M * (1 + depth / reach)) & (shaded_m > COVERED * PERSON_HEIGHT_M)
    hidden = np.zeros(len(places), dtype=np.bool_)
    hidden[row[before]] = True
    return hidden


def _rivals(places: Places) -> tuple[Ints, Ints]:
    """Pairs of boxes of one camera at one instant that show two people; the first with an identity."""
    _, key = np.unique(np.column_stack([places.step, places.camera]), axis=0, return_inverse=True)
    i, j = pairs_within(key.ravel())
    i, j = i[places.identity[i] != UNKNOWN], j[places.identity[i] != UNKNOWN]
    other = _iou(places.ltwh[i], places.ltwh[j]) < SAME_BOX_IOU
    return i[other], j[other]


def _failures(groups: _Groups, step: Ints, active: Ints, mine: Ints, theirs: Ints) -> tuple[Ints, Floats]:
    """(R,) for each active row `SURE` or why not, and how bad it is."""
    places = groups.places
    place, covariance = groups.elsewhere(active)
    own = _square_lengths(places.place[active] - place, covariance + places.covariance[active])
    at = np.full(len(places), -1)
    at[active] = np.arange(len(active))
    pairs = at[mine] >= 0
    row, rival = at[mine[pairs]], theirs[pairs]
    limit = np.maximum(OTHER, own + MARGIN)
    # Of two in one camera
    nearest = np.full(len(active), np.inf)
    np.minimum.at(nearest, row, _square_lengths(places.place[rival] - place[row], covariance[row] + places.covariance[rival]))
    # and of a place where two others see another person.
    row, squared = _elsewhere_another(groups, step, active)
    np.minimum.at(nearest, row, squared)
    lack = limit - nearest
    why = np.where(own > FITS, MISFIT, np.where(lack > 0, AMBIGUOUS, SURE))
    return why, np.where(own > FITS, 1e3 + own, lack)


def _elsewhere_another(groups: _Groups, step: Ints, active: Ints) -> tuple[Ints, Floats]:
    """Rows of `active` and the squared sigmas from each to another person whom two further cameras see at that instant."""
    places = groups.places
    number, information, pull = groups.sums(active)
    seen = np.flatnonzero(number > 1)  # sorted by instant
    row, place = rows_of_equal(places.step[active], step[seen])
    other = seen[place]
    foreign = groups.group[active[row]] != other
    row, other = row[foreign], other[foreign]
    # The other's box in the row's own camera is no further proof: it is taken out, which leaves those with two more.
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
    """People of whom as many cameras see something else as agree: which of them is right?"""
    agree = np.bincount(groups.group[reason == SURE], minlength=groups.count)
    against = np.bincount(groups.group[reason == MISFIT], minlength=groups.count)
    _overrule(groups, reason, np.asarray(agree <= against), DISPUTED)


def _overrule(groups: _Groups, reason: Ints, doubtful: NDArray[np.bool_], why: int) -> None:
    """Confirmed boxes (N,) of people (G,) who are doubtful get a reason."""
    sure = np.flatnonzero(reason == SURE)
    reason[sure[doubtful[groups.group[sure]]]] = why


def _positions(groups: _Groups, step: Ints, reason: Ints, fewest: int) -> tuple[Floats, NDArray[np.bool_]]:
    """(G, 2) where all people are whom so many cameras see, confirmed or not; (G,) whether another person is near."""
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
    """(G,) people of whom a camera that has their box has another's too that may stand where they do.

    That is so where cameras look from one side: they tell the way to a person no better than one of them does.
    """
    places = groups.places
    number, information, pull = groups.sums(np.flatnonzero(reason == SURE))
    # Where a camera's label went to another person, the other's box is the person's own.
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
    """(N,) squared Mahalanobis lengths of (N, 2)."""
    return np.asarray(np.einsum("ni,nij,nj->n", difference, _inverse(covariance), difference))


def _inverse(matrix: Floats) -> Floats:
    """Inverses of (N, 2, 2) symmetric matrices."""
    a, b, c = matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 1]
    determinant = a * c - b * b
    return np.stack([np.stack([c, -b], -1), np.stack([-b, a], -1)], -2) / determinant[:, None, None]


def _iou(a: Floats, b: Floats) -> Floats:
    """(N,) intersection over union of boxes (N, 4), pair by pair."""
    low, high = np.maximum(a[:, :2], b[:, :2]), np.minimum(a[:, :2] + a[:, 2:], b[:, :2] + b[:, 2:])
    both = np.maximum(high - low, 0.0).prod(axis=1)
    return np.asarray(both / (a[:, 2:].prod(axis=1) + b[:, 2:].prod(axis=1) - both))
