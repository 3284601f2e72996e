"""Significant links between tracklets and boxes, frame by frame.

All lengths are in body heights (the height of the tracked box), so one set of constants serves people near and far and any
lens. Costs are -2 log likelihood, so a difference of costs is a likelihood ratio for any kind of evidence.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from passerby.association.tracking.embedding_model import EmbeddingSimilarity
from passerby.common.arrays import Columns, Floats, Ints
from passerby.core.observations import Boxes, Vectors

Mask = NDArray[np.bool_]

POSITION_SD = 0.05
"""Body heights, sigma of a box's centre: detectors' edges have errors of 2 to 4 % of it, arms and stride move the centre."""
TURN_DENSITY = 0.3
"""(Body heights / s)^2 / s, white acceleration: within a second the velocity changes by 0.55 body heights / s, 0.9 m/s."""
START_SPEED_SD = 0.6
"""Body heights / s on either axis, of a person first seen: a walker moves at 1.4 m/s in an unknown direction."""
SHAPE_SD = (0.15, 0.3)
"""Standard deviations of the logarithms of height and width from box to box: the width varies with arms and stride."""
SHAPE_GAIN = 0.4
"""Share of a new box in the tracklet's shape: people crouch and approach, so it has to follow within a few boxes."""
SHAPE_STEP = 0.15
"""Largest change of the shape's logarithm by one box: the box of a half-hidden person must not change the unit of length."""
TAIL = 3.0
"""Degrees of freedom of Student's t, used instead of a Gaussian: half-hidden people's boxes have errors far above the noise."""
FARTHEST = 16.0
"""Squared distance from the predicted position, in standard deviations, beyond which a box is not considered."""
SLACK = 0.3
"""Body heights that a centre may jump beyond walking: a person hidden to the hips and seen whole in the next frame."""
WEAK_COST = 4.0
"""Additional cost of a box of low score: it is linked only where no strong box fits nearly as well."""


@dataclass(frozen=True)
class LinkCosts:
    """Parameters of the costs of links and of their significance; see `TrackingOptions`."""

    max_gap_s: float = 1.0
    max_speed: float = 3.5
    margin: float = 6.0
    unlinked: float = 16.0


CENTRE, VELOCITY, COVARIANCE, SHAPE = slice(0, 2), slice(2, 4), slice(4, 7), slice(7, 9)
"""Columns of a track's state."""


@dataclass(eq=False)
class Tracks(Columns):
    """States of T tracklets at their last boxes; these tracklets may continue."""

    row: Ints
    """(T,) row of the last box; -1 where the person may be in another, later box."""
    time: Floats
    """(T,) seconds."""
    state: Floats
    """(T, 9) centre, velocity, covariance and shape, in one array, since it is copied and joined at every frame."""
    appearance: Vectors
    """(T, D) sum of the embeddings so far; D = 0 without any."""

    @property
    def centre(self) -> Floats:
        """(T, 2) pixels."""
        return self.state[:, CENTRE]

    @property
    def velocity(self) -> Floats:
        """(T, 2) pixels per second."""
        return self.state[:, VELOCITY]

    @property
    def covariance(self) -> Floats:
        """(T, 3) position-position, position-velocity, velocity-velocity of either axis; body heights and seconds."""
        return self.state[:, COVARIANCE]

    @property
    def shape(self) -> Floats:
        """(T, 2) logarithms of height and width in pixels."""
        return self.state[:, SHAPE]

    def put(self, rows: Ints, other: Tracks) -> None:
        """Replace the tracks of the given rows."""
        for item in fields(self):
            getattr(self, item.name)[rows] = getattr(other, item.name)


def agreed_links(
    boxes: Boxes, seconds: Floats, weak: Mask, costs: LinkCosts, similarity: EmbeddingSimilarity | None
) -> tuple[Ints, Ints]:
    """Find links in both time directions and return those that agree: rows (L,) and the rows (L,) that continue them.

    Arguments as of `link`.
    """
    after = link(boxes, seconds, weak, costs, similarity)
    before = link(boxes, -seconds, weak, costs, similarity)
    here = np.flatnonzero(after >= 0)
    here = here[before[after[here]] == here]
    return here, after[here]


def link(boxes: Boxes, seconds: Floats, weak: Mask, costs: LinkCosts, similarity: EmbeddingSimilarity | None) -> Ints:
    """Return for every box the row (N,) of the box that continues it, -1 where there is none or none that is significant.

    Args:
        boxes: N boxes in any order.
        seconds: (N,) time of each box, equal within a frame; negated times track backwards.
        weak: (N,) boxes that may continue a tracklet but not begin one.
        costs: costs and margin of links.
        similarity: distributions of the embeddings' similarity; None to leave embeddings out.
    """
    following = np.full(len(boxes), -1, dtype=np.int64)
    order = np.argsort(seconds, kind="stable")
    everything = first_seen(boxes, seconds, similarity is not None).take(order)
    tracks = everything.take(slice(0))
    first = np.flatnonzero(np.diff(everything.time, prepend=-np.inf))
    for frame in map(slice, first, np.append(first[1:], len(order))):
        seen = everything.take(frame)
        rows, now = seen.row, seen.time[0]
        tracks = tracks.take(now - tracks.time <= costs.max_gap_s * (1 + 1e-9))
        predicted = predict(tracks, now)
        gain = _gains(tracks, predicted, seen, weak[rows], costs, similarity)
        of_track, of_box, clear = _decide(gain, costs.margin)
        sure = clear & (tracks.row[of_track] >= 0)
        following[tracks.row[of_track[sure]]] = rows[of_box[sure]]
        tracks.row[_contested(gain, of_box[~clear])] = -1
        waiting, fresh = np.ones(len(tracks.row), dtype=np.bool_), ~weak[rows]
        waiting[of_track], fresh[of_box] = False, False
        going_on = update(predicted.take(of_track), seen.take(of_box))
        tracks = Tracks.joined([tracks.take(waiting), going_on, seen.take(fresh)])
    return following


def first_seen(boxes: Boxes, seconds: Floats, with_embeddings: bool = False) -> Tracks:
    """Convert every box to a track of its own, with velocity 0 and the sigma `START_SPEED_SD`."""
    centre = boxes.ltwh[:, :2] + boxes.ltwh[:, 2:] / 2
    certainty = np.tile([POSITION_SD**2, 0.0, START_SPEED_SD**2], (len(boxes), 1))
    state = np.column_stack([centre, np.zeros_like(centre), certainty, np.log(boxes.ltwh[:, [3, 2]])])
    without = np.zeros((len(boxes), 0), np.float32)
    appearance = boxes.embedding if with_embeddings and boxes.embedding is not None else without
    return Tracks(np.arange(len(boxes)), seconds, state, appearance)


def predict(tracks: Tracks, now: float | Floats) -> Tracks:
    """Predict the tracklets at a later time, by constant velocity with white acceleration.

    The field `time` of the result is the elapsed time.
    """
    dt = now - tracks.time
    pp, pv, vv = tracks.covariance.T
    state = tracks.state.copy()
    state[:, CENTRE] += dt[:, None] * tracks.velocity
    covariance = state[:, COVARIANCE].T
    covariance[0] = pp + 2 * dt * pv + dt**2 * vv + TURN_DENSITY * dt**3 / 3
    covariance[1] = pv + dt * vv + TURN_DENSITY * dt**2 / 2
    covariance[2] = vv + TURN_DENSITY * dt
    return Tracks(tracks.row, dt, state, tracks.appearance)


def _gains(
    tracks: Tracks, predicted: Tracks, seen: Tracks, weak: Mask, costs: LinkCosts, similarity: EmbeddingSimilarity | None
) -> Floats:
    """Return the cost (T, D) of each link minus that of leaving both unlinked, -2 log likelihood: below 0, or 0 for no link."""
    height = np.exp(tracks.shape[:, :1])
    variance = predicted.covariance[:, :1] + POSITION_SD**2
    apart = _squares(seen.centre, predicted.centre) / height**2 / variance
    moved = np.sqrt(_squares(seen.centre, tracks.centre)) / height
    possible = (apart < FARTHEST) & (moved < costs.max_speed * predicted.time[:, None] + SLACK)
    if not possible.any():
        return np.zeros(possible.shape)
    cost = (TAIL + 2) * np.log1p(apart / TAIL) + 2 * np.log(2 * np.pi * variance)
    for axis, sd in enumerate(SHAPE_SD):
        reshaped = (seen.shape[:, axis] - tracks.shape[:, axis, None]) / sd
        cost += (TAIL + 1) * np.log1p(reshaped**2 / TAIL)
    cost += np.where(weak, WEAK_COST, 0.0)
    if similarity is not None:
        cost += similarity.cost(tracks.appearance, seen.appearance)
    return np.asarray(np.where(possible, np.minimum(cost - costs.unlinked, 0.0), 0.0))


def _squares(seen: Floats, expected: Floats) -> Floats:
    """Return the squared distances (T, D) of points (D, 2) from points (T, 2)."""
    across, down = seen.T[:, None, :] - expected.T[:, :, None]
    return np.asarray(across**2 + down**2)


def _decide(gain: Floats, margin: float) -> tuple[Ints, Ints, Mask]:
    """Find tracks (L,) and boxes (L,) of the best assignment (Hungarian algorithm), and a mask (L,) of significant links.

    A link is significant if the best assignment without it is worse by the margin.
    """
    track, box = (index.astype(np.int64) for index in linear_sum_assignment(gain))
    taken = gain[track, box] < 0
    track, box = track[taken], box[taken]
    best = gain[track, box].sum()
    clear = -gain[track, box] >= margin
    rivals = (gain < 0).sum(axis=1)[track] + (gain < 0).sum(axis=0)[box] - 2
    for place in np.flatnonzero(clear & (rivals > 0)):
        without = gain.copy()
        without[track[place], box[place]] = 0.0
        clear[place] = without[linear_sum_assignment(without)].sum() - best >= margin
    return track, box, clear


def _contested(gain: Floats, box: Ints) -> Ints:
    """Return the tracks that may continue in one of the given boxes."""
    return np.flatnonzero((gain[:, box] < 0).any(axis=1))


def update(predicted: Tracks, seen: Tracks) -> Tracks:
    """Update tracks by the Kalman filter; a box far from its predicted position is weighted down (Student's t)."""
    pp, pv, vv = predicted.covariance.T
    height = np.exp(predicted.shape[:, 0])
    off = seen.centre - predicted.centre
    apart = np.sum(off**2, axis=1) / height**2 / (pp + POSITION_SD**2)
    noise = POSITION_SD**2 * np.maximum(1.0, (TAIL + apart) / (TAIL + 2))
    gain_p, gain_v = pp / (pp + noise), pv / (pp + noise)
    state = predicted.state.copy()
    state[:, CENTRE] += gain_p[:, None] * off
    state[:, VELOCITY] += gain_v[:, None] * off
    covariance = state[:, COVARIANCE].T
    covariance[0], covariance[1], covariance[2] = (1 - gain_p) * pp, (1 - gain_p) * pv, vv - gain_v * pv
    state[:, SHAPE] += np.clip(SHAPE_GAIN * (seen.shape - predicted.shape), -SHAPE_STEP, SHAPE_STEP)
    return Tracks(seen.row, seen.time, state, predicted.appearance + seen.appearance)
