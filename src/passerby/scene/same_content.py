"""Do two cameras show the same pictures? One file under two names, a sub-stream, a second encoding, a copy that starts later.

Such a pair fits itself perfectly at any place, and draws the rig with it. The rows tell: brought to one time and to one scale,
the boxes of the one are those of the other, frame by frame. Two cameras that stand side by side see the same people too, but
each person shifted by a share of the height in the picture (the baseline over the person's height), wherever that person is.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Rig
from passerby.core.extents import extents_of
from passerby.core.observations import CameraObservations, Observations
from passerby.findings.finding import Finding, doubt
from passerby.geometry.groups import rows_of_equal
from passerby.geometry.robust import NORMAL_BY_MAD

MIN_FRAMES, MIN_MATCHES = 30, 60
"""Fewer frames with people in both, or fewer boxes that agree, tell nothing."""
MOST_FRAMES = 150
"""Of those that are compared, at even steps."""
FIRST_FRAMES, FIRST_BOXES, FIRST_MARGIN = 30, 150, 0.7
"""So many frames are compared first. With so many boxes in each of the two, they show other people where even this share of
what the same content needs is not reached. It saves most of the time with many cameras, whose pairs are many."""
LAGS = 4
"""Time shifts that are tried: those at which numbers, places and sizes of the boxes agree best over the recording."""
NEAR = (0.6, 0.3, 0.3)
"""Boxes may belong together whose edges differ by less than this share of the height, in one round after another."""
LEAST_SHARE = 0.6
"""Of the boxes of one of the two, found in the other."""
SAME_NUMBERS = 0.004
"""Mean difference of the edges of matched boxes, as a share of the height, of copied rows: what rounding to whole pixels
leaves."""
SAME_PICTURE = 0.07
"""The same of people who were found twice in the same pictures, by detectors of 4 % noise."""
LOOSELY_SAME = 0.12
"""The same by poorer detectors: enough only where the rig puts both cameras at one place."""
ONE_PLACE, ONE_VIEW_DEG = 0.05, 5.0
"""Distance of two cameras over that of the people they see, and the angle between their views, at one place and view."""
SHIFT = 0.03
"""The same picture begins at the same corner: of the size, as far as encoders cut off rows and columns."""
BASELINE, BASELINE_SIGMA = 0.02, 0.007
"""Shift of people by so large a share of their height in the picture is a second camera, 3.5 cm away; it has to be known so
well."""
NEARER, NEARER_SIGMA = 0.03, 0.01
"""Change of the boxes' ratio from people far off to people twice as near: 0.3 m towards people who are 10 m away."""


@dataclass(frozen=True)
class SameContent:
    """Two cameras that show the same."""

    first: str
    second: str
    share: float
    """Of the boxes of one of the two that are in the other."""
    scale: float
    """Of the second's pixels over the first's."""
    later: float
    """How much later the second shows the same: seconds, or frames where no frame rate is known."""
    timed: bool

    @property
    def finding(self) -> Finding:
        """The doubt that it is."""
        values = {"share": self.share, "scale": self.scale, "later": self.later, "timed": self.timed}
        return doubt("same_recording", self.first, self.second, **values)


@dataclass(frozen=True, eq=False)
class _Shown:
    """What one camera shows."""

    frame: Ints
    """(N,) in order."""
    extent: Floats
    """(N, 4) left, top, right, bottom, pixels."""
    size: tuple[int, int]
    seconds: Floats
    """(N,) by the camera's own clock; frames where no rate is known."""
    step: float
    """Usual time between frames with people."""


@dataclass(frozen=True, eq=False)
class _Map:
    """Pixels of the second camera from those of the first: scale and shift, across and down."""

    scale: Floats
    shift: Floats

    def __call__(self, extent: Floats) -> Floats:
        return np.asarray(extent * np.tile(self.scale, 2) + np.tile(self.shift, 2))


def same_contents(rig: Rig, observations: Observations, *, sure: bool = True) -> list[SameContent]:
    """The pairs of cameras that show the same.

    Args:
        rig: the cameras, for the sizes of their pictures.
        observations: what they saw, in frames of their own; clocks give the rates.
        sure: otherwise those that may show the same, by what is known, count as well.
    """
    rates = {name: clock.fps for name, clock in observations.clocks.items()}
    shown = {
        camera.name: one
        for camera in rig
        if (one := _shown(observations[camera.name], camera.lens.size, rates.get(camera.name) or observations.fps)) is not None
    }
    timed = bool(rates) or observations.fps is not None
    found = []
    for first, second in combinations(shown, 2):
        pair = _compare(shown[first], shown[second], sure)
        if pair is not None:
            found.append(SameContent(first, second, pair.share, float(np.sqrt(pair.map.scale.prod())), pair.later, timed))
    return found


def doubts_of_same_content(rig: Rig, observations: Observations) -> list[Finding]:
    """A doubt for each pair of cameras that show the same."""
    return [pair.finding for pair in same_contents(rig, observations)]


def doubts_of_same_place(rig: Rig, observations: Observations) -> list[Finding]:
    """A doubt for each pair of cameras that stand at one place, look one way, and whose people do not tell them apart.

    Two cameras side by side are meant to be there: what they see differs. Pairs that surely show the same are left out.

    Args:
        rig: with poses, metres.
        observations: what the cameras saw, in frames of their own.
    """
    posed = [camera for camera in rig if camera.pose is not None]
    out = []
    for one, other in combinations(posed, 2):
        assert one.pose is not None
        assert other.pose is not None
        between = float(np.degrees(np.arccos(np.clip(one.pose.R_cw[2] @ other.pose.R_cw[2], -1.0, 1.0))))
        apart = float(np.linalg.norm(one.pose.centre - other.pose.centre))
        if between > ONE_VIEW_DEG or apart > ONE_PLACE * max(_reach(rig, camera.name) for camera in (one, other)):
            continue
        pair = Rig((one, other))
        if same_contents(pair, observations) or not same_contents(pair, observations, sure=False):
            continue
        out.append(doubt("same_place", one.name, other.name, distance_m=apart))
    return out


def _reach(rig: Rig, name: str) -> float:
    """How far a camera is from the farthest other one, metres: about as far as from the people between them."""
    at = rig[name].pose
    assert at is not None
    return max(float(np.linalg.norm(camera.pose.centre - at.centre)) for camera in rig if camera.pose is not None)


def _shown(seen: CameraObservations, size: tuple[int, int], fps: float | None) -> _Shown | None:
    part = seen.boxes if len(seen.boxes) else seen.keypoints
    extent = extents_of(part)
    order = np.argsort(part.frame, kind="stable")
    order = order[(extent[order, 2:] > extent[order, :2]).all(axis=1)]
    frames = np.unique(part.frame[order])
    if len(frames) < MIN_FRAMES:
        return None
    rate = fps or 1.0
    frame = np.asarray(part.frame[order])
    return _Shown(frame, extent[order], size, (frame - 1) / rate, float(np.median(np.diff(frames))) / rate)


@dataclass(frozen=True, eq=False)
class _Pair:
    share: float
    map: _Map
    later: float


def _compare(first: _Shown, second: _Shown, sure: bool) -> _Pair | None:
    """The time shift and the map by which two cameras show the same; None where they do not."""
    step = max(first.step, second.step)
    start = min(first.seconds[0], second.seconds[0])
    a, b = _Binned.of(first, start, step), _Binned.of(second, start, step)
    aspects = np.array([1.0, second.size[1] / first.size[1] / (second.size[0] / first.size[0])])
    for lag in _lags(a, b):
        for begin in _beginnings(first, second, a, b, lag):
            found = _matched(a, b, lag, begin, second.size, aspects, sure)
            if found is not None:
                return _Pair(found[0], found[1], lag * step)
    return None


@dataclass(frozen=True, eq=False)
class _Binned:
    """The boxes by steps of a common time."""

    bin: Ints
    """(N,) in order."""
    extent: Floats

    @classmethod
    def of(cls, shown: _Shown, start: float, step: float) -> _Binned:
        """Of each step the frame that is nearest to its middle."""
        at = (shown.seconds - start) / step
        number = np.round(at).astype(np.int64)
        away = np.abs(at - number)
        nearest = np.full(int(number.max()) + 1, np.inf)
        np.minimum.at(nearest, number, away)
        keep = away <= nearest[number] + 1e-9
        # Two frames as far off on either side: the earlier.
        first = np.zeros(len(nearest), dtype=np.int64)
        first[number[keep][::-1]] = shown.frame[keep][::-1]
        keep &= shown.frame == first[number]
        return cls(number[keep], shown.extent[keep])

    def signals(self, length: int) -> tuple[Floats, Floats]:
        """(4, length) how many people, where in the mean and how tall, each of mean 0 and size 1; (length,) where any."""
        count = np.bincount(self.bin, minlength=length).astype(float)
        some = count > 0
        middle, tall = 0.5 * (self.extent[:, :2] + self.extent[:, 2:]), self.extent[:, 3] - self.extent[:, 1]
        rows = [count]
        for values in (middle[:, 0], middle[:, 1], np.log(tall)):
            rows.append(np.bincount(self.bin, values, minlength=length) / np.maximum(count, 1))
        table = np.array(rows)
        mean, spread = table[:, some].mean(axis=1), table[:, some].std(axis=1)
        table = np.where(some, (table - mean[:, None]) / np.maximum(spread, 1e-9)[:, None], 0.0)
        return table, some.astype(float)


def _lags(a: _Binned, b: _Binned) -> list[int]:
    """Steps by which the second may show the same later, the likeliest first; none at all where the two do not overlap."""
    length = int(max(a.bin[-1], b.bin[-1])) + 1
    (one, seen_one), (other, seen_other) = a.signals(length), b.signals(length)
    size = next_fast_len(2 * length)

    def correlated(x: Floats, y: Floats) -> Floats:
        return np.asarray(irfft(np.conj(rfft(x, size)) * rfft(y, size), size))

    overlap = np.round(correlated(seen_one, seen_other))
    agree = sum(correlated(x, y) for x, y in zip(one, other, strict=True)) / np.maximum(overlap, 1.0)
    least = max(MIN_FRAMES, 0.3 * min(seen_one.sum(), seen_other.sum()))
    agree = np.where(overlap >= least, agree, -np.inf)
    out = [0] if overlap[0] >= MIN_FRAMES else []
    for _ in range(LAGS):
        best = int(np.argmax(agree))
        if not agree[best] > 0:
            break
        out.append(best if best < size // 2 else best - size)
        agree[(best + np.arange(-2, 3)) % size] = -np.inf
    return list(dict.fromkeys(out))


def _beginnings(first: _Shown, second: _Shown, a: _Binned, b: _Binned, lag: int) -> list[_Map]:
    """Maps to begin with: the pictures' sizes, the same pixels, and what brings the boxes to the same spread."""
    both = np.intersect1d(a.bin + lag, b.bin)
    one, other = a.extent[np.isin(a.bin + lag, both)], b.extent[np.isin(b.bin, both)]
    none = np.zeros(2)
    out = [_Map(np.array(second.size) / np.array(first.size), none)]
    if first.size != second.size:
        out.append(_Map(np.ones(2), none))
    if not len(one) or not len(other):
        return out
    (a_low, a_middle, a_high), (b_low, b_middle, b_high) = (
        np.quantile(0.5 * (each[:, :2] + each[:, 2:]), (0.1, 0.5, 0.9), axis=0) for each in (one, other)
    )
    scale = (b_high - b_low) / np.maximum(a_high - a_low, 1e-9)
    if (scale > 0.1).all() and (scale < 10).all():
        out.append(_Map(scale, b_middle - scale * a_middle))
    return out


def _matched(
    a: _Binned, b: _Binned, lag: int, begin: _Map, size: tuple[int, int], aspects: Floats, sure: bool
) -> tuple[float, _Map] | None:
    """The share of boxes that are in the other camera too, and the map between them; None where they are not the same."""
    both = np.intersect1d(a.bin + lag, b.bin)
    if len(both) < MIN_FRAMES:
        return None
    if len(both) > 2 * FIRST_FRAMES and _surely_others(_Shared.of(a, b, lag, _spread(both, FIRST_FRAMES)), begin, sure):
        return None
    shared = _Shared.of(a, b, lag, _spread(both, MOST_FRAMES))
    fit = shared.fit(begin, MIN_MATCHES)
    if fit is None:
        return None
    shares = fit.shares
    if max(shares) < LEAST_SHARE or min(shares) < 0.5 * LEAST_SHARE or fit.off > (SAME_PICTURE if sure else LOOSELY_SAME):
        return None
    alike = _begins_alike(fit.map, size) and _at_one_place(fit.mine, fit.theirs, aspects, sure)
    return (max(shares), fit.map) if fit.off <= SAME_NUMBERS or alike else None


def _spread(frames: Ints, most: int) -> Ints:
    """So many of the frames at even steps, or all."""
    return np.asarray(frames[np.unique(np.linspace(0, len(frames) - 1, min(len(frames), most)).astype(int))])


def _surely_others(shared: _Shared, begin: _Map, sure: bool) -> bool:
    """Whether a few frames with many boxes show that the people are others, by far."""
    if min(len(shared.from_a), len(shared.from_b)) < FIRST_BOXES:
        return False
    fit = shared.fit(begin, 2)
    if fit is None:
        return True
    least, most = FIRST_MARGIN * LEAST_SHARE, (SAME_PICTURE if sure else LOOSELY_SAME) / FIRST_MARGIN
    return max(fit.shares) < least or min(fit.shares) < 0.5 * least or fit.off > most


@dataclass(frozen=True, eq=False)
class _Fit:
    """Boxes of one camera on those of the other."""

    map: _Map
    mine: Floats
    """(K, 4) matched boxes,"""
    theirs: Floats
    """(K, 4) and those that they are on."""
    shares: tuple[float, float]
    """Of all boxes of either that are matched."""
    off: float
    """Median difference of the edges, as a share of the height."""


@dataclass(frozen=True, eq=False)
class _Shared:
    """The boxes of two cameras at steps that both have, the first's brought to the second's time."""

    bin_a: Ints
    from_a: Floats
    bin_b: Ints
    from_b: Floats

    @classmethod
    def of(cls, a: _Binned, b: _Binned, lag: int, steps: Ints) -> _Shared:
        """Those at some of the second's steps."""
        one, other = np.isin(a.bin + lag, steps), np.isin(b.bin, steps)
        return cls(a.bin[one] + lag, a.extent[one], b.bin[other], b.extent[other])

    def fit(self, begin: _Map, least: int) -> _Fit | None:
        """The map that puts most boxes of the first on boxes of the second; None where fewer than `least` match."""
        pairs, change = (np.zeros(0, np.int64),) * 2, begin
        for near in NEAR:
            pairs = _nearest(self.bin_a, change(self.from_a), self.bin_b, self.from_b, near)
            if len(pairs[0]) < least:
                return None
            change = _fitted(self.from_a[pairs[0]], self.from_b[pairs[1]])
        mine, theirs = self.from_a[pairs[0]], self.from_b[pairs[1]]
        tall = theirs[:, 3] - theirs[:, 1]
        off = float(np.median(np.abs(change(mine) - theirs).mean(axis=1) / tall))
        return _Fit(change, mine, theirs, (len(tall) / len(self.from_a), len(tall) / len(self.from_b)), off)


def _nearest(bin_a: Ints, at: Floats, bin_b: Ints, extent: Floats, near: float) -> tuple[Ints, Ints]:
    """(K,) rows of either that are each other's nearest in their frame, no farther apart than a share of the height."""
    rows, columns = rows_of_equal(bin_a, bin_b)
    away = np.abs(at[rows] - extent[columns]).max(axis=1) / (extent[columns, 3] - extent[columns, 1])
    best_a, best_b = np.full(len(bin_a), np.inf), np.full(len(bin_b), np.inf)
    np.minimum.at(best_a, rows, away)
    np.minimum.at(best_b, columns, away)
    mutual = (away <= near) & (away == best_a[rows]) & (away == best_b[columns])
    return rows[mutual], columns[mutual]


def _fitted(mine: Floats, theirs: Floats) -> _Map:
    """Scale and shift of each axis by least squares on both edges, those that are far off left out."""
    scale, shift = np.ones(2), np.zeros(2)
    for axis in range(2):
        x, y = mine[:, [axis, axis + 2]].ravel(), theirs[:, [axis, axis + 2]].ravel()
        use = np.ones(len(x), dtype=bool)
        for _ in range(3):
            design = np.column_stack([x[use], np.ones(int(use.sum()))])
            (scale[axis], shift[axis]), *_ = np.linalg.lstsq(design, y[use], rcond=None)
            miss = np.abs(scale[axis] * x + shift[axis] - y)
            use = miss <= 3 * np.median(miss) + 1e-9
    return _Map(scale, shift)


def _begins_alike(change: _Map, size: tuple[int, int]) -> bool:
    """Whether the corner of the one picture is the corner of the other, and neither is much drawn out."""
    drawn = float(change.scale[0] / change.scale[1])
    return bool((np.abs(change.shift) <= SHIFT * np.array(size)).all()) and 0.7 < drawn < 1.43


def _at_one_place(mine: Floats, theirs: Floats, aspects: Floats, sure: bool) -> bool:
    """Whether people near and far are shifted alike and are larger by one factor, and this is known well; else may be.

    Across the picture the scale comes from where people are; down the picture that is how large they are as well, so there
    the scale is that across, times one of the `aspects` (pictures that were squeezed).
    """
    tall, tall_before = theirs[:, 3] - theirs[:, 1], mine[:, 3] - mine[:, 1]
    (x, y), (x_there, y_there) = (0.5 * (each[:, :2] + each[:, 2:]).T for each in (mine, theirs))
    one = np.ones(len(x))
    (scale, _, across), sigma_across = _robust(np.column_stack([x - x.mean(), one, tall - tall.mean()]), x_there)
    drawn = np.median(tall / tall_before) / scale
    down_scale = scale * aspects[np.argmin(np.abs(aspects - drawn))]
    (_, down), sigma_down = _robust(np.column_stack([one, tall - tall.mean()]), y_there - down_scale * y)
    size = tall / tall.mean()
    (_, larger), sigma_larger = _robust(np.column_stack([one, size - size.mean()]), np.log(tall / tall_before))
    found, sigma = np.abs([across, down, larger]), np.array([sigma_across[-1], sigma_down[-1], sigma_larger[-1]])
    most, well = np.array([BASELINE, BASELINE, NEARER]), np.array([BASELINE_SIGMA, BASELINE_SIGMA, NEARER_SIGMA])
    return bool((found <= most).all() and (sigma <= well).all()) if sure else bool((found - 2 * sigma <= most).all())


def _robust(design: Floats, values: Floats) -> tuple[Floats, Floats]:
    """(K,) least squares without those that are far off, and (K,) sigmas; infinite where nothing fixes them."""
    use = np.ones(len(values), dtype=bool)
    found: Floats = np.zeros(design.shape[1])
    miss: Floats = np.zeros(len(values))
    for _ in range(3):
        found = np.asarray(np.linalg.lstsq(design[use], values[use], rcond=None)[0])
        miss = np.abs(design @ found - values)
        use = miss <= 4 * np.median(miss) + 1e-9
    square = design[use].T @ design[use]
    if np.linalg.matrix_rank(square) < len(square):
        return found, np.full(len(found), np.inf)
    return found, NORMAL_BY_MAD * float(np.median(miss)) * np.sqrt(np.diag(np.linalg.inv(square)))
