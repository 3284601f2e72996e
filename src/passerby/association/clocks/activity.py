"""Lag of two cameras' recordings from people's activity; the cost is nearly linear in the time that is searched.

Each camera's ground is cut into regions with equally many people. The number of people in each, over time, is a signal. People
that two cameras share make the signals of some pairs of regions rise together, at one lag and no other. All lags of all pairs
of regions are computed by fast Fourier transforms. Neither poses nor identities are needed. Where identities are known, the
times at which the same people are seen reduce the possible lags to a range of a minute or so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.ndimage import gaussian_filter1d

from passerby.association.ground.ground_tracks import GroundTracks
from passerby.association.sampling import STEP_S
from passerby.common.arrays import Floats, Ints

BEARINGS, RANGES = 4, 4
"""Regions: number of sectors, and of distances in each. With 1, 2, 4 and 6 of both a true lag exceeds the others by about 5,
20, 27 and 20 times their spread (`simulation.passing_crowd`, seed 1)."""
SMOOTH_STEPS, TREND_STEPS = 1.0, 20.0
"""Standard deviations of the two Gaussians of the band-pass filter of the signals, in grid steps. Positions of people have
errors of half a second of walking. Changes over a minute are the crowd's coming and going, which is similar at other hours."""
LEAST_OVERLAP_S = 60.0
"""Least overlap of recordings that are compared, seconds: in less time so few people are there that peaks occur by chance."""
SPREAD_LAGS = 240
"""Number of neighbouring lags over which the spread is estimated: it grows where recordings overlap for a short time."""
CORRELATED_STEPS = 200
"""Number of lags of a signal's autocorrelation, for the variance of the correlations (Bartlett's formula)."""
SAME_PEAK = 10
"""Grid steps within which two lags are one peak."""
UPPER_DECILE = 1.2816
"""The upper decile of the normal distribution, in standard deviations."""
ABSENT_S = 5.0
"""A person who is not seen for longer, seconds, has left; the next sighting is another visit."""
VISIT_REACH_S = 45.0
"""People pass one camera's view before another's: largest time between the two visits in a place of some 30 m, by one clock."""
LEAST_VISITORS, VISITORS_SHARE = 4, 0.5
"""Least number of people, and least share of them, whose lags agree within `VISIT_REACH_S` for a significant result."""


@dataclass(frozen=True, eq=False)
class Activity:
    """Signals of one camera over even steps of time."""

    first: int
    """Grid time of the first row."""
    signals: NDArray[np.float32]
    """(N, K) signals without mean or trend, of unit variance."""


@dataclass(frozen=True)
class LagPeak:
    """A lag at which two cameras' activities agree."""

    lag: int
    """Time of camera b's clock minus that of camera a's, grid steps."""
    significance: float
    """Height above the values at other lags, in their standard deviations."""


def region_activity(tracks: GroundTracks, bearings: int = BEARINGS, ranges: int = RANGES) -> Activity | None:
    """Compute the signals of the number of people in each region of a camera's ground; return None without people.

    Args:
        tracks: tracks of the camera.
        bearings: number of sectors.
        ranges: number of regions of a sector.
    """
    if not len(tracks):
        return None
    region = _regions(tracks.position, bearings, ranges)
    return _activity(tracks.step, region, bearings * ranges)


def lag_of_visits(a: GroundTracks, b: GroundTracks) -> tuple[int, int] | None:
    """Find the range of lags, from and to, in grid steps, at which known people visit both views at about the same time.

    Returns None where too few people come and go: people who are always there give no information on the clocks.

    Args:
        a: tracks of the first camera; tracklet numbers are identities that hold in both.
        b: tracks of the second camera.
    """
    first, second = _visits(a), _visits(b)
    lag, weight = [], []
    for person in sorted(first.keys() & second.keys()):
        apart = (second[person][None] - first[person][:, None]).ravel()
        lag.append(apart)
        weight.append(np.full(len(apart), 1.0 / len(apart)))
    if len(lag) < LEAST_VISITORS:
        return None
    lags, weights = np.concatenate(lag), np.concatenate(weight)
    order = np.argsort(lags, kind="stable")
    lags, total = lags[order], np.concatenate([[0.0], np.cumsum(weights[order])])
    reach = VISIT_REACH_S / STEP_S
    end = np.searchsorted(lags, lags + 2 * reach, side="right")
    inside = total[end] - total[:-1]
    best = int(np.argmax(inside))
    if inside[best] < max(LEAST_VISITORS, VISITORS_SHARE * len(lag)):
        return None
    centre = float(np.median(lags[best : end[best]]))
    return round(centre - reach), round(centre + reach)


def _visits(tracks: GroundTracks) -> dict[int, Floats]:
    """Return, by person, the middle times of the person's visits, in grid steps."""
    order = np.lexsort((tracks.step, tracks.tracklet))
    who, step = tracks.tracklet[order], tracks.step[order]
    new = (np.diff(who) != 0) | (np.diff(step) > ABSENT_S / STEP_S)
    begin, end = np.append(0, np.flatnonzero(new) + 1), np.append(np.flatnonzero(new), len(who) - 1)
    out: dict[int, list[float]] = {}
    for k, low, high in zip(who[begin].tolist(), step[begin].tolist(), step[end].tolist(), strict=True):
        out.setdefault(k, []).append(0.5 * (low + high))
    return {person: np.array(middles) for person, middles in out.items()}


def _regions(position: NDArray[np.complex128], bearings: int, ranges: int) -> Ints:
    """Return the region (N,) of each position: sectors by bearing, each cut by distance, all with equally many people."""
    bearing, reach = np.angle(position), np.abs(position)
    sector = np.searchsorted(np.quantile(bearing, np.arange(1, bearings) / bearings), bearing)
    region = np.zeros(len(position), dtype=np.int64)
    for number in range(bearings):
        inside = sector == number
        if inside.any():
            cuts = np.quantile(reach[inside], np.arange(1, ranges) / ranges)
            region[inside] = number * ranges + np.searchsorted(cuts, reach[inside])
    return region


def _activity(step: Ints, signal: Ints, count: int) -> Activity:
    first = int(step.min())
    length = int(step.max()) - first + 1
    people = np.bincount((step - first) * count + signal, minlength=length * count).reshape(length, count)
    # The variance of the root of a count does not depend on the count.
    values = np.sqrt(people).astype(np.float32)
    values = gaussian_filter1d(values, SMOOTH_STEPS, axis=0) - gaussian_filter1d(values, TREND_STEPS, axis=0)
    spread = values.std(axis=0)
    return Activity(first, np.asarray(values / np.where(spread > 0, spread, 1.0), dtype=np.float32))


def find_lag_peaks(a: Activity, b: Activity, low: int, high: int, most: int) -> tuple[LagPeak, ...]:
    """Find the lags at which activities agree most, the best first, each apart from the others.

    Args:
        a: activity of the first camera.
        b: activity of the second camera.
        low: smallest lag that is searched, grid steps.
        high: largest lag that is searched, grid steps.
        most: largest number of peaks.
    """
    n_a, n_b = len(a.signals), len(b.signals)
    shift = np.arange(-(n_a - 1), n_b)
    overlap = np.minimum(n_a, n_b - shift) - np.maximum(0, -shift)
    lag = shift + b.first - a.first
    long = overlap >= LEAST_OVERLAP_S / STEP_S
    if not (long & (lag >= low) & (lag <= high)).any():
        return ()
    shift, lag, overlap = shift[long], lag[long], overlap[long]
    # The usual values are estimated from all lags, even if the range of the search is small.
    value = _standardised(_agreement(a, b)[shift] / overlap)
    inside = np.flatnonzero((lag >= low) & (lag <= high))
    peaks: list[LagPeak] = []
    for k in inside[np.argsort(-value[inside], kind="stable")].tolist():
        if len(peaks) == most or value[k] <= 0:
            break
        if all(abs(int(lag[k]) - one.lag) > SAME_PEAK for one in peaks):
            peaks.append(LagPeak(int(lag[k]), float(value[k])))
    return tuple(peaks)


def _agreement(a: Activity, b: Activity) -> Floats:
    """Return (length,) by shift, which may be negative: squared correlations over their variances, summed over all pairs."""
    length = next_fast_len(len(a.signals) + len(b.signals), real=True)
    at_a, at_b = (rfft(side.signals, length, axis=0) for side in (a, b))
    variance = _self_resemblance(at_a, length, len(a.signals)).T @ _self_resemblance(at_b, length, len(b.signals))
    total = np.zeros(length)
    for k in range(at_a.shape[1]):
        correlation = irfft(at_a[:, k, None].conj() * at_b, length, axis=0)
        total += (correlation**2 / np.maximum(variance[k], 1e-9)).sum(axis=1)
    return total


def _self_resemblance(transformed: NDArray[np.complex64], length: int, count: int) -> Floats:
    """Return the autocorrelations (lags, K) of signals."""
    lags = np.arange(-CORRELATED_STEPS + 1, CORRELATED_STEPS) % length
    return np.asarray(irfft(np.abs(transformed) ** 2, length, axis=0)[lags] / count)


def _standardised(value: Floats) -> Floats:
    """Return values (N,) relative to the median of their neighbours, in standard deviations by the neighbours' upper decile."""
    blocks = np.array_split(np.arange(len(value)), max(1, len(value) // SPREAD_LAGS))
    centre = np.array([block.mean() for block in blocks])
    middle = np.array([np.median(value[block]) for block in blocks])
    upper = np.array([np.percentile(value[block], 90.0) for block in blocks])
    at = np.arange(len(value))
    spread = np.interp(at, centre, upper - middle) / UPPER_DECILE
    return np.asarray((value - np.interp(at, centre, middle)) / np.maximum(spread, 1e-9))
