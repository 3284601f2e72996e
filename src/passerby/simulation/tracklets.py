"""Identities as a tracker has them: numbers that hold in one camera and, if wished, break off at random."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Ints
from passerby.core.observations import UNKNOWN, Boxes, CameraObservations, Keypoints

LONGEST_GAP_S = 1.0
"""A tracker lets go of a person whom it has not seen for longer than this."""


def renumber(
    seen: CameraObservations, n_people: int, fps: float, mean_seconds: float, rng: np.random.Generator
) -> CameraObservations:
    """Boxes and joints of one camera with tracklet numbers, 1 and up in random order, instead of identities.

    Args:
        seen: identities from 1 to `n_people`; those of the joints are the boxes' of the same rows, -1 left out.
        n_people: how many people there are.
        fps: of the camera's frame numbers.
        mean_seconds: mean of the exponential length of a tracklet; 0 cuts none.
        rng: every person's cuts come from a child of it, whatever the camera sees of others.
    """
    boxes, joints = seen.boxes, seen.keypoints
    number = number_tracklets(boxes, n_people, fps, mean_seconds, rng)
    return CameraObservations(
        Boxes(boxes.frame, number, boxes.ltwh, boxes.score, boxes.embedding),
        Keypoints(joints.frame, number[boxes.identity != UNKNOWN], joints.xy, joints.score, joints.joints),
    )


def number_tracklets(boxes: Boxes, n_people: int, fps: float, mean_seconds: float, rng: np.random.Generator) -> Ints:
    """(N,) tracklet numbers of one camera's boxes, with the arguments of `renumber`; -1 stays."""
    numbering, *people = rng.spawn(1 + n_people)
    piece = np.zeros(len(boxes), dtype=np.int64)
    if mean_seconds > 0 and len(boxes):
        length = float(boxes.frame.max()) / fps
        for person, child in enumerate(people, start=1):
            rows = np.flatnonzero(boxes.identity == person)
            piece[rows] = _pieces((boxes.frame[rows] - 1) / fps, 1.0 / fps, length, mean_seconds, child)
    known = boxes.identity != UNKNOWN
    pieces, which = np.unique(np.stack([boxes.identity, piece])[:, known], axis=1, return_inverse=True)
    number = np.full(len(boxes), UNKNOWN)
    number[known] = (numbering.permutation(pieces.shape[1]) + 1)[which.ravel()]
    return number


def _pieces(seconds: NDArray[np.float64], step: float, length: float, mean_seconds: float, rng: np.random.Generator) -> Ints:
    """(N,) which piece each of a person's boxes, at ascending times, belongs to.

    Exponential lengths are the gaps of a Poisson process, and that is a Poisson number of cuts at uniform times.
    """
    cuts = np.sort(rng.uniform(0.0, length, rng.poisson(length / mean_seconds)))
    gaps = np.diff(seconds, prepend=seconds[:1]) > max(LONGEST_GAP_S, step) + 1e-9
    return np.asarray(2 * np.searchsorted(cuts, seconds) + np.cumsum(gaps) * (2 * len(cuts) + 2), dtype=np.int64)
