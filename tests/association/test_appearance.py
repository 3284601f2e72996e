"""Looks: what the features, the matches and the two measures of usefulness say where the truth is known."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from passerby.association.appearance import discriminability as evidence
from passerby.association.appearance import embeddings as appearance
from passerby.common.arrays import Floats, Ints
from passerby.core.observations import Boxes

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


# --- features


def test_one_box_of_each_chunk_is_taken() -> None:
    n = 43
    chunk = np.searchsorted([5, 10, 16, 21, 26, 32, 37], np.arange(n), side="right")  # floor(c * 43 / 8)
    order = np.random.default_rng(0).permutation(n)
    boxes = boxes_of(np.arange(n)[order] * 3, np.full(n, 7), np.eye(8)[chunk][order])
    found = appearance.tracklet_features(boxes, np.random.default_rng(1))
    np.testing.assert_allclose(found.feature, np.full((1, 8), 8**-0.5), atol=1e-7)
    assert (found.tracklet.tolist(), found.n.tolist()) == ([7], [n])


def test_every_box_of_a_chunk_is_drawn_now_and_then_and_the_same_seed_draws_the_same() -> None:
    boxes = boxes_of(np.arange(24), np.zeros(24), np.eye(24))
    drawn = [appearance.tracklet_features(boxes, np.random.default_rng(seed)).feature[0] > 0 for seed in range(60)]
    assert np.any(drawn, axis=0).all()
    assert all(one.reshape(8, 3).sum(axis=1).tolist() == [1] * 8 for one in drawn)
    again = appearance.tracklet_features(boxes, np.random.default_rng(5)).feature[0] > 0
    assert (again == drawn[5]).all()


def test_short_tracklets_unknown_boxes_and_boxes_without_tracklet() -> None:
    embedding = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0], [0, 0, 0], [0, 1, 0]])
    found = appearance.tracklet_features(boxes_of([1, 2, 3, 4, 1, 2], [5, 5, -1, 5, 2, 9], embedding), np.random.default_rng(0))
    assert (found.tracklet.tolist(), found.n.tolist(), found.known.tolist()) == ([2, 5, 9], [0, 2, 1], [False, True, True])
    np.testing.assert_allclose(found.feature, [[0, 0, 0], [2**-0.5, 2**-0.5, 0], [0, 1, 0]], atol=1e-7)


# --- matches


def brute_matches(scene: Crowd, similarity: Floats, a: appearance.TrackletFeatures, b: appearance.TrackletFeatures) -> float:
    """Sum of the best assignments' distances over all instants, each solved for itself."""
    total = 0.0
    for frame in np.intersect1d(scene.a.frame, scene.b.frame):
        i = a.index(scene.a.identity[scene.a.frame == frame])
        j = b.index(scene.b.identity[scene.b.frame == frame])
        cost = np.sqrt(np.maximum(2 - 2 * similarity[np.ix_(i, j)], 0))
        total += cost[linear_sum_assignment(cost)].sum()
    return total


def test_matches_are_the_best_of_every_instant() -> None:
    scene = crowd("distinct", 3, n_frames=80, noise=4.0)
    a, b = of_both(scene)
    found = appearance.match_boxes(camera(scene.a, a), camera(scene.b, b))
    assert (scene.a.frame[found.row_a] == scene.b.frame[found.row_b]).all()
    assert found.distance.sum() == pytest.approx(brute_matches(scene, appearance.similarities(a, b), a, b))
    for rows in (found.row_a, found.row_b):
        assert len(np.unique(rows)) == len(rows)
    later = appearance.match_boxes(camera(scene.a, a, scene.a.frame + 1000), camera(scene.b, b, scene.b.frame + 1000))
    assert (later.row_a == found.row_a).all()
    never = appearance.match_boxes(camera(scene.a, a), camera(scene.b, b, scene.b.frame + 1000))
    assert len(never.row_a) == 0


def test_the_cameras_mean_is_in_the_way() -> None:
    """Each person takes on the camera's own look by a share that differs from person to person and camera to camera."""
    nearest, matched = np.zeros((2, 5)), np.zeros((2, 5))
    for seed in range(5):
        scene = crowd("leaning", seed, n_people=20, n_frames=150, noise=2.0, shared=0.6)
        a, b = of_both(scene, seed)
        _, same, _ = ratio_of(scene, 0.0, seed)
        for way, centre in enumerate((True, False)):
            similarity = appearance.similarities(a, b, centre)
            nearest[way, seed] = same[np.arange(len(same)), similarity.argmax(axis=1)].mean()
            found = appearance.match_boxes(camera(scene.a, a), camera(scene.b, b), centre)
            matched[way, seed] = (scene.person_a[found.row_a] == scene.person_b[found.row_b]).mean()
    assert nearest[0].mean() > nearest[1].mean() + 0.1
    assert matched[0].mean() > matched[1].mean()


def test_a_tracklet_seen_twice_at_one_instant_is_matched_once() -> None:
    embedding = np.array([[1, 0, 0], [1, 0, 0], [0, 1, 0]])
    a, b = boxes_of([1, 2, 1], [0, 0, 1], embedding), boxes_of([1, 1, 1], [4, 4, 6], embedding)
    fa, fb = (appearance.tracklet_features(one, np.random.default_rng(0)) for one in (a, b))
    found = appearance.match_boxes(camera(a, fa, np.zeros(3, int)), camera(b, fb, np.zeros(3, int)))
    assert sorted(zip(a.identity[found.row_a].tolist(), b.identity[found.row_b].tolist(), strict=True)) == [(0, 4), (1, 6)]


def test_votes_count_instants() -> None:
    scene = crowd("distinct", 2, n_frames=100, noise=2.0)
    a, b = of_both(scene)
    found = appearance.match_boxes(camera(scene.a, a), camera(scene.b, b))
    votes = appearance.count_votes(camera(scene.a, a), camera(scene.b, b), found)
    assert votes.matched.sum() == len(found.row_a)
    assert (votes.together.toarray() >= votes.matched.toarray()).all()
    i, j = 3, 5
    frames_a = scene.a.frame[scene.a.identity == a.tracklet[i]]
    frames_b = scene.b.frame[scene.b.identity == b.tracklet[j]]
    assert votes.together.toarray()[i, j] == len(np.intersect1d(frames_a, frames_b))


def test_nothing_known_of_looks_gives_nothing() -> None:
    scene = crowd("distinct", 0, n_frames=40)
    rng = np.random.default_rng(0)
    for b in (replace(scene.b, embedding=None), Boxes.empty()):
        fa, fb = appearance.tracklet_features(scene.a, rng), appearance.tracklet_features(b, rng)
        one, other = camera(scene.a, fa), camera(b, fb)
        found = appearance.match_boxes(one, other)
        assert (len(found.row_a), appearance.count_votes(one, other, found).together.nnz) == (0, 0)
        assert evidence.within_camera_discriminability(b, rng) is None
        assert evidence.between_camera_discriminability(one, other, rng) is None
        assert not evidence.appearance_log_likelihood_ratios(fa, fb, np.zeros(0), 1.0).any()


# --- usefulness


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


def test_too_few_people_tell_nothing() -> None:
    a, b = of_both(few := crowd("distinct", 0, n_people=2, shared=1.0))
    rng = np.random.default_rng(0)
    assert evidence.between_camera_discriminability(camera(few.a, a), camera(few.b, b), rng) is None
    assert evidence.within_camera_discriminability(crowd("distinct", 0, n_people=1, shared=1.0).a, rng) is None


# --- likelihood ratio


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
    for seed in range(6):
        ratio, same, similarity = ratio_of(crowd("distinct", seed, noise=noise), 1.0, seed)
        assert np.abs(ratio).max() <= 3.0
        assert ratio[same].mean() > least
        assert ratio[~same].mean() < -least
        assert (np.diff(ratio.ravel()[similarity.ravel().argsort()]) >= -1e-9).all()


@pytest.mark.parametrize("kind", ["alike", "own look per tracklet", "own look per camera"])
def test_the_ratio_of_useless_looks_is_zero_by_its_weight(kind: str) -> None:
    for seed in range(4):
        scene = crowd(kind, seed)
        assert np.abs(ratio_of(scene, weight_of(scene, seed), seed)[0]).mean() < 0.05


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
