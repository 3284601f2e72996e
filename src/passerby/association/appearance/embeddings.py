"""Identities by appearance, as in the paper: a feature per tracklet, and the Hungarian algorithm at every instant.

Source: Xu, Li, Weng, Kitani, "Wide-Baseline Multi-Camera Calibration using Person Re-Identification", CVPR 2021, section 3.1.
The reliability of appearance is measured in `discriminability`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.sparse import csr_array

from passerby.common.arrays import Floats, Ints
from passerby.core.observations import UNKNOWN, Boxes

SAMPLES = 8
"""Number of boxes whose mean is a tracklet's feature; the paper's number."""


@dataclass(frozen=True, eq=False)
class TrackletFeatures:
    """The appearance of one camera's tracklets."""

    tracklet: Ints
    """(T,) the tracklets' numbers (`Boxes.identity`), ascending."""
    feature: Floats
    """(T, D) unit vectors; zeros for a tracklet without embeddings."""
    n: Ints
    """(T,) number of boxes with an embedding."""

    @property
    def known(self) -> NDArray[np.bool_]:
        """(T,) whether the appearance is known."""
        return np.asarray((self.feature != 0).any(axis=1))

    def index(self, tracklet: Ints) -> Ints:
        """Return the rows (N,) of tracklet numbers in this table; -1 for a number that is not in it."""
        if not len(self.tracklet):
            return np.full(len(tracklet), UNKNOWN)
        at = np.minimum(np.searchsorted(self.tracklet, tracklet), len(self.tracklet) - 1)
        return np.where(self.tracklet[at] == tracklet, at, UNKNOWN)


@dataclass(frozen=True, eq=False)
class CameraAppearance:
    """One camera's tracklets: their boxes, when they were seen, and their appearance."""

    boxes: Boxes
    instants: Ints
    """(N,) instant of each box, in the same count for all cameras."""
    features: TrackletFeatures


@dataclass(frozen=True, eq=False)
class BoxMatches:
    """Boxes of cameras a and b that are assumed to show one person at one instant."""

    row_a: Ints
    """(M,) rows of a's boxes."""
    row_b: Ints
    """(M,) rows of b's boxes."""
    distance: Floats
    """(M,) distance between the features, 0 to 2."""


@dataclass(frozen=True, eq=False)
class Votes:
    """Counts of matches between the tracklets of two cameras."""

    matched: csr_array
    """(T_a, T_b) number of instants at which they were matched."""
    together: csr_array
    """(T_a, T_b) number of instants at which both were seen."""


def normalise(vectors: Floats) -> Floats:
    """Scale vectors (..., D) to length one; vectors shorter than 1e-6 become zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.where(length > 1e-6, vectors / np.maximum(length, 1e-6), 0.0)


def tracklet_features(
    boxes: Boxes, rng: np.random.Generator, samples: int = SAMPLES, part: tuple[float, float] = (0.0, 1.0)
) -> TrackletFeatures:
    """Compute one feature per tracklet by the paper's restricted random sampling.

    The tracklet is cut into `samples` equal chunks in order of its frames (as many as it has boxes, when it has fewer). A
    random box of each is taken, and the mean of their embeddings is scaled to length one.

    Args:
        boxes: boxes of one camera; rows without tracklet (-1) or with an embedding of zeros are ignored.
        rng: draws the boxes.
        samples: number of chunks.
        part: the part of each tracklet that is used, from and to, as shares 0..1.
    """
    tracklets = np.unique(boxes.identity[boxes.identity > UNKNOWN])
    embedding = np.zeros((len(boxes), 0), np.float32) if boxes.embedding is None else boxes.embedding
    rows = np.flatnonzero((boxes.identity > UNKNOWN) & (embedding != 0).any(axis=1))
    rows = rows[np.lexsort((boxes.frame[rows], boxes.identity[rows]))]
    start = np.searchsorted(boxes.identity[rows], tracklets)
    n = np.searchsorted(boxes.identity[rows], tracklets, side="right") - start
    start, n = start + np.floor(part[0] * n).astype(int), np.floor(part[1] * n).astype(int) - np.floor(part[0] * n).astype(int)
    chunks = np.minimum(n, samples)
    total = np.zeros((len(tracklets), embedding.shape[1]))
    for chunk in range(samples):
        has = np.flatnonzero(chunk < chunks)
        low, high = chunk * n[has] // chunks[has], (chunk + 1) * n[has] // chunks[has]
        total[has] += embedding[rows[start[has] + rng.integers(low, high)]]
    return TrackletFeatures(tracklets, normalise(total), n)


def without_camera_bias(features: TrackletFeatures) -> TrackletFeatures:
    """Subtract from the features their mean over the camera's tracklets, and scale them to length one again.

    The same person looks different to two cameras (light, white balance, height of the camera). Much of this difference is
    common to all people that the camera sees, and it is larger than the differences between people: without this step, all
    people in camera a are most similar to the people in camera b whose features happen to be near a's mean. In simulation with
    a bias 0.5 to 3 times as long as the differences between people, the most similar tracklet of the other camera is the right
    person for 0.98 of the tracklets, and for 0.65 without this step. The Hungarian algorithm gains little (a shift of all
    distances of a tracklet cancels); likelihood ratios, which use one pair alone, need it. The paper has no such step.
    """
    known = features.known
    if not known.any():
        return features
    centred = np.where(known[:, None], features.feature - features.feature[known].mean(axis=0), 0.0)
    return TrackletFeatures(features.tracklet, normalise(centred), features.n)


def similarities(a: TrackletFeatures, b: TrackletFeatures, centre: bool = True) -> Floats:
    """Compute the cosines (T_a, T_b) between the tracklets of two cameras; 0 where the appearance of one is unknown.

    Args:
        a: features of the first camera.
        b: features of the second camera.
        centre: whether to subtract each camera's mean first (`without_camera_bias`).
    """
    if a.feature.shape[1] != b.feature.shape[1]:  # one of them has no embeddings at all
        return np.zeros((len(a.tracklet), len(b.tracklet)))
    if centre:
        a, b = without_camera_bias(a), without_camera_bias(b)
    return np.asarray(a.feature @ b.feature.T)


def tracklet_presence(camera: CameraAppearance) -> tuple[Ints, Ints, Ints]:
    """Select the boxes that can be compared: boxes of tracklets with a known appearance, one per tracklet and instant.

    Returns:
        (S,) rows of the boxes, (S,) rows in the features, (S,) instants; in order of the instant, then the tracklet.
    """
    features, instants = camera.features, camera.instants
    index = features.index(camera.boxes.identity)
    usable = np.flatnonzero((index > UNKNOWN) & np.append(features.known, False)[index])
    order = usable[np.lexsort((index[usable], instants[usable]))]
    instant, tracklet = instants[order], index[order]
    first = np.ones(len(order), dtype=bool)
    first[1:] = (np.diff(instant) != 0) | (np.diff(tracklet) != 0)
    return order[first], tracklet[first], instant[first]


def match_boxes(a: CameraAppearance, b: CameraAppearance, centre: bool = True) -> BoxMatches:
    """Match the boxes of two cameras: at every common instant, by the assignment with the least sum of feature distances.

    All boxes of the camera that sees fewer people are matched. Errors are expected; later steps reject them.

    Args:
        a: the first camera.
        b: the second camera.
        centre: whether to subtract each camera's mean feature first (the paper does not).
    """
    distance = np.sqrt(np.maximum(2.0 - 2.0 * similarities(a.features, b.features, centre), 0.0))
    rows_a, tracklet_a, when_a = tracklet_presence(a)
    rows_b, tracklet_b, when_b = tracklet_presence(b)
    common = np.intersect1d(when_a, when_b)
    from_a, to_a = np.searchsorted(when_a, common), np.searchsorted(when_a, common, side="right")
    from_b, to_b = np.searchsorted(when_b, common), np.searchsorted(when_b, common, side="right")
    # The same people stay for many instants: each set of tracklets is solved once.
    solved: dict[tuple[bytes, bytes], tuple[Ints, Ints]] = {}
    matched_a, matched_b = [np.zeros(0, int)], [np.zeros(0, int)]
    for start_a, end_a, start_b, end_b in zip(from_a, to_a, from_b, to_b, strict=True):
        who_a, who_b = tracklet_a[start_a:end_a], tracklet_b[start_b:end_b]
        key = (who_a.tobytes(), who_b.tobytes())
        if key not in solved:
            solved[key] = linear_sum_assignment(distance[np.ix_(who_a, who_b)])
        matched_a.append(start_a + solved[key][0])
        matched_b.append(start_b + solved[key][1])
    at_a, at_b = np.concatenate(matched_a), np.concatenate(matched_b)
    return BoxMatches(rows_a[at_a], rows_b[at_b], distance[tracklet_a[at_a], tracklet_b[at_b]])


def presence(tracklet: Ints, instant: Ints, shape: tuple[int, int]) -> csr_array:
    """Return a sparse matrix (I, T): 1 where a tracklet is seen at an instant (both 0-based)."""
    return csr_array((np.ones(len(tracklet), dtype=np.int64), (instant, tracklet)), shape=shape)


def common_presence(a: CameraAppearance, b: CameraAppearance) -> tuple[csr_array, csr_array]:
    """Return sparse matrices (I, T_a) and (I, T_b): tracklets at the I instants at which both cameras see known appearances."""
    _, tracklet_a, when_a = tracklet_presence(a)
    _, tracklet_b, when_b = tracklet_presence(b)
    common = np.intersect1d(when_a, when_b)
    out = []
    for tracklet, when, features in ((tracklet_a, when_a, a.features), (tracklet_b, when_b, b.features)):
        shared = np.isin(when, common)
        at = np.searchsorted(common, when[shared])
        out.append(presence(tracklet[shared], at, (len(common), len(features.tracklet))))
    return out[0], out[1]


def count_votes(a: CameraAppearance, b: CameraAppearance, matches: BoxMatches) -> Votes:
    """Count the instants at which each two tracklets of two cameras were matched, and those at which both were seen.

    Args:
        a: the first camera.
        b: the second camera.
        matches: from `match_boxes`.
    """
    in_a, in_b = common_presence(a, b)
    identity_a, identity_b = a.boxes.identity[matches.row_a], b.boxes.identity[matches.row_b]
    pair = (a.features.index(identity_a), b.features.index(identity_b))
    matched = csr_array((np.ones(len(matches.row_a), dtype=np.int64), pair), shape=(in_a.shape[1], in_b.shape[1]))
    matched.sum_duplicates()
    return Votes(matched, csr_array(in_a.T @ in_b))
