"""RPE and ERR of Table 2: nothing at the truth, the marks' own noise with it, and what it must not hide."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.observations import Boxes, CameraObservations, Keypoints, Observations
from passerby.evaluation.reprojection import median_residuals, reprojection_error
from passerby.simulation import SimulationOptions, simulate

TRUTH = simulate(SimulationOptions(preset="terrace", seed=0, seconds=0.2)).rig
PLACES = np.random.default_rng(0).uniform((-2, -3, 0), (2, 3, 2), (15, 3))


def marks(noise_px: float = 0.0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(1)
    return {camera.name: camera.project(PLACES) + noise_px * rng.standard_normal((15, 2)) for camera in TRUTH}


def moved(camera: Camera, metres: tuple[float, float, float]) -> Camera:
    return replace(camera, pose=Pose.from_centre(camera.pose.R_cw, camera.centre + np.array(metres)))


def test_nothing_at_the_truth_wherever_and_however_large_the_rig_is() -> None:
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    for rig in (TRUTH, TRUTH.moved(turn, np.array([3.0, 2.0, 1.0]), 2.5)):
        found = reprojection_error(rig, marks())
        assert found.rpe_px < 1e-6
        assert (found.correspondences, found.lost) == (15, 0)


def test_by_hand() -> None:
    """Two cameras a metre apart look along z; marks 2 px apart in height are each 1 px from where their rays come nearest."""
    lens = Lens((640, 480), np.array([[500.0, 0, 320], [0, 500.0, 240], [0, 0, 1]]), np.zeros(0))
    rig = Rig(tuple(Camera(name, lens, Pose(np.eye(3), np.array([-x, 0.0, 0.0]))) for name, x in (("a", 0.0), ("b", 1.0))))
    seen = {"a": np.array([[370.0, 241.0]]), "b": np.array([[270.0, 239.0]])}
    found = reprojection_error(rig, seen)
    assert found.rpe_px == pytest.approx(1.0, rel=1e-3)
    assert found.err == pytest.approx(1.0 / 480, rel=1e-3)


def test_grows_with_the_error_of_a_camera() -> None:
    rigs = (Rig((*TRUTH.cameras[:3], moved(TRUTH.cameras[3], (step, -step, 0.0)))) for step in (0.0, 0.1, 0.5))
    least, more, most = (reprojection_error(rig, marks(0.5)).rpe_px for rig in rigs)
    assert 0.2 < least < 0.7
    assert least < more < most


def test_correspondences_that_cannot_be_judged_are_counted() -> None:
    seen = marks()
    seen["C3"][:5] = seen["C4"][:5] = np.nan
    first, second, *others = TRUTH.cameras
    found = reprojection_error(Rig((first, replace(second, pose=None), *others)), seen)
    assert (found.correspondences, found.lost) == (10, 5)
    assert reprojection_error(Rig((first,)), {"C1": seen["C1"]}) is None


def test_a_point_behind_a_camera_costs_the_whole_picture() -> None:
    """A rig with two cameras turned round is no better than one whose points lie at the other end of the picture."""
    back = np.diag([-1.0, 1.0, -1.0])
    turned = tuple(replace(c, pose=Pose.from_centre(back @ c.pose.R_cw, c.centre)) for c in TRUTH)
    assert 100 < reprojection_error(Rig(turned), marks()).rpe_px <= np.hypot(720, 576) + 1e-6


def test_marks_that_contradict_the_rig_are_told() -> None:
    with pytest.raises(InputError, match="camera C9"):
        reprojection_error(TRUTH, {"C9": np.zeros((3, 2))})
    with pytest.raises(InputError, match="different numbers"):
        reprojection_error(TRUTH, {"C1": np.zeros((3, 2)), "C2": np.zeros((4, 2))})


def seen(noise_px: float, *, joints: bool = False) -> Observations:
    """The places as people, each an identity, seen by every camera in one frame."""
    cameras, n = {}, len(PLACES)
    for name, pixels in marks(noise_px).items():
        ones, who = np.ones(n, dtype=np.int64), np.arange(n)
        boxes = Boxes(ones, who, np.column_stack([pixels - 5, np.full((n, 2), 10.0)]), np.ones(n))
        if joints:
            xy, score = np.zeros((n, 17, 2)), np.zeros((n, 17))
            xy[:, 3], score[:, 3] = pixels, 1.0
            cameras[name] = CameraObservations(Boxes.empty(), Keypoints(ones, who, xy, score))
        else:
            cameras[name] = CameraObservations(boxes)
    return Observations(cameras)


@pytest.mark.parametrize("joints", [False, True])
def test_residuals_need_no_truth(joints: bool) -> None:
    exact, noisy = (median_residuals(TRUTH, seen(noise, joints=joints)) for noise in (0.0, 2.0))
    assert set(exact) == set(noisy) == set(TRUTH.names)
    assert max(exact.values()) < 1e-6
    # Four cameras of 8 coordinates and 3 unknowns keep 5/8 of the variance; the median of a Rayleigh is 1.18 sigma.
    assert np.mean(list(noisy.values())) == pytest.approx(2.0 * 1.18 * np.sqrt(5 / 8), rel=0.3)
    wrong = replace(TRUTH, cameras=(moved(TRUTH.cameras[0], (0.5, 0, 0)), *TRUTH.cameras[1:]))
    assert median_residuals(wrong, seen(0.0, joints=joints))[TRUTH.names[0]] > 5


def test_no_residual_of_what_one_camera_saw() -> None:
    alone = Observations({TRUTH.names[0]: seen(0.0)[TRUTH.names[0]]})
    assert median_residuals(TRUTH, alone) == {}
    assert median_residuals(TRUTH, Observations({})) == {}
