"""Two cameras registered by people on common ground, against known motions and against what tracks score by chance."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from passerby.association.graph import view_graph
from passerby.association.ground.ground_tracks import GroundTracks, Tolerance
from passerby.association.ground.registration import PairRegistration, Registration, register_pair, score_motion
from passerby.association.sampling import STEP_S
from passerby.geometry.single_view import Level
from support.scenes.walkers_on_plane import UP, Station, Walker, seen_by, standing, walkers

A = Station(0.4, -12.0 - 3.0j)


def facing(degrees: float, **more: float) -> Station:
    """A camera 13 metres from the middle, turned against A by so much."""
    turn = np.deg2rad(degrees)
    return Station(A.turn + turn, complex(13.0 * np.exp(1j * (2.5 - turn))), **more)


def assert_found(guess: Registration, b: Station, *, degrees: float = 1.5, metres: float = 0.5, seconds: float = 0.1) -> None:
    turn, shift, lag_s = A.motion_to(b)
    assert abs(np.rad2deg(np.angle(guess.turn / turn))) < degrees
    assert abs(guess.lag_s - lag_s) < seconds
    middle = A.ground(0j)
    assert abs(guess.turn * middle + guess.shift - turn * middle - shift) < metres, "camera b's ground is shifted"


def registered(
    b: Station, people: list[Walker], rng: np.random.Generator, max_lag_s: float = 0.0, **options: float
) -> PairRegistration:
    return register_pair(0, 1, seen_by(A, people, rng, **options), seen_by(b, people, rng, **options), max_lag_s)


@pytest.mark.parametrize("degrees", [0.0, 37.0, -100.0, 180.0])
def test_turn_and_shift_are_found(degrees: float) -> None:
    rng = np.random.default_rng(1)
    found = registered(facing(degrees), walkers(6, rng), rng)
    assert (found.a, found.b) == (0, 1)
    assert_found(found.candidates[0], facing(degrees), seconds=1e-12)
    assert found.runner_up < 0.3


@pytest.mark.parametrize(("lag_s", "fps"), [(-5.0, 5.0), (-3.3, 5.0), (0.0, 5.0), (0.26, 5.0), (1.37, 25.0), (4.8, 5.0)])
def test_the_lag_is_found_within_a_tenth_of_a_second(lag_s: float, fps: float) -> None:
    """Whatever the frame rate of the other camera."""
    rng = np.random.default_rng(2)
    b = facing(120.0, delay_s=lag_s, fps=fps)
    found = registered(b, walkers(6, rng), rng, 5.0, cut_s=6.0)
    assert_found(found.candidates[0], b)
    assert found.runner_up < 0.4


def test_people_that_one_camera_sees_alone_do_not_mislead() -> None:
    """As many strangers as common people on each side, and some who stand."""
    rng = np.random.default_rng(4)
    b = facing(-60.0, delay_s=-2.2)
    common = [*walkers(5, rng), *standing(3, rng)]
    tracks_a = seen_by(A, [*common, *walkers(5, rng), *standing(2, rng)], rng, cut_s=8.0)
    tracks_b = seen_by(b, [*walkers(5, rng), *common, *standing(2, rng)], rng, cut_s=8.0)
    found = register_pair(0, 1, tracks_a, tracks_b, 4.0)
    guess = found.candidates[0]
    assert_found(guess, b)
    assert found.runner_up < 0.5
    # Person p of a, of 15, is person p + 5 of b; tracklets of a person are 15 apart.
    right = (guess.tracklets_a % 15 < 8) & (guess.tracklets_a % 15 + 5 == guess.tracklets_b % 15)
    assert guess.weight[right].sum() > 0.9 * guess.weight.sum()


def test_people_who_only_stand_tell_the_place_but_not_the_lag() -> None:
    rng = np.random.default_rng(5)
    b, people = facing(90.0), standing(6, rng)
    in_step = registered(b, people, rng)
    assert_found(in_step.candidates[0], b, seconds=1e-12)
    assert in_step.runner_up < 0.75
    assert registered(b, people, rng, 3.0).runner_up > 0.9, "one lag looks better than the others"


@pytest.mark.parametrize("seed", range(4))
def test_cameras_that_see_different_people_have_no_clear_best(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    b = facing(70.0)
    tracks_a, tracks_b = (seen_by(station, walkers(6, rng), rng, cut_s=4.0) for station in (A, b))
    found = register_pair(0, 1, tracks_a, tracks_b, 5.0)
    same = registered(b, walkers(6, rng), rng, 5.0, cut_s=4.0)
    assert found.runner_up > 0.6
    assert found.candidates[0].score < 0.15 * same.candidates[0].score
    assert same.runner_up < 0.2


@pytest.mark.parametrize("scale", [0.9, 1.1])
def test_the_ratio_of_the_scales_is_found(scale: float) -> None:
    rng = np.random.default_rng(6)
    b = facing(150.0, scale=scale)
    guess = registered(b, walkers(8, rng, 60.0), rng, seconds=60.0).candidates[0]
    assert_found(guess, b)
    assert abs(guess.turn) == pytest.approx(scale, abs=0.025)


def test_likeness_decides_where_the_ground_cannot() -> None:
    """Two people walk as each other's mirror images about a point: turned by half a turn about it, all fits as well."""
    rng = np.random.default_rng(7)
    (one,) = walkers(1, rng)
    people = [one, Walker(one.seconds, -one.points)]
    b = facing(100.0)
    tracks_a, tracks_b = (seen_by(station, people, rng, cut_s=4.0) for station in (A, b))
    assert register_pair(0, 1, tracks_a, tracks_b, 0.0).runner_up > 0.8
    person_a, person_b = (np.arange(int(tracks.tracklet.max()) + 1) % 2 for tracks in (tracks_a, tracks_b))
    alike = np.where(person_a[:, None] == person_b, 3.0, -12.0)
    right = register_pair(0, 1, tracks_a, tracks_b, 0.0, alike)
    assert_found(right.candidates[0], b, degrees=3.0)
    assert right.runner_up < 0.3
    wrong = register_pair(0, 1, tracks_a, tracks_b, 0.0, -9.0 - alike).candidates[0]
    assert abs(np.angle(wrong.turn / A.motion_to(b)[0])) > np.deg2rad(175.0)


def test_from_the_other_camera_the_motion_is_the_inverse_and_the_same_tracks_give_the_same_bits() -> None:
    rng = np.random.default_rng(8)
    b, people = facing(45.0, delay_s=1.2), walkers(6, rng)
    tracks_a, tracks_b = seen_by(A, people, rng), seen_by(b, people, rng)
    first, second = (register_pair(0, 1, tracks_a, tracks_b, 3.0).candidates for _ in range(2))
    there, back = first[0], register_pair(1, 0, tracks_b, tracks_a, 3.0).candidates[0]
    assert abs(np.angle(there.turn * back.turn)) < np.deg2rad(0.5)
    assert there.lag_s == pytest.approx(-back.lag_s, abs=0.05)
    middle = A.ground(0j)
    assert abs(back.turn * (there.turn * middle + there.shift) + back.shift - middle) < 0.3
    bits = [[(guess.score, guess.turn, guess.shift, guess.lag_s) for guess in one] for one in (first, second)]
    assert bits[0] == bits[1] == sorted(bits[0], key=lambda guess: -guess[0])


def test_at_one_instant_a_tracklet_has_one_partner() -> None:
    """Camera b sees everyone twice, half a step apart; camera a's tracklets are matched to one of the two at a time."""
    rng = np.random.default_rng(9)
    b, people = facing(30.0), walkers(5, rng)
    doubles = [Walker(who.seconds, who.points + 0.2) for who in people]
    tracks_a, tracks_b = seen_by(A, people, rng), seen_by(b, [*people, *doubles], rng, cut_s=10.0)
    guess = register_pair(0, 1, tracks_a, tracks_b, 0.0).candidates[0]
    assert_found(guess, b)
    assert len(guess.tracklets_a) > len(people), "each person has a partner after another"
    lag = round(guess.lag_s / STEP_S)
    taken_a, taken_b = set(), set()
    for i, j in zip(guess.tracklets_a.tolist(), guess.tracklets_b.tolist(), strict=True):
        common = set(tracks_a.step[tracks_a.tracklet == i] + lag) & set(tracks_b.step[tracks_b.tracklet == j])
        for taken, own in ((taken_a, {(i, step) for step in common}), (taken_b, {(j, step) for step in common})):
            assert len(taken & own) <= 0.2 * len(own), "but for a few samples where two tracklets touch"
            taken |= own


def test_a_crowd_is_registered_by_a_part_of_its_encounters() -> None:
    """More encounters than are counted, and far more than one person's."""
    rng = np.random.default_rng(10)
    b = facing(-140.0, delay_s=0.8)
    people = [*walkers(22, rng, 60.0), *standing(8, rng)]
    found = registered(b, people, rng, 1.5, seconds=60.0)
    assert_found(found.candidates[0], b)
    assert found.runner_up < 0.5


def test_far_cameras_are_registered_as_near_ones() -> None:
    """Shifts are counted on a torus 96 metres round."""
    rng = np.random.default_rng(11)
    b, people = Station(A.turn + 1.0, 90.0 + 90.0j), walkers(6, rng)
    tracks_a, tracks_b = seen_by(A, people, rng), seen_by(b, people, rng, height=12.0, noise_share=0.005)
    assert abs(A.motion_to(b)[1]) > 96.0
    assert_found(register_pair(0, 1, tracks_a, tracks_b, 0.0).candidates[0], b, metres=2.0)


def test_without_tracks_or_common_time_there_is_no_guess() -> None:
    rng = np.random.default_rng(12)
    people = walkers(3, rng)
    some, none = seen_by(A, people, rng), seen_by(A, people, rng, seconds=0.5)
    assert len(none) == 0
    later = seen_by(Station(0.4, delay_s=600.0), people, rng)
    for pair in ((some, none), (none, some), (none, none), (some, later), (later, some)):
        found = register_pair(0, 1, *pair, 5.0)
        assert (found.candidates, found.runner_up) == ((), 1.0)
        assert [len(column) for column in score_motion(*pair, 1 + 0j, 0j, 0.0)] == [0, 0, 0, 0]


@given(seed=st.integers(0, 10_000), spread=st.sampled_from([0.5, 6.0, 60.0]), max_lag_s=st.sampled_from([0.0, 2.0]))
def test_scraps_of_tracks_never_fail(seed: int, spread: float, max_lag_s: float) -> None:
    rng = np.random.default_rng(seed)
    level = Level(UP, 4.0, 0.0)

    def scraps() -> GroundTracks:
        n = int(rng.integers(0, 12))
        position, velocity = rng.normal(0, spread, (2, n)), rng.normal(0, 1, (2, n))
        step, tracklet = np.sort(rng.integers(-5, 6, n)), rng.integers(0, 4, n)
        place, moving = position[0] + 1j * position[1], velocity[0] + 1j * velocity[1]
        return GroundTracks(level, Tolerance(), step, tracklet, place, moving)

    found = register_pair(0, 1, scraps(), scraps(), max_lag_s)
    for guess in found.candidates:
        assert np.isfinite([guess.turn, guess.shift]).all()
        assert abs(guess.lag_s) <= max_lag_s + STEP_S
        assert 0.7 - 1e-9 <= abs(guess.turn) <= 1.4 + 1e-9


def test_agreement_counts_common_samples() -> None:
    rng = np.random.default_rng(14)
    b, people = facing(25.0, delay_s=1.0), [*walkers(3, rng), Walker(np.array([-10.0, 100.0]), np.array([50j, 50j]))]
    tracks_a, tracks_b = (seen_by(station, people, rng, noise_m=0.0, noise_share=0.0) for station in (A, b))
    i, j, value, samples = score_motion(tracks_a, tracks_b, *A.motion_to(b))
    assert len(i) == 16, "every two tracklets have common samples"
    # Both cameras run for 40 seconds; camera b's grid is camera a's, two steps on.
    np.testing.assert_array_equal(samples, samples[0])
    assert samples[0] >= 2 * 38
    np.testing.assert_allclose(value[i == j], samples[i == j], rtol=1e-3)
    far = (i != j) & ((i == 3) | (j == 3))
    np.testing.assert_array_equal(value[far], -samples[far])
    assert (value[i != j] < 0.3 * samples[i != j]).all()


def half_missed(tracks: GroundTracks, rng: np.random.Generator) -> GroundTracks:
    """The tracks of a detector that loses everybody for three seconds again and again, more often than not."""
    stretch = ((tracks.step * STEP_S + 20.0) // 3.0).astype(np.int64)
    kept = rng.uniform(size=(1000, 100))[tracks.tracklet, stretch] < 0.35
    tracklet = 100 * tracks.tracklet + stretch
    return replace(
        tracks, step=tracks.step[kept], tracklet=tracklet[kept], position=tracks.position[kept], velocity=tracks.velocity[kept]
    )


B = Station(2.2, 4.0 + 11.0j)


@pytest.mark.parametrize("seed", range(3))
def test_half_of_the_people_missed_is_still_clear_of_chance(seed: int) -> None:
    rng = np.random.default_rng(seed)
    people = walkers(8, rng)
    found = register_pair(0, 1, *(half_missed(seen_by(station, people, rng), rng) for station in (A, B)), 5.0)
    assert found.candidates[0].share < 0.45, "else the share alone would do"
    assert found.clear_of_chance
    assert_found(found.candidates[0], B, degrees=180.0, metres=1.0, seconds=np.inf)
    assert view_graph([found], 2).edges[0].used


@pytest.mark.parametrize("seed", range(6))
def test_strangers_are_not_clear_of_chance(seed: int) -> None:
    rng = np.random.default_rng(10 + seed)
    tracks = [half_missed(seen_by(station, walkers(8, rng), rng), rng) for station in (A, B)]
    found = register_pair(0, 1, *tracks, 5.0)
    assert not found.clear_of_chance
    assert not view_graph([found], 2).edges[0].used
