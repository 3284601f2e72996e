"""Registration of two cameras by the people who walk on their common ground, without known identities.

Two levelled cameras differ by a turn about the vertical, a shift along the ground and a lag of their clocks. Likely motions
(`hough`) are refined by alternating between matching of tracklets and least squares (`pair_matching`), and compared. Where the
runner-up scores nearly as well, the registration cannot be trusted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from passerby.association.ground.chance import CLEAR_OF_CHANCE, CLEAR_SCORE, CLEAR_SHARE, MOST_AMBIGUOUS, make_surrogates
from passerby.association.ground.cooccurrence import SynchronousPairs, TrackPair, find_synchronous_pairs
from passerby.association.ground.ground_tracks import GroundTracks
from passerby.association.ground.hough import SAME_LAG_S, SAME_SHIFT_M, SAME_TURN, hough_motion_candidates
from passerby.association.ground.pair_matching import (
    GroundMotion,
    TrackletMatches,
    agreement_of_pairs,
    fit_motion,
    match_tracklets,
)
from passerby.association.sampling import STEP_S
from passerby.common.arrays import Floats, Ints
from passerby.geometry.groups import least_of_groups

# Instants used in the refinement come in stretches of ten seconds. With even steps over an hour, a tracklet of four seconds
# would have one or two samples and match no other.
_INSTANTS, _STRETCH = 1500, 20
BELIEVED_SHARE = 0.45
"""Least share of the people that both cameras should see. Over simulated scenes with nearly all boxes present, cameras that see
the same place reach 0.63 to 0.83, and cameras that see different people at most 0.44. Third cameras do not help there: cameras
that see one place agree on one wrong pose for a camera of another place."""
# Usual median distance, in tolerances, of samples of one person in two cameras (0.2 to 0.35 in simulation). Where it is larger,
# the tolerance is too small, and is widened up to this factor.
_USUAL_MISS, _WIDEST, _MIN_NEAREST = 0.35, 3.0, 20


@dataclass(frozen=True)
class Thoroughness:
    """Amount of the tracks that a registration uses; more would be redundant."""

    candidates: int
    """Number of likely motions that are refined."""
    voters: int
    """Approximate number of encounters that propose motions at each lag."""
    encounters: int
    """Approximate number of encounters by which motions are refined."""
    tolerances: tuple[float, ...]
    """Factors on the tolerance of the matching, one a round: likely motions are known to a cell and five degrees only."""


THOROUGH = Thoroughness(6, 20_000, 300_000, (2.5, 2.0, 1.5, 1.2, 1.0, 1.0))
QUICK = Thoroughness(3, 6_000, 60_000, (2.5, 1.5, 1.0))
"""Enough to measure how well two cameras agree, but not for their relative pose."""


@dataclass(frozen=True, eq=False)
class Registration:
    """One guess of the relative pose of cameras a and b: `ground_b = turn * ground_a + shift`, at `time_b = time_a + lag_s`."""

    turn: complex
    """Turn about the vertical, and the ratio of the two cameras' scales."""
    shift: complex
    """x + iy, metres of camera b."""
    lag_s: float
    """Time of camera b's clock minus that of camera a's, seconds."""
    score: float
    """Samples of walking people that agree, minus those that disagree."""
    samples: int
    """Samples of matched tracklets."""
    share: float
    """Share of each camera's samples, at places where the other camera sees people, that have a partner there."""
    middle: complex
    """Mean position of camera a's matched people, metres of camera a."""
    tracklets_a: Ints
    """(K,) matched tracklets of camera a."""
    tracklets_b: Ints
    """(K,) their partners of camera b."""
    weight: Floats
    """(K,) agreement of each match, in samples."""

    @property
    def motion(self) -> GroundMotion:
        """The motion alone."""
        return GroundMotion(self.turn, self.shift, self.lag_s)

    @property
    def merit(self) -> float:
        """Score by which guesses are ranked: the agreement times the share of expected samples that agree."""
        return self.score * self.share


@dataclass(frozen=True, eq=False)
class PairRegistration:
    """All guesses for a pair of cameras, the best first."""

    a: int
    b: int
    candidates: tuple[Registration, ...]
    by_chance: float | None = None
    """Score of the tracks by chance; None where it was not computed, since share or runner-up decide already."""

    @property
    def clear_of_chance(self) -> bool:
        """Whether the best guess scores significantly more than chance, even if the cameras share few of their people."""
        if self.by_chance is None:
            return False
        best = self.candidates[0]
        return best.score > max(CLEAR_OF_CHANCE * self.by_chance, CLEAR_SCORE) and best.share >= CLEAR_SHARE

    @property
    def runner_up(self) -> float:
        """Best score of another guess as a share of the first one's; 1 or more where no guess stands out."""
        if not self.candidates or self.candidates[0].score <= 0:
            return 1.0
        return max((guess.score for guess in self.candidates[1:]), default=0.0) / self.candidates[0].score


def register_pair(
    a: int, b: int, tracks_a: GroundTracks, tracks_b: GroundTracks, max_lag_s: float, affinity: Floats | None = None
) -> PairRegistration:
    """Register two cameras by their ground tracks.

    Args:
        a: number of the first camera.
        b: number of the second camera.
        tracks_a: tracks of the first camera, in its own levelled frame and clock.
        tracks_b: tracks of the second camera.
        max_lag_s: largest difference of the two clocks that is searched for; 0 takes them as synchronised.
        affinity: (T_a, T_b) log-likelihood ratio of tracklets (by their numbers) showing one person rather than two, from their
            appearance; None where nothing is known.
    """
    if not len(tracks_a) or not len(tracks_b):
        return PairRegistration(a, b, ())
    tracks = TrackPair(tracks_a, tracks_b, affinity)
    found = PairRegistration(a, b, _guesses(tracks, max_lag_s, tracks_a))
    if not found.candidates or found.candidates[0].share >= BELIEVED_SHARE or found.runner_up > MOST_AMBIGUOUS:
        return found
    chance = [_guesses(TrackPair(tracks_a, other, None), max_lag_s, tracks_a) for other in make_surrogates(tracks_b, max_lag_s)]
    return replace(found, by_chance=max((guesses[0].score for guesses in chance if guesses), default=0.0))


def best_merit(tracks_a: GroundTracks, tracks_b: GroundTracks, max_lag_s: float) -> float:
    """Return the merit of the best motion of two cameras (`Registration.merit`); 0 where nothing agrees.

    Arguments as of `register_pair`.
    """
    guesses = _guesses(TrackPair(tracks_a, tracks_b, None), max_lag_s, tracks_a, QUICK)
    return max(guesses[0].merit, 0.0) if guesses else 0.0


def _guesses(
    tracks: TrackPair, max_lag_s: float, tracks_a: GroundTracks, effort: Thoroughness = THOROUGH
) -> tuple[Registration, ...]:
    """Find the guesses for a pair, the best first."""
    most_instants = min(_INSTANTS, tracks.instants_of(effort.encounters))

    # Guesses usually share a few lags; the cached pairs of one lag may be large.
    @lru_cache(maxsize=3)
    def met_at(lag: int) -> SynchronousPairs:
        return find_synchronous_pairs(tracks, lag, most_instants, _STRETCH)

    starts = hough_motion_candidates(tracks, max_lag_s, effort.candidates, effort.voters)
    found = [_refined(met_at, start, max_lag_s, effort.tolerances) for start in starts]
    ranked = sorted((guess for guess in found if guess is not None), key=lambda guess: -guess.merit)
    distinct: list[Registration] = []
    for guess in ranked:
        if not any(_same(guess, other, tracks_a) for other in distinct):
            distinct.append(guess)
    return tuple(distinct)


def _refined(
    met_at: Callable[[int], SynchronousPairs], start: GroundMotion, max_lag_s: float, tolerances: Sequence[float]
) -> Registration | None:
    """Alternate between matching tracklets and the least-squares motion, from large to small tolerances."""
    motion, latest = start, max_lag_s + STEP_S
    last: tuple[SynchronousPairs, TrackletMatches] | None = None
    for factor in tolerances:
        met = met_at(round(motion.lag_s / STEP_S))
        matched = match_tracklets(met, motion, factor)
        fitted = None if matched is None else fit_motion(met, matched, motion, free_lag=max_lag_s > 0)
        if matched is None or fitted is None:
            return None
        motion = GroundMotion(fitted.turn, fitted.shift, float(np.clip(fitted.lag_s, -latest, latest)))
        last = met, matched
    return None if last is None else _registration(*last, motion)


def _registration(met: SynchronousPairs, matched: TrackletMatches, motion: GroundMotion) -> Registration:
    middle = complex(np.mean(met.tracks.a.position[met.a[matched.rows]]))
    share = _share(met, matched, motion)
    return Registration(
        motion.turn, motion.shift, motion.lag_s, matched.score, len(matched.rows), share, middle,
        matched.tracklets_a, matched.tracklets_b, matched.weight,
    )  # fmt: skip


def _share(met: SynchronousPairs, matched: TrackletMatches, motion: GroundMotion) -> float:
    """Return the share of samples that both cameras should see and do. It is the best test of a motion in any crowd."""
    found = expected = 0
    sides = (
        (met.tracks.a, met.a, met.tracks.b, met.lag, motion), (met.tracks.b, met.b, met.tracks.a, -met.lag, motion.inverse)
    )  # fmt: skip
    for tracks, rows, other, lag, way in sides:
        partnered = np.zeros(len(tracks), dtype=bool)
        partnered[rows[matched.rows]] = True
        both = (tracks.step >= other.step[0] - lag) & (tracks.step <= other.step[-1] - lag)
        if met.thinned:
            both &= np.isin(tracks.step, tracks.step[rows])
        due = both & (other.covers(way.turn * tracks.position + way.shift) | partnered)
        found += int(np.count_nonzero(partnered))
        expected += int(np.count_nonzero(due))
    return found / max(expected, 1)


def _same(guess: Registration, other: Registration, tracks_a: GroundTracks) -> bool:
    """Check whether two guesses move camera a's people to about the same positions at about the same time."""
    middle = complex(np.mean(tracks_a.position))
    apart = abs(guess.turn * middle + guess.shift - other.turn * middle - other.shift)
    turned = abs(np.angle(guess.turn / other.turn))
    return bool(apart < SAME_SHIFT_M and turned < SAME_TURN and abs(guess.lag_s - other.lag_s) < SAME_LAG_S)


def score_motion(
    tracks_a: GroundTracks, tracks_b: GroundTracks, turn: complex, shift: complex, lag_s: float
) -> tuple[Ints, Ints, Floats, Ints]:
    """Score the agreement of every two tracklets of two cameras under a motion.

    The tolerance is widened, at most threefold, where mutually nearest samples are farther apart than usual: all positions are
    worse on ground that is not level, or where a camera's people are half hidden.

    Returns:
        (K,) tracklets of camera a, (K,) tracklets of camera b, (K,) the sum over their common samples of the agreement (1 where
        they meet, 0 a tolerance apart, -1 beyond), and (K,) the number of these samples.
    """
    met = find_synchronous_pairs(TrackPair(tracks_a, tracks_b), round(lag_s / STEP_S))
    motion = GroundMotion(turn, shift, lag_s)
    value = agreement_of_pairs(met, motion, _WIDEST)
    usual = _usual_miss(met, value)
    value = agreement_of_pairs(met, motion, float(np.clip(usual / _USUAL_MISS, 1.0, _WIDEST)))
    return met.tracklets.a, met.tracklets.b, met.tracklets.summed(value), met.tracklets.size


def _usual_miss(met: SynchronousPairs, value: Floats) -> float:
    """Return the median distance, in tolerances, of mutually nearest samples; 0 where there are too few.

    Args:
        met: encounters.
        value: (N,) their agreement at the widest tolerance.
    """
    near = np.flatnonzero(value > -1.0)
    mutual = near[np.intersect1d(least_of_groups(met.a[near], -value[near]), least_of_groups(met.b[near], -value[near]))]
    if len(mutual) < _MIN_NEAREST:
        return 0.0
    return float(np.median(_WIDEST * np.sqrt(1.0 - value[mutual])))
