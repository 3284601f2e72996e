"""Ways against the truth: placed, matched, counted."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.core.observations import Clock
from passerby.core.trajectories import Trajectories
from passerby.evaluation.trajectories import GroundTruth, compare_places, judge, placements
from passerby.geometry.rotations import Similarity
from support.scenes.people_and_rigs import ring

TIMES = np.arange(40) / 5.0


def line(number, times=TIMES):
    """(T, 2) where true person `number` is: lines 3 m apart."""
    return np.column_stack([0.5 * times, 3.0 * number + 0 * times])


def truth(people=(1, 2, 3)):
    return GroundTruth.of(
        np.repeat(people, len(TIMES)), np.tile(TIMES, len(people)), np.concatenate([line(number) for number in people])
    )


def ways(places, sigma=0.1, cameras=3):
    """Trajectories from identity -> (times, (T, 2))."""
    times, xy = (np.concatenate(column) for column in zip(*places.values(), strict=True))
    identity = np.repeat(list(places), [len(one) for one, _ in places.values()])
    n = len(identity)
    return Trajectories(
        identity, np.round(times * 5).astype(int) + 1, times, np.column_stack([xy, np.full(n, 0.9)]), np.full(n, sigma),
        np.full(n, cameras), np.ones(n, int), Clock(5.0),
    )  # fmt: skip


def test_distances_are_those_that_were_put_in():
    found = ways({number: (TIMES, line(number) + (0.0, 0.1 * number)) for number in (1, 2, 3)}, sigma=0.12)
    errors = judge(found, truth(), same_ids=True)
    assert (errors.distances.mean_m, errors.distances.median_m) == pytest.approx((0.2, 0.2))
    assert errors.distances.within == {"0.15": pytest.approx(1 / 3), "0.26": pytest.approx(2 / 3), "0.59": 1.0}
    assert errors.distances.within_sigma == pytest.approx(1 / 3)
    assert errors.covered == 1.0
    assert errors.missing == errors.unmatched == ()
    # Places are told apart by how many cameras saw them.
    found = ways({1: (TIMES, line(1) + (0.0, 0.3))}, cameras=1)
    errors = judge(found, truth(), same_ids=True)
    assert errors.by_cameras["one"].mean_m == pytest.approx(0.3)
    assert errors.by_cameras["several"].places == errors.by_cameras["none"].places == 0
    assert errors.to_dict()["by_cameras"]["none"]["mean_m"] is None


@pytest.mark.parametrize(
    ("times", "places"),
    [(TIMES[:-1] + 0.07, len(TIMES) - 1), (np.concatenate([TIMES, TIMES + 100.0]), len(TIMES))],
    ids=["straight between two true instants", "nothing is compared outside the truth"],
)
def test_the_true_way(times, places):
    errors = judge(ways({1: (times, line(1, times))}), truth(), same_ids=True)
    assert (errors.distances.places, errors.distances.mean_m) == (places, pytest.approx(0.0, abs=1e-9))


def test_people_are_matched_one_to_one_by_where_they_are():
    found = ways({
        70: (TIMES, line(3) + (0.0, 0.1)),
        71: (TIMES[:25], line(1)[:25]),
        72: (TIMES[25:], line(1)[25:]),
        73: (TIMES, line(2) + (0.0, 40.0)),
    })  # fmt: skip
    errors = judge(found, truth())
    assert errors.matched == {70: 3, 71: 1}
    assert errors.unmatched == (72, 73)
    assert errors.missing == (2,)
    assert errors.covered == pytest.approx((40 + 25) / 120)
    assert errors.distances.places == 65


def test_two_who_changed_their_names_half_way_are_half_wrong():
    late = (TIMES[len(TIMES) // 2] <= TIMES)[:, None]
    first, second = np.where(late, line(2), line(1)), np.where(late, line(1), line(2))
    assert judge(ways({1: (TIMES, first), 2: (TIMES, second)}), truth((1, 2))).distances.mean_m == pytest.approx(1.5)


def test_the_estimated_world_is_placed_upon_the_true_one():
    rig = ring(4)
    angle, scale, shift = 0.7, 1.04, np.array([3.0, -2.0, 0.0])
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    estimate = rig.moved(turn, shift, scale)
    motions = placements(estimate, rig)
    moved = {n: (TIMES, (scale * np.column_stack([line(n), 0 * TIMES]) @ turn.T + shift)[:, :2]) for n in (1, 2)}
    found = ways(moved)
    assert judge(found, truth(), motions["similarity"], same_ids=True).distances.mean_m == pytest.approx(0.0, abs=1e-9)
    # By the reference camera the scale's 4 % remain, of the way from there.
    away = [np.linalg.norm(line(n) - rig["C1"].centre[:2], axis=1) for n in (1, 2)]
    metric = judge(found, truth(), motions["metric"], same_ids=True).distances.mean_m
    assert metric == pytest.approx(0.04 * np.mean(away), rel=0.01)
    # Sigmas go with the scale.
    assert judge(ways(moved, sigma=0.1), truth(), Similarity(5.0, turn, shift), same_ids=True).distances.within_sigma == 0.0


def test_the_same_people_by_other_cameras():
    one = ways({1: (TIMES, line(1)), 2: (TIMES, line(2))})
    other = ways({2: (TIMES[5:], line(2)[5:] + (0.2, 0.0)), 3: (TIMES, line(3))})
    apart = compare_places(one, other, Similarity(1.0, np.eye(3), np.zeros(3)))
    assert apart.places == 35
    assert apart.mean_m == pytest.approx(0.2)


def test_rigs_that_share_no_camera():
    rig = ring(3)
    renamed = Rig(tuple(replace(camera, name=f"other {camera.name}") for camera in rig))
    with pytest.raises(InputError, match="names must be the same"):
        placements(renamed, rig)
    with pytest.raises(InputError, match="reference camera C9"):
        placements(rig, rig, "C9")
