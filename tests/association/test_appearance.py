"""Looks: what the features, the matches, the measures of usefulness and the likeness say where the truth is known."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from passerby.association.appearance import discriminability as evidence
from passerby.association.appearance import embeddings as appearance
from passerby.association.appearance.affinity import AppearanceAffinity
from passerby.association.camera_tracklets import CameraTracklets
from passerby.association.sampling import STEP_S
from passerby.common.arrays import Floats, Ints
from passerby.core.observations import UNKNOWN, Boxes, CameraObservations, Clock
from support.scenes.walkers_on_plane import bodies_at

DIMENSIONS = 64


@dataclass(frozen=True)
class Crowd:
    """Two cameras' boxes, and who is in each."""

    a: Boxes
    b: Boxes
    person_a: Ints
    person_b: Ints


def unit_rows(values: Floats) -> Floats:
    return values / np.linalg.norm(values, axis=-1, keepdims=True)


def one_camera(kind: str, people: Floats, seen: np.ndarray, rng: np.random.Generator, noise: float) -> tuple[Boxes, Ints]:
    """Tracklets cut every 30 frames on average; embeddings of a kind, each unit length plus a bias of the camera."""
    frame, person = (axis.astype(int) for axis in np.nonzero(seen))
    order = np.lexsort((frame, person))
    frame, person = frame[order], person[order]
    new = np.append(True, (np.diff(person) != 0) | (np.diff(frame) != 1)) | (rng.random(len(frame)) < 1 / 30)
    tracklet = np.cumsum(new) - 1
    naming = rng.permutation(tracklet[-1] + 1) * 3 + 1
    if kind in ("distinct", "leaning"):
        core = people[person]
    elif kind == "teams":
        core = people[person % 2]
    elif kind == "own look per tracklet":
        core = unit_rows(rng.normal(size=(tracklet[-1] + 1, DIMENSIONS)))[tracklet]
    elif kind == "own look per camera":
        core = unit_rows(rng.normal(size=people.shape))[person]
    else:
        core = np.zeros((len(frame), DIMENSIONS))
    bias = unit_rows(rng.normal(size=DIMENSIONS))
    lean = rng.uniform(0.5, 3.0, len(people))[person, None] if kind == "leaning" else 1.5
    embedding = core + lean * bias + noise * rng.normal(size=core.shape) / np.sqrt(DIMENSIONS)
    shuffled = rng.permutation(len(frame))
    boxes = Boxes(frame, naming[tracklet], np.ones((len(frame), 4)), np.ones(len(frame)), embedding).take(shuffled)
    return boxes, person[shuffled]


def crowd(kind: str, seed: int, n_people: int = 12, n_frames: int = 400, shared: float = 0.7, noise: float = 1.0) -> Crowd:
    """People who come and go; a camera sees each of them for `shared` of the time, in long stretches."""
    rng = np.random.default_rng(seed)
    people = unit_rows(rng.normal(size=(n_people, DIMENSIONS)))
    cameras = []
    for _ in range(2):
        phase = rng.integers(0, n_frames, n_people)
        seen = (np.arange(n_frames)[:, None] + phase) % n_frames < shared * n_frames
        cameras.append(one_camera(kind, people, seen, rng, noise))
    return Crowd(cameras[0][0], cameras[1][0], cameras[0][1], cameras[1][1])


def of_both(scene: Crowd, seed: int = 0) -> tuple[appearance.TrackletFeatures, appearance.TrackletFeatures]:
    rng = np.random.default_rng(seed)
    return appearance.tracklet_features(scene.a, rng), appearance.tracklet_features(scene.b, rng)


def camera(boxes: Boxes, features: appearance.TrackletFeatures, instants: Ints | None = None) -> appearance.CameraAppearance:
    return appearance.CameraAppearance(boxes, boxes.frame if instants is None else instants, features)


def weight_of(scene: Crowd, seed: int = 0) -> float:
    a, b = of_both(scene, seed)
    rng = np.random.default_rng(seed)
    return evidence.between_camera_discriminability(camera(scene.a, a), camera(scene.b, b), rng).weight


def boxes_of(frame: object, identity: object, embedding: object) -> Boxes:
    n = len(np.asarray(frame))
    return Boxes(np.asarray(frame), np.asarray(identity), np.ones((n, 4)), np.ones(n), embedding)  # type: ignore[arg-type]


def test_one_box_of_each_chunk_is_drawn_and_the_same_seed_draws_the_same() -> None:
    chunk = np.searchsorted([5, 10, 16, 21, 26, 32, 37], np.arange(43), side="right")  # floor(c * 43 / 8)
    order = np.random.default_rng(0).permutation(43)
    boxes = boxes_of(np.arange(43)[order] * 3, np.full(43, 7), np.eye(8)[chunk][order])
    found = appearance.tracklet_features(boxes, np.random.default_rng(1))
    np.testing.assert_allclose(found.feature, np.full((1, 8), 8**-0.5), atol=1e-7)
    assert (found.tracklet.tolist(), found.n.tolist()) == ([7], [43])
    boxes = boxes_of(np.arange(24), np.zeros(24), np.eye(24))
    drawn = [appearance.tracklet_features(boxes, np.random.default_rng(seed)).feature[0] > 0 for seed in (*range(60), 5)]
    assert np.any(drawn, axis=0).all(), "every box of a chunk is drawn now and then"
    assert all(one.reshape(8, 3).sum(axis=1).tolist() == [1] * 8 for one in drawn)
    assert (drawn[-1] == drawn[5]).all()


def test_short_tracklets_unknown_boxes_and_boxes_without_tracklet() -> None:
    embedding = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0], [0, 0, 0], [0, 1, 0]])
    found = appearance.tracklet_features(boxes_of([1, 2, 3, 4, 1, 2], [5, 5, -1, 5, 2, 9], embedding), np.random.default_rng(0))
    assert (found.tracklet.tolist(), found.n.tolist(), found.known.tolist()) == ([2, 5, 9], [0, 2, 1], [False, True, True])
    np.testing.assert_allclose(found.feature, [[0, 0, 0], [2**-0.5, 2**-0.5, 0], [0, 1, 0]], atol=1e-7)


def brute_matches(scene: Crowd, similarity: Floats, a: appearance.TrackletFeatures, b: appearance.TrackletFeatures) -> float:
    """Sum of the best assignments' distances over all instants, each solved for itself."""
    total = 0.0
    for frame in np.intersect1d(scene.a.frame, scene.b.frame):
        i = a.index(scene.a.identity[scene.a.frame == frame])
        j = b.index(scene.b.identity[scene.b.frame == frame])
        cost = np.sqrt(np.maximum(2 - 2 * similarity[np.ix_(i, j)], 0))
        total += cost[linear_sum_assignment(cost)].sum()
    return total


def test_matches_are_the_best_of_every_instant_and_votes_count_instants() -> None:
    scene = crowd("distinct", 3, n_frames=80, noise=4.0)
    a, b = of_both(scene)
    found = appearance.match_boxes(camera(scene.a, a), camera(scene.b, b))
    assert (scene.a.frame[found.row_a] == scene.b.frame[found.row_b]).all()
    assert found.distance.sum() == pytest.approx(brute_matches(scene, appearance.similarities(a, b), a, b))
    for rows in (found.row_a, found.row_b):
        assert len(np.unique(rows)) == len(rows)
    votes = appearance.count_votes(camera(scene.a, a), camera(scene.b, b), found)
    together = votes.together.toarray()
    assert votes.matched.sum() == len(found.row_a)
    assert (together >= votes.matched.toarray()).all()
    frames = [own.frame[own.identity == one.tracklet[k]] for own, one, k in ((scene.a, a, 3), (scene.b, b, 5))]
    assert together[3, 5] == len(np.intersect1d(*frames))
    later = appearance.match_boxes(camera(scene.a, a, scene.a.frame + 1000), camera(scene.b, b, scene.b.frame + 1000))
    assert (later.row_a == found.row_a).all()
    never = appearance.match_boxes(camera(scene.a, a), camera(scene.b, b, scene.b.frame + 1000))
    assert len(never.row_a) == 0


def test_a_tracklet_seen_twice_at_one_instant_is_matched_once() -> None:
    embedding = np.array([[1, 0, 0], [1, 0, 0], [0, 1, 0]])
    a, b = boxes_of([1, 2, 1], [0, 0, 1], embedding), boxes_of([1, 1, 1], [4, 4, 6], embedding)
    fa, fb = (appearance.tracklet_features(one, np.random.default_rng(0)) for one in (a, b))
    found = appearance.match_boxes(camera(a, fa, np.zeros(3, int)), camera(b, fb, np.zeros(3, int)))
    assert sorted(zip(a.identity[found.row_a].tolist(), b.identity[found.row_b].tolist(), strict=True)) == [(0, 4), (1, 6)]


def test_unknown_looks_and_too_few_people_give_nothing() -> None:
    rng, scene = np.random.default_rng(0), crowd("distinct", 0, n_frames=40)
    for b in (replace(scene.b, embedding=None), Boxes.empty()):
        fa, fb = appearance.tracklet_features(scene.a, rng), appearance.tracklet_features(b, rng)
        one, other = camera(scene.a, fa), camera(b, fb)
        found = appearance.match_boxes(one, other)
        assert (len(found.row_a), appearance.count_votes(one, other, found).together.nnz) == (0, 0)
        assert evidence.within_camera_discriminability(b, rng) is None
        assert evidence.between_camera_discriminability(one, other, rng) is None
        assert not evidence.appearance_log_likelihood_ratios(fa, fb, np.zeros(0), 1.0).any()
    a, b = of_both(few := crowd("distinct", 0, n_people=2, shared=1.0))
    assert evidence.between_camera_discriminability(camera(few.a, a), camera(few.b, b), rng) is None
    assert evidence.within_camera_discriminability(crowd("distinct", 0, n_people=1, shared=1.0).a, rng) is None


@pytest.mark.parametrize(
    ("kind", "low", "high"),
    [("distinct", 0.9, 1.0), ("own look per tracklet", 0.9, 1.0), ("teams", 0.2, 0.8), ("alike", 0.0, 0.1)],
)
def test_usefulness_within_a_camera(kind: str, low: float, high: float) -> None:
    for seed in range(8):
        assert low <= evidence.within_camera_discriminability(crowd(kind, seed).a, np.random.default_rng(seed)).weight <= high


@pytest.mark.parametrize("kind", ["alike", "own look per tracklet", "own look per camera", "teams"])
@pytest.mark.parametrize("size", [(12, 400, 0.7), (5, 200, 0.7), (30, 300, 0.4), (8, 100, 1.0)])
def test_looks_that_do_not_carry_over_to_the_other_camera_are_worth_nothing(kind: str, size: tuple[int, int, float]) -> None:
    for seed in range(10):
        assert weight_of(crowd(kind, seed, *size), seed) < 0.05


@pytest.mark.parametrize(("size", "least"), [((12, 400, 0.7), 0.3), ((12, 200, 1.0), 0.85), ((40, 600, 0.3), 0.03)])
def test_looks_that_carry_over_are_worth_what_is_seen_by_both(size: tuple[int, int, float], least: float) -> None:
    for seed in range(6):
        assert weight_of(crowd("distinct", seed, *size), seed) > least


def test_a_camera_whose_light_changes_is_not_thought_useful() -> None:
    """In one camera all people drift the same way over time, so that they are alike at an instant."""
    for seed in range(8):
        scene = crowd("own look per camera", seed)
        drift = unit_rows(np.random.default_rng(seed + 100).normal(size=(2, DIMENSIONS)))
        angle = scene.a.frame[:, None] * (2 * np.pi / 400)
        moved = scene.a.embedding + 2 * (np.cos(angle) * drift[0] + np.sin(angle) * drift[1])
        assert weight_of(replace(scene, a=replace(scene.a, embedding=moved)), seed) < 0.05


def ratio_of(scene: Crowd, weight: float, seed: int = 0) -> tuple[Floats, np.ndarray, Floats]:
    """The ratio, whether each pair of tracklets is one person, the similarities."""
    a, b = of_both(scene, seed)
    different = np.concatenate(
        [evidence.similarities_of_different_people(scene.a, a), evidence.similarities_of_different_people(scene.b, b)]
    )
    who_a = scene.person_a[[np.flatnonzero(scene.a.identity == one)[0] for one in a.tracklet]]
    who_b = scene.person_b[[np.flatnonzero(scene.b.identity == one)[0] for one in b.tracklet]]
    ratio = evidence.appearance_log_likelihood_ratios(a, b, different, weight)
    return ratio, who_a[:, None] == who_b[None, :], appearance.similarities(a, b)


@pytest.mark.parametrize(("noise", "least"), [(1.0, 2.4), (3.0, 1.2)])
def test_the_ratio_tells_same_from_different_and_stays_in_bounds(noise: float, least: float) -> None:
    assert not ratio_of(crowd("distinct", 0, noise=noise), 0.0)[0].any(), "looks of no weight"
    for seed in range(6):
        ratio, same, similarity = ratio_of(crowd("distinct", seed, noise=noise), 1.0, seed)
        assert np.abs(ratio).max() <= 3.0
        assert ratio[same].mean() > least
        assert ratio[~same].mean() < -least
        assert (np.diff(ratio.ravel()[similarity.ravel().argsort()]) >= -1e-9).all()


@pytest.mark.slow
def test_the_ratio_claims_no_more_than_is_so() -> None:
    """Calibration: with the prior odds, the ratio's mean chance of one person is not above the share that are."""
    claimed, so = [], []
    for seed in range(10):
        ratio, same, _ = ratio_of(crowd("distinct", seed, noise=6.0), 1.0, seed)
        prior = same.mean()
        chance = 1 / (1 + (1 - prior) / prior * np.exp(-ratio))
        claimed.append(chance[ratio > 0].mean())
        so.append(same[ratio > 0].mean())
    assert np.mean(claimed) < np.mean(so) + 0.05


PEOPLE, FPS, FRAMES = 10, 10.0, 600


def filmed(seed: int, *, distinct: bool = True, offset_s: float = 0.0) -> tuple[CameraTracklets, np.ndarray]:
    """People who are seen for most of the time, each in several tracklets, and who the tracklets are (-1: a false number)."""
    looks = np.random.default_rng(0).standard_normal((PEOPLE, DIMENSIONS)) / np.sqrt(DIMENSIONS)
    rng = np.random.default_rng(seed)
    frame = np.tile(np.arange(1, FRAMES + 1), PEOPLE)
    person = np.repeat(np.arange(PEOPLE), FRAMES)
    part = frame * 4 // (FRAMES + 1)
    naming = rng.permutation(4 * PEOPLE + 3)
    tracklet = naming[4 * person + part]
    who = np.full(4 * PEOPLE + 3, UNKNOWN)
    who[tracklet] = person
    keep = (rng.random(len(frame)) < 0.9) & (part != (person + seed) % 4)
    tracklet = np.where(rng.random(len(frame)) < 0.05, UNKNOWN, tracklet)[keep]
    core = looks[person[keep]] if distinct else np.zeros((keep.sum(), DIMENSIONS))
    bias = rng.standard_normal(DIMENSIONS) / np.sqrt(DIMENSIONS)
    vectors = core + bias + 0.7 * rng.standard_normal(core.shape) / np.sqrt(DIMENSIONS)
    boxes = Boxes(frame[keep], tracklet, np.full((len(tracklet), 4), 50.0), np.ones(len(tracklet)), vectors)
    boxes = boxes.take(rng.permutation(len(boxes)))
    none = np.zeros(0, np.int64)
    clock = Clock(FPS, offset_s)
    bodies = bodies_at(boxes.identity, clock.seconds(boxes.frame), np.full(len(boxes), 5.0 + 5.0j))
    return CameraTracklets(f"C{seed}", CameraObservations(boxes), clock, bodies, None, None, (none, none)), who


def looks_of(*cameras: CameraTracklets, candidates: set[tuple[int, int]] | None = None) -> AppearanceAffinity | None:
    return AppearanceAffinity.of(cameras, np.random.default_rng(0), candidates)


def test_the_likeness_features_and_votes_of_a_pair_tell_one_person_from_two() -> None:
    (a, who_a), (b, who_b), (c, _) = filmed(1), filmed(2), filmed(3)
    found = looks_of(a, b, c)
    assert (sorted(found.pairs), set(looks_of(a, b, c, candidates={(0, 2)}).pairs)) == ([(0, 1), (0, 2), (1, 2)], {(0, 2)})
    ratio = looks_of(a, b).affinity()[0, 1]
    assert ratio.shape == (a.n_tracklets, b.n_tracklets)
    known_a, known_b = (np.isin(np.arange(own.n_tracklets), own.seen.boxes.identity) for own in (a, b))
    known = known_a[:, None] & known_b[None]
    same = known & (who_a[: a.n_tracklets, None] == who_b[None, : b.n_tracklets])
    assert np.mean(ratio[same] > 0) > 0.95
    assert np.mean(ratio[known & ~same] < 0) > 0.95
    assert (ratio[~known] == 0).all(), "nothing is said of a number that is nobody's"
    first, second = found.features_of(0, 1)
    for features, own in ((first, a), (second, b)):
        np.testing.assert_array_equal(features.tracklet, np.unique(own.seen.boxes.identity)[1:])
    votes = found.pairs[0, 1].votes
    matched, together = votes.matched.toarray(), votes.together.toarray()
    same = who_a[first.tracklet][:, None] == who_b[second.tracklet][None]
    assert (matched <= together).all()
    assert matched[same].sum() > 0.9 * together[same].sum() > 0
    alike = looks_of(filmed(1, distinct=False)[0], filmed(2, distinct=False)[0]).affinity()
    assert alike == {} or np.abs(alike[0, 1]).max() < 0.5


def test_a_camera_that_saw_no_people_or_is_without_embeddings_has_no_looks() -> None:
    (a, _), (b, _), (c, _) = filmed(1), filmed(2), filmed(3)
    nobody = b.seen.boxes.take(np.zeros(len(b.seen.boxes), dtype=bool))
    assert nobody.embedding is not None
    for boxes in (replace(b.seen.boxes, embedding=None), Boxes.empty(), nobody):
        blind = replace(b, seen=CameraObservations(boxes))
        found = looks_of(a, blind, c)
        assert ([own is None for own in found.cameras], list(found.pairs)) == ([False, True, False], [(0, 2)])
        assert looks_of(a, blind) is None
    assert looks_of() is None


@pytest.mark.parametrize("offset_s", [0.0, 7.25])
def test_boxes_are_thinned_to_one_a_tracklet_and_grid_time(offset_s: float) -> None:
    a = filmed(1, offset_s=offset_s)[0]
    own = looks_of(a, filmed(2)[0]).cameras[0]
    assert (own.boxes.identity > UNKNOWN).all()
    keys = list(zip(own.boxes.identity.tolist(), own.instants.tolist(), strict=True))
    assert len(set(keys)) == len(keys)
    off = np.abs(a.clock.seconds(own.boxes.frame) - own.instants * STEP_S)
    assert off.max() <= 0.5 * STEP_S
    # The nearest of those there are: with a tenth of the boxes missing, mostly the one at the time itself.
    assert np.mean(off < 0.06) > 0.8
    every = a.seen.boxes.take(a.seen.boxes.identity > UNKNOWN)
    steps = np.round(a.clock.seconds(every.frame) / STEP_S).astype(np.int64)
    assert set(keys) == set(zip(every.identity.tolist(), steps.tolist(), strict=True)), "none is lost"
