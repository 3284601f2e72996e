"""Sigmas in a world that known places set: errors drawn from what a rig and a survey state are as large as stated."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from passerby.calibration.alignment.places import position_sds
from passerby.calibration.alignment.plan import align_to_plan
from passerby.calibration.alignment.sigmas import fit_moves, own_covariances
from passerby.calibration.alignment.world import align_to_points, align_to_positions
from passerby.common.arrays import Floats
from passerby.core.cameras import Camera, Lens, Pose, PoseSigma, Rig
from passerby.core.scale_cues import FloorPlan, KnownPoint, KnownPosition, PlannedCamera
from passerby.geometry.rotations import angle_between, exp_rotation
from support.scenes.people_and_rigs import looking_at

LENS = Lens((1280, 720), np.array([[900.0, 0, 640], [0, 900, 360], [0, 0, 1]]), np.zeros(4))
SPOTS = ((-9.0, -8.0, 3.1), (9.0, -7.0, 2.7), (8.0, 9.0, 4.2), (-8.0, 8.0, 3.6), (0.5, -11.0, 3.0))
OWN_M, OWN_RAD = 0.02, np.radians(0.1)
SCALE, SURVEYED_M = 0.03, 0.02
OWN = np.diag([OWN_M**2] * 3 + [OWN_RAD**2] * 3)


def truth() -> Rig:
    return Rig(tuple(Camera(f"C{n}", LENS, looking_at(spot, (0.0, 0.0, 0.8))) for n, spot in enumerate(SPOTS, start=1)))


def scale_move(rig: Rig, name: str) -> Floats:
    """What the scale does to a camera's pose (6,): it grows from the ground below the cameras' middle."""
    middle = np.mean([camera.centre for camera in rig], axis=0) * (1.0, 1.0, 0.0)
    return np.concatenate([rig[name].centre - middle, np.zeros(3)])


def stated(rig: Rig, tilt: float = 0.0) -> Rig:
    """The rig with sigmas: each camera's own, a common scale and, with `tilt`, turns of the vertical (radians)."""
    cameras = []
    for camera in rig:
        covariance = OWN + SCALE**2 * np.outer(scale_move(rig, camera.name), scale_move(rig, camera.name))
        for axis in np.eye(3)[:2] if tilt else ():
            move = np.concatenate([np.cross(axis, camera.centre), -camera.pose.R_cw @ axis])
            covariance = covariance + tilt**2 * np.outer(move, move)
        cameras.append(replace(camera, sigma=PoseSigma.from_covariance(covariance)))
    return Rig(tuple(cameras))


def estimated(rng: np.random.Generator) -> Rig:
    """A rig that is off by errors drawn from what it states, in a frame of its own."""
    true = truth()
    grown = SCALE * rng.standard_normal()
    cameras = []
    for camera in true:
        off = np.linalg.cholesky(OWN) @ rng.standard_normal(6) + grown * scale_move(true, camera.name)
        pose = Pose.from_centre(exp_rotation(off[3:]) @ camera.pose.R_cw, camera.centre + off[:3])
        cameras.append(replace(camera, pose=pose))
    own_frame = exp_rotation(np.array([0.0, 0.0, rng.uniform(-3, 3)]))
    return stated(Rig(tuple(cameras))).moved(own_frame, np.array([*rng.uniform(-20, 20, 2), 0.0]))


def surveyed(rng: np.random.Generator, count: int) -> list[KnownPosition]:
    some = rng.permutation(len(SPOTS))[:count]
    return [
        KnownPosition(f"C{k + 1}", np.array(SPOTS[k]) + SURVEYED_M * rng.standard_normal(3), SURVEYED_M) for k in some.tolist()
    ]


def errors_in_sigmas(rig: Rig) -> tuple[list[float], list[float]]:
    position, orientation = [], []
    for camera, true in zip(rig, truth(), strict=True):
        position.append(float(np.linalg.norm(camera.centre - true.centre)) / camera.sigma.position_m)
        turned = np.degrees(angle_between(camera.pose.R_cw, true.pose.R_cw))
        orientation.append(float(turned) / camera.sigma.orientation_deg)
    return position, orientation


def rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.slow
@pytest.mark.parametrize("count", [3, 5])
def test_errors_in_the_known_world_are_as_large_as_stated(count: int) -> None:
    rng = np.random.default_rng(count)
    position, orientation = list[float](), list[float]()
    for _ in range(25):
        aligned = align_to_positions(estimated(rng), surveyed(rng, count), with_scale=True)
        found = errors_in_sigmas(aligned.rig)
        position += found[0]
        orientation += found[1]
    assert 0.75 < rms(position) < 1.15
    assert 0.75 < rms(orientation) < 1.15


@pytest.mark.parametrize("count", [3, 5])
def test_errors_on_a_plan_are_as_large_as_stated(count: int) -> None:
    rng, unit = np.random.default_rng(count), 0.001
    position, orientation = list[float](), list[float]()
    for _ in range(25):
        places = {f"C{k + 1}": np.array(SPOTS[k][:2]) + SURVEYED_M * rng.standard_normal(2)
                  for k in rng.permutation(len(SPOTS))[:count].tolist()}  # fmt: skip
        cameras = tuple(PlannedCamera(name, (xy[0] / unit, -xy[1] / unit), SURVEYED_M) for name, xy in places.items())
        aligned = align_to_plan(estimated(rng), FloorPlan("hall", unit, 1e-4, cameras), Path("hall.png"), with_scale=True)
        for every, found in zip((position, orientation), errors_in_sigmas(aligned.rig), strict=True):
            every += found
    assert 0.75 < rms(position) < 1.15
    assert 0.75 < rms(orientation) < 1.15


def test_places_and_points_that_set_the_scale_take_its_uncertainty_off() -> None:
    rng = np.random.default_rng(0)
    rig, places = estimated(rng), surveyed(rng, 5)
    kept = align_to_positions(rig, places).rig
    fitted = align_to_positions(rig, places, with_scale=True).rig
    for camera in rig:
        stated_m = camera.sigma.position_m
        assert kept[camera.name].sigma.position_m > 0.95 * stated_m
        assert fitted[camera.name].sigma.position_m < 0.4 * stated_m
    true, rng = truth(), np.random.default_rng(1)
    rig = stated(true)
    points = [KnownPoint(f"P{n}", xyz := np.array([*rng.uniform(-4, 4, 2), 0.0]),
                         {c.name: tuple(c.project(xyz)[0].tolist()) for c in true}, 0.01) for n in range(8)]  # fmt: skip
    aligned = align_to_points(rig, points, with_scale=True).rig
    assert all(camera.sigma.position_m < 0.5 * rig[camera.name].sigma.position_m for camera in aligned)


def test_what_is_common_is_taken_off_and_no_more() -> None:
    """One camera that is sure holds the common scale down."""
    rig = stated(truth(), tilt=np.radians(0.5))
    for name, left in own_covariances(rig, with_scale=True, tilt=True).items():
        assert (np.linalg.eigvalsh(left) > -1e-12).all()
        assert np.sqrt(np.trace(left[:3, :3])) < 2.0 * np.sqrt(3) * OWN_M
        assert np.sqrt(np.trace(left[3:, 3:])) < 0.6 * np.radians(rig[name].sigma.orientation_deg)
    kept = own_covariances(rig, with_scale=False, tilt=False)
    assert all((kept[camera.name] == camera.sigma.covariance).all() for camera in rig)
    # Of three equal variances the scale can take one off at most, with two cameras as with many.
    for count in (2, 5):
        for left in own_covariances(stated(Rig(truth().cameras[:count])), with_scale=True, tilt=False).values():
            assert 0.66 * 3 * OWN_M**2 < np.trace(left[:3, :3]) < 1.5 * 3 * OWN_M**2
            np.testing.assert_allclose(left[3:, 3:], OWN[3:, 3:], rtol=1e-6, atol=1e-9)
    rig = stated(truth())
    sure = replace(rig["C1"], sigma=PoseSigma.from_covariance(OWN))
    others = replace(rig, cameras=(sure, *rig.cameras[1:]))
    own = own_covariances(others, with_scale=True, tilt=False)
    for camera in others.cameras[1:]:
        assert np.trace(own[camera.name][:3, :3]) > 0.9 * np.trace(camera.sigma.covariance[:3, :3])


def test_sigmas_without_covariances_and_rigs_without_sigmas() -> None:
    """What they leave does not depend on the origin of the world."""
    bare = truth()
    single = stated(bare)
    plain = Rig(tuple(replace(c, sigma=replace(c.sigma, covariance=None)) for c in single))
    by_size, by_covariance = position_sds(plain, True), position_sds(single, True)
    for name in bare.names:
        assert by_covariance[name] < 2.0 * OWN_M
        assert by_size[name] < 0.5 * single[name].sigma.position_m / np.sqrt(3)
    for none in (bare, Rig(tuple(replace(c, sigma=PoseSigma(np.inf, 1.0)) for c in bare))):
        assert position_sds(none, True) == position_sds(none, False) == dict.fromkeys(bare.names, 0.0)
    known = align_to_positions(plain, surveyed(np.random.default_rng(3), 4)).rig["C1"].sigma
    assert (known.position_m, known.covariance) == (plain["C1"].sigma.position_m, None)
    far = plain.moved(exp_rotation(np.array([0.0, 0.0, 2.0])), np.array([150.0, -80.0, 0.0]))
    assert position_sds(far, True) == pytest.approx(by_size, rel=1e-6)


@pytest.mark.parametrize("tilt", [False, True])
def test_moves_are_the_derivatives_of_the_motion(tilt: bool) -> None:
    pose, centre, step = truth()["C2"].pose, np.array([1.0, -2.0, 0.4]), 1e-6
    moves = fit_moves(pose, centre, with_scale=True, tilt=tilt)
    assert moves.shape == (6, 7 if tilt else 4)
    for column, axis in enumerate(np.eye(3) if tilt else np.eye(3)[2:]):
        turn = exp_rotation(step * axis)
        there = turn @ (pose.centre - centre) + centre
        np.testing.assert_allclose(moves[:3, column], (there - pose.centre) / step, atol=1e-5)
        turned = pose.R_cw @ turn.T @ pose.R_cw.T
        seen = np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]]) / 2
        np.testing.assert_allclose(moves[3:, column], seen / step, atol=1e-5)
