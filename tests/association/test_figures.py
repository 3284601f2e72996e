"""The figures of an association, counted by hand."""

import json

import numpy as np
import pytest

from passerby.association.associate import Tracklets
from passerby.association.camera_tracklets import CameraTracklets
from passerby.association.figures import association_figures
from passerby.association.graph import ViewGraph, view_graph
from passerby.association.ground.ground_tracks import ground_tracks
from passerby.association.ground.registration import register_pair
from passerby.association.initial_association import InitialAssociation
from passerby.core.association_figures import AssociationFigures
from passerby.core.figures import LevelFigures
from passerby.core.observations import UNKNOWN, Boxes, CameraObservations, Clock
from passerby.geometry.single_view import Level
from passerby.interchange.storage.text_formats import plain, to_json
from support.scenes.walkers_on_plane import UP, Station, bodies_at, walkers

LEVEL = Level(UP, 4.0, 0.125)
STATIONS = Station(turn=0.4, place=-6 - 8j), Station(turn=-1.2, place=7 - 6j, delay_s=0.8), Station(turn=2.0, place=1 + 9j)
SECONDS, N_PEOPLE = 40.0, 6


def camera(name: str, station: Station, numbers: list[int], *, level: bool = True) -> CameraTracklets:
    """Everybody walks past it; person p's tracklet is `numbers[p]`, and three detections are in none."""
    people = walkers(N_PEOPLE, np.random.default_rng(5), SECONDS)
    times = np.arange(int(SECONDS * 5)) / 5.0
    place = np.concatenate([station.ground(walker.at(times)) for walker in people])
    tracklet = np.repeat(numbers, len(times))
    bodies = bodies_at(tracklet, np.tile(times + station.delay_s, N_PEOPLE), place)
    tracks = ground_tracks(bodies, LEVEL) if level else None
    n, none = len(tracklet) + 3, np.zeros(0, np.int64)
    boxes = Boxes(np.arange(n), np.append(tracklet, [UNKNOWN] * 3), np.full((n, 4), 9.0), np.ones(n))
    return CameraTracklets(name, CameraObservations(boxes), Clock(5.0), bodies, LEVEL if level else None, tracks, (none, none))


def graph_of(cameras: list[CameraTracklets]) -> ViewGraph:
    return view_graph([register_pair(0, 1, cameras[0].tracks, cameras[1].tracks, 3.0)], len(cameras))


@pytest.fixture(scope="module")
def cameras() -> list[CameraTracklets]:
    """The second camera's numbers 2 and 6 are nobody's; the third has no level."""
    return [
        camera("C1", STATIONS[0], [0, 1, 2, 3, 4, 5]),
        camera("C2", STATIONS[1], [7, 5, 4, 3, 1, 0]),
        camera("C3", STATIONS[2], [0, 1, 2, 3, 4, 5], level=False),
    ]


def figures(cameras: list[CameraTracklets], person: np.ndarray, graph: ViewGraph | None) -> AssociationFigures:
    offset_s = np.array([0.0, -0.8, 0.0])
    initial = InitialAssociation(person, offset_s, graph)
    found = association_figures(cameras, Tracklets.of(cameras), None, initial, person, offset_s)
    assert json.loads(to_json(found)) == plain(found)
    return found


PERSON = np.array([10, 11, 12, 13, 14, 15, 15, 14, 99, 13, 12, 77, 11, 10, 20, 21, 22, 23, 24, 25])
"""Of the first two cameras' tracklets five are joined, 0 and 7, 2 and 4, 3 and 3, 4 and 1, and 5 and 0, but 1 and 5 are not."""


def test_cameras_and_people_are_counted(cameras: list[CameraTracklets]) -> None:
    """People are ten to fifteen in the first camera, 77 in the second, six in the third; 99 has no box, nor has one 11."""
    every = figures(cameras, PERSON, None)
    assert (every.people, every.pairs) == (6 + 1 + 6, ())
    for entry, name, own in zip(every.cameras, ("C1", "C2", "C3"), cameras, strict=True):
        boxes = N_PEOPLE * 200
        assert (entry.name, entry.tracklets, entry.boxes, entry.tracked_boxes) == (name, N_PEOPLE, boxes + 3, boxes)
        assert entry.walking_samples == (0 if own.tracks is None else len(own.tracks.step))
        assert entry.looks is None
    assert every.cameras[0].walking_samples > 0
    level = LevelFigures(height_m=4.0, residual=0.125)
    assert [entry.own_level for entry in every.cameras] == [level, level, None]
    none = association_figures(cameras, Tracklets.of(cameras), None, None, PERSON, np.zeros(3))
    assert (none.people, none.pairs) == (13, ())


def test_a_registered_pair(cameras: list[CameraTracklets]) -> None:
    graph = graph_of(cameras)
    (pair,) = figures(cameras, PERSON, graph).pairs
    guess = graph.edges[0].guess
    assert (pair.cameras, pair.route) == (("C1", "C2"), "tracks")
    assert pair.used
    assert (pair.matched_tracklets, pair.offset_s, pair.registered_offset_s) == (5, -0.8, pytest.approx(-0.8, abs=0.1))
    assert (pair.score, pair.share, pair.matches) == (guess.score, guess.share, guess.samples)
    assert pair.runner_up == graph.edges[0].runner_up
    assert pair.looks is None
