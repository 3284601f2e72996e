"""Which people meet by a calibrated rig, against people whose places are known, and tracklets joined to people."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from passerby.association.correlation_clustering import cluster_tracklets, find_overlaps
from passerby.association.ground.ray_affinity import RayTracks, pairwise_ray_affinity, ray_tracks
from passerby.association.sampling import STEP_S
from passerby.core.cameras import Pose
from passerby.people.sightings import Sightings
from support.scenes.people_and_rigs import looking_at

BODY_M = 1.72
FAR = looking_at((9.0, -3.0, 3.0), (0, 0, 1))
NEAR = looking_at((-2.0, -8.0, 2.2), (0, 0, 1))


@dataclass(frozen=True, eq=False)
class People:
    """Walkers on a circle of 1 m each, about a middle of their own, on ground that climbs along x."""

    middle: np.ndarray
    """(P, 2)"""
    slope: float = 0.0
    apart: float = 2.0
    """Radians, of one walker after another; 0 where they walk in step."""

    def feet(self, person: np.ndarray, seconds: np.ndarray) -> np.ndarray:
        angle = 1.2 * seconds + self.apart * person
        xy = self.middle[person] + np.column_stack([np.cos(angle), np.sin(angle)])
        return np.column_stack([xy, self.slope * xy[:, 0]])

    def seen_from(
        self, pose: Pose, *, late_s: float = 0.0, noise: float = 0.0, seconds: float = 20.0, unknown: int = -1
    ) -> RayTracks:
        """By a camera whose clock shows so much more than the time; the tracklet numbers are the people's, one is in none."""
        rng, n = np.random.default_rng(len(self.middle)), len(self.middle)
        time = np.tile(np.arange(0.0, seconds, 0.1), n)
        person = np.repeat(np.arange(n), len(time) // n)
        height = BODY_M * (1 + 0.03 * np.cos(5 * person))[:, None] * [0.0, 0.0, 1.0]
        feet = self.feet(person, time)
        jitter = noise * BODY_M * rng.standard_normal((2, len(time), 3))
        top, bottom = (_rays(pose, points) for points in (feet + height + jitter[0], feet + jitter[1]))
        none = np.zeros(len(time))
        bodies = Sightings(
            np.zeros(len(time), np.int64), np.arange(len(time)), np.where(person == unknown, -1, person),
            seconds=time + late_s, top=top, bottom=bottom, top_fraction=none + 1, bottom_fraction=none,
        )  # fmt: skip
        return ray_tracks(bodies.take(rng.permutation(len(time))), pose)


def _rays(pose: Pose, points: np.ndarray) -> np.ndarray:
    rays = (points - pose.centre) @ pose.R_cw.T
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def table(a: RayTracks, b: RayTracks, n: int, lag_s: float = 0.0) -> np.ndarray:
    """(n, n) the mean value of a common sample; NaN where there is none."""
    i, j, value = pairwise_ray_affinity(a, b, lag_s, BODY_M)
    assert len(set(zip(i.tolist(), j.tolist(), strict=True))) == len(i)
    count = np.full((n, n), np.nan)
    for k, m in zip(i, j, strict=True):
        in_b = b.step[b.tracklet == m] - round(lag_s / STEP_S)
        count[k, m] = np.isin(a.step[a.tracklet == k], in_b).sum()
    found = np.full((n, n), np.nan)
    found[i, j] = value
    return np.asarray(found / count)


def assert_told_apart(found: np.ndarray) -> None:
    """One person's samples are worth 0.86 to 0.99 here, the most alike of two people's -0.21."""
    same = np.eye(len(found), dtype=bool)
    assert (found[same] > 0.8).all(), found.round(2)
    assert (found[~same] < -0.1).all(), found.round(2)


CROWD = People(np.array([[0.0, 0.0], [3.0, 2.0], [-4.0, 3.0], [1.0, -4.0]]))
LOW = looking_at((9.0, -3.0, 1.6), (0, 0, 1))


@pytest.mark.parametrize(
    ("first", "second", "slope"),
    [
        pytest.param(FAR, NEAR, 0.0, id="level ground"),
        pytest.param(LOW, NEAR, 0.05, id="a low camera sees feet on a slope metres beside the ground at height 0"),
        pytest.param(LOW, NEAR, -0.05, id="falling"),
        pytest.param(FAR, looking_at(tuple(FAR.centre), (0.0, 1.5, 1.0)), 0.0, id="at one place: ground and sizes tell"),
    ],
)
def test_people_meet_themselves_and_no_one_else(first: Pose, second: Pose, slope: float) -> None:
    people = People(CROWD.middle, slope)
    assert_told_apart(table(people.seen_from(first, noise=0.02), people.seen_from(second, noise=0.02), 4))


def test_the_sum_grows_with_every_common_sample_and_is_at_most_one_each() -> None:
    short = pairwise_ray_affinity(CROWD.seen_from(FAR, seconds=10), CROWD.seen_from(NEAR, seconds=10), 0.0, BODY_M)
    long = pairwise_ray_affinity(CROWD.seen_from(FAR), CROWD.seen_from(NEAR), 0.0, BODY_M)
    for i, j, value, samples in (*zip(*short, [20] * 16, strict=True), *zip(*long, [40] * 16, strict=True)):
        assert abs(value) <= samples
        assert (value > 0.8 * samples) == (i == j)


@pytest.mark.parametrize("across", [(1.5, 0.0), (0.0, 1.5), (1.06, 1.06), (-1.06, 1.06)])
def test_two_people_side_by_side_do_not_meet(across: tuple[float, float]) -> None:
    """They walk in step, so that only the place tells them apart."""
    middle = np.array([[0.0, 0.0], across, [-4.0, 3.0], [4.0, 4.0]])
    walk = People(middle, apart=0.0)
    high = looking_at((9.0, -3.0, 4.5), (0, 0, 1)), looking_at((-2.0, -8.0, 4.5), (0, 0, 1))
    first, second = (walk.seen_from(pose, noise=0.02) for pose in high)
    assert_told_apart(table(first, second, 4))
    # Low cameras, 3.0 and 2.2 m high, tell less of the distance; but one person still fits much better than two.
    found = table(walk.seen_from(FAR, noise=0.02), walk.seen_from(NEAR, noise=0.02), 4)
    assert (np.diag(found) - np.where(np.eye(4) > 0, -1, found).max(axis=1) > 0.3).all()


def test_people_behind_a_camera_do_not_meet() -> None:
    """Two cameras at one place and at half a body's height, back to back, and two people opposite each other all the time."""
    here = 0.5 * BODY_M
    first, second = (looking_at((0, 0, here), (x, 0, here)) for x in (6, -6))
    opposite = People(np.array([[6.0, 0.0], [-6.0, 0.0]]), apart=np.pi)
    met = pairwise_ray_affinity(opposite.seen_from(first, unknown=1), opposite.seen_from(second, unknown=0), 0.0, BODY_M)
    assert [column.tolist() for column in met] == [[0], [1], [-40.0]]


@pytest.mark.parametrize("lag_s", [2.0, -1.5, 0.7, -0.25])
def test_the_lag_is_what_camera_bs_clock_shows_more(lag_s: float) -> None:
    here, there = CROWD.seen_from(FAR), CROWD.seen_from(NEAR, late_s=lag_s)
    assert_told_apart(table(here, there, 4, lag_s))
    in_step = np.diag(table(CROWD.seen_from(FAR), CROWD.seen_from(NEAR), 4)).mean()
    np.testing.assert_allclose(np.diag(table(here, there, 4, lag_s)).mean(), in_step, atol=0.03)
    if abs(lag_s) > 1:
        assert np.diag(table(here, there, 4, -lag_s)).mean() < in_step - 0.2


def test_people_in_no_tracklet_or_never_seen_at_one_time_do_not_meet() -> None:
    i, j, _ = pairwise_ray_affinity(CROWD.seen_from(FAR, unknown=1), CROWD.seen_from(NEAR, unknown=2), 0.0, BODY_M)
    assert (set(i.tolist()), set(j.tolist())) == ({0, 2, 3}, {0, 1, 3})
    apart = pairwise_ray_affinity(CROWD.seen_from(FAR), CROWD.seen_from(NEAR, late_s=500.0), 0.0, BODY_M)
    assert [len(column) for column in apart] == [0, 0, 0]


NEVER = -1e9
"""Weight of two tracklets that cannot be one person."""
Edge = tuple[int, int, float]
SQUARE = [(0, 1, 5.0), (2, 3, 5.0), (1, 2, 2.0)]
"""0 with 1 and 2 with 3 join first; then the sum between the two groups decides."""
EDGES = st.lists(st.tuples(st.integers(0, 8), st.integers(0, 8), st.floats(-10, 10)), max_size=40)
PAIRS = st.lists(st.tuples(st.integers(0, 8), st.integers(0, 8)).filter(lambda pair: pair[0] != pair[1]), max_size=12)


def joined(n: int, *edges: Edge) -> list[int]:
    first, second, weight = (np.array(column) for column in zip(*edges, strict=True)) if edges else (np.zeros(0),) * 3
    return cluster_tracklets(n, first.astype(np.int64), second.astype(np.int64), weight.astype(np.float64)).tolist()


@pytest.mark.parametrize(
    ("edges", "people"),
    [
        ([], [0, 1, 2]),
        ([(0, 3, 0.1), (1, 2, -0.1)], [0, 1, 2, 0]),
        (SQUARE, [0, 0, 0, 0]),
        ([*SQUARE, (0, 3, -2.5)], [0, 0, 1, 1]),
        ([*SQUARE, (0, 3, -1.5)], [0, 0, 0, 0]),
        # Tracklet 1 fits both 0 and 2, who are two people: the stronger joins first.
        ([(0, 1, 1.0), (1, 2, 3.0), (0, 2, NEVER)], [0, 1, 1]),
        ([(0, 1, 3.0), (1, 2, 1.0), (0, 2, NEVER)], [0, 0, 1]),
        # Edges that stand twice are added, and loops say nothing.
        ([(0, 1, 1.0), (1, 0, -2.0)], [0, 1]),
        ([(0, 1, -1.0), (1, 0, 2.0), (0, 0, NEVER)], [0, 0]),
        # Never reaches through a chain; one cut is enough, at the weakest link.
        ([(0, 5, NEVER), *((i, i + 1, 10.0 - i) for i in range(5))], [0, 0, 0, 0, 0, 1]),
    ],
)  # fmt: skip
def test_tracklets_are_joined_by_the_sums_between_groups(edges: list[Edge], people: list[int]) -> None:
    assert joined(len(people), *edges) == people


@given(edges=EDGES, never=PAIRS)
def test_never_is_never_broken_and_no_two_groups_are_left_that_gain_by_joining(
    edges: list[Edge], never: list[tuple[int, int]]
) -> None:
    """And groups are numbered by their first members."""
    group = joined(9, *edges, *((i, j, NEVER) for i, j in never))
    assert len(group) == 9
    assert all(group[i] != group[j] for i, j in never)
    group = joined(9, *edges)
    between = np.zeros((9, 9))
    for i, j, weight in edges:
        if group[i] != group[j]:
            between[group[i], group[j]] += weight
            between[group[j], group[i]] += weight
    assert between.max() < 1e-9
    assert list(dict.fromkeys(group)) == list(range(max(group) + 1))


@given(sizes=st.lists(st.integers(1, 4), min_size=1, max_size=5), seed=st.integers(0, 1000))
def test_clear_people_are_found_as_they_are(sizes: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    person = rng.permutation(np.repeat(np.arange(len(sizes)), sizes))
    first, second = np.triu_indices(len(person), 1)
    weight = np.where(person[first] == person[second], 1.0, -1.0) * rng.uniform(0.1, 5.0, len(first))
    group = cluster_tracklets(len(person), first, second, weight)
    np.testing.assert_array_equal(group[:, None] == group, person[:, None] == person)


@given(
    spans=st.lists(st.tuples(st.integers(0, 20), st.integers(0, 12)), max_size=14), slack=st.sampled_from([0.0, 0.3, 1.5, 4.0])
)
def test_overlaps_are_those_that_brute_force_finds(spans: list[tuple[int, int]], slack: float) -> None:
    start = np.array([begin for begin, _ in spans], dtype=np.float64)
    end = start + np.array([length for _, length in spans], dtype=np.float64)
    i, j = find_overlaps(start, end, slack)
    found = list(zip(i.tolist(), j.tolist(), strict=True))
    wanted = {(m, n) for n in range(len(spans)) for m in range(n) if min(end[m], end[n]) - max(start[m], start[n]) > slack}
    assert (len(found), set(found)) == (len(set(found)), wanted)
