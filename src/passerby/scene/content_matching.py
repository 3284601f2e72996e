"""Boxes of one camera on the boxes of another: at which time shifts, by which map of the picture, and how many fit.

Every pair of cameras is compared, at several time shifts: what depends on one camera only is computed once, and all boxes of
the frames compared are worked on together.
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
"""Fewer frames with people in both tell nothing."""
LAGS = 4
"""Time shifts that are tried: those at which numbers, places and sizes of the boxes agree best over the recording."""
NEAR = (0.6, 0.3, 0.3)
"""Boxes may belong together whose edges differ by less than this share of the height, in one round after another."""
SPREAD = (0.1, 0.5, 0.9)
"""Quantiles of where the boxes are, by which a map begins."""


Spectrum = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class PictureMap:
    """Pixels of the second camera from those of the first: scale and shift, across and down."""

    scale: Floats
    """(2,)"""
    shift: Floats
    """(2,) pixels"""

    def __call__(self, edges: Floats) -> Floats:
        """(4, N) edges of boxes, left, top, right and bottom, in the second camera."""
        scale, shift = (np.concatenate([of_axis, of_axis])[:, None] for of_axis in (self.scale, self.shift))
        out = edges * scale
        out += shift
        return np.asarray(out)


@dataclass(frozen=True, eq=False)
class BinnedBoxes:
    """The boxes of one camera by steps of a common time."""

    bin: Ints
    """(N,) in order."""
    edges: Floats
    """(4, N) left, top, right, bottom, pixels."""

    @classmethod
    def of(cls, seconds: Floats, frame: Ints, extent: Floats, start: float, step: float) -> BinnedBoxes:
        """Of each step the frame that is nearest to its middle.

        Args:
            seconds: (N,) in order.
            frame: (N,) of the camera's own.
            extent: (N, 4) left, top, right, bottom, pixels.
            start: seconds at which step 0 is.
            step: seconds between steps.
        """
        at = (seconds - start) / step
        number = np.round(at).astype(np.int64)
        away = np.abs(at - number)
        nearest = np.full(int(number.max()) + 1, np.inf)
        np.minimum.at(nearest, number, away)
        keep = away <= nearest[number] + 1e-9
        # Two frames as far off on either side: the earlier.
        first = np.zeros(len(nearest), dtype=np.int64)
        first[number[keep][::-1]] = frame[keep][::-1]
        keep &= frame == first[number]
        return cls(number[keep], np.ascontiguousarray(extent[keep].T))

    @cached_property
    def there(self) -> Bools:
        """(L,) the steps with boxes, up to the last of them."""
        return np.bincount(self.bin) > 0

    @cached_property
    def centres(self) -> Floats:
        """(2, N) middles of the boxes, pixels."""
        return 0.5 * (self.edges[:2] + self.edges[2:])

    @cached_property
    def ascending(self) -> tuple[tuple[Ints, Floats], ...]:
        """Of each axis, (N,) the rows by their middles, and (N,) these."""
        orders = np.argsort(self.centres, axis=1, kind="stable")
        return tuple((order, values[order]) for order, values in zip(orders, self.centres, strict=True))

    @cached_property
    def _spectra(self) -> dict[int, tuple[Spectrum, Spectrum, float]]:
        return {}

    def spectra(self, length: int) -> tuple[Spectrum, Spectrum, float]:
        """Of signals of so many steps: (4, F) spectra of how many people, where in the mean and how tall, each of mean 0 and
        size 1; (F,) the spectrum of whether there are any; in how many steps there are.
        """
        if length not in self._spectra:
            table, some = self._signals(length)
            size = next_fast_len(2 * length)
            self._spectra.clear()  # usually the next pair's length is the same
            self._spectra[length] = rfft(table, size), rfft(some, size), float(some.sum())
        return self._spectra[length]

    def _signals(self, length: int) -> tuple[Floats, Floats]:
        """(4, length) how many people, where in the mean and how tall; (length,) where any."""
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
        """(3, 2) quantiles `SPREAD` of the middles of the boxes at the steps that are marked, (L,)."""
        inside = steps[self.bin]
        return np.column_stack([_quantiles(values[inside[order]]) for order, values in self.ascending])


def likely_lags(a: BinnedBoxes, b: BinnedBoxes) -> list[int]:
    """Steps by which the second may show the same later, the most likely first; none at all where the two do not overlap."""
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
    """Steps by which the second shows the same later."""

    @cached_property
    def steps(self) -> Ints:
        """The second's steps at which both have boxes."""
        there_a, there_b = self.a.there, self.b.there
        first, last = max(0, self.lag), min(len(there_b), len(there_a) + self.lag)
        if first >= last:
            return np.zeros(0, np.int64)
        return first + np.flatnonzero(there_a[first - self.lag : last - self.lag] & there_b[first:last])

    def map_of_spread(self) -> PictureMap | None:
        """The map that brings the boxes of the one to the spread of the other's; None where it is out of the question."""
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
        """The boxes of so many of the steps that both have, at even distances, or of all."""
        if most not in self._boxes:
            every = self.steps
            steps = every[np.unique(np.linspace(0, len(every) - 1, min(len(every), most)).astype(int))]
            self._boxes[most] = SharedBoxes.of(self.a, self.b, self.lag, steps)
        return self._boxes[most]


@dataclass(frozen=True, eq=False)
class BoxFit:
    """Boxes of one camera on those of the other."""

    map: PictureMap
    mine: Floats
    """(4, K) edges of matched boxes, left, top, right, bottom, pixels,"""
    theirs: Floats
    """(4, K) and of those that they are on."""
    shares: tuple[float, float]
    """Of all boxes of either that are matched."""
    off: float
    """Median difference of the edges, as a share of the height."""


@dataclass(frozen=True, eq=False)
class SharedBoxes:
    """The boxes of two cameras at steps that both have."""

    count_a: int
    count_b: int
    rows: Ints
    """(R,) box of the first of each pair of boxes of one step, ascending,"""
    columns: Ints
    """(R,) and that of the second."""
    edges_a: Floats
    """(4, R) the edges of the one, left, top, right, bottom, pixels,"""
    edges_b: Floats
    """(4, R) and of the other."""

    @classmethod
    def of(cls, a: BinnedBoxes, b: BinnedBoxes, lag: int, steps: Ints) -> SharedBoxes:
        """Those at some of the second's steps."""
        one = np.flatnonzero(_mark_steps(steps - lag, len(a.there))[a.bin])
        other = np.flatnonzero(_mark_steps(steps, len(b.there))[b.bin])
        rows, columns = rows_of_equal(a.bin[one] + lag, b.bin[other])
        return cls(len(one), len(other), rows, columns, a.edges[:, one[rows]], b.edges[:, other[columns]])

    @cached_property
    def _tall(self) -> Floats:
        return np.asarray(self.edges_b[3] - self.edges_b[1])

    @cached_property
    def _first_of_row(self) -> Ints:
        """Where the pairs of each box of the first begin; each has some."""
        return np.flatnonzero(np.diff(self.rows, prepend=-1))

    def fit(self, begin: PictureMap, least: int) -> BoxFit | None:
        """The map that puts most boxes of the first on boxes of the second; None where fewer than `least` match."""
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
        """(K,) pairs that are each other's nearest in their step, no farther apart than a share of the height."""
        miss = change(self.edges_a)
        miss -= self.edges_b
        np.abs(miss, out=miss)
        # The maximum along an axis of four takes several times as long.
        away = np.maximum(np.maximum(miss[0], miss[1]), np.maximum(miss[2], miss[3])) / self._tall
        best_a = np.minimum.reduceat(away, self._first_of_row) if len(away) else away
        best_b = np.full(self.count_b, np.inf)
        np.minimum.at(best_b, self.columns, away)
        mutual = (away <= near) & (away == best_a[self.rows]) & (away == best_b[self.columns])
        return np.flatnonzero(mutual)


def _round_up(length: int) -> int:
    """So that recordings which end a little earlier or later have one length: at most an eighth more."""
    unit = 1 << max(0, length.bit_length() - 4)
    return -(-length // unit) * unit


def _mark_steps(steps: Ints, length: int) -> Bools:
    out = np.zeros(length, dtype=bool)
    out[steps] = True
    return out


def _quantiles(ascending: Floats) -> Floats:
    """(3,) quantiles `SPREAD`, as `np.quantile` has them, which sorts first."""
    at = np.array(SPREAD) * (len(ascending) - 1)
    low = at.astype(np.int64)
    before, after = ascending[low], ascending[np.minimum(low + 1, len(ascending) - 1)]
    return np.asarray(before + (at - low) * (after - before))


def _fit_map(mine: Floats, theirs: Floats) -> PictureMap:
    """Scale and shift of each axis by least squares on both edges (4, K), those that are far off left out."""
    x, y = (np.concatenate([edges[:2], edges[2:]], axis=1) for edges in (mine, theirs))
    scale, shift = np.ones(2), np.zeros(2)
    use = np.ones(x.shape)
    for _ in range(3):
        scale, shift = _lines(x, y, use)
        miss = np.abs(scale[:, None] * x + shift[:, None] - y)
        use = (miss <= 3 * _medians(miss)[:, None] + 1e-9).astype(np.float64)
    return PictureMap(scale, shift)


def _lines(x: Floats, y: Floats, use: Floats) -> tuple[Floats, Floats]:
    """(A,) slopes and (A,) intercepts of the lines y(x), all (A, N), by the points used (1, or 0); of a point alone the
    smallest of both.
    """
    count = use.sum(axis=1)
    mean_x, mean_y = np.einsum("an,an->a", x, use) / count, np.einsum("an,an->a", y, use) / count
    from_x, from_y = (x - mean_x[:, None]) * use, y - mean_y[:, None]
    square, product = np.einsum("an,an->a", from_x, from_x), np.einsum("an,an->a", from_x, from_y)
    alone = square <= 1e-20 * count * (mean_x**2 + 1)
    slope = np.where(alone, mean_x * mean_y / (mean_x**2 + 1), product / np.where(alone, 1.0, square))
    return np.asarray(slope), np.asarray(mean_y - slope * mean_x)


def _medians(values: Floats) -> Floats:
    """(A,) of the rows (A, N); `np.median` takes longer to begin with."""
    ascending = np.sort(values, axis=1)
    n = values.shape[1]
    return np.asarray(0.5 * (ascending[:, (n - 1) // 2] + ascending[:, n // 2]))
