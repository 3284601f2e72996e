"""Selection of pairs of cameras of a large site that may share ground, before any pair is registered.

The number of pairs grows with the square of the number of cameras, true overlaps grow linearly. Each camera's ground is cut
into regions, and the number of people in each over time is a signal (`clocks.activity`). People that two cameras share make
signals of both rise and fall together, at the one lag of their clocks; times at which only one of them sees people are equally
significant. For all pairs and all lags at once this is a product of matrices, computed in blocks of cameras: apart from one
value a pair, memory grows linearly with the number of cameras.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft

from passerby.association.clocks.activity import Activity, region_activity
from passerby.association.ground.ground_tracks import GroundTracks
from passerby.association.sampling import STEP_S
from passerby.core.association_figures import PairsTried

ALL_PAIRS_UP_TO = 12
"""Scenes of up to this number of cameras try every pair: there is little to save."""
MOST_CANDIDATES = 12
"""Largest number of candidates of a camera. Cameras of a site share ground with two to six others."""
BEARINGS, RANGES, STEPS = 5, 5, 2
"""Regions of each camera's ground by bearing and by range, and the grid steps of a sample: one second. On a site of 100 cameras
for ten minutes (seed 800, doors of three metres) twelve candidates a camera hold 95.8, 97.2, 98.6 and 97.7 % of the true
overlaps with 3, 4, 5 and 6 bearings and ranges; samples every half second find no more."""
LEAST_SIGMAS = 3.0
"""Correlations of two regions below this number of their standard deviations are not counted. Cameras that share a corner agree
in a few of all pairs of regions, and in the sum of all pairs the noise of the others is larger. On the same site, with 16
regions and without common partners, 93.0 % are found by the sum of all squares, and 95.3 % by this."""
COMMON_PARTNER = 0.5
"""Gain of two cameras by a common partner, as a share of the partner's weaker agreement with the two: neighbours of a neighbour
are near. Without it 97.2 % are found instead of 98.6 %; 0.25 finds the same."""
SURE_PARTNERS = 8
"""Number of best agreements of each camera that count as partners for this gain."""
LEAST_LAGS_S = 10.0
"""The usual agreement of a pair is measured over lags up to this one at least, even if fewer are possible."""
CORRELATED_S = 30.0
"""Largest lag of a signal's autocorrelation, for the variance of the correlations (Bartlett's formula)."""
CAMERAS_AT_ONCE = 32
ACTIVITY, STATED = "activity", "stated"

Values = NDArray[np.float32]


@dataclass(frozen=True)
class Candidates:
    """Pairs of cameras that may share ground."""

    n_cameras: int
    found_by: Mapping[tuple[int, int], str]
    """Pairs a < b, ascending: `ACTIVITY` or `STATED`."""

    def __contains__(self, pair: object) -> bool:
        """Check whether two cameras, a < b, are to be tried."""
        return pair in self.found_by

    @property
    def tried(self) -> PairsTried:
        """Number of pairs that are tried, by reason."""
        why = list(self.found_by.values())
        of_camera = np.bincount(np.array(list(self.found_by), dtype=np.int64).ravel(), minlength=self.n_cameras)
        return PairsTried(
            possible=self.n_cameras * (self.n_cameras - 1) // 2, tried=len(why), by_activity=why.count(ACTIVITY),
            stated=why.count(STATED), most_of_a_camera=int(of_camera.max(initial=0)),
        )  # fmt: skip


def stated_candidates(names: Sequence[str], groups: Sequence[Sequence[str]]) -> Candidates:
    """Return the pairs that the user states: cameras of one group, and no others.

    Args:
        names: names of all cameras.
        groups: names of cameras that may share ground; a camera may be in several groups. Unknown names are ignored.
    """
    number = {name: index for index, name in enumerate(names)}
    pairs = {
        (min(number[one], number[other]), max(number[one], number[other]))
        for group in groups
        for k, one in enumerate(group)
        for other in group[k + 1 :]
        if one != other and one in number and other in number
    }
    return Candidates(len(names), dict.fromkeys(sorted(pairs), STATED))


def find_candidates(tracks: Sequence[GroundTracks | None], max_lag_s: float, most: int = MOST_CANDIDATES) -> Candidates:
    """Find the pairs to register: at most `most` of each camera, those whose activities agree best.

    Args:
        tracks: tracks of each camera, on its own ground; a camera without tracks is in no pair.
        max_lag_s: largest difference of two clocks, seconds.
        most: largest number of candidates of a camera.
    """
    activities = [None if own is None else region_activity(own, BEARINGS, RANGES) for own in tracks]
    there = [index for index, activity in enumerate(activities) if activity is not None]
    if len(there) < 2:
        return Candidates(len(tracks), {})
    agreement = activity_agreement([activity for activity in activities if activity is not None], max_lag_s)
    chosen = sorted((there[a], there[b]) for a, b in best_partners(with_common_partners(agreement), most))
    return Candidates(len(tracks), dict.fromkeys(chosen, ACTIVITY))


def with_common_partners(agreement: Values) -> Values:
    """Return the agreements (C, C) with the gain of cameras that have a common partner; only above the diagonal."""
    count = len(agreement)
    both = np.maximum(agreement, agreement.T)
    partners: list[list[int]] = [[] for _ in range(count)]
    for a, b in best_partners(agreement, SURE_PARTNERS):
        partners[a].append(b)
        partners[b].append(a)
    gain = np.zeros_like(both)
    for camera, own in enumerate(partners):
        rows = np.array(own, dtype=np.int64)
        weaker = np.minimum(both[camera, rows][:, None], both[camera, rows])
        gain[np.ix_(rows, rows)] = np.maximum(gain[np.ix_(rows, rows)], weaker)
    return np.triu(agreement + COMMON_PARTNER * gain, 1)


def best_partners(agreement: Values, most: int) -> list[tuple[int, int]]:
    """Return pairs a < b, the best first; each is taken if neither camera has `most` pairs yet.

    Args:
        agreement: (C, C); only values above the diagonal are used.
        most: largest number of pairs of a camera.
    """
    count = len(agreement)
    first, second = np.triu_indices(count, 1)
    # All pairs are sorted: of a thousand cameras their list is short enough.
    order = np.argsort(-agreement[first, second], kind="stable")
    left, chosen = np.full(count, most), []
    for a, b in zip(first[order].tolist(), second[order].tolist(), strict=True):
        if left[a] > 0 and left[b] > 0:
            left[a] -= 1
            left[b] -= 1
            chosen.append((a, b))
    return chosen


def activity_agreement(activities: Sequence[Activity], max_lag_s: float) -> Values:
    """Compute the excess (C, C) of two cameras' agreement at their best lag over its usual value; only above the diagonal.

    The agreement at a lag is the sum of the squares of the positive correlations of two regions, in standard deviations, that
    are above `LEAST_SIGMAS`. The usual value is the median over the lags.

    Args:
        activities: activities of C cameras.
        max_lag_s: largest possible lag, seconds.
    """
    signals = _sampled(activities)
    count, regions, length = signals.shape
    resemblance = _self_resemblance(signals)
    step_s = STEPS * STEP_S
    within = int(np.ceil(max_lag_s / step_s))
    reach = max(within, round(LEAST_LAGS_S / step_s))
    lags = np.arange(-reach, reach + 1)
    lags = lags[np.abs(lags) < length // 2]
    out = np.zeros((count, count), dtype=np.float32)
    if not len(lags):
        return out
    flat = signals.reshape(count * regions, length)
    for start in range(0, count, CAMERAS_AT_ONCE):
        rows = slice(start * regions, min(start + CAMERAS_AT_ONCE, count) * regions)
        rest = slice(start * regions, count * regions)
        per_sigma = 1.0 / np.sqrt(np.maximum(resemblance[rows] @ resemblance[rest].T, 1e-3))
        total = np.stack([_agreement(flat[rows], flat[rest], per_sigma, int(lag), regions) for lag in lags])
        best = total[np.abs(lags) <= within].max(axis=0)
        out[start : start + CAMERAS_AT_ONCE, start:] = best - np.median(total, axis=0)
    return np.triu(out, 1)


def _agreement(a: Values, b: Values, per_sigma: Values, lag: int, regions: int) -> Values:
    """Return the agreements (A, B) of signals (A regions, N) and (B regions, N) at one lag."""
    length = a.shape[1] - abs(lag)
    early, late = max(0, -lag), max(0, lag)
    value = a[:, early : early + length] @ b[:, late : late + length].T
    value *= per_sigma
    np.maximum(value, np.float32(LEAST_SIGMAS * np.sqrt(length)), out=value)
    value *= value
    shape = len(a) // regions, regions, len(b) // regions, regions
    return np.asarray(value.reshape(shape).sum(axis=3).sum(axis=1) / length - (LEAST_SIGMAS * regions) ** 2)


def _sampled(activities: Sequence[Activity]) -> Values:
    """Return signals (C, K, N) of unit variance over the time in which any camera sees people; 0 where a camera sees none."""
    first = min(activity.first for activity in activities)
    end = max(activity.first + len(activity.signals) for activity in activities)
    length = -(-(end - first) // STEPS)
    out = np.zeros((len(activities), activities[0].signals.shape[1], length * STEPS), dtype=np.float32)
    for own, activity in zip(out, activities, strict=True):
        own[:, activity.first - first : activity.first - first + len(activity.signals)] = activity.signals.T
    out = out.reshape(*out.shape[:2], length, STEPS).mean(axis=3)
    return np.asarray(out / np.maximum(out.std(axis=2, keepdims=True), 1e-6), dtype=np.float32)


def _self_resemblance(signals: Values) -> Values:
    """Return autocorrelations (C K, lags), weighted so that the product of two rows is the variance of their correlation."""
    length = signals.shape[2]
    lags = max(1, min(round(CORRELATED_S / (STEPS * STEP_S)), length // 4))
    padded = next_fast_len(2 * length, real=True)
    weight = np.where(np.arange(lags) == 0, 1.0, np.sqrt(2.0)).astype(np.float32)
    rows = [irfft(np.abs(rfft(own, padded, axis=1)) ** 2, padded, axis=1)[:, :lags] / length for own in signals]
    return np.asarray(np.concatenate(rows) * weight, dtype=np.float32)
