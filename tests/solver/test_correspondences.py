"""Which points become correspondences."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Rig
from passerby.core.observations import Boxes, CameraObservations, Keypoints, Observations
from passerby.solver.geopose.correspondences import (
    BOTTOM,
    CENTRE,
    TOP,
    box_points,
    joint_points,
    match_pair,
    numbered_points,
    point_observations,
)

LENS = Lens((640, 480), np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]]), np.zeros(4))
RIG = Rig((Camera("A", LENS), Camera("B", LENS)))


def boxes(*rows: tuple[int, int, float, float, float, float]) -> CameraObservations:
    """Boxes of (frame, identity, left, top, width, height)."""
    table = np.array(rows, dtype=float).reshape(-1, 6)
    return CameraObservations(
        Boxes(table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2:], np.ones(len(table)))
    )


def test_parts_of_a_box() -> None:
    seen = Observations({"A": boxes((1, 7, 100, 50, 40, 120))})
    points = box_points(RIG, seen, (CENTRE, TOP, BOTTOM))
    at = {int(part): pixel.tolist() for part, pixel in zip(points.part, points.pixel, strict=True)}
    assert at == {CENTRE: [120, 110], TOP: [120, 50], BOTTOM: [120, 170]}
    assert set(points.identity) == {7}
    np.testing.assert_allclose(LENS.project_rays(points.bearing), points.pixel, atol=1e-9)
    of_centre = points.sigma_px[points.part == CENTRE]
    assert (of_centre < points.sigma_px[points.part != CENTRE]).all()


@pytest.mark.parametrize("box", [(1.5, 100, 40, 120), (100, 0, 40, 120), (599, 100, 40, 120), (100, 359, 40, 120)])
def test_boxes_cut_by_the_border_or_of_unknown_identity_are_left_out(box: tuple[float, float, float, float]) -> None:
    whole = tuple(np.clip(box, 3, None) - np.array([3, 3, 0, 0]) * (np.array(box) > 300))
    points = box_points(RIG, Observations({"A": boxes((1, 7, *box), (2, 0, *whole), (3, -1, *whole))}))
    assert (points.frame.tolist(), points.identity.tolist()) == ([2], [0])


def test_an_identity_twice_in_a_picture_is_bad_input() -> None:
    seen = Observations({"B": boxes((3, 7, 100, 50, 40, 120), (3, 7, 200, 50, 40, 120))})
    with pytest.raises(InputError, match=r"camera B .* identity 7 in frame 3"):
        box_points(RIG, seen)


@given(st.sets(st.tuples(st.integers(1, 6), st.integers(0, 6))), st.sets(st.tuples(st.integers(1, 6), st.integers(0, 6))))
def test_pairs_are_those_with_the_same_identity_and_frame(in_a: set[tuple[int, int]], in_b: set[tuple[int, int]]) -> None:
    seen = Observations(
        {
            "A": boxes(*((frame, who, 10 + frame, 20 + who, 30, 60) for frame, who in in_a)),
            "B": boxes(*((frame, who, 200 + frame, 20 + who, 30, 60) for frame, who in in_b)),
        }
    )
    points = box_points(RIG, seen)
    label, key = points.labels()
    rows_a, rows_b = match_pair(points, label, 0, 1)
    assert set(zip(points.frame[rows_a], points.identity[rows_a], strict=True)) == in_a & in_b
    assert (points.camera[rows_a] == 0).all()
    assert (points.camera[rows_b] == 1).all()
    assert (label[rows_a] == label[rows_b]).all()
    assert len(key) == len(in_a | in_b)
    np.testing.assert_array_equal(key[label], np.column_stack([points.identity, points.frame, points.part]))


def skeletons(joints: int, score: float = 1.0) -> CameraObservations:
    xy = np.random.default_rng(0).uniform(50, 400, (2, joints, 2))
    scores = np.full((2, joints), score)
    scores[0, 1] = 0.1
    names = tuple(f"joint_{j}" for j in range(joints))
    people = Keypoints(np.array([1, 2]), np.array([4, 4]), xy, scores, names)
    return CameraObservations(keypoints=people)


def test_doubtful_joints_are_left_out_and_joints_keep_their_number() -> None:
    points = joint_points(RIG, Observations({"A": skeletons(5), "B": skeletons(5)}))
    assert len(points) == 2 * (2 * 5 - 1)
    assert not ((points.part == 1) & (points.frame == 1)).any()
    seen = skeletons(5).keypoints
    np.testing.assert_array_equal(points.pixel[(points.part == 3) & (points.frame == 2)], np.tile(seen.xy[1, 3], (2, 1)))


def test_layouts_of_different_length_are_bad_input() -> None:
    with pytest.raises(InputError, match="A 5, B 6"):
        joint_points(RIG, Observations({"A": skeletons(5), "B": skeletons(6)}))


def test_each_sighting_moves_over_the_picture_as_its_own_lens_has_it() -> None:
    long = Lens((640, 480), np.array([[1500.0, 0, 320], [0, 1500, 240], [0, 0, 1]]), np.zeros(4))
    bent = Lens((640, 480), np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]]), np.array([-0.2, 0.05, 0, 0]))
    rig = Rig((Camera("A", LENS), Camera("B", long), Camera("C", bent)))
    rng = np.random.default_rng(0)
    numbers = np.arange(8)
    points = numbered_points(rig, {name: (numbers, rng.uniform([20, 20], [620, 460], (8, 2))) for name in rig.names})
    seen = point_observations(rig, points, points.labels()[0])
    turned = seen.bearing + 1e-5 * np.cross(rng.normal(size=(24, 3)), seen.bearing)
    moved = np.einsum("mki,mi->mk", seen.tangent, turned - seen.bearing)
    for c, camera in enumerate(rig):
        own = seen.camera == c
        assert own.sum() == 8
        np.testing.assert_allclose(camera.lens.project_rays(turned[own]) - points.pixel[own], moved[own], rtol=1e-3, atol=1e-5)
