"""Matches of several pairs and moments as points: what is the same point, and what is used once."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.matching import Matches
from baselines.pooling import pooled_points
from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from support.scenes.textured_planes import looking

RIG = Rig(tuple(looking(name, (x, -2.5, 1.5), (0.0, 2.0, 0.4)) for name, x in (("a", -0.5), ("b", 0.5), ("c", 0.0))))


def matches(*rows: tuple[float, float, float, float, float]) -> Matches:
    table = np.array(rows, dtype=float).reshape(-1, 5)
    return Matches(table[:, :2], table[:, 2:4], table[:, 4])


def shared(points: object, a: int, b: int) -> set[int]:
    numbers = [set(points.identity[points.camera == camera].tolist()) for camera in (a, b)]  # type: ignore[attr-defined]
    return numbers[0] & numbers[1]


def test_a_keypoint_of_the_reference_is_one_point_in_all_cameras() -> None:
    points = pooled_points(RIG, "a", [{"b": matches((10, 20, 5, 6, 1), (30, 40, 7, 8, 1)), "c": matches((30, 40, 9, 9, 1))}])
    assert len(points) == 5
    assert len(shared(points, 0, 1)) == 2
    assert len(shared(points, 1, 2)) == 1
    row = np.flatnonzero(points.camera == 2)[0]
    same = points.identity == points.identity[row]
    np.testing.assert_array_equal(points.pixel[same], [[30, 40], [7, 8], [9, 9]])


def test_moments_have_points_of_their_own() -> None:
    moment = {"b": matches((10, 20, 5, 6, 1), (30, 40, 7, 8, 1))}
    points = pooled_points(RIG, "a", [moment, moment])
    assert len(points) == 8
    assert len(shared(points, 0, 1)) == 4


def test_a_place_is_used_once_by_its_surest_match() -> None:
    found = matches((10, 20, 5, 6, 0.5), (10, 20, 50, 60, 0.9), (11, 21, 50, 60, 0.8), (12, 22, 1, 2, 0.1))
    points = pooled_points(RIG, "a", [{"b": found}])
    np.testing.assert_array_equal(points.pixel[points.camera == 1], [[50, 60], [1, 2]])
    assert len(shared(points, 0, 1)) == 2


def test_no_matches_no_points() -> None:
    assert len(pooled_points(RIG, "a", [{"b": Matches.none(), "c": Matches.none()}])) == 0
    assert len(pooled_points(RIG, "a", [])) == 0


def test_a_camera_that_the_rig_lacks() -> None:
    with pytest.raises(InputError, match="camera z"):
        pooled_points(RIG, "a", [{"z": matches((1, 2, 3, 4, 1))}])
