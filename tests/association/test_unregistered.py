"""Why a camera is not registered: the fix that is named is the mistake that was made."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest

from passerby.association import registration_failures
from passerby.association.camera_tracklets import CameraTracklets
from passerby.association.candidates import Candidates
from passerby.association.clocks.starts import Starts
from passerby.association.graph import Edge, ViewGraph, view_graph
from passerby.association.ground.ground_tracks import ground_tracks
from passerby.association.ground.registration import Registration, register_pair
from passerby.association.registration_failures import (
    fit_of,
    nobody_walks,
    sees_too_little,
    unregistered_cameras,
    what_would_fit,
)
from passerby.core.observations import CameraObservations, Clock
from passerby.findings.finding import Finding, notice
from passerby.geometry.single_view import Level
from support.scenes.people_and_rigs import looking_at
from support.scenes.walkers_on_plane import UP, Station, Walker, bodies_at, standing, walkers
from support.tiers import thinned

LEVEL = Level(UP, 4.0, 0.0)
SECONDS = 60.0
EAST, WEST = Station(turn=0.4, place=-6 - 8j), Station(turn=-1.2, place=7 - 6j)


def camera(
    name: str, station: Station, people: list[Walker], *, seed: int = 0, stated_fps: float | None = None, level: bool = True,
    seconds: float = SECONDS,
) -> CameraTracklets:  # fmt: skip
    """What a camera saw whose clock runs by the stated rate."""
    rng, stated = np.random.default_rng(seed), stated_fps or station.fps
    times = np.arange(int(seconds * station.fps)) / station.fps
    place = np.concatenate([station.ground(walker.at(times)) for walker in people] or [np.zeros(0, np.complex128)])
    place = place + 0.1 * (rng.standard_normal(len(place)) + 1j * rng.standard_normal(len(place)))
    shown = np.tile(times * station.fps / stated + station.delay_s, len(people))
    bodies = bodies_at(np.repeat(np.arange(len(people)), len(times)), shown, place)
    tracks, none = ground_tracks(bodies, LEVEL) if level else None, np.zeros(0, np.int64)
    return CameraTracklets(name, CameraObservations(), Clock(stated), bodies, LEVEL if level else None, tracks, (none, none))


def crowd(n: int = 7, seed: int = 5) -> list[Walker]:
    return walkers(n, np.random.default_rng(seed), SECONDS)


def graph_of(cameras: list[CameraTracklets], max_lag_s: float) -> ViewGraph:
    tracked = [c for c, camera in enumerate(cameras) if camera.tracks is not None]
    pairs = combinations(tracked, 2)
    return view_graph([register_pair(a, b, cameras[a].tracks, cameras[b].tracks, max_lag_s) for a, b in pairs], len(cameras))


@thinned(("true_fps", "stated"), [(5.0, 6.0), (6.0, 5.0), (10.0, 5.0)], quick=2)
def test_a_mistaken_frame_rate_is_named(true_fps: float, stated: float) -> None:
    people = crowd()
    right, wrong = camera("C1", EAST, people), camera("C2", replace(WEST, fps=true_fps), people, stated_fps=stated)
    found = what_would_fit(right, wrong, 3.0)
    assert (found.code, found.cameras) == ("other_rate_fits", ("C2", "C1"))
    assert (found.values["fits_fps"], found.values["fps"]) == (pytest.approx(true_fps), stated)


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_rate_at_which_two_ways_fit_alike_is_not_named(mirrored: bool) -> None:
    """People who walk as each other's mirror images fit as well after half a turn, so that they prove nothing."""
    some = crowd(3)
    people = some + [Walker(one.seconds, -one.points) for one in some if mirrored]
    right, wrong = camera("C1", EAST, people), camera("C2", WEST, people, seed=1, stated_fps=10.0)
    assert (registration_failures._at_rate(right, wrong, 2.0, 0.5) is None) == mirrored


def test_a_lag_between_what_was_searched_and_half_of_the_recordings_is_found_unless_clocks_are_in_step() -> None:
    people = crowd()
    here = camera("C1", EAST, people, seconds=24.0)
    late = camera("C2", replace(WEST, delay_s=5.6), people, seed=1, seconds=24.0)
    found = registration_failures._at_larger_lag(here, late, 3.0)
    assert found.lag_s == pytest.approx(5.6, abs=0.1)
    here, wrong = camera("C1", EAST, people), camera("C2", WEST, people, stated_fps=10.0)
    assert what_would_fit(here, wrong, 3.0) is not None
    assert what_would_fit(here, wrong, 0.0) is None


@pytest.mark.slow
@thinned(
    ("delay_s", "seconds", "n", "max_lag_s", "search_s"),
    [
        (12.3, 60.0, 7, 3.0, (14, 14)),
        (-8.4, 60.0, 7, 3.0, (10, 10)),
        (120.0, 200.0, 5, 5.0, (120, 122)),
        (-140.3, 200.0, 5, 5.0, (140.3, 142.3)),
    ],
)
def test_clocks_farther_apart_than_was_searched_for(delay_s, seconds, n, max_lag_s, search_s) -> None:
    """Also farther than a minute, and than half of the recordings: the lags at which anything overlaps are all looked at."""
    people = walkers(n, np.random.default_rng(5 if n == 7 else 8), seconds)
    late = camera("C2", replace(WEST, delay_s=delay_s), people, seed=0 if n == 7 else 1, seconds=seconds)
    found = what_would_fit(camera("C1", EAST, people, seconds=seconds), late, max_lag_s)
    assert (found.code, found.cameras) == ("clock_far_off", ("C2", "C1"))
    assert found.values["ahead_s"] == pytest.approx(delay_s, abs=0.05)
    assert search_s[0] <= found.values["search_s"] <= search_s[1]


@pytest.mark.slow
@thinned("seed", range(4))
def test_nothing_fits_strangers(seed: int) -> None:
    """All lags are tried: by chance something fits, but not clearly."""
    people, others = (walkers(3, np.random.default_rng(number + seed), SECONDS) for number in (100, 200))
    assert what_would_fit(camera("C1", EAST, people), camera("C2", WEST, others, seed=1), 3.0) is None
    if seed == 0:
        here = camera("C1", EAST, crowd())
        assert what_would_fit(here, camera("C2", WEST, crowd(seed=9)), 3.0) is None
        assert what_would_fit(here, camera("C2", WEST, [], level=False), 3.0) is None


@pytest.mark.slow
def test_each_camera_that_is_lost_has_its_own_finding() -> None:
    """Two that fit; one whose clock is far off, one that sees others, one that sees no people, one whose people are too few."""
    people = crowd()
    cameras = [
        camera("C1", EAST, people),
        camera("C2", WEST, people, seed=1),
        camera("late", Station(turn=2.0, place=1 + 9j, delay_s=12.0), people, seed=2),
        camera("elsewhere", Station(turn=1.0, place=-4 + 7j), crowd(seed=9), seed=3),
        camera("blind", EAST, []),
        camera("flat", EAST, people, level=False),
    ]
    graph = graph_of(cameras, 3.0)
    assert graph.groups[0] == (0, 1)
    found = unregistered_cameras(cameras, graph, 3.0)
    assert [(name, doubt.code, doubt.cameras) for name, doubt in found.items()] == [
        ("late", "camera_unregistered", ("late",)),
        ("elsewhere", "camera_unregistered", ("elsewhere",)),
        ("blind", "nobody_seen_whole", ("blind",)),
        ("flat", "few_walkers", ("flat",)),
    ]
    fixed = Finding.of_value(found["late"].values["fixed_by"])
    assert (fixed.code, fixed.cameras[0]) == ("clock_far_off", "late")
    assert fixed.values["ahead_s"] == pytest.approx(12.0, abs=0.05)
    assert found["late"].values["to"] in ("C1", "C2")
    assert "fixed_by" not in found["elsewhere"].values


def guess(share: float) -> Registration:
    none = np.zeros(0, np.int64)
    return Registration(1 + 0j, 0j, 0.0, 40.0, 50, share, 0j, none, none, np.zeros(0))


def lost(edges: Sequence[Edge], **named: Any) -> Finding:
    """What is said of C3, which these edges join to no camera, where clocks are in step."""
    people = crowd()
    cameras = [camera(name, EAST, people, level=name != "flat") for name in ("C1", "C2", "C3", "flat")]
    graph = ViewGraph(tuple(edges), ((0, 1), (2,), (3,)), np.zeros(4))
    found = unregistered_cameras(cameras, graph, 0.0, **named)
    assert [(name, one.severity) for name, one in found.items()] == [("C3", "notice"), ("flat", "notice")]
    assert (found["flat"].code, found["flat"].cameras) == ("few_walkers", ("flat",))
    return found["C3"]


def test_a_lost_camera_is_named_with_the_one_that_it_fits_best_or_by_its_unknown_start() -> None:
    few, none = Edge(0, 2, guess(0.2), 0.0, 0.0, False), Edge(1, 2, None, 0.0, 0.0, False)
    found = lost([few, none])
    assert (found.code, found.cameras) == ("camera_unregistered", ("C3",))
    assert found.values == {"to": "C1", "timed": True, "fit": "few_in_both", "share": 0.2}
    assert lost([none], timed=False).values == {"to": "C2", "timed": False, "fit": "never_together"}
    # An edge to a camera that is lost itself says nothing of this one.
    assert lost([Edge(2, 3, guess(0.9), 0.0, 0.0, False)]).values == {"to": None, "timed": True, "fit": "nobody"}
    why = notice("start_unknown", "C3", searched_s=600.0, lags_s=None)
    starts = Starts(600.0, np.zeros(4), np.zeros(4, dtype=np.int64), doubts={2: why})
    assert lost([], starts=starts) is why
    assert lost([], starts=replace(starts, doubts={})).code == "camera_unregistered"


def test_nothing_is_tried_with_cameras_that_share_no_ground(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[str] = []
    fix = notice("clock_far_off", "C3", "C2", ahead_s=12.0, search_s=13)

    def would_fit(a: CameraTracklets, b: CameraTracklets, max_lag_s: float) -> Finding | None:
        tried.append(a.name)
        return fix if a.name == "C2" else None

    monkeypatch.setattr(registration_failures, "what_would_fit", would_fit)
    assert "fixed_by" not in lost([], near=Candidates(4, {(0, 2): "activity"})).values
    assert tried == ["C1"]
    assert Finding.of_value(lost([], near=Candidates(4, {(0, 2): "activity", (1, 2): "activity"})).values["fixed_by"]) == fix


def test_no_camera_is_lost_where_all_fit_and_else_the_reason_is_stated() -> None:
    people = crowd()
    cameras = [camera("C1", EAST, people), camera("C2", WEST, people, seed=1)]
    assert unregistered_cameras(cameras, graph_of(cameras, 3.0), 3.0) == {}
    assert sees_too_little(cameras[0]) is None
    found = register_pair(0, 1, cameras[0].tracks, cameras[1].tracks, 3.0).candidates[0]
    assert found.share > 0.6
    for one, runner_up, stated in (
        (None, 0.0, {"fit": "never_together"}),
        (replace(found, share=0.31), 0.0, {"fit": "few_in_both", "share": 0.31}),
        (found, 1.2, {"fit": "contradicted"}),
        (found, 0.8, {"fit": "ambiguous", "runner_up": 0.8}),
    ):
        assert fit_of(Edge(0, 1, one, runner_up, 0.0, False)) == stated


def test_people_who_stand_still_are_named_and_those_who_pace_up_and_down_walk() -> None:
    """A tracklet that ends where it began is not one of somebody who stands. A camera may see no walker at all."""
    poses = [looking_at((8, 0, 4), (0, 0, 1)), looking_at((0, 8, 4), (0, 0, 1)), None]
    still = standing(7, np.random.default_rng(0))
    walk, stand, flat = camera("C1", EAST, crowd()), camera("C2", WEST, still), camera("C2", EAST, crowd(), level=False)
    assert nobody_walks([walk, walk, stand], poses) == nobody_walks([walk, walk], poses[:2]) == []
    for cameras in ([walk, stand, walk], [stand, stand, walk], [walk, flat]):
        (doubt,) = nobody_walks(cameras, poses[: len(cameras)])
        assert doubt.code == "people_stand_still"
    times = np.linspace(0.0, SECONDS, 601)
    back_and_forth = Walker(times, (1.6 * np.cos(2 * np.pi * 6 * times / SECONDS)).astype(np.complex128))
    pacing = [camera(name, station, [back_and_forth]) for name, station in (("C1", EAST), ("C2", WEST))]
    assert all(abs(one.tracks.position[-1] - one.tracks.position[0]) < 1.0 for one in pacing)
    assert nobody_walks(pacing, poses[:2]) == []
