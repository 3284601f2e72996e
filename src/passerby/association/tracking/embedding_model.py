"""Distributions of the embeddings' similarity for one person and for different people, measured in the recording itself.

Networks, crops and clothes differ: a cosine of 0.8 is the same person in one recording and any person in another. Tracklets
made by motion alone show the similarity of the boxes of one person and, within one frame, that of different people.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.core.observations import UNKNOWN, Boxes, Vectors
from passerby.geometry.groups import residual_scale

Mask = NDArray[np.bool_]

FEWEST = 50
"""Least number of pairs of either kind for a result."""
TELLING = 0.5
"""Least distance of the two means, in standard deviations, for the embeddings to be used at all."""
STRONGEST = 8.0
"""Largest cost or reward, -2 log likelihood: appearance may decide where motion does not, but not overrule clear motion."""

STRONGEST_OF_TRACKLETS = 12.0
"""The same between whole tracklets, whose means contain more information than a box. Simulated people with different
appearance, at 7 fps: IDF1 0.89, 0.92, 0.86 (terrace, basketball, a crowded terrace); with 8 0.82, 0.90, 0.76, with 20 a little
more."""
FEWEST_HALVES = 20
"""Least number of pairs of halves of tracklets of either kind for a result."""
HALF = 4
"""Least number of boxes in half a tracklet."""


@dataclass(frozen=True)
class EmbeddingSimilarity:
    """Cosines between a box and the sum of a tracklet's earlier embeddings: mean and standard deviation of either kind."""

    same: tuple[float, float]
    """Mean and standard deviation for one person."""
    other: tuple[float, float]
    """Mean and standard deviation for different people."""

    def cost(self, sums: Vectors, embeddings: Vectors) -> Floats:
        """Return the costs (T, D): -2 log of the likelihood ratio of one person to two, 0 where an embedding is unknown.

        Args:
            sums: (T, K) sums of the embeddings of T tracklets.
            embeddings: (D, K) embeddings of D boxes.
        """
        length = np.linalg.norm(sums, axis=1)[:, None] * np.linalg.norm(embeddings, axis=1)
        return self._bounded((sums @ embeddings.T).astype(np.float64), length, STRONGEST)

    def cost_of_pairs(self, one: Vectors | Floats, two: Vectors | Floats) -> Floats:
        """Return the costs (N,) of pairs of tracklets, from the sums (N, K) of the embeddings of all their boxes."""
        length = np.linalg.norm(one, axis=1) * np.linalg.norm(two, axis=1)
        return self._bounded(np.einsum("nk,nk->n", one, two).astype(np.float64), length, STRONGEST_OF_TRACKLETS)

    def _bounded(self, product: Floats, length: Floats, strongest: float) -> Floats:
        (same, same_sd), (other, other_sd) = self.same, self.other
        # Outside of the two means the ratio of Gaussians of unequal width changes its direction, which has no meaning.
        cosine = np.clip(product / np.where(length > 0, length, 1.0), other, same)
        ratio = ((cosine - same) / same_sd) ** 2 - ((cosine - other) / other_sd) ** 2 + 2 * np.log(same_sd / other_sd)
        return np.asarray(np.where(length > 0, np.clip(ratio, -strongest, strongest), 0.0))


def learn_similarity(boxes: Boxes) -> EmbeddingSimilarity | None:
    """Measure the cosines within tracklets and between tracklets seen at once; return None where they do not differ enough.

    Args:
        boxes: boxes with embeddings and tracklet numbers.
    """
    if boxes.embedding is None:
        return None
    known = boxes.take((boxes.identity != UNKNOWN) & (np.abs(boxes.embedding).max(axis=1, initial=0.0) > 0))
    if known.embedding is None or len(known) == 0:
        return None
    earlier = _earlier_sums(known)
    has_past = np.linalg.norm(earlier, axis=1) > 0
    order = np.lexsort((known.identity, known.frame))
    one, two = order[:-1], order[1:]
    pairs = known.frame[one] == known.frame[two]
    one, two = np.concatenate([one[pairs], two[pairs]]), np.concatenate([two[pairs], one[pairs]])
    one, two = one[has_past[one]], two[has_past[one]]
    same = _cosines(earlier[has_past], known.embedding[has_past])
    other = _cosines(earlier[one], known.embedding[two])
    return _resemblance(same, other, FEWEST)


def similarity_of_halves(early: Floats, late: Floats, long: Mask, one: Ints, two: Ints) -> EmbeddingSimilarity | None:
    """Do the same for whole tracklets: both halves of one are one person, halves of two seen at once are two people.

    Args:
        early: (T, K) sum of the embeddings of the first half of each tracklet.
        late: (T, K) the same of the second half.
        long: (T,) tracklets with enough boxes to be halved.
        one: (P,) tracklets that are seen at the same time as `two`.
        two: (P,) the others of these pairs.
    """
    known = long & early.any(axis=1) & late.any(axis=1)
    pairs = known[one] & known[two]
    one, two = one[pairs], two[pairs]
    other = np.concatenate([_cosines(early[one], late[two]), _cosines(early[two], late[one])])
    return _resemblance(_cosines(early[known], late[known]), other, FEWEST_HALVES)


def _resemblance(same: Floats, other: Floats, fewest: int) -> EmbeddingSimilarity | None:
    """Fit the distributions to cosines of both kinds; return None where they are too few or too similar."""
    if min(len(same), len(other)) < fewest:
        return None
    found = EmbeddingSimilarity(_centre_and_spread(same), _centre_and_spread(other))
    apart = (found.same[0] - found.other[0]) / np.hypot(found.same[1], found.other[1])
    return found if apart > TELLING else None


def _earlier_sums(boxes: Boxes) -> Vectors:
    """Return for every box the sum (N, D) of the embeddings of its tracklet's boxes before it."""
    assert boxes.embedding is not None
    sums = np.zeros_like(boxes.embedding)
    order = np.lexsort((boxes.frame, boxes.identity))
    for rows in np.split(order, np.flatnonzero(np.diff(boxes.identity[order])) + 1):
        sums[rows[1:]] = np.cumsum(boxes.embedding[rows[:-1]], axis=0)
    return sums


def _cosines(one: Vectors | Floats, two: Vectors | Floats) -> Floats:
    """Return the cosines (N,) between rows (N, D)."""
    product = np.einsum("nd,nd->n", one, two).astype(np.float64)
    return np.asarray(product / (np.linalg.norm(one, axis=1) * np.linalg.norm(two, axis=1)))


def _centre_and_spread(values: Floats) -> tuple[float, float]:
    """Return median and 1.48 median absolute deviations, since some tracklets change person and some boxes are false."""
    median = float(np.median(values))
    return median, residual_scale(values - median, 0.01)
