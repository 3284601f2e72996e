"""Who is who, from pairs of cameras and from a rig, against the truth of a simulated scene, and the figures of it."""

import json
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from metrics.identities import IdentityAgreement, identity_agreement
from passerby.association.associate import Tracklets, cluster_by_pairwise_poses, cluster_by_rig, compared_pairs
from passerby.association.camera_tracklets import CameraTracklets, build_camera_tracklets
from passerby.association.candidates import Candidates
from passerby.association.figures import association_figures
from passerby.association.graph import Edge, ViewGraph, view_graph
from passerby.association.ground.ground_tracks import GroundTracks, ground_tracks
from passerby.association.ground.registration import register_pair
from passerby.association.initial_association import InitialAssociation, associate_by_ground_tracks
from passerby.association.shared_sightings import joined_sightings
from passerby.core.association_figures import AssociationFigures
from passerby.core.cameras import Pose
from passerby.core.figures import LevelFigures
from passerby.core.observations import UNKNOWN, Boxes, CameraObservations, Clock, Observations
from passerby.geometry.single_view import Level
from passerby.interchange.storage.text_formats import plain, to_json
from passerby.simulation import SimulationOptions, simulate
from passerby.simulation.scene import SimulatedScene
from support.scenes.walkers_on_plane import UP, Station, bodies_at, walkers


@dataclass(frozen=True, eq=False)
class Prepared:
    """A simulated scene up to where the cameras meet."""

    scene: SimulatedScene
    cameras: list[CameraTracklets]
    tracklets: Tracklets

    @property
    def tracks(self) -> list[GroundTracks | None]:
        return [camera.tracks for camera in self.cameras]

    @property
    def poses(self) -> list[Pose | None]:
        return [camera.pose for camera in self.scene.rig]

    @property
    def offset_s(self) -> np.ndarray:
        return np.array([self.scene.clock_offsets[name] for name in self.scene.rig.names])

    def people_of_rig(self, poses=None, offset_s=None, graph=None, **evidence) -> np.ndarray:  # type: ignore[no-untyped-def]
        """Person of each tracklet by the true rig and clocks, or by others."""
        return cluster_by_rig(
            self.tracklets, self.cameras, graph or ViewGraph((), (), np.zeros(len(self.cameras))), poses or self.poses,
            self.offset_s if offset_s is None else offset_s, self.scene.options.person_height_mean_m, **evidence,
        )  # fmt: skip

    def by_camera(self, person: np.ndarray) -> list[set[int]]:
        return [set(part.tolist()) for part in np.split(person, self.tracklets.first[1:-1])]

    def agreement(self, person: np.ndarray, *, cameras: tuple[int, ...] = (0, 1, 2, 3)) -> IdentityAgreement:
        """How well persons of tracklets agree with the truth."""
        found: dict[str, Boxes] = {}
        for first, camera in zip(self.tracklets.first, self.cameras, strict=False):
            boxes = camera.seen.boxes
            known = boxes.identity >= 0
            identity = np.where(known, person[first + np.where(known, boxes.identity, 0)], UNKNOWN)
            found[camera.name] = replace(boxes, identity=identity)
        truth = {name: self.scene.truth[name] for name in (self.scene.rig.names[c] for c in cameras)}
        return identity_agreement(found, truth, self.scene.true_clocks)


@pytest.fixture(scope="module")
def prepared() -> Prepared:
    scene = simulate(
        SimulationOptions(
            preset="terrace", seconds=30.0, unrelated_ids=True, tracklet_seconds=4.0, box_noise=0.02, missing=0.1,
            clock_offsets=1.5, seed=3,
        )
    )  # fmt: skip
    clock, person_height_m = Clock(scene.options.fps), scene.options.person_height_mean_m
    cameras = [
        build_camera_tracklets(camera, scene.observations[camera.name], clock, person_height_m, np.random.default_rng(0))
        for camera in scene.rig
    ]
    return Prepared(scene, cameras, Tracklets.of(cameras))


def registered(prepared: Prepared) -> ViewGraph:
    tracks = prepared.tracks
    return view_graph([register_pair(a, b, tracks[a], tracks[b], 3.0) for a, b in combinations(range(4), 2)], 4)


def test_pairs_of_cameras_tell_who_is_who_and_those_that_are_not_used_nothing(prepared: Prepared) -> None:
    graph = registered(prepared)
    assert graph.groups == ((0, 1, 2, 3),)
    apart = prepared.offset_s - graph.offset_s
    np.testing.assert_allclose(apart, apart[0], atol=0.15)
    found = prepared.agreement(cluster_by_pairwise_poses(prepared.tracklets, prepared.tracks, graph))
    # Three seeds: precision 0.997 to 1, recall 0.957 to 0.990.
    assert found.precision > 0.98
    assert found.recall > 0.92
    lone = replace(graph, edges=tuple(replace(edge, used=edge.used and 0 not in (edge.a, edge.b)) for edge in graph.edges))
    camera = prepared.by_camera(cluster_by_pairwise_poses(prepared.tracklets, prepared.tracks, lone))
    assert not camera[0] & (camera[1] | camera[2] | camera[3])
    assert camera[1] & camera[2]


def test_a_calibrated_rig_tells_who_is_who_wherever_the_world_and_its_clocks_begin(prepared: Prepared) -> None:
    """The world may be turned about the vertical and moved along the ground; of the offsets only differences count."""
    person = prepared.people_of_rig()
    found = prepared.agreement(person)
    # Three seeds: precision 0.997 to 1, recall 0.989 to 0.996.
    assert found.precision > 0.985
    assert found.recall > 0.96
    i, j, seconds = prepared.tracklets.together()
    assert (person[i[seconds > 1.0]] != person[j[seconds > 1.0]]).all(), "one person twice in one camera"
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    moved = [pose.moved(turn, np.array([40.0, -7.0, 0.0])) for pose in prepared.poses]
    np.testing.assert_array_equal(prepared.people_of_rig(moved, prepared.offset_s + 3.25), person)
    late = prepared.offset_s + np.array([0.0, 2.0, -2.0, 4.0])
    assert prepared.agreement(prepared.people_of_rig(offset_s=late)).recall < 0.5


def test_registrations_stand_in_for_lost_cameras_only(prepared: Prepared) -> None:
    """Without them a lost camera shares no people; between two with poses the rig alone decides, whatever they say."""
    graph = registered(prepared)
    late = [replace(edge, guess=edge.guess and replace(edge.guess, lag_s=edge.guess.lag_s + 4.0)) for edge in graph.edges]
    here = prepared.people_of_rig()
    np.testing.assert_array_equal(prepared.people_of_rig(graph=replace(graph, edges=tuple(late))), here)
    lost = [*prepared.poses[:2], None, prepared.poses[3]]
    alone = prepared.by_camera(prepared.people_of_rig(lost))
    assert not alone[2] & (alone[0] | alone[1] | alone[3])
    assert alone[0] & alone[1] & alone[3]
    camera = prepared.by_camera(prepared.people_of_rig(lost, graph=graph))
    assert camera[2] & camera[0] & camera[1]


def test_looks_and_candidates_decide_with_the_rig(prepared: Prepared) -> None:
    """Two cameras whose people look like no one in the other, whatever the ground says; then cameras compared in two pairs."""
    affinity = {(0, 1): np.full(np.diff(prepared.tracklets.first)[:2], -1000.0)}
    person = prepared.people_of_rig(affinity=affinity)
    found = prepared.agreement(person, cameras=(0, 1))
    # Those are left whose tracklets in the two cameras have no grid time in common.
    assert found.pairs_found < 0.05 * found.pairs_true
    for other in ((0, 2), (1, 2)):
        assert prepared.agreement(person, cameras=other).recall > 0.2, "everyone goes with one of the two"
    person = prepared.people_of_rig(candidates={(0, 1), (2, 3)})
    camera = np.repeat(np.arange(4), np.diff(prepared.tracklets.first))
    seen_by = [set(camera[person == one].tolist()) for one in np.unique(person)]
    assert {0, 1} in seen_by
    assert {2, 3} in seen_by
    assert all(not (both & {0, 1} and both & {2, 3}) for both in seen_by)


def test_only_candidates_are_registered(prepared: Prepared) -> None:
    candidates = Candidates(4, {(0, 3): "stated", (1, 2): "stated"})
    found = associate_by_ground_tracks(prepared.cameras, prepared.tracklets, 3.0, {}, candidates=candidates)
    assert [(edge.a, edge.b) for edge in found.graph.edges] == [(0, 3), (1, 2)]


def camera_of(*rows: tuple[int, float], continued: tuple[int, int] | None = None) -> CameraTracklets:
    """People by (tracklet, seconds) of their boxes."""
    tracklet, seconds = (np.array(column) for column in zip(*rows, strict=True)) if rows else (np.zeros(0), np.zeros(0))
    tracklet = tracklet.astype(np.int64)
    boxes = Boxes(np.arange(len(rows)), tracklet, np.full((len(rows), 4), 9.0), np.ones(len(rows)))
    links = np.array([] if continued is None else [continued], dtype=np.int64).reshape(-1, 2).T
    bodies = bodies_at(tracklet, seconds, np.full(len(seconds), 5.0 + 5.0j))
    return CameraTracklets("C", CameraObservations(boxes), Clock(5.0), bodies, None, None, (links[0], links[1]))


def test_tracklets_are_numbered_through_and_know_their_times() -> None:
    first = camera_of((0, 4.0), (0, 1.0), (2, 3.0), (2, 9.0), (-1, 50.0), continued=(0, 2))
    found = Tracklets.of([first, camera_of(), camera_of((1, 2.5), (0, 7.0), (1, 3.5), continued=(1, 0))])
    assert found.first.tolist() == [0, 3, 3, 5]
    seen = np.array([True, False, True, True, True])
    np.testing.assert_array_equal(found.start_s[seen], [1.0, 3.0, 7.0, 2.5])
    np.testing.assert_array_equal(found.end_s[seen], [4.0, 9.0, 7.0, 3.5])
    assert not np.isfinite(found.start_s[~seen]).any()
    assert [column.tolist() for column in found.continued] == [[0, 4], [2, 3]]
    # Only those of one camera are together; 1 and 3 only touch.
    one = camera_of((0, 0.0), (0, 5.0), (1, 4.0), (1, 8.0), (3, 7.9), (3, 12.0), (4, 30.0), (4, 31.0))
    together = Tracklets.of([one, camera_of((0, 0.0), (0, 20.0), (1, 19.0), (1, 40.0))]).together()
    assert sorted(zip(*(column.tolist() for column in together), strict=True)) == [(0, 1, 1.0), (5, 6, 1.0)]


def test_a_tracklet_goes_on_as_another_where_nothing_speaks_against_it() -> None:
    graph = view_graph([], 1)
    for own, person in (
        (camera_of((0, 0.0), (0, 5.0), (1, 5.5), (1, 9.0), continued=(0, 1)), [0, 0]),
        (camera_of((0, 0.0), (0, 8.0), (1, 5.5), (1, 9.0), continued=(0, 1)), [0, 1]),
        (camera_of((0, 0.0), (1, 5.5)), [0, 1]),
    ):
        assert cluster_by_pairwise_poses(Tracklets.of([own]), [None], graph).tolist() == person


def test_of_many_cameras_registered_pairs_are_compared_and_the_candidates_of_cameras_without_any() -> None:
    edges = tuple(Edge(a, b, None, 0.0, 0.0, used) for a, b, used in ((0, 1, True), (1, 2, True), (0, 2, False), (2, 3, False)))
    graph = ViewGraph(edges, ((0, 1, 2), (3,)), np.zeros(4))
    assert list(compared_pairs(graph, 4, {(0, 2), (0, 3), (2, 3)})) == [(0, 1), (0, 3), (1, 2), (2, 3)]
    assert len(compared_pairs(graph, 4, None)) == 6


CHAIN = [("A", "B"), ("B", "C"), ("E", "D")]
sightings = st.dictionaries(
    st.sampled_from("ABCDE"), st.lists(st.tuples(st.integers(0, 2), st.integers(1, 3)), unique=True, max_size=6), min_size=2
)


def boxes_of(rows: list[tuple[int, int]]) -> Boxes:
    """Boxes at (frame, identity)."""
    frame, identity = np.array(rows, dtype=np.int64).reshape(-1, 2).T
    return Boxes(frame, identity, np.tile([10.0, 10.0, 20.0, 50.0], (len(rows), 1)), np.ones(len(rows)))


@given(sightings)
def test_a_person_at_an_instant_stays_where_most_cameras_that_are_joined_see_them(
    rows: dict[str, list[tuple[int, int]]],
) -> None:
    """The largest part of each person-instant that pairs join is kept whole, and nothing else of it."""
    seen = Observations({name: CameraObservations(boxes_of(own)) for name, own in rows.items()})
    boxes = {name: own.boxes for name, own in joined_sightings(seen, CHAIN).cameras.items()}
    found = {name: list(zip(own.frame.tolist(), own.identity.tolist(), strict=True)) for name, own in boxes.items()}
    assert found.keys() == rows.keys()
    for key in {key for own in rows.values() for key in own}:
        before, after = ({name for name, own in side.items() if key in own} for side in (rows, found))
        chains = ("".join(name if name in before else " " for name in chain) for chain in ("ABC", "ED"))
        parts = [set(part) for chain in chains for part in chain.split()]
        assert after in parts
        assert len(after) == max(map(len, parts))


LEVEL = Level(UP, 4.0, 0.125)
SECONDS, N_PEOPLE = 40.0, 6
PERSON = np.array([10, 11, 12, 13, 14, 15, 15, 14, 99, 13, 12, 77, 11, 10, 20, 21, 22, 23, 24, 25])
"""Of the first two cameras' tracklets five are joined, 0 and 7, 2 and 4, 3 and 3, 4 and 1, and 5 and 0, but 1 and 5 are not."""


def walked_past(name: str, station: Station, numbers: list[int], *, level: bool = True) -> CameraTracklets:
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


def test_the_figures_of_an_association_are_those_counted_by_hand() -> None:
    """The second camera's numbers 2 and 6 are no one's; the third has no level.

    People are ten to fifteen in the first camera, 77 in the second, six in the third; 99 has no box, nor has one 11.
    """
    second, third = Station(turn=-1.2, place=7 - 6j, delay_s=0.8), Station(turn=2.0, place=1 + 9j)
    cameras = [
        walked_past("C1", Station(turn=0.4, place=-6 - 8j), [0, 1, 2, 3, 4, 5]),
        walked_past("C2", second, [7, 5, 4, 3, 1, 0]),
        walked_past("C3", third, [0, 1, 2, 3, 4, 5], level=False),
    ]
    graph = view_graph([register_pair(0, 1, cameras[0].tracks, cameras[1].tracks, 3.0)], 3)
    offset_s = np.array([0.0, -0.8, 0.0])

    def figures(initial: InitialAssociation | None) -> AssociationFigures:
        return association_figures(cameras, Tracklets.of(cameras), None, initial, PERSON, offset_s)

    without = [figures(None), figures(InitialAssociation(PERSON, offset_s, None))]
    assert [(found.people, found.pairs) for found in without] == [(6 + 1 + 6, ())] * 2
    found = figures(InitialAssociation(PERSON, offset_s, graph))
    assert json.loads(to_json(found)) == plain(found)
    assert found.people == 13
    boxes = N_PEOPLE * 200
    for entry, name, own in zip(found.cameras, ("C1", "C2", "C3"), cameras, strict=True):
        assert (entry.name, entry.tracklets, entry.boxes, entry.tracked_boxes) == (name, N_PEOPLE, boxes + 3, boxes)
        assert entry.walking_samples == (0 if own.tracks is None else len(own.tracks.step))
        assert entry.looks is None
    assert found.cameras[0].walking_samples > 0
    level = LevelFigures(height_m=4.0, residual=0.125)
    assert [entry.own_level for entry in found.cameras] == [level, level, None]
    (pair,) = found.pairs
    guess = graph.edges[0].guess
    assert (pair.cameras, pair.route, pair.used, pair.looks) == (("C1", "C2"), "tracks", True, None)
    assert (pair.matched_tracklets, pair.offset_s, pair.registered_offset_s) == (5, -0.8, pytest.approx(-0.8, abs=0.1))
    assert (pair.score, pair.share, pair.matches) == (guess.score, guess.share, guess.samples)
    assert pair.runner_up == graph.edges[0].runner_up
