"""The view graph on registrations made by hand: what it uses, what it doubts, and what edges say of cameras in space."""

from itertools import combinations

import numpy as np
import pytest

from passerby.association.ambiguity import ambiguity, ambiguous_cameras
from passerby.association.graph import Edge, ViewGraph, view_graph
from passerby.association.ground.registration import PairRegistration, Registration
from passerby.association.initial_association import _hypothesis
from passerby.geometry.rotations import angle_between
from passerby.geometry.single_view import Level
from support.scenes.people_and_rigs import looking_at
from support.scenes.walkers_on_plane import Station

STATIONS = [
    Station(0.3, -12.0 - 2.0j, 0.0),
    Station(1.9, 9.0 - 9.0j, 1.4),
    Station(-2.4, 10.0 + 8.0j, -2.2),
    Station(-0.9, -7.0 + 11.0j, 0.6),
    Station(2.8, 1.0 - 14.0j, 3.1),
]


def guess(turn: complex, shift: complex, lag_s: float, score: float, middle: complex) -> Registration:
    none = np.zeros(0, dtype=np.int64)
    return Registration(turn, shift, lag_s, score, 100, 0.7, middle, none, none, np.zeros(0))


def right(a: int, b: int, score: float = 100.0, *, degrees: float = 0.0, late_s: float = 0.0) -> Registration:
    """The true motion, or one off by a turn about the people and by some seconds."""
    turn, shift, lag_s = STATIONS[a].motion_to(STATIONS[b])
    middle = complex(STATIONS[a].ground(0j))
    off = turn * np.exp(1j * np.deg2rad(degrees))
    return guess(off, turn * middle + shift - off * middle, lag_s + late_s, score, middle)


def wrong(a: int, b: int, score: float) -> Registration:
    """Off by a turn that differs from pair to pair."""
    return right(a, b, score, degrees=70.0 + 31.0 * a + 17.0 * b)


def pair(a: int, b: int, *guesses: Registration) -> PairRegistration:
    return PairRegistration(a, b, tuple(sorted(guesses, key=lambda one: -one.score)))


def among(cameras: range, rival: float = 0.0, *, but: tuple[tuple[int, int], ...] = ()) -> list[PairRegistration]:
    """Every two cameras rightly registered, each with a wrong rival that scores so much if any."""
    both = [two for two in combinations(cameras, 2) if two not in but]
    return [pair(a, b, right(a, b), *([wrong(a, b, rival)] if rival else [])) for a, b in both]


def edge(graph: ViewGraph, a: int, b: int) -> Edge:
    (found,) = (one for one in graph.edges if (one.a, one.b) == (a, b))
    return found


def assert_in_step(graph: ViewGraph, group: tuple[int, ...], seconds: float = 1e-6) -> None:
    """All clocks of a group show the same time when their offsets are added."""
    shown = np.array([STATIONS[c].delay_s + graph.offset_s[c] for c in group])
    np.testing.assert_allclose(shown, shown[0], atol=seconds)
    assert graph.offset_s[group[0]] == pytest.approx(0.0, abs=1e-9)


def assert_right(graph: ViewGraph, *, but: tuple[tuple[int, int], ...] = ()) -> None:
    """All edges are used, and their turns are the true ones."""
    for one in graph.edges:
        if (one.a, one.b) not in but:
            assert one.used
            assert one.guess.turn == right(one.a, one.b).turn  # type: ignore[union-attr]


def test_pairs_that_agree_are_all_kept() -> None:
    graph = view_graph(among(range(4), 30.0), 4)
    assert graph.groups == ((0, 1, 2, 3),)
    assert_right(graph)
    assert [one.runner_up for one in graph.edges] == [pytest.approx(0.3)] * 6
    assert all(one.support > 0.9 for one in graph.edges)
    assert_in_step(graph, graph.groups[0])


@pytest.mark.parametrize(
    ("false", "true"),
    [(wrong(1, 2, 100.0), right(1, 2, 80.0)), (right(1, 2, 120.0, late_s=4.0), right(1, 2, 100.0))],
    ids=["turn", "lag alone"],
)
def test_third_cameras_overrule_a_pair_whose_best_is_wrong(false: Registration, true: Registration) -> None:
    graph = view_graph([*among(range(4), 30.0, but=((1, 2),)), pair(1, 2, false, true)], 4)
    found = edge(graph, 1, 2)
    assert found.guess is true
    assert (found.used, found.runner_up) == (True, pytest.approx(false.score / true.score))
    assert_in_step(graph, (0, 1, 2, 3))


@pytest.mark.parametrize("score", [90.0, 400.0], ids=["quiet", "four times as loud as any other"])
def test_a_pair_without_a_right_guess_is_not_used_and_does_not_lead_the_tree(score: float) -> None:
    """It has no rival of its own."""
    false = wrong(2, 3, score)
    graph = view_graph([*among(range(4), 40.0, but=((2, 3),)), pair(2, 3, false)], 4)
    assert not edge(graph, 2, 3).used
    assert edge(graph, 2, 3).guess is false, "the best guess is stated though it is not used"
    assert_right(graph, but=((2, 3),))
    assert graph.groups == ((0, 1, 2, 3),)
    assert_in_step(graph, (0, 1, 2, 3))


def test_a_louder_pair_with_a_near_rival_gives_way_to_clear_ones() -> None:
    """In a ring of four no third camera speaks: the other three decide about the pair that is in doubt, not it about them."""
    clear = among(range(4), 10.0, but=((0, 2), (0, 3), (1, 3)))
    graph = view_graph([*clear, pair(0, 3, wrong(0, 3, 150.0), right(0, 3, 0.45 * 150.0))], 4)
    assert len(graph.edges) == 4
    assert_right(graph)
    assert_in_step(graph, (0, 1, 2, 3))


def test_two_groups_stay_apart() -> None:
    between = [pair(0, 3), pair(1, 3, wrong(1, 3, 8.0)), pair(2, 4, wrong(2, 4, 60.0), right(2, 4, 55.0))]
    graph = view_graph([*among(range(3)), *among(range(3, 5)), *between], 5)
    assert (graph.groups, edge(graph, 0, 3).guess, edge(graph, 0, 3).runner_up) == (((0, 1, 2), (3, 4)), None, 1.0)
    assert not any(edge(graph, a, b).used for a, b in ((0, 3), (1, 3), (2, 4)))
    assert_in_step(graph, (0, 1, 2))
    assert_in_step(graph, (3, 4))
    alone = view_graph([], 3)
    assert (alone.edges, alone.groups, alone.offset_s.tolist()) == ((), ((0,), (1,), (2,)), [0.0] * 3)


@pytest.mark.parametrize(("rival", "used"), [(0.95, False), (0.2, True)])
def test_a_bridge_is_crossed_only_if_nothing_comes_near_it(rival: float, used: bool) -> None:
    """No third camera speaks for the one pair that joins two groups."""
    bridge = pair(2, 3, right(2, 3), wrong(2, 3, 100.0 * rival))
    graph = view_graph([*among(range(3)), *among(range(3, 5)), bridge], 5)
    assert edge(graph, 2, 3).used is used
    assert graph.groups == (((0, 1, 2, 3, 4),) if used else ((0, 1, 2), (3, 4)))


def test_two_ambiguous_ways_that_agree_are_believed() -> None:
    """Every pair of three cameras has an equal rival, but only the right ones close the triangle."""
    graph = view_graph([pair(a, b, wrong(a, b, 100.0), right(a, b, 99.0)) for a, b in combinations(range(3), 2)], 3)
    assert graph.groups == ((0, 1, 2),)
    assert_right(graph)


def test_a_lag_that_is_off_does_not_pull_the_offsets() -> None:
    """Ten lags, one of them half a second off: as little as not to be thrown out, but too much to be averaged."""
    graph = view_graph([*among(range(5), but=((0, 4),)), pair(0, 4, right(0, 4, late_s=0.5))], 5)
    assert edge(graph, 0, 4).used
    assert_in_step(graph, (0, 1, 2, 3, 4), seconds=0.02)


def with_rival(a: int, b: int, runner_up: float, score: float = 100.0, *, used: bool = True) -> Edge:
    return Edge(a, b, guess(1 + 0j, 0j, 0.0, score, 0j), runner_up, 1.0, used)


def one_group(*edges: Edge) -> ViewGraph:
    return ViewGraph(edges, ((0, 1, 2, 3),), np.zeros(4))


def test_ambiguity_is_weighted_by_scores_and_one_doubt_names_the_cameras() -> None:
    edges = with_rival(0, 1, 0.9, 300.0), with_rival(0, 2, 0.1), with_rival(1, 2, 0.5)
    shares = ambiguity(one_group(*edges), 4)
    np.testing.assert_allclose(shares[:3], [(270 + 10) / 400, (270 + 50) / 400, (10 + 50) / 200])
    assert np.isnan(shares[3])
    (found,) = ambiguous_cameras(one_group(with_rival(0, 1, 0.98), with_rival(2, 3, 0.2)), ("C1", "C2", "C3", "C4"))
    assert (found.code, found.severity, found.cameras) == ("arrangement_ambiguous", "doubt", ("C1", "C2"))
    assert found.values == {"runner_up": 0.98}


@pytest.mark.parametrize(
    "edges",
    [
        [with_rival(0, 1, 0.98), with_rival(0, 2, 0.1), with_rival(1, 2, 0.1)],
        [with_rival(0, 1, 2.0, used=False), with_rival(2, 3, 0.2)],
        [Edge(0, 1, None, 2.0, 0.0, True), with_rival(2, 3, 0.2)],
    ],
    ids=["a clear third camera makes up for it", "not used", "not registered"],
)
def test_nothing_is_doubtful(edges: list[Edge]) -> None:
    assert ambiguous_cameras(one_group(*edges), ("C1", "C2", "C3", "C4")) == []


@pytest.mark.parametrize("scales", [(1.0, 1.0), (1.2, 1.2), (0.9, 1.15)])
def test_the_motion_of_the_grounds_is_that_of_the_cameras_in_space(scales: tuple[float, float]) -> None:
    """Each ground is `turn * world + shift`, x + iy, in metres of its camera; the baseline is in metres between the two."""
    poses = looking_at((9.0, -3.0, 3.0), (0.0, 0.0, 1.0)), looking_at((-2.0, -8.0, 5.5), (0.5, 0.0, 0.5))
    levels = [Level(pose.R_cw[:, 2], scale * float(pose.centre[2]), 0.0) for pose, scale in zip(poses, scales, strict=True)]
    axes = [(level.R_lc @ pose.R_cw)[:2, 0] @ [1, 1j] for level, pose in zip(levels, poses, strict=True)]
    turn_a, turn_b = (scale * complex(own) for own, scale in zip(axes, scales, strict=True))
    shift_a, shift_b = (-turn * complex(*pose.centre[:2]) for turn, pose in zip((turn_a, turn_b), poses, strict=True))
    turn = turn_b / turn_a
    edge = Edge(0, 1, guess(turn, shift_b - turn * shift_a, 0.0, 100.0, 0j), 0.2, 0.9, True)
    found = _hypothesis(edge, *levels)
    R_ba = poses[1].R_cw @ poses[0].R_cw.T
    assert angle_between(found.R_ba, R_ba) < 1e-6
    np.testing.assert_allclose(found.t_ba, np.sqrt(np.prod(scales)) * (poses[1].t_cw - R_ba @ poses[0].t_cw), atol=1e-9)
    assert _hypothesis(edge, levels[0], None) is None
