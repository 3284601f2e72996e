"""What the looks of all cameras' tracklets say, where it is known who is who."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.association.appearance.affinity import AppearanceAffinity
from passerby.association.camera_tracklets import CameraTracklets
from passerby.association.sampling import STEP_S
from passerby.core.observations import UNKNOWN, Boxes, CameraObservations, Clock
from support.scenes.walkers_on_plane import bodies_at

PEOPLE, DIMENSIONS = 10, 64
FPS = 10.0


def camera(
    name: str, *, seed: int, distinct: bool = True, seconds: float = 60.0, offset_s: float = 0.0
) -> tuple[CameraTracklets, np.ndarray]:
    """People who are seen for most of the time, each in several tracklets, and who the tracklets are (-1: a false number)."""
    appearance = np.random.default_rng(0).standard_normal((PEOPLE, DIMENSIONS)) / np.sqrt(DIMENSIONS)
    rng = np.random.default_rng(seed)
    frame = np.tile(np.arange(1, int(seconds * FPS) + 1), PEOPLE)
    person = np.repeat(np.arange(PEOPLE), int(seconds * FPS))
    part = frame * 4 // (int(seconds * FPS) + 1)
    naming = rng.permutation(4 * PEOPLE + 3)
    tracklet = naming[4 * person + part]
    who = np.full(4 * PEOPLE + 3, UNKNOWN)
    who[tracklet] = person
    keep = (rng.random(len(frame)) < 0.9) & (part != (person + seed) % 4)
    tracklet = np.where(rng.random(len(frame)) < 0.05, UNKNOWN, tracklet)[keep]
    core = appearance[person[keep]] if distinct else np.zeros((keep.sum(), DIMENSIONS))
    bias = rng.standard_normal(DIMENSIONS) / np.sqrt(DIMENSIONS)
    vectors = core + bias + 0.7 * rng.standard_normal(core.shape) / np.sqrt(DIMENSIONS)
    boxes = Boxes(frame[keep], tracklet, np.full((len(tracklet), 4), 50.0), np.ones(len(tracklet)), vectors)
    boxes = boxes.take(rng.permutation(len(boxes)))
    none = np.zeros(0, np.int64)
    clock = Clock(FPS, offset_s)
    bodies = bodies_at(boxes.identity, clock.seconds(boxes.frame), np.full(len(boxes), 5.0 + 5.0j))
    return CameraTracklets(name, CameraObservations(boxes), clock, bodies, None, None, (none, none)), who


def looks_of(*cameras: CameraTracklets, candidates: set[tuple[int, int]] | None = None) -> AppearanceAffinity | None:
    return AppearanceAffinity.of(cameras, np.random.default_rng(0), candidates)


def test_the_likeness_tells_one_person_from_two() -> None:
    (a, who_a), (b, who_b) = camera("C1", seed=1), camera("C2", seed=2)
    found = looks_of(a, b)
    ratio = found.affinity()[0, 1]
    assert ratio.shape == (a.n_tracklets, b.n_tracklets)
    known_a, known_b = (np.isin(np.arange(own.n_tracklets), own.seen.boxes.identity) for own in (a, b))
    known = known_a[:, None] & known_b[None]
    same = known & (who_a[: a.n_tracklets, None] == who_b[None, : b.n_tracklets])
    assert np.mean(ratio[same] > 0) > 0.95
    assert np.mean(ratio[known & ~same] < 0) > 0.95
    assert (ratio[~known] == 0).all(), "nothing is said of a number that is nobody's"


def test_the_features_and_votes_are_those_of_the_pair() -> None:
    (a, who_a), (b, who_b), (c, _) = camera("C1", seed=1), camera("C2", seed=2), camera("C3", seed=3)
    found = looks_of(a, b, c)
    assert (sorted(found.pairs), set(looks_of(a, b, c, candidates={(0, 2)}).pairs)) == ([(0, 1), (0, 2), (1, 2)], {(0, 2)})
    first, second = found.features_of(0, 1)
    for features, own in ((first, a), (second, b)):
        np.testing.assert_array_equal(features.tracklet, np.unique(own.seen.boxes.identity)[1:])
    votes = found.pairs[0, 1].votes
    matched, together = votes.matched.toarray(), votes.together.toarray()
    same = who_a[first.tracklet][:, None] == who_b[second.tracklet][None]
    assert (matched <= together).all()
    assert matched[same].sum() > 0.9 * together[same].sum() > 0


def test_looks_that_tell_nobody_apart_say_nothing() -> None:
    found = looks_of(camera("C1", seed=1, distinct=False)[0], camera("C2", seed=2, distinct=False)[0])
    assert found.affinity() == {} or np.abs(found.affinity()[0, 1]).max() < 0.5


def test_a_camera_that_saw_nobody_or_is_without_embeddings_has_no_looks() -> None:
    (a, _), (b, _), (c, _) = camera("C1", seed=1), camera("C2", seed=2), camera("C3", seed=3)
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
    (a, _), (b, _) = camera("C1", seed=1, offset_s=offset_s), camera("C2", seed=2)
    found = looks_of(a, b)
    own = found.cameras[0]
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
