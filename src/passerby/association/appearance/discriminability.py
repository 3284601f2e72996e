"""Discriminability of people by appearance, measured without ground truth, and likelihood ratios of one person against two.

A re-identification network gives numbers for any picture, even where all people wear the same vest. Two facts are certain: two
halves of one tracklet are the same person, and two tracklets that one camera sees at one instant are two people. *Within a
camera* (`within_camera_discriminability`) these facts show whether the embeddings distinguish people at all. They do not show
whether a second camera finds the same differences (a background or a seat in the light can be as characteristic as a face). So
*between two cameras* (`between_camera_discriminability`) a second test is made: does a person in one camera have a match in the
other that stands out more than matches among people who are known to be different?
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from passerby.association.appearance.embeddings import (
    SAMPLES,
    CameraAppearance,
    TrackletFeatures,
    common_presence,
    normalise,
    presence,
    similarities,
    tracklet_features,
    tracklet_presence,
    without_camera_bias,
)
from passerby.common.arrays import Floats, Ints
from passerby.core.observations import Boxes
from passerby.geometry.groups import residual_scale

Mask = NDArray[np.bool_]

# Below this number of comparisons the probability's sigma is above 0.1, and no result can be distinguished from chance.
_MIN_COMPARISONS = 8
# More comparisons than this improve the result little (sigma 0.025).
_MAX_COMPARISONS = 400
# Share of images that mislead, for any network: a jacket put on, another person in the box. Bounds the log-likelihood ratio.
_MISLEADING = 0.05
# Weight of a pair from which appearance is used in full. People that only one camera sees count as failures in it. A small
# re-identification network on real crops has about 0.7 where both cameras see all, 0.3 where each sees 70 %, 0.1 at 50 %.
_FULL_WEIGHT = 0.2
# Number of similarities to which the two distributions are fitted, and rounds of the fit.
_FIT_SAMPLE, _FIT_ROUNDS = 20_000, 60


@dataclass(frozen=True)
class Discriminability:
    """Probability that appearance decides a comparison with a known answer correctly; 0.5 is chance."""

    probability: float
    sigma: float
    comparisons: int

    @property
    def weight(self) -> float:
        """Weight from 0 (not significantly better than chance, at three sigma) to 1 (never wrong)."""
        return float(np.clip(2.0 * (self.probability - 3.0 * self.sigma) - 1.0, 0.0, 1.0))


def _usefulness(wins: Floats, independent: float) -> Discriminability | None:
    if independent < _MIN_COMPARISONS:
        return None
    sigma = max(float(wins.std()), 0.5 / np.sqrt(len(wins))) / np.sqrt(independent)
    return Discriminability(float(wins.mean()), float(sigma), len(wins))


def within_camera_discriminability(boxes: Boxes, rng: np.random.Generator, samples: int = SAMPLES) -> Discriminability | None:
    """Measure whether appearance distinguishes one camera's people.

    It is the probability that the first third of a tracklet is more similar to its own last third than to that of another
    tracklet seen at the same instant. The middle is left out: consecutive boxes are near copies.

    Args:
        boxes: boxes of one camera, with tracklet numbers and embeddings.
        rng: draws boxes, see `tracklet_features`.
        samples: number of chunks, see `tracklet_features`.

    Returns:
        The discriminability; None where too few tracklets were seen together with others.
    """
    early = tracklet_features(boxes, rng, samples, (0.0, 1 / 3))
    late = tracklet_features(boxes, rng, samples, (2 / 3, 1.0))
    usable = early.known & late.known
    if not usable.any():
        return None
    middle = (early.feature[usable].mean(axis=0) + late.feature[usable].mean(axis=0)) / 2
    first, last = normalise(early.feature - middle), normalise(late.feature - middle)
    usable_only = TrackletFeatures(early.tracklet, np.where(usable[:, None], early.feature, 0.0), early.n)
    i, j = _seen_together(boxes, usable_only)
    own = np.einsum("td,td->t", first, last)[i]
    other = np.einsum("pd,pd->p", first[i], last[j])
    wins = np.sign(own - other) / 2 + 0.5
    count = np.bincount(i, minlength=len(first))
    per_tracklet = np.bincount(i, wins, len(first))[count > 0] / count[count > 0]
    return _usefulness(per_tracklet, len(per_tracklet))


def _seen_together(boxes: Boxes, features: TrackletFeatures) -> tuple[Ints, Ints]:
    """Return rows (P,), (P,) of two tracklets of known appearance seen at one instant; each pair in both orders."""
    _, tracklet, frame = tracklet_presence(CameraAppearance(boxes, boxes.frame, features))
    frames, at = np.unique(frame, return_inverse=True)
    seen = presence(tracklet, at, (len(frames), len(features.tracklet)))
    together = coo_array(seen.T @ seen)
    i, j = (np.asarray(axis, dtype=np.int64) for axis in together.coords)
    return i[i != j], j[i != j]


def similarities_of_different_people(boxes: Boxes, features: TrackletFeatures, centre: bool = True) -> Floats:
    """Compute the cosines (P,) between tracklets that are known to be two people: one camera saw them at one instant.

    Args:
        boxes: boxes of one camera.
        features: features of its tracklets.
        centre: whether to subtract the camera's mean first.
    """
    i, j = _seen_together(boxes, features)
    once = i < j
    vectors = without_camera_bias(features).feature if centre else features.feature
    return np.asarray(np.einsum("pd,pd->p", vectors[i[once]], vectors[j[once]]))


def between_camera_discriminability(
    a: CameraAppearance, b: CameraAppearance, rng: np.random.Generator, centre: bool = True
) -> Discriminability | None:
    """Measure whether appearance is comparable between two cameras.

    One instant of every tracklet is drawn. There, the similarity of the tracklet's best match in the other camera exceeds that
    of the second best by a margin. No person is seen twice at one instant. So if appearance is comparable, this is the margin
    of the same person against a different person. It is compared with two margins among different people: that of the
    tracklet's two best matches among the *others in its own camera*, and that of a person in the other camera among the others
    there. The cross-camera margin is the larger one with a probability of 0.5 where appearance is not comparable. The
    comparison with the smaller probability is returned. The numbers of candidates are made equal, since the margin shrinks with
    them. A margin is used, not a similarity: a camera's light, or dusk, changes all similarities alike.

    A person that the other camera does not see counts as chance, so the figure is a lower bound.

    Args:
        a: the first camera.
        b: the second camera.
        rng: draws instants and candidates.
        centre: whether to subtract each camera's mean feature first.

    Returns:
        The discriminability; None where there are too few instants at which each camera sees three people or more.
    """
    in_a, in_b = common_presence(a, b)
    if not in_a.shape[0]:
        return None
    features_a, features_b = a.features, b.features
    if centre:
        features_a, features_b = without_camera_bias(features_a), without_camera_bias(features_b)
    forth = _margin_wins(in_a, in_b, features_a.feature, features_b.feature, rng)
    back = _margin_wins(in_b, in_a, features_b.feature, features_a.feature, rng)
    wins = np.concatenate([forth, back])
    found = [_usefulness(column, len(wins) / 2) for column in wins.T]  # both directions are highly correlated
    return min((one for one in found if one is not None), key=lambda one: one.probability, default=None)


def _margin_wins(in_a: csr_array, in_b: csr_array, vectors_a: Floats, vectors_b: Floats, rng: np.random.Generator) -> Floats:
    """Return (R, 2) 1 where a tracklet's cross-camera margin exceeds that among other people in a, and in b; 0.5 for ties."""
    instant, tracklet = (np.asarray(axis, dtype=np.int64) for axis in coo_array(in_a).coords)
    shuffled = rng.permutation(len(tracklet))
    _, once = np.unique(tracklet[shuffled], return_index=True)
    drawn = shuffled[once]
    many_a, many_b = np.diff(in_a.indptr)[instant[drawn]], np.diff(in_b.indptr)[instant[drawn]]
    drawn = rng.permutation(drawn[(many_a >= 3) & (many_b >= 3)])[:_MAX_COMPARISONS]
    at, who = instant[drawn], tracklet[drawn]
    if not len(at):
        return np.zeros((0, 2))
    (people_a, seen_a), (people_b, seen_b) = _present(in_a, at), _present(in_b, at)
    column = _random_choice(seen_b, 1, rng).argmax(axis=1)
    stranger = people_b[np.arange(len(at)), column]
    others_a = _random_choice(seen_a & (people_a != who[:, None]), seen_b.sum(axis=1), rng)
    others_b = seen_b & (people_b != stranger[:, None])
    cross = _margin(vectors_a[who], vectors_b[people_b], seen_b)
    among_a = _margin(vectors_a[who], vectors_a[people_a], others_a)
    among_b = _margin(vectors_b[stranger], vectors_b[people_b], others_b)
    return np.sign(cross[:, None] - np.stack([among_a, among_b], axis=1)) / 2 + 0.5


def _present(seen: csr_array, at: Ints) -> tuple[Ints, Mask]:
    """Return the tracklets (R, K) seen at each of R instants, K at most, and a mask of the valid entries."""
    start, count = seen.indptr[at], np.diff(seen.indptr)[at]
    step = np.arange(count.max())
    held = step < count[:, None]
    return np.where(held, seen.indices[np.where(held, start[:, None] + step, 0)], 0), held


def _random_choice(mask: Mask, count: Ints | int, rng: np.random.Generator) -> Mask:
    """Draw at random at most `count` (R,) true entries of each row of a mask (R, K)."""
    draw = np.where(mask, rng.random(mask.shape), 2.0)
    rank = draw.argsort(axis=1).argsort(axis=1)
    return np.asarray(mask & (rank < np.reshape(count, (-1, 1))))


def _margin(appearance: Floats, candidates: Floats, mask: Mask) -> Floats:
    """Return the margin (R,) between the two allowed candidates (R, K, D) that are most similar to vectors (R, D)."""
    similarity = np.where(mask, np.einsum("rd,rkd->rk", appearance, candidates), -np.inf)
    best = np.partition(similarity, -2, axis=1)[:, -2:]
    return np.asarray(best[:, 1] - best[:, 0])


def appearance_log_likelihood_ratios(
    features_a: TrackletFeatures,
    features_b: TrackletFeatures,
    different: Floats,
    weight: float,
    together: csr_array | None = None,
    centre: bool = True,
) -> Floats:
    """Compute the log-likelihood ratios (T_a, T_b), nats, of two tracklets being one person against two.

    The similarities between the cameras are a mixture of two normal distributions, fitted by expectation maximisation. The
    similarities of known different people determine one of them. The other is the similarity of one person in *two* cameras,
    which no single camera can show. One image in 20 is taken to mislead, so that the ratio is bounded by
    log(0.95 / 0.05) = 2.94 on both sides. It never decreases with the similarity.

    Args:
        features_a: features of a's tracklets.
        features_b: features of b's tracklets.
        different: (P,) from `similarities_of_different_people` of both cameras.
        weight: weight of `between_camera_discriminability` (`Discriminability.weight`; 0 where it is None): 0 gives zeros, 0.2
            and more the full ratio.
        together: (T_a, T_b) `Votes.together`: the fit is made on tracklets that were seen at one instant; None: on all.
        centre: whether to subtract each camera's mean feature first.
    """
    ratio = np.zeros((len(features_a.tracklet), len(features_b.tracklet)))
    known = np.outer(features_a.known, features_b.known)
    trust = min(max(weight, 0.0) / _FULL_WEIGHT, 1.0)
    if trust == 0 or not known.any():
        return ratio
    similarity = similarities(features_a, features_b, centre)
    fitted = known if together is None else known & (together.toarray() > 0)
    model = _fit(_thinned(similarity[fitted]), _thinned(different))
    if model is not None:
        ratio[known] = trust * model.ratio(similarity[known])
    return ratio


@dataclass(frozen=True)
class _TwoKinds:
    """Normal distributions of similarities of different people, and of the same person."""

    different: tuple[float, float]
    same: tuple[float, float]
    """Mean and sigma, as in `different`."""

    def ratio(self, similarity: Floats) -> Floats:
        """Return the bounded log-likelihood ratios (N,), which never decrease with the similarity."""
        (mean_0, sigma_0), (mean_1, sigma_1) = self.different, self.same
        # Normal densities of different widths cross twice: beyond its extremum the ratio is held constant.
        bend = 1 / sigma_0**2 - 1 / sigma_1**2
        if bend != 0:
            turn = (mean_0 / sigma_0**2 - mean_1 / sigma_1**2) / bend
            similarity = np.maximum(similarity, turn) if bend > 0 else np.minimum(similarity, turn)
        log_0, log_1 = _log_normal(similarity, mean_0, sigma_0), _log_normal(similarity, mean_1, sigma_1)
        well, ill = np.log(1 - _MISLEADING), np.log(_MISLEADING)
        return np.asarray(np.logaddexp(well + log_1, ill + log_0) - np.logaddexp(well + log_0, ill + log_1))


def _log_normal(x: Floats, mean: float, sigma: float) -> Floats:
    return np.asarray(-0.5 * ((x - mean) / sigma) ** 2 - np.log(sigma))


def _thinned(values: Floats) -> Floats:
    return values[:: max(1, -(-len(values) // _FIT_SAMPLE))]


def _fit(mixed: Floats, different: Floats) -> _TwoKinds | None:
    """Fit two distributions to `mixed`, given samples `different` of one; return None where there are not two."""
    if len(mixed) < _MIN_COMPARISONS:
        return None
    share = 0.1
    # The lower half of the mixture is different people; the start must not be affected by similarities of the same person.
    mean_0 = float(np.median(mixed))
    sigma_0 = residual_scale(mean_0 - mixed[mixed <= mean_0], 1e-3)
    mean_1, sigma_1 = float(np.quantile(mixed, 1 - share / 2)), sigma_0
    pool = np.concatenate([mixed, different])
    for _ in range(_FIT_ROUNDS):
        odds = np.log(share / (1 - share)) + _log_normal(mixed, mean_1, sigma_1) - _log_normal(mixed, mean_0, sigma_0)
        same = np.where(mixed > mean_0, 1 / (1 + np.exp(-np.clip(odds, -50, 50))), 0.0)
        # No person has more than one match among two or more: the share is a half at most.
        share = float(np.clip(same.mean(), 1e-4, 0.5))
        if same.sum() < 1:
            return None
        mean_1 = float(np.average(mixed, weights=same))
        sigma_1 = float(np.sqrt(np.average((mixed - mean_1) ** 2, weights=same)))
        rest = np.concatenate([1 - same, np.ones(len(different))])
        mean_0 = float(np.average(pool, weights=rest))
        sigma_0 = max(float(np.sqrt(np.average((pool - mean_0) ** 2, weights=rest))), 1e-3)
        # A few matches that agree by chance must not give a narrow distribution.
        sigma_1 = max(sigma_1, 0.5 * sigma_0, 1e-3)
    return _TwoKinds((mean_0, sigma_0), (mean_1, sigma_1)) if mean_1 - mean_0 > sigma_0 else None
