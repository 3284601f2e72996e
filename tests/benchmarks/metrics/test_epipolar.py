"""Distances to the epipolar lines of the true cameras: in pixels, by hand and under a distortion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from metrics.epipolar import epipolar_distances
from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose

LENS = Lens((640, 480), np.array([[500.0, 0, 320], [0, 500.0, 240], [0, 0, 1]]), np.zeros(0))
A, B = (Camera(name, LENS, Pose(np.eye(3), np.array([-x, 0.0, 0.0]))) for name, x in (("a", 0.0), ("b", 1.0)))


def test_rows_of_two_cameras_side_by_side() -> None:
    """Every epipolar line is a row: in the middle of the picture a match is as far off as its rows differ."""
    at = np.array([[300.0, 240.0], [340.0, 240.0], [320.0, 240.0]])
    to = np.array([[200.0, 240.0], [320.0, 245.0], [320.0, 200.0]])
    np.testing.assert_allclose(epipolar_distances(A, B, at, to), [0, 5, 40], atol=0.1)


def test_a_distortion_bends_the_line_and_not_the_answer() -> None:
    bent = replace(LENS, distortions=np.array([-0.3, 0.1, 0.001, 0.002]))
    a, b = replace(A, lens=bent), replace(B, lens=bent)
    places = np.random.default_rng(0).uniform((-2, -1.5, 4), (2, 1.5, 9), (50, 3))
    at, to = a.project(places), b.project(places)
    assert epipolar_distances(a, b, at, to).max() < 0.05
    assert epipolar_distances(a, b, at, to + (0, 12)).min() > 5


def test_without_a_pose() -> None:
    with pytest.raises(InputError, match="camera b has no pose"):
        epipolar_distances(A, replace(B, pose=None), np.zeros((1, 2)), np.zeros((1, 2)))
