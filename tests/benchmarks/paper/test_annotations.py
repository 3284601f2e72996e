"""What stands in for an annotator: marks where the truth is, missed by as much as asked; names by overlap."""

from __future__ import annotations

import numpy as np
import pytest

from paper.annotations import marked_length, marked_points, named_by_hand
from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.core.observations import Boxes
from passerby.evaluation.reprojection import reprojection_error
from passerby.simulation import SimulationOptions, simulate

SCENE = simulate(SimulationOptions(preset="terrace", seed=0, seconds=8.0))


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def test_points_are_marked_where_they_are() -> None:
    marks = marked_points(SCENE, 15, 0.0, rng())
    seen = np.stack([np.isfinite(pixels).all(axis=1) for pixels in marks.values()])
    assert seen.shape == (4, 15)
    assert seen[0].all()
    assert (seen.sum(axis=0) >= 2).all()
    found = reprojection_error(SCENE.rig, marks)
    assert found is not None
    assert found.rpe_px < 1e-6


def test_marks_miss_by_as_much_as_asked() -> None:
    exact, missed = (marked_points(SCENE, 60, noise, rng()) for noise in (0.0, 1.0))
    off = np.concatenate([(missed[name] - exact[name]).ravel() for name in exact])
    assert np.nanstd(off) == pytest.approx(1.0, abs=0.15)


def test_points_are_not_all_on_one_level() -> None:
    """Thirty of them fix the cameras: the paper's oracle."""
    marks = marked_points(SCENE, 30, 0.0, rng())
    rows = np.isfinite(marks["C1"]).all(axis=1)
    assert np.std(marks["C1"][rows, 1]) > 30


def test_a_known_length_is_as_long_as_it_says_and_seen_by_all() -> None:
    cue = marked_length(SCENE.rig, 3.6, 0.0, rng())
    assert set(cue.points) == set(SCENE.rig.names)
    for camera in SCENE.rig:
        assert camera.pose is not None
        ray = camera.lens.bearings(cue.points[camera.name]) @ camera.pose.R_cw
        ends = camera.centre - ray * (camera.centre[2] / ray[:, 2])[:, None]
        assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(3.6, abs=1e-3)


def test_no_length_where_no_two_cameras_see_one() -> None:
    with pytest.raises(InputError, match=r"no line of 3\.6 m"):
        marked_length(Rig(SCENE.rig.cameras[:1]), 3.6, 0.0, rng())


def test_boxes_are_named_by_whom_they_show() -> None:
    true = Boxes(
        np.array([1, 1, 2]), np.array([7, 8, 7]), np.array([[0, 0, 10, 20], [50, 0, 10, 20], [5, 0, 10, 20]]), np.ones(3)
    )
    places = np.array([[51, 1, 10, 20], [1, 0, 10, 19], [90, 0, 10, 20]])
    found = Boxes(np.array([1, 1, 2]), np.array([1, 2, 3]), places, np.ones(3))
    assert named_by_hand({"a": found}, {"a": true})["a"].identity.tolist() == [8, 7, -1]
