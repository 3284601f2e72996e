"""Rigs held against the same people, and against marks of the same places: what two cameras say of one point."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.observations import Boxes, CameraObservations, Keypoints, Observations
from passerby.evaluation.on_people import compare_on_people
from passerby.evaluation.reprojection import median_residuals, reprojection_error
from passerby.simulation import SimulationOptions, simulate

HEIGHT_M = 1.72


@pytest.fixture(scope="module")
def scene():
    return simulate(SimulationOptions(preset="terrace", seed=960, seconds=60.0, box_noise=0.01))


def turned(rig, name, degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    camera, about_up = rig[name], np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    pose = Pose.from_centre(about_up @ camera.pose.R_cw, camera.pose.centre)
    return Rig(tuple(replace(one, pose=pose) if one.name == name else one for one in rig.cameras))


def until(scene, frame):
    cameras = {name: replace(seen, boxes=seen.boxes.take(seen.boxes.frame < frame), keypoints=seen.keypoints.take(slice(0)))
               for name, seen in scene.observations.cameras.items()}  # fmt: skip
    return replace(scene.observations, cameras=cameras)


def test_the_turned_camera_is_the_worse_rig_whichever_comes_first(scene):
    good, bad = scene.rig, turned(scene.rig, "C2", 0.5)
    found, other, same = (
        compare_on_people(*rigs, scene.observations, HEIGHT_M) for rigs in ((good, bad), (bad, good), (good, good))
    )
    assert (found.better, other.better, found.stretches) == ("first", "second", 6)
    assert found.difference_px > 5 * found.sigma_px > 0
    assert found.cameras["C2"].second_px > 1.3 * found.cameras["C2"].first_px
    assert other.difference_px == pytest.approx(-found.difference_px)
    assert (same.better, same.difference_px, same.first) == ("neither", 0, same.second)
    short = compare_on_people(good, turned(good, "C2", 2.0), until(scene, 100), HEIGHT_M)
    assert (short.sigma_px, short.better) == (None, "neither"), "a short recording has no sigma"


def test_another_frame_counts_unless_the_shape_alone_is_asked_for(scene):
    """A world that hangs 0.5 m too high and is 8 % too small puts people elsewhere; its shape is the same."""
    moved = scene.rig.moved(np.eye(3), np.array([3.0, -2.0, 0.5]), 0.92)
    as_it_is = compare_on_people(scene.rig, moved, scene.observations, HEIGHT_M)
    assert as_it_is.better == "first"
    shape = compare_on_people(scene.rig, moved, scene.observations, HEIGHT_M, shape=True)
    assert shape.better == "neither"
    assert shape.difference_px == pytest.approx(0, abs=1e-6)


def test_what_cannot_be_compared(scene):
    rig = scene.rig
    alone = Rig(tuple(camera if camera.name == "C1" else replace(camera, pose=None) for camera in rig.cameras))
    with pytest.raises(InputError, match=r"have one camera in common .* two are needed"):
        compare_on_people(rig, alone, scene.observations, HEIGHT_M)
    with pytest.raises(EvidenceError, match=r"too few people whom two cameras see at once"):
        compare_on_people(rig, rig, until(scene, 3), HEIGHT_M)


TRUTH = simulate(SimulationOptions(preset="terrace", seed=0, seconds=0.2)).rig


PLACES = np.random.default_rng(0).uniform((-2, -3, 0), (2, 3, 2), (15, 3))


def marks(noise_px: float = 0.0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(1)
    return {camera.name: camera.project(PLACES) + noise_px * rng.standard_normal((15, 2)) for camera in TRUTH}


def moved(camera: Camera, metres: tuple[float, float, float]) -> Camera:
    return replace(camera, pose=Pose.from_centre(camera.pose.R_cw, camera.centre + np.array(metres)))


def test_nothing_is_off_at_the_truth_however_the_rig_is_placed_and_more_with_the_error_of_a_camera() -> None:
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    for rig in (TRUTH, TRUTH.moved(turn, np.array([3.0, 2.0, 1.0]), 2.5)):
        found = reprojection_error(rig, marks())
        assert found.rpe_px < 1e-6
        assert (found.correspondences, found.lost) == (15, 0)
    rigs = (Rig((*TRUTH.cameras[:3], moved(TRUTH.cameras[3], (step, -step, 0.0)))) for step in (0.0, 0.1, 0.5))
    least, more, most = (reprojection_error(rig, marks(0.5)).rpe_px for rig in rigs)
    assert 0.2 < least < 0.7
    assert least < more < most


def test_by_hand() -> None:
    """Two cameras a metre apart look along z; marks 2 px apart in height are each 1 px from where their rays come nearest."""
    lens = Lens((640, 480), np.array([[500.0, 0, 320], [0, 500.0, 240], [0, 0, 1]]), np.zeros(0))
    rig = Rig(tuple(Camera(name, lens, Pose(np.eye(3), np.array([-x, 0.0, 0.0]))) for name, x in (("a", 0.0), ("b", 1.0))))
    seen = {"a": np.array([[370.0, 241.0]]), "b": np.array([[270.0, 239.0]])}
    found = reprojection_error(rig, seen)
    assert found.rpe_px == pytest.approx(1.0, rel=1e-3)
    assert found.err == pytest.approx(1.0 / 480, rel=1e-3)


def test_points_behind_cameras_cost_the_whole_picture_and_what_cannot_be_measured_is_counted() -> None:
    """A rig with two cameras turned round is no better than one whose points lie at the other end of the picture."""
    back = np.diag([-1.0, 1.0, -1.0])
    turned = tuple(replace(c, pose=Pose.from_centre(back @ c.pose.R_cw, c.centre)) for c in TRUTH)
    assert 100 < reprojection_error(Rig(turned), marks()).rpe_px <= np.hypot(720, 576) + 1e-6
    seen = marks()
    seen["C3"][:5] = seen["C4"][:5] = np.nan
    first, second, *others = TRUTH.cameras
    found = reprojection_error(Rig((first, replace(second, pose=None), *others)), seen)
    assert (found.correspondences, found.lost) == (10, 5)
    assert reprojection_error(Rig((first,)), {"C1": seen["C1"]}) is None
    with pytest.raises(InputError, match="camera C9"):
        reprojection_error(TRUTH, {"C9": np.zeros((3, 2))})
    with pytest.raises(InputError, match="different numbers"):
        reprojection_error(TRUTH, {"C1": np.zeros((3, 2)), "C2": np.zeros((4, 2))})


def people(noise_px: float, *, joints: bool = False) -> Observations:
    """The places as people, each an identity, people by every camera in one frame."""
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
def test_residuals_need_no_truth_but_two_cameras(joints: bool) -> None:
    exact, noisy = (median_residuals(TRUTH, people(noise, joints=joints)) for noise in (0.0, 2.0))
    assert set(exact) == set(noisy) == set(TRUTH.names)
    assert max(exact.values()) < 1e-6
    # Four cameras of 8 coordinates and 3 unknowns keep 5/8 of the variance; the median of a Rayleigh is 1.18 sigma.
    assert np.mean(list(noisy.values())) == pytest.approx(2.0 * 1.18 * np.sqrt(5 / 8), rel=0.3)
    wrong = replace(TRUTH, cameras=(moved(TRUTH.cameras[0], (0.5, 0, 0)), *TRUTH.cameras[1:]))
    assert median_residuals(wrong, people(0.0, joints=joints))[TRUTH.names[0]] > 5
    alone = Observations({TRUTH.names[0]: people(0.0, joints=joints)[TRUTH.names[0]]})
    assert median_residuals(TRUTH, alone) == median_residuals(TRUTH, Observations({})) == {}
