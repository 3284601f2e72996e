"""Up direction from the upright parts of bodies, where no person is seen from head to feet.

On average, trunks are upright, heads are above shoulders, and upper arms hang. For each body, the first of these parts that is
seen is used, weighted by how much parts of its kind lean. Each person has an unknown mean lean with a prior. A person who turns
around makes the lean observable; a person at a desk determines only the sideways tilt.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.geometry.groups import group_numbers
from passerby.solver.body_segments import Bodies

LEAN_SD, SIDEWAYS_SD = 0.20, 0.05
"""Standard deviations of the lean of one person's mean trunk, radians, forwards and sideways: people at a desk lean on it."""
SWAY_SD = 0.15
"""Standard deviation of a trunk's lean about its person's mean, radians, independent for each posture."""
SAME_POSTURE = 20
"""Number of successive time steps that count as one posture."""
BENT_SIGMAS = 2.0
"""Lean in sigmas at which a part has half its weight."""


@dataclass(frozen=True)
class UprightPart:
    """A part of the body that is upright on average."""

    name: str
    """Name in the plural, for reports."""
    ends: tuple[tuple[str, str], ...]
    """Lower and upper joint. The first pair is in the middle of the body; other pairs are of one side, and lean sideways."""
    lean_sd: float
    sideways_sd: float
    sway_sd: float


_TRUNKS = (("hips", "shoulders"), ("left_hip", "left_shoulder"), ("right_hip", "right_shoulder"))
_ARMS = (("elbows", "shoulders"), ("left_elbow", "left_shoulder"), ("right_elbow", "right_shoulder"))
UPRIGHT_PARTS = (
    UprightPart("trunks", _TRUNKS, LEAN_SD, SIDEWAYS_SD, SWAY_SD),
    # A nose is 0.41 radians ahead of the neck; necks bend sideways three times as far as trunks do.
    UprightPart("heads over shoulders", (("shoulders", "head"),), 0.5, 0.15, 0.3),
    UprightPart("upper arms", _ARMS, 0.6, 0.3, 0.4),
)
"""Upright parts, the best first. Sigmas in radians, as `LEAN_SD`, `SIDEWAYS_SD` and `SWAY_SD`."""


@dataclass(frozen=True, eq=False)
class BodyVertical:
    """Up direction from the upright parts of bodies."""

    up: Floats
    """(3,) unit vector in the rig's frame."""
    covariance: Floats
    """(2, 2) covariance of its tilt along two directions orthogonal to it, the rows of `basis`, radians squared."""
    basis: Floats
    """(2, 3) unit vectors orthogonal to `up`."""
    parts: tuple[str, ...]
    """Names of the parts that were used, the most frequent first."""


@dataclass(frozen=True, eq=False)
class _Parts:
    """N upright parts of bodies; sigmas are radians."""

    direction: Floats
    """(N, 3) unit vectors from below to above."""
    left: Floats
    """(N, 3) unit vectors from right to left; NaN where forwards and sideways are not known or not distinguished."""
    kind: Ints
    """(N,) index in `UPRIGHT_PARTS`."""
    body: Ints
    """(N,) index of the body."""

    @property
    def sided(self) -> Bools:
        """(N,) whether forwards and sideways are known."""
        return np.asarray(np.isfinite(self.left).all(axis=1))

    def sd(self) -> Floats:
        """Return the sigmas (N, 3) of a person's mean lean forwards and sideways, and of sway."""
        table = np.array([[part.lean_sd, part.sideways_sd, part.sway_sd] for part in UPRIGHT_PARTS])[self.kind]
        table[~self.sided, 1] = table[~self.sided, 0]
        return np.asarray(table)


def body_vertical(bodies: Bodies) -> BodyVertical | None:
    """Estimate the up direction from upright parts; None where there are none."""
    parts = _upright_parts(bodies)
    if not len(parts.body):
        return None
    person, frame = _certainly_different(bodies.identity, bodies.frame)[parts.body], bodies.frame[parts.body]
    group = group_numbers(person, parts.kind, parts.sided.astype(np.int64))
    sd = parts.sd()
    up = _unit(np.average(parts.direction, axis=0, weights=(sd**2).sum(axis=1) ** -1)[None])[0]
    kinds, count = np.unique(parts.kind, return_counts=True)
    names = tuple(UPRIGHT_PARTS[kind].name for kind in kinds[np.argsort(-count, kind="stable")])
    found = None
    for _ in range(10):
        basis = np.linalg.svd(up[None])[2][1:]
        flat = parts.direction @ basis.T
        sideways = np.where(parts.sided[:, None], _unit(parts.left @ basis.T), [0.0, 1.0])
        tilt, covariance = _common_tilt(flat, sideways, sd, group, frame)
        up = _unit((up + tilt @ basis)[None])[0]
        found = BodyVertical(up, covariance, basis, names)
        if np.linalg.norm(tilt) < 1e-5:
            break
    return found


def parts_agree(bodies: Bodies) -> bool:
    """Return whether trunks and heads give the same up direction; they do not where shoulders and hips are exchanged."""
    trunks, heads, _ = UPRIGHT_PARTS
    own = [_unit(bodies.at(above) - bodies.at(below)) for below, above in (*trunks.ends, *heads.ends)]
    means = [np.nanmean(one, axis=0) for one in own if np.isfinite(one).any()]
    return all(first @ second > 0 for first, second in combinations(means, 2))


def _upright_parts(bodies: Bodies) -> _Parts:
    """Return for each body the best part that is seen."""
    lines = [_unit(bodies.at(f"left_{part}") - bodies.at(f"right_{part}")) for part in ("shoulder", "hip")]
    left = np.where(np.isfinite(lines[0]), lines[0], lines[1])
    n = len(bodies.identity)
    direction, across, kind = np.full((n, 3), np.nan), np.full((n, 3), np.nan), np.zeros(n, dtype=np.int64)
    for number, part in enumerate(UPRIGHT_PARTS):
        for one_sided, (below, above) in enumerate(part.ends):
            own = _unit(bodies.at(above) - bodies.at(below))
            new = np.isfinite(own).all(axis=1) & ~np.isfinite(direction[:, 0])
            direction[new], kind[new] = own[new], number
            across[new] = np.nan if one_sided else left[new]
    use = np.flatnonzero(np.isfinite(direction[:, 0]))
    return _Parts(direction[use], across[use], kind[use], use)


def _certainly_different(identity: Ints, frame: Ints) -> Ints:
    """Number the people (N,) with as few numbers as possible: identities that do not overlap in time may be one person.

    Without this, identities that hold for one time step only would make every time step an independent person.
    """
    identities, number = np.unique(identity, return_inverse=True)
    first, last = np.full(len(identities), np.iinfo(np.int64).max), np.full(len(identities), np.iinfo(np.int64).min)
    np.minimum.at(first, number, frame)
    np.maximum.at(last, number, frame)
    person, gone = np.zeros(len(identities), dtype=np.int64), list[tuple[int, int]]()
    for k in np.lexsort((last, first)):
        new = not gone or gone[0][0] >= first[k]
        person[k] = len(gone) if new else heapq.heappop(gone)[1]
        heapq.heappush(gone, (int(last[k]), int(person[k])))
    return np.asarray(person[number])


def _common_tilt(flat: Floats, sideways: Floats, sd: Floats, group: Ints, frame: Ints) -> tuple[Floats, Floats]:
    """Estimate the common tilt (2,) of all parts, radians, and its covariance (2, 2).

    Args:
        flat: (N, 2) components of the parts orthogonal to the assumed up direction, radians.
        sideways: (N, 2) unit vectors from right to left, in the same axes.
        sd: (N, 3) sigmas as from `_Parts.sd`; the same within a group.
        group: (N,) group of parts with one mean lean.
        frame: (N,) instant of each part.
    """
    groups, number = np.unique(group, return_inverse=True)
    instant = np.unique(frame, return_inverse=True)[1]
    stretch = group_numbers(number, instant // SAME_POSTURE)
    bent = np.linalg.norm(flat, axis=1) / (BENT_SIGMAS * np.hypot(sd[:, 0], sd[:, 2]))
    weight = 1 / ((1 + bent**2) * sd[:, 2] ** 2 * np.bincount(stretch)[stretch])
    forwards = np.column_stack([sideways[:, 1], -sideways[:, 0]])
    size = 2 + 2 * len(groups)
    normal, right = np.zeros((size, size)), np.zeros(size)
    for p in range(len(groups)):
        own = np.flatnonzero(number == p)
        at = [0, 1, 2 + 2 * p, 3 + 2 * p]
        rows = np.zeros((len(own), 2, 4))
        rows[:, :, :2] = np.eye(2)
        rows[:, :, 2], rows[:, :, 3] = forwards[own], sideways[own]
        weighted = rows * weight[own, None, None]
        normal[np.ix_(at, at)] += np.einsum("nki,nkj->ij", weighted, rows)
        right[at] += np.einsum("nki,nk->i", weighted, flat[own])
        normal[at[2:], at[2:]] += 1 / sd[own[0], :2] ** 2
    covariance = np.linalg.inv(normal)
    return np.asarray((covariance @ right)[:2]), np.asarray(covariance[:2, :2], dtype=np.float64)


def _unit(vectors: Floats) -> Floats:
    """Return the vectors normalised to length 1; NaN stays NaN."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12))
