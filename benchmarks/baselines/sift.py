"""SIFT and brute force: Lowe, IJCV 2004, by OpenCV, with the root of the descriptors (Arandjelovic, Zisserman, CVPR 2012)."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from baselines.matching import MAX_FEATURES, BruteForce, Features, Matcher, Picture, grey

RATIO = 0.8  # Lowe's: it drops nine in ten wrong matches and one in twenty right ones


def open_matcher(weights: Path | None = None) -> Matcher:
    """SIFT has no weights, and is there wherever OpenCV is."""
    return BruteForce(lambda picture: describe(picture, MAX_FEATURES), RATIO)


def describe(picture: Picture, most: int) -> Features:
    """The strongest features of a picture, `most` of them."""
    places, descriptors = cv2.SIFT.create(nfeatures=most).detectAndCompute(grey(picture), None)
    if not places:
        return Features(np.zeros((0, 2)), np.zeros((0, 128), dtype=np.float32))
    return Features(np.array([place.pt for place in places], dtype=np.float64), rooted(np.asarray(descriptors)))


def rooted(descriptors: NDArray[np.generic]) -> NDArray[np.float32]:
    """(N, D) unit vectors: the square root of the descriptors as shares of their sum."""
    shares = np.asarray(descriptors, dtype=np.float32)
    shares = shares / np.maximum(shares.sum(axis=1, keepdims=True), 1e-9)
    return np.asarray(np.sqrt(shares), dtype=np.float32)
