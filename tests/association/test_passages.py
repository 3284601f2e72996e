"""Two groups of cameras registered by people who pass from one to the other: the motion, its chance, and strangers."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.association.ground.common_sightings import compare_people, refine_by_sightings
from passerby.association.ground.pair_matching import GroundMotion
from passerby.association.ground.passages import Passage, TrackEnds, find_track_ends, register_by_passages
from passerby.core.observations import CameraObservations, Observations
from passerby.people.ground_positions import COLUMNS, Places
from passerby.simulation import SimulationOptions, simulate

TRUE = GroundMotion(np.exp(1j * np.deg2rad(70.0)), 12.0 - 5.0j, 1.7)
DOOR = 3.0 + 4.0j
LAGS = (-5.0, 5.0)


def ends(rng: np.random.Generator, count: int, *, seconds: float = 600.0) -> TrackEnds:
    """People who come and go at other places of a hall of 20 by 20 m."""
    place = rng.uniform(-10, 10, (count, 2)) @ np.array([1, 1j]) + DOOR
    heading = np.exp(2j * np.pi * rng.uniform(size=count))
    return TrackEnds(
        rng.choice([-1.0, 1.0], count), np.sort(rng.uniform(0, seconds, count)), place, 1.3 * heading,
        np.ones((count, 2), dtype=bool),
    )  # fmt: skip


def passing(rng: np.random.Generator, count: int, motion: GroundMotion, gap_s: float) -> tuple[TrackEnds, TrackEnds]:
    """People who walk through a door, the ends of their tracks `gap_s` apart, seen by either side with noise."""
    time, out = np.sort(rng.uniform(0, 600, count)), rng.choice([-1.0, 1.0], count)
    door = DOOR + 0.5j * rng.normal(size=count)
    velocity = 1.3 * out * np.exp(1j * np.deg2rad(rng.normal(0, 20, count)))
    noise = [0.15 * rng.normal(size=(count, 2)) @ np.array([1, 1j]) for _ in range(2)]
    turned = [velocity * np.exp(1j * np.deg2rad(rng.normal(0, 15, count))) for _ in range(2)]
    # Half of the gap on either side: who walks out is last seen by the first group, and then seen by the second.
    first = TrackEnds(
        out, time - out * gap_s / 2, door - velocity * out * gap_s / 2 + noise[0], turned[0], np.tile([True, False], (count, 1))
    )
    there = motion.turn * (door + velocity * out * gap_s / 2) + motion.shift
    second = TrackEnds(
        -out, time + out * gap_s / 2 + motion.lag_s, there + noise[1], motion.turn * turned[1],
        np.tile([False, True], (count, 1)),
    )  # fmt: skip
    return first, second


def in_corridor(rng: np.random.Generator, count: int) -> TrackEnds:
    """Ends of tracks all along a corridor of 200 m."""
    place = DOOR + rng.uniform(-100, 100, count) + 1j * rng.uniform(-4, 4, count)
    return replace(ends(rng, count), place=place)


def test_ends_are_where_people_are_first_and_last_seen() -> None:
    scene = simulate(SimulationOptions(seed=3, seconds=20.0, cameras=3))
    found = find_track_ends(scene.rig, scene.observations, 1.72)
    assert len(found) >= 2 * scene.ground_positions.shape[1]
    assert found.sense.sum() == 0
    assert found.seen_by.any(axis=1).all()
    true = scene.ground_positions @ np.array([1, 1j])  # (T, P)
    at = np.round(found.time_s * 5.0).astype(int)
    apart = np.nanmin(np.abs(true[at] - found.place[:, None]), axis=1)
    assert np.median(apart) < 0.15
    nobody = Observations({name: CameraObservations() for name in scene.rig.names}, scene.observations.fps)
    assert len(find_track_ends(scene.rig, nobody, 1.72)) == 0


@pytest.mark.parametrize("gap_s", [-1.0, 0.8])
def test_people_who_pass_a_door_register_two_groups(gap_s: float) -> None:
    rng = np.random.default_rng(3)
    first, second = passing(rng, 60, TRUE, gap_s)
    found = register_by_passages(TrackEnds.joined([first, ends(rng, 120)]), TrackEnds.joined([second, ends(rng, 120)]), LAGS)
    assert found.clear
    assert found.motion.lag_s == pytest.approx(TRUE.lag_s, abs=0.2)
    assert abs(found.motion.turn * DOOR + found.motion.shift - TRUE.turn * DOOR - TRUE.shift) < 0.3
    assert abs(np.angle(found.motion.turn / TRUE.turn)) < np.deg2rad(12)
    assert abs(found.place - DOOR) < 1.0
    assert found.cameras.argmax() == 1  # the first group's first camera, and the second group's second one
    assert found.cameras[0, 1] > 40


@pytest.mark.parametrize(("count", "corridor", "hall"), [(15, 1500, 200), (20, 3000, 400)])
def test_a_door_is_found_in_a_long_corridor(count: int, corridor: int, hall: int) -> None:
    """A few people pass among the ends of other tracks; in the second case these have as many votes by chance."""
    rng = np.random.default_rng(4)
    first, second = passing(rng, count, TRUE, 0.8)
    others = in_corridor(rng, corridor), ends(rng, hall)
    found = register_by_passages(TrackEnds.joined([first, others[0]]), TrackEnds.joined([second, others[1]]), LAGS)
    assert found.clear
    assert abs(found.place - DOOR) < 1.0
    assert abs(np.angle(found.motion.turn / TRUE.turn)) < np.deg2rad(20)


def with_doors(rng: np.random.Generator, first: complex) -> TrackEnds:
    """Three doors, where 80 tracks end at any time."""
    parts = [ends(rng, 300)]
    for number in range(3):
        busy, spread = ends(rng, 80), 0.5 * rng.normal(size=(80, 2)) @ np.array([1, 1j])
        parts.append(replace(busy, place=first + 12.0 * number + spread))
    return TrackEnds.joined(parts)


def test_strangers_and_busy_doors_that_are_not_shared_join_nothing() -> None:
    """Chance is what the same two doors reach at other lags."""
    for seed in range(4):
        rng = np.random.default_rng(seed)
        found = [register_by_passages(ends(rng, 150), ends(rng, 150), LAGS)]
        if seed < 3:
            rng = np.random.default_rng(seed)
            found += [register_by_passages(with_doors(rng, DOOR), with_doors(rng, 40.0 - 30.0j), LAGS)]
        assert all(one is None or one.votes < one.needed for one in found)
    nobody, some = ends(rng, 0), ends(rng, 50)
    assert register_by_passages(nobody, some, LAGS) is register_by_passages(some, nobody, LAGS) is None


def test_crowds_that_come_and_go_together_are_not_joined() -> None:
    """Trains: people leave a hall by one door when others, who were not seen before, enter another hall by one door."""
    rng = np.random.default_rng(1)
    crowd = np.repeat(np.arange(30.0, 600.0, 60.0), 8)

    def at_door(sense: float, door: complex) -> TrackEnds:
        count = len(crowd)
        place = door + 0.4 * rng.normal(size=(count, 2)) @ np.array([1, 1j])
        velocity = 1.3 * np.exp(1j * np.deg2rad(rng.normal(0, 20, count)))
        seen = np.ones((count, 2), dtype=bool)
        return TrackEnds(np.full(count, sense), np.sort(crowd + rng.uniform(-15, 15, count)), place, velocity, seen)

    found = register_by_passages(at_door(1.0, DOOR), at_door(-1.0, 5.0 + 1.0j), LAGS)
    assert found.votes > 40
    assert found.votes < found.needed


def seen_at(rng: np.random.Generator, person: np.ndarray, time_s: np.ndarray, place: np.ndarray, start_s: float) -> Places:
    """Boxes of one camera at instants 0.2 s apart."""
    step = np.round((time_s - start_s) / 0.2).astype(np.int64)
    order = np.argsort(step, kind="stable")
    noisy = place[order] + 0.15 * rng.normal(size=(len(order), 2)) @ np.array([1, 1j])
    n = len(order)
    return Places(
        step[order], np.zeros(n, np.int64), np.arange(n), np.full(n, -1), np.column_stack([noisy.real, noisy.imag]),
        np.tile(0.15**2 * np.eye(2), (n, 1, 1)), np.ones(n, dtype=bool), np.zeros((n, 4)), 0.2, np.zeros((1, 3)), start_s,
    )  # fmt: skip


def walks_through(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Persons, times and places of people who are in a door for a moment."""
    person, since = np.arange(count).repeat(8), np.tile(np.arange(8) * 0.2, count)
    begin = np.sort(rng.uniform(0, 600, count)).repeat(8)
    direction = np.exp(1j * np.deg2rad(rng.normal(0, 30, count))).repeat(8)
    return person, begin + since, DOOR + 0.5j * rng.normal(size=count).repeat(8) + 1.3 * direction * (since - 0.7)


def turned_wrongly() -> Passage:
    wrong = TRUE.turn * np.exp(1j * np.deg2rad(-25.0))
    first = GroundMotion(wrong, TRUE.turn * DOOR + TRUE.shift - wrong * DOOR, TRUE.lag_s)
    return Passage(first, DOOR, 60, 10, np.ones((1, 1), np.int64))


def both_see(rng: np.random.Generator, person: np.ndarray, time_s: np.ndarray, place: np.ndarray) -> tuple[Places, Places]:
    there = TRUE.turn * place + TRUE.shift
    return seen_at(rng, person, time_s, place, 0.0), seen_at(rng, person, time_s + TRUE.lag_s, there, 1.7)


def test_what_both_sides_see_of_a_door_shows_the_turn_even_if_people_wait_there() -> None:
    """Then ten wait on each side for minutes, seen by one group each: their boxes meet at any time."""
    rng = np.random.default_rng(7)
    found = [refine_by_sightings(turned_wrongly(), *both_see(rng, *walks_through(rng, 60)))]
    rng = np.random.default_rng(8)
    (person, time_s, place), n = walks_through(rng, 60), 3000

    def seen(side: complex, turn: complex, shift: complex, lag_s: float, start_s: float) -> Places:
        who = rng.integers(0, 10, n)
        spot = DOOR + side + 0.7 * rng.normal(size=(10, 2)) @ np.array([1, 1j])
        times = np.concatenate([time_s, rng.uniform(0, 600, n)]) + lag_s
        return seen_at(
            rng, np.concatenate([person, who + 100]), times, turn * np.concatenate([place, spot[who]]) + shift, start_s
        )

    here, there = seen(-2.0, 1.0, 0.0, 0.0, 0.0), seen(2.0, TRUE.turn, TRUE.shift, TRUE.lag_s, 1.7)
    found.append(refine_by_sightings(turned_wrongly(), here, there))
    for one in found:
        assert abs(np.angle(one.motion.turn / TRUE.turn)) < np.deg2rad(2)
        assert abs(one.motion.turn * DOOR + one.motion.shift - TRUE.turn * DOOR - TRUE.shift) < 0.1


def test_the_turn_stays_open_where_nothing_shows_it() -> None:
    rng, passage = np.random.default_rng(7), turned_wrongly()
    person, time_s, place = walks_through(rng, 60)
    still = both_see(rng, person, time_s, DOOR + 0 * place)
    exact = [replace(side, place=np.tile(side.place[:1], (len(side), 1))) for side in still]
    for sides in (still, exact, (still[0], still[1].take(np.zeros(0, np.int64)))):
        assert refine_by_sightings(passage, *sides).motion is passage.motion


def of_camera(places: Places, camera: int, identity: np.ndarray) -> Places:
    """Boxes, in the order in which they were made, as those of one of two cameras, with identities."""
    order = np.argsort(places.step, kind="stable")
    return replace(places, camera=np.full(len(order), camera), identity=identity, centre=np.zeros((2, 3)))


def both(first: Places, second: Places) -> Places:
    """All boxes of two cameras, in the order of time."""
    rows = {name: np.concatenate([getattr(first, name), getattr(second, name)]) for name in COLUMNS}
    found = replace(first, **rows)
    return found.take(np.argsort(found.step, kind="stable"))


def test_people_are_one_who_are_at_one_place_whenever_both_groups_see_them() -> None:
    rng, passage = np.random.default_rng(9), replace(turned_wrongly(), motion=TRUE)
    person, time_s, place = walks_through(rng, 12)
    a, b = both_see(rng, person, time_s, place)
    first = of_camera(a, 0, person)
    # The person that the second group knows as 105 is seen far away from 5 at other times: two people that it takes for one.
    elsewhere = np.full(60, 5), np.linspace(300.0, 310.0, 60), np.full(60, DOOR + 8.0)
    far, near = both_see(rng, *elsewhere)
    wrong = replace(near, place=near.place + 20.0)
    first = both(first, of_camera(far, 0, elsewhere[0]))
    second = both(of_camera(b, 0, person + 100), of_camera(wrong, 0, elsewhere[0] + 100))
    # The other camera of the second group shows a stranger beside one of them for a second.
    stranger = both_see(rng, np.full(5, 7), time_s[person == 7][:5], place[person == 7][:5] + 0.2)[1]
    alike = compare_people(passage, first, both(second, of_camera(stranger, 1, np.full(5, 200))))
    assert sorted(alike.pairs.tolist()) == sorted([[k, k + 100] for k in range(12) if k != 5] + [[7, 200]])
    assert alike.pairs.tolist().index([7, 107]) < alike.pairs.tolist().index([7, 200])
    assert alike.cameras.tolist() == [[0, 0]]
    later = replace(b, step=b.step + 10_000)
    none = compare_people(passage, of_camera(a, 0, person), of_camera(later, 0, person + 100))
    assert (none.pairs.shape, len(none.cameras)) == ((0, 2), 0)
