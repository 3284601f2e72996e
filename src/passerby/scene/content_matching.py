"""Match of one camera's boxes with another's: likely time shifts, the map between the pictures, and the number of matches.

Every pair of cameras is compared, at several time shifts. So quantities that depend on one camera only are computed once, and
all boxes of the compared frames are processed together.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft

from passerby.common.arrays import Bools, Floats, Ints
from passerby.geometry.groups import rows_of_equal

MIN_FRAMES = 30
"""Minimum number of frames with people in both cameras; fewer are no evidence."""
LAGS = 4
"""Number of time shifts that are tried: at these, numbers, places and sizes of the boxes agree best over the recording."""
NEAR = (0.6, 0.3, 0.3)
"""Maximum difference of the edges of boxes that may match, as a share of the height, in each of the rounds."""
SPREAD = (0.1, 0.5, 0.9)
"""Quantiles of the positions of the boxes that give an initial map."""


Spectrum = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class PictureMap:
    """A map from pixels of the first camera to pixels of the second: scale and shift, across and down."""

    scale: Floats
    """(2,) factors"""
    shift: Floats
    """(2,) pixels"""

    def __call__(self, edges: Floats) -> Floats:
        """Map edges (4, N) of boxes, left, top, right and bottom, to pixels of the second camera."""
        scale, shift = (np.concatenate([of_axis, of_axis])[:, None] for of_axis in (self.scale, self.shift))
        out = edges * scale
        out += shift
        return np.asarray(out)


@dataclass(frozen=True, eq=False)
class BinnedBoxes:
    """The boxes of one camera by steps of a common time."""

    bin: Ints
    """(N,) steps in order."""
    edges: Floats
    """(4, N) left, top, right, bottom, pixels."""

    @classmethod
    def of(cls, seconds: Floats, frame: Ints, extent: Floats, start: float, step: float) -> BinnedBoxes:
        """Select, for each step, the boxes of the frame that is nearest to its middle.

        Args:
            seconds: (N,) times in order.
            frame: (N,) frame numbers of the camera.
            extent: (N, 4) left, top, right, bottom, pixels.
            start: time of step 0, seconds.
            step: seconds between steps.
        """
        at = (seconds - start) / step
        number = np.round(at).astype(np.int64)
        away = np.abs(at - number)
        nearest = np.full(int(number.max()) + 1, np.inf)
        np.minimum.at(nearest, number, away)
        keep = away <= nearest[number] + 1e-9
        # Of two frames at the same distance from the middle, the earlier one is taken.
        first = np.zeros(len(nearest), dtype=np.int64)
        first[number[keep][::-1]] = frame[keep][::-1]
        keep &= frame == first[number]
        return cls(number[keep], np.ascontiguousarray(extent[keep].T))

    @cached_property
    def there(self) -> Bools:
        """(L,) whether each step has boxes, up to the last step that has."""
        return np.bincount(self.bin) > 0

    @cached_property
    def centres(self) -> Floats:
        """(2, N) middles of the boxes, pixels."""
        return 0.5 * (self.edges[:2] + self.edges[2:])

    @cached_property
    def ascending(self) -> tuple[tuple[Ints, Floats], ...]:
        """For each axis: (N,) row indices in ascending order of the middles, and (N,) the sorted middles."""
        orders = np.argsort(self.centres, axis=1, kind="stable")
        return tuple((order, values[order]) for order, values in zip(orders, self.centres, strict=True))

    @cached_property
    def _spectra(self) -> dict[int, tuple[Spectrum, Spectrum, float]]:
        return {}

    def spectra(self, length: int) -> tuple[Spectrum, Spectrum, float]:
        """Compute spectra of signals of `length` steps.

        Returns:
            (4, F) spectra of the number of people, their mean position (2) and their mean log height, each standardised to
            mean 0 and standard deviation 1; (F,) the spectrum of the presence of people; the number of steps with people.
        """
        if length not in self._spectra:
            table, some = self._signals(length)
            size = next_fast_len(2 * length)
            self._spectra.clear()  # usually the next pair's length is the same
            self._spectra[length] = rfft(table, size), rfft(some, size), float(some.sum())
        return self._spectra[length]

    def _signals(self, length: int) -> tuple[Floats, Floats]:
        """Compute (4, length) the standardised signals of `spectra`, and (length,) 1 for each step with people, else 0."""
        count = np.bincount(self.bin, minlength=length).astype(float)
        some = count > 0
        rows = [count]
        for values in (*self.centres, np.log(self.edges[3] - self.edges[1])):
            rows.append(np.bincount(self.bin, values, minlength=length) / np.maximum(count, 1))
        table = np.array(rows)
        mean, spread = table[:, some].mean(axis=1), table[:, some].std(axis=1)
        table = np.where(some, (table - mean[:, None]) / np.maximum(spread, 1e-9)[:, None], 0.0)
        return table, some.astype(float)

    def spread(self, steps: Bools) -> Floats:
        """Compute the quantiles `SPREAD` (3, 2) of the middles of the boxes at the marked steps (L,)."""
        inside = steps[self.bin]
        return np.column_stack([_quantiles(values[inside[order]]) for order, values in self.ascending])


def likely_lags(a: BinnedBoxes, b: BinnedBoxes) -> list[int]:
    """Find likely delays of the second camera, in steps: 0 first, then the best correlations; none if there is no overlap."""
    length = _round_up(max(len(a.there), len(b.there)))
    size = next_fast_len(2 * length)
    (one, seen_one, count_one), (other, seen_other, count_other) = a.spectra(length), b.spectra(length)
    overlap = np.round(irfft(np.conj(seen_one) * seen_other, size))
    agree = irfft((np.conj(one) * other).sum(axis=0), size) / np.maximum(overlap, 1.0)
    least = max(MIN_FRAMES, 0.3 * min(count_one, count_other))
    agree = np.where(overlap >= least, agree, -np.inf)
    out = [0] if overlap[0] >= MIN_FRAMES else []
    for _ in range(LAGS):
        best = int(np.argmax(agree))
        if not agree[best] > 0:
            break
        out.append(best if best < size // 2 else best - size)
        agree[(best + np.arange(-2, 3)) % size] = -np.inf
    return list(dict.fromkeys(out))


@dataclass(frozen=True, eq=False)
class Overlap:
    """Two cameras at one time shift."""

    a: BinnedBoxes
    b: BinnedBoxes
    lag: int
    """Delay of the second camera, steps."""

    @cached_property
    def steps(self) -> Ints:
        """Steps of the second camera at which both have boxes."""
        there_a, there_b = self.a.there, self.b.there
        first, last = max(0, self.lag), min(len(there_b), len(there_a) + self.lag)
        if first >= last:
            return np.zeros(0, np.int64)
        return first + np.flatnonzero(there_a[first - self.lag : last - self.lag] & there_b[first:last])

    def map_of_spread(self) -> PictureMap | None:
        """Compute the map that gives the first camera's boxes the spread of the second's; None if its scale is implausible."""
        if not len(self.steps):
            return None
        low_a, middle_a, high_a = self.a.spread(_mark_steps(self.steps - self.lag, len(self.a.there)))
        low_b, middle_b, high_b = self.b.spread(_mark_steps(self.steps, len(self.b.there)))
        scale = (high_b - low_b) / np.maximum(high_a - low_a, 1e-9)
        if not ((scale > 0.1).all() and (scale < 10).all()):
            return None
        return PictureMap(scale, middle_b - scale * middle_a)

    @cached_property
    def _boxes(self) -> dict[int, SharedBoxes]:
        return {}

    def boxes(self, most: int) -> SharedBoxes:
        """Return the boxes of at most `most` of the common steps, evenly spaced."""
        if most not in self._boxes:
            every = self.steps
            steps = every[np.unique(np.linspace(0, len(every) - 1, min(len(every), most)).astype(int))]
            self._boxes[most] = SharedBoxes.of(self.a, self.b, self.lag, steps)
        return self._boxes[most]


@dataclass(frozen=True, eq=False)
class BoxFit:
    """A fit of one camera's boxes to those of the other."""

    map: PictureMap
    mine: Floats
    """(4, K) edges of the first camera's matched boxes, left, top, right, bottom, pixels."""
    theirs: Floats
    """(4, K) edges of the second camera's boxes that match them."""
    shares: tuple[float, float]
    """Share of all boxes of each camera that are matched."""
    off: float
    """Median difference of the edges, as a share of the height."""


@dataclass(frozen=True, eq=False)
class SharedBoxes:
    """The boxes of two cameras at steps that both have."""

    count_a: int
    count_b: int
    rows: Ints
    """(R,) first camera's box of each pair of boxes of one step, ascending."""
    columns: Ints
    """(R,) second camera's box of each pair."""
    edges_a: Floats
    """(4, R) edges of the first camera's boxes, left, top, right, bottom, pixels."""
    edges_b: Floats
    """(4, R) edges of the second camera's boxes."""

    @classmethod
    def of(cls, a: BinnedBoxes, b: BinnedBoxes, lag: int, steps: Ints) -> SharedBoxes:
        """Pair all boxes of the two cameras at the given steps of the second camera."""
        one = np.flatnonzero(_mark_steps(steps - lag, len(a.there))[a.bin])
        other = np.flatnonzero(_mark_steps(steps, len(b.there))[b.bin])
        rows, columns = rows_of_equal(a.bin[one] + lag, b.bin[other])
        return cls(len(one), len(other), rows, columns, a.edges[:, one[rows]], b.edges[:, other[columns]])

    @cached_property
    def _tall(self) -> Floats:
        return np.asarray(self.edges_b[3] - self.edges_b[1])

    @cached_property
    def _first_of_row(self) -> Ints:
        """Index of the first pair of each of the first camera's boxes; each box has at least one pair."""
        return np.flatnonzero(np.diff(self.rows, prepend=-1))

    def fit(self, begin: PictureMap, least: int) -> BoxFit | None:
        """Fit the map from the first camera's boxes to the second's; None if fewer than `least` boxes match."""
        pairs, change = np.zeros(0, np.int64), begin
        for near in NEAR:
            pairs = self._match_nearest(change, near)
            if len(pairs) < least:
                return None
            change = _fit_map(self.edges_a[:, pairs], self.edges_b[:, pairs])
        mine, theirs = self.edges_a[:, pairs], self.edges_b[:, pairs]
        off = float(np.median(np.abs(change(mine) - theirs).mean(axis=0) / self._tall[pairs]))
        return BoxFit(change, mine, theirs, (len(pairs) / self.count_a, len(pairs) / self.count_b), off)

    def _match_nearest(self, change: PictureMap, near: float) -> Ints:
        """Find the pairs (K,) that are mutual nearest neighbours in their step, not farther apart than `near` of the height."""
        miss = change(self.edges_a)
        miss -= self.edges_b
        np.abs(miss, out=miss)
        # np.max along an axis of length four takes several times as long.
        away = np.maximum(np.maximum(miss[0], miss[1]), np.maximum(miss[2], miss[3])) / self._tall
        best_a = np.minimum.reduceat(away, self._first_of_row) if len(away) else away
        best_b = np.full(self.count_b, np.inf)
        np.minimum.at(best_b, self.columns, away)
        mutual = (away <= near) & (away == best_a[self.rows]) & (away == best_b[self.columns])
        return np.flatnonzero(mutual)


def _round_up(length: int) -> int:
    """Round a length up by at most an eighth, so that recordings that end at slightly different times have equal lengths."""
    unit = 1 << max(0, length.bit_length() - 4)
    return -(-length // unit) * unit


def _mark_steps(steps: Ints, length: int) -> Bools:
    out = np.zeros(length, dtype=bool)
    out[steps] = True
    return out


def _quantiles(ascending: Floats) -> Floats:
    """Compute the quantiles `SPREAD` (3,) of sorted values, as `np.quantile` does, but without its sort."""
    at = np.array(SPREAD) * (len(ascending) - 1)
    low = at.astype(np.int64)
    before, after = ascending[low], ascending[np.minimum(low + 1, len(ascending) - 1)]
    return np.asarray(before + (at - low) * (after - before))


def _fit_map(mine: Floats, theirs: Floats) -> PictureMap:
    """Fit scale and shift of each axis by least squares on the edges (4, K), without outliers."""
    x, y = (np.concatenate([edges[:2], edges[2:]], axis=1) for edges in (mine, theirs))
    scale, shift = np.ones(2), np.zeros(2)
    use = np.ones(x.shape)
    for _ in range(3):
        scale, shift = _lines(x, y, use)
        miss = np.abs(scale[:, None] * x + shift[:, None] - y)
        use = (miss <= 3 * _medians(miss)[:, None] + 1e-9).astype(np.float64)
    return PictureMap(scale, shift)


def _lines(x: Floats, y: Floats, use: Floats) -> tuple[Floats, Floats]:
    """Fit slopes (A,) and intercepts (A,) of lines y(x), each (A, N), to the points that `use` (A, N) marks by 1, else 0.

    If all points of a line have one x, the solution of the smallest norm is returned.
    """
    count = use.sum(axis=1)
    mean_x, mean_y = np.einsum("an,an->a", x, use) / count, np.einsum("an,an->a", y, use) / count
    from_x, from_y = (x - mean_x[:, None]) * use, y - mean_y[:, None]
    square, product = np.einsum("an,an->a", from_x, from_x), np.einsum("an,an->a", from_x, from_y)
    alone = square <= 1e-20 * count * (mean_x**2 + 1)
    slope = np.where(alone, mean_x * mean_y / (mean_x**2 + 1), product / np.where(alone, 1.0, square))
    return np.asarray(slope), np.asarray(mean_y - slope * mean_x)


def _medians(values: Floats) -> Floats:
    """Compute the medians (A,) of the rows (A, N); `np.median` has a larger overhead."""
    ascending = np.sort(values, axis=1)
    n = values.shape[1]
    return np.asarray(0.5 * (ascending[:, (n - 1) // 2] + ascending[:, n // 2]))
