"""A camera that no pair registers, registered to people whose places the others know."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from passerby.association.attachment import KnownPeople, attach_camera, attach_cameras, known_people
from passerby.association.camera_tracklets import CameraTracklets, build_camera_tracklets
from passerby.association.candidates import Candidates
from passerby.core.observations import Clock
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.people.level import of_moving_tracklets
from passerby.simulation import SimulatedScene, SimulationOptions, simulate

FPS = 5.0
LATE_S = 1.3


@cache
def simulated(seed: int) -> SimulatedScene:
    return simulate(SimulationOptions(people=3, seconds=30.0, fps=FPS, box_noise=0.02, missing=0.1, seed=seed))


@cache
def cameras(seed: int) -> list[CameraTracklets]:
    scene, rng = simulated(seed), np.random.default_rng(0)
    return [
        build_camera_tracklets(camera, scene.observations[camera.name], Clock(FPS), PERSON_HEIGHT_M, rng, given=True)
        for camera in scene.rig
    ]


def people_without(seed: int, left_out: int) -> KnownPeople:
    """What the other cameras, at their true poses, know of everybody."""
    return known_people(*told_of(seed, left_out))


def told_of(seed: int, left_out: int) -> tuple:
    own = cameras(seed)
    poses = [None if c == left_out else camera.pose for c, camera in enumerate(simulated(seed).rig)]
    return own, poses, [np.arange(camera.n_tracklets) for camera in own], np.zeros(len(own))


@pytest.mark.slow
@pytest.mark.parametrize("c", [0, 2])
def test_a_camera_is_found_where_it_is_with_its_clock(c):
    camera = cameras(4)[c]
    late = replace(camera, bodies=replace(camera.bodies, seconds=camera.bodies.seconds + LATE_S))
    found = attach_camera(late.bodies, people_without(4, c), PERSON_HEIGHT_M, 5.0)
    assert found is not None
    assert found.believed
    true = simulated(4).rig.cameras[c].pose
    assert true is not None
    assert np.linalg.norm(found.pose.centre - true.centre) < 0.4
    assert np.degrees(np.arccos((np.trace(found.pose.R_cw @ true.R_cw.T) - 1) / 2)) < 4
    assert abs(found.offset_s + LATE_S) < 0.3


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "other"), [(4, 5), (5, 6), (6, 4)])
def test_a_camera_among_other_people_is_not_believed(seed, other):
    found = attach_camera(cameras(seed)[1].bodies, people_without(other, 1), PERSON_HEIGHT_M, 5.0)
    assert found is None or not found.believed


def test_nobody_known_or_nobody_seen_places_no_camera():
    bodies, people = cameras(4)[0].bodies, people_without(4, 0)
    nobody = KnownPeople(people.step[:0], people.person[:0], people.ground[:0], people.rate[:0])
    assert attach_camera(bodies, nobody, PERSON_HEIGHT_M, 5.0) is None
    assert attach_camera(bodies.take(np.zeros(len(bodies), dtype=bool)), people, PERSON_HEIGHT_M, 5.0) is None


def test_known_people_walk_where_they_truly_are():
    people, scene = people_without(5, 1), simulated(5)
    at = np.round(people.step * 0.5 * FPS).astype(int)
    inside = (at < len(scene.frames)) & (np.abs(people.step * 0.5 * FPS - at) < 1e-9)
    true = scene.ground_positions[at[inside], people.person[inside] - 1]
    assert np.median(np.linalg.norm(people.ground[inside] - true, axis=1)) < 0.2


def test_whoever_sits_does_not_move():
    camera = cameras(4)[0]
    own = camera.bodies.take(camera.bodies.identity == camera.bodies.identity.max())
    assert of_moving_tracklets(own).all()
    still = replace(own, top=np.repeat(own.top[:1], len(own), axis=0), bottom=np.repeat(own.bottom[:1], len(own), axis=0))
    assert not of_moving_tracklets(still).any()
    assert not of_moving_tracklets(replace(own, identity=np.full(len(own), -1))).any()


def test_on_a_site_a_camera_is_tried_by_the_people_of_those_that_may_be_near():
    arguments = *told_of(4, 2), PERSON_HEIGHT_M, {2: (0.5, 0.0)}
    everybody = {(min(a, 2), max(a, 2)): "stated" for a in range(4) if a != 2}
    by_near, by_all = attach_cameras(*arguments, Candidates(4, everybody)), attach_cameras(*arguments)
    assert set(by_near) == set(by_all) == {2}
    np.testing.assert_array_equal(by_near[2].pose.centre, by_all[2].pose.centre)
    assert attach_cameras(*arguments, Candidates(4, {(0, 1): "stated"})) == {}
