"""The stated sigmas of what a rig measures are those of rigs that are off by as much as their cameras' covariance says."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.common.arrays import Bools, Floats
from passerby.core.cameras import Pose, Rig
from passerby.core.measuring import measure_change
from passerby.geometry.rotations import exp_rotation
from passerby.solver.gauge import Free
from passerby.solver.measuring_uncertainty import measuring_uncertainty
from passerby.solver.uncertainty import COMPLETE
from support.scenes.people_and_rigs import ring

RIG = ring(4)
PLACES = np.random.default_rng(3).uniform(-2.0, 2.0, (60, 2))
CENTRE_M, TURN_RAD = 0.03, 0.004


def covariance(n_cameras: int) -> Floats:
    """Of cameras that are off each for itself, with exact lenses."""
    one = np.zeros(COMPLETE)
    one[:3], one[3:6] = CENTRE_M**2, TURN_RAD**2
    return np.diag(np.tile(one, n_cameras))


def off(rig: Rig, rng: np.random.Generator) -> Rig:
    """A rig that is off by as much."""
    cameras = []
    for camera in rig:
        R = exp_rotation(TURN_RAD * rng.standard_normal((1, 3)))[0] @ camera.pose.R_cw
        cameras.append(replace(camera, pose=Pose.from_centre(R, camera.centre + CENTRE_M * rng.standard_normal(3))))
    return Rig(tuple(cameras))


def everywhere(cameras: int) -> Bools:
    """Cameras that see people at all places."""
    return np.ones((cameras, len(PLACES)), dtype=bool)


def test_cameras_measure_no_farther_than_people_were_whom_they_saw() -> None:
    """People behind a wall are in their pictures by geometry alone; so far away, they would be measured poorly."""
    places = np.concatenate([PLACES, PLACES * 1.5 + (0.0, 12.0)])
    seen = np.arange(len(places)) < len(PLACES) * np.ones((4, 1))
    alone = measuring_uncertainty(RIG, covariance(4), PLACES, everywhere(4), 1.75, Free())
    walled = measuring_uncertainty(RIG, covariance(4), places, seen, 1.75, Free())
    assert walled == alone
    assert set(
        measuring_uncertainty(RIG, covariance(4), places, seen & [[1], [1], [0], [0]], 1.75, Free(), [(0, 1), (2, 3)]).cameras
    ) == {*RIG.names[:2]}
    through = measuring_uncertainty(RIG, covariance(4), places, np.ones_like(seen), 1.75, Free())
    assert through.ground.p90_mm > 3 * alone.ground.p90_mm


def test_sigmas_are_those_of_rigs_that_are_off_by_as_much() -> None:
    found = measuring_uncertainty(RIG, covariance(4), PLACES, everywhere(4), 1.75, Free())
    rng = np.random.default_rng(1)
    changes = [measure_change(RIG, off(RIG, rng), PLACES) for _ in range(60)]
    points, ground = (
        np.sqrt(np.mean([np.square(distances.median_mm) for one in changes if one is not None and (distances := of(one))]))
        for of in (lambda one: one.points, lambda one: one.ground)
    )
    assert points == pytest.approx(found.points.median_mm, rel=0.25)
    assert ground == pytest.approx(found.ground.median_mm, rel=0.25)


def test_points_that_only_cameras_at_one_place_see_are_not_measured() -> None:
    twice = Rig((RIG.cameras[0], replace(RIG.cameras[0], name="again")))
    assert measuring_uncertainty(twice, covariance(2), PLACES, everywhere(2), 1.75, Free()) is None
    found = measuring_uncertainty(Rig((*twice.cameras, RIG.cameras[1])), covariance(3), PLACES, everywhere(3), 1.75, Free())
    assert 0 < found.points.median_mm < 1000


def test_groups_measure_by_themselves_whatever_is_known_of_their_relative_pose() -> None:
    """The second pair of cameras is off by a metre as a whole."""
    shared = np.zeros((4, 4))
    shared[2:, 2:] = 1.0
    whole = covariance(4) + np.kron(shared, np.diag([1.0, 1.0, *np.zeros(COMPLETE - 2)]))
    groups = [(0, 1), (2, 3)]
    found = measuring_uncertainty(RIG, whole, PLACES, everywhere(4), 1.75, Free(), groups)
    for group in groups:
        own = Rig(tuple(RIG.cameras[c] for c in group))
        alone = measuring_uncertainty(own, covariance(2), PLACES, everywhere(2), 1.75, Free())
        for name in own.names:
            assert found.cameras[name].points.median_mm == pytest.approx(alone.cameras[name].points.median_mm, rel=1e-6)
    assert measuring_uncertainty(RIG, whole, PLACES, everywhere(4), 1.75, Free()).points.median_mm > 5 * found.points.median_mm
