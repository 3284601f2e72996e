"""Which pairs of cameras are worth registering, and cameras that no pair registers."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from passerby.association.attachment import KnownPeople, attach_camera, attach_cameras, known_people
from passerby.association.camera_tracklets import CameraTracklets, build_camera_tracklets
from passerby.association.candidates import (
    Candidates,
    activity_agreement,
    best_partners,
    find_candidates,
    stated_candidates,
    with_common_partners,
)
from passerby.association.clocks.activity import Activity
from passerby.association.ground.ground_tracks import GroundTracks, Tolerance
from passerby.core.observations import Clock
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.geometry.single_view import Level
from passerby.people.level import of_moving_tracklets
from passerby.simulation import SimulatedScene, SimulationOptions, simulate

STEPS, REGIONS = 1200, 4


def activities(seed: int, shared: dict[tuple[int, int], int], count: int = 5) -> list[Activity]:
    """Independent signals; each pair of `shared` has one signal in common, later in the second by so many grid steps."""
    rng = np.random.default_rng(seed)

    def smooth() -> np.ndarray:
        values = np.convolve(rng.standard_normal(STEPS + 20), np.ones(6), mode="same")[:STEPS]
        return (values - values.mean()) / values.std()

    signals = [np.column_stack([smooth() for _ in range(REGIONS)]) for _ in range(count)]
    for number, ((a, b), lag) in enumerate(shared.items()):
        signals[b][:, number % REGIONS] = np.roll(signals[a][:, number % REGIONS], lag) + 0.5 * smooth()
    return [Activity(0, own.astype(np.float32)) for own in signals]


@pytest.mark.parametrize("lag", [-12, 0, 9])
def test_cameras_with_a_signal_in_common_agree_most_at_any_possible_lag(lag):
    agreement = activity_agreement(activities(1, {(1, 3): lag}), 10.0)
    assert np.unravel_index(agreement.argmax(), agreement.shape) == (1, 3)
    assert agreement[1, 3] > 3 * np.sort(agreement.ravel())[-2]
    assert not np.tril(agreement).any()


def test_a_lag_that_the_clocks_cannot_have_is_not_counted_and_other_begins_are_aligned():
    impossible, possible = (activity_agreement(activities(2, {(0, 4): 14}), lag_s)[0, 4] for lag_s in (2.0, 8.0))
    assert impossible < possible / 3
    first, second = activities(4, {(0, 1): 0}, count=2)
    assert activity_agreement([first, Activity(400, second.signals[400:])], 5.0)[0, 1] > 50


def test_blocks_of_cameras_change_nothing(monkeypatch):
    own = activities(3, {(0, 1): 2, (2, 4): 5})
    whole = activity_agreement(own, 5.0)
    monkeypatch.setattr("passerby.association.candidates.CAMERAS_AT_ONCE", 2)
    assert np.allclose(activity_agreement(own, 5.0), whole, rtol=1e-4, atol=1e-3)


def test_no_camera_has_more_than_its_share_of_partners_and_the_best_come_first() -> None:
    agreement = np.triu(np.random.default_rng(0).uniform(size=(9, 9)), 1)
    pairs = best_partners(agreement, 3)
    values = [agreement[pair] for pair in pairs]
    assert (values, values[0]) == (sorted(values, reverse=True), agreement.max())
    assert (np.bincount(np.array(pairs).ravel()).max(), len(best_partners(agreement, 8))) == (3, 36)
    agreement = np.zeros((4, 4), dtype=np.float32)
    agreement[0, 1], agreement[1, 2], agreement[0, 2], agreement[0, 3] = 100.0, 60.0, 2.0, 3.0
    raised = with_common_partners(agreement)
    assert raised[0, 2] > raised[0, 3], "a common partner raises a pair that alone says little"
    assert raised[0, 2] == pytest.approx(2.0 + 0.5 * 60.0)


def tracks_of(seed: int, lag: int) -> GroundTracks:
    """People who come one after the other, each somewhere else: the same ones for one seed, `lag` grid steps later."""
    rng = np.random.default_rng(seed)
    step, place = [], []
    for start in np.cumsum(rng.integers(5, 40, 40)):
        duration, at = int(rng.integers(6, 30)), complex(*rng.uniform(-10, 10, 2))
        step += range(start, start + duration)
        place += [at] * duration
    order = np.argsort(step, kind="stable")
    none = np.zeros(len(step), dtype=np.int64)
    level = Level(np.array([0.0, 1.0, 0.0]), 3.0, 0.0)
    return GroundTracks(level, Tolerance(), np.array(step)[order] + lag, none, np.array(place)[order], none.astype(complex))


def test_candidates_are_the_cameras_that_see_the_same_people():
    seen = [tracks_of(seed, lag) for seed, lag in ((1, 0), (2, 3), (1, -8), (3, 0), (2, 9), (4, 0))]
    found = find_candidates([*seen, None], 10.0, most=1)
    assert (0, 2) in found
    assert (1, 4) in found
    assert all(6 not in pair for pair in found.found_by)
    tried = found.tried
    assert (tried.possible, tried.most_of_a_camera) == (21, 1)
    assert tried.tried == tried.by_activity == len(found.found_by)
    assert find_candidates([None, seen[0], None], 5.0) == Candidates(3, {}), "fewer than two cameras with people"


def test_stated_groups_are_the_only_pairs():
    found = stated_candidates(("a", "b", "c", "d"), (("c", "a"), ("b", "c", "d"), ("a", "elsewhere"), ("elsewhere", "d")))
    assert (list(found.found_by), found.tried.stated) == ([(0, 2), (1, 2), (1, 3), (2, 3)], 4)
    assert found.tried.most_of_a_camera == 3


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


def known_without(seed: int, left_out: int) -> tuple:
    """What the other cameras, at their true poses, know of everybody."""
    own = cameras(seed)
    poses = [None if c == left_out else camera.pose for c, camera in enumerate(simulated(seed).rig)]
    return own, poses, [np.arange(camera.n_tracklets) for camera in own], np.zeros(len(own))


@pytest.mark.slow
@pytest.mark.parametrize("c", [0, 2])
def test_a_camera_is_found_where_it_is_with_its_clock(c):
    camera, true = cameras(4)[c], simulated(4).rig.cameras[c].pose
    late = replace(camera, bodies=replace(camera.bodies, seconds=camera.bodies.seconds + LATE_S))
    found = attach_camera(late.bodies, known_people(*known_without(4, c)), PERSON_HEIGHT_M, 5.0)
    assert found.believed
    assert np.linalg.norm(found.pose.centre - true.centre) < 0.4
    assert np.degrees(np.arccos((np.trace(found.pose.R_cw @ true.R_cw.T) - 1) / 2)) < 4
    assert abs(found.offset_s + LATE_S) < 0.3


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "other"), [(4, 5), (5, 6), (6, 4)])
def test_a_camera_among_other_people_is_not_believed(seed, other):
    found = attach_camera(cameras(seed)[1].bodies, known_people(*known_without(other, 1)), PERSON_HEIGHT_M, 5.0)
    assert found is None or not found.believed


def test_known_people_walk_where_they_truly_are_and_without_any_no_camera_is_placed():
    people, scene, bodies = known_people(*known_without(5, 1)), simulated(5), cameras(5)[0].bodies
    at = np.round(people.step * 0.5 * FPS).astype(int)
    inside = (at < len(scene.frames)) & (np.abs(people.step * 0.5 * FPS - at) < 1e-9)
    true = scene.ground_positions[at[inside], people.person[inside] - 1]
    assert np.median(np.linalg.norm(people.ground[inside] - true, axis=1)) < 0.2
    nobody = KnownPeople(people.step[:0], people.person[:0], people.ground[:0], people.rate[:0])
    assert attach_camera(bodies, nobody, PERSON_HEIGHT_M, 5.0) is None
    assert attach_camera(bodies.take(np.zeros(len(bodies), dtype=bool)), people, PERSON_HEIGHT_M, 5.0) is None


def test_people_who_sit_do_not_move():
    camera = cameras(5)[0]
    own = camera.bodies.take(camera.bodies.identity == camera.bodies.identity.max())
    assert of_moving_tracklets(own).all()
    still = replace(own, top=np.repeat(own.top[:1], len(own), axis=0), bottom=np.repeat(own.bottom[:1], len(own), axis=0))
    assert not of_moving_tracklets(still).any()
    assert not of_moving_tracklets(replace(own, identity=np.full(len(own), -1))).any()


def test_on_a_site_a_camera_is_tried_by_the_people_of_those_that_may_be_near():
    arguments = *known_without(4, 2), PERSON_HEIGHT_M, {2: (0.5, 0.0)}
    everybody = {(min(a, 2), max(a, 2)): "stated" for a in range(4) if a != 2}
    by_near, by_all = attach_cameras(*arguments, Candidates(4, everybody)), attach_cameras(*arguments)
    assert set(by_near) == set(by_all) == {2}
    np.testing.assert_array_equal(by_near[2].pose.centre, by_all[2].pose.centre)
    assert attach_cameras(*arguments, Candidates(4, {(0, 1): "stated"})) == {}
