"""What of the observations counts as evidence."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.core.observations import BODY_17, Boxes, CameraObservations, Keypoints, Observations
from passerby.people.segments import nominal_heights
from passerby.solver.evidence import Evidence, gather_evidence
from support.scenes.people_and_rigs import LENS, ring

RIG = ring(3)
WIDTH, HEIGHT = LENS.size


def boxes(*rows: tuple[float, ...]) -> CameraObservations:
    """Rows of frame, identity, left, top, width, height."""
    table = np.array(rows, dtype=float).reshape(-1, 6)
    return CameraObservations(Boxes(table[:, 0].astype(int), table[:, 1].astype(int), table[:, 2:], np.ones(len(table))))


def gather(*seen: CameraObservations, seed: int = 0, **limits: int) -> Evidence:
    seen += (CameraObservations(),) * (3 - len(seen))
    observations = Observations(dict(zip(RIG.names, seen, strict=True)))
    return gather_evidence(RIG, observations, np.random.default_rng(seed), **limits)


def instants(evidence: Evidence) -> set[tuple[int, int]]:
    """(identity, frame) of the person-instants."""
    return set(zip(evidence.identities[evidence.person].tolist(), evidence.frame.tolist(), strict=True))


def names(evidence: Evidence) -> list[tuple[int, int, int]]:
    """(camera, identity, frame) of each sighting."""
    s = evidence.sightings
    identity = evidence.identities[evidence.person[s.block]]
    return list(zip(s.camera.tolist(), identity.tolist(), evidence.frame[s.block].tolist(), strict=True))


def standing(people: int = 1, *, joints: tuple[str, ...] = BODY_17) -> CameraObservations:
    """People who stand upright in the picture, with all joints found, one a frame."""
    share = nominal_heights(BODY_17)
    share[[7, 8, 9, 10]] = (0.63, 0.63, 0.5, 0.5)
    xy = np.tile(np.stack([np.full(17, 500.0) + np.arange(17), 600 - 400 * share], axis=1), (people, 1, 1))
    frame = np.arange(1, people + 1)
    return CameraObservations(keypoints=Keypoints(frame, np.full(people, 7), xy, np.full((people, 17), 0.9), joints))


WHOLE = (1, 5, 500, 200, 60, 180)


@pytest.mark.parametrize(
    "useless",
    [(1, 5, 0, 200, 60, 180), (1, 5, 500, 1, 60, 180), (1, 5, WIDTH - 61, 200, 60, 180), (1, 5, 500, HEIGHT - 181, 60, 180),
     (1, -1, 500, 200, 60, 180), (1, 5, 500, 200, 3, 7)],
    ids=["cut at the left", "at the top", "at the right", "at the bottom", "unnamed", "tiny"],
)  # fmt: skip
def test_boxes_that_tell_of_nobody_are_left_out(useless: tuple[float, ...]) -> None:
    assert names(gather(boxes(WHOLE), boxes(useless), boxes(WHOLE))) == [(0, 5, 1), (2, 5, 1)]
    nothing = gather(boxes(WHOLE), boxes(useless))
    assert len(nothing.sightings) == nothing.n_people == nothing.n_joints == 0


def test_only_instants_that_two_cameras_saw_count() -> None:
    """Frames may be any whole numbers, far apart and negative: identity and frame must not be mixed up."""
    seen = {0: [(1, 5), (2, 5), (3, 6)], 1: [(1, 5), (2, 6), (4, 5)], 2: [(3, 6), (1, 5)]}
    evidence = gather(*(boxes(*((*row, *WHOLE[2:]) for row in rows)) for rows in seen.values()))
    assert instants(evidence) == {(5, 1), (6, 3)}
    assert sorted(names(evidence)) == [(0, 5, 1), (0, 6, 3), (1, 5, 1), (2, 5, 1), (2, 6, 3)]
    assert (np.diff(evidence.sightings.camera) >= 0).all()
    assert (evidence.n_people, evidence.n_cameras) == (2, 3)
    rows = [(frame, identity, *WHOLE[2:]) for frame in (-40, 0, 10**9) for identity in (0, 1, 10**6)]
    assert instants(gather(boxes(*rows), boxes(*rows))) == {(row[1], row[0]) for row in rows}


def test_a_sighting_is_the_rays_of_its_box() -> None:
    evidence = gather(boxes(WHOLE), boxes((1, 5, 300, 100, 80, 240)))
    s = evidence.sightings
    np.testing.assert_allclose(LENS.project_rays(s.top), [[530, 200], [340, 100]], atol=1e-4)
    np.testing.assert_allclose(LENS.project_rays(s.bottom), [[530, 380], [340, 340]], atol=1e-4)
    np.testing.assert_allclose(s.extent_px, [180, 240])
    np.testing.assert_allclose(s.top_tangent, LENS.tangents(s.top))
    assert s.has_foot.tolist() == [1, 1]
    assert s.top_fraction.tolist() == [1, 1]


def test_limits_hold_and_the_seed_decides_what_is_kept() -> None:
    seen = [boxes(*((frame, identity, *WHOLE[2:]) for frame in range(50) for identity in range(4)))] * 3
    few, again, other = (gather(*seen, max_sightings=100, seed=seed) for seed in (0, 0, 1))
    assert 90 <= len(few.sightings) <= 100
    assert (np.bincount(few.sightings.block) == 3).all(), "a person-instant was cut in pieces"
    assert names(few) == names(again)
    assert instants(few) != instants(other)
    assert len(gather(*seen).sightings) == 600


def test_joints_that_two_cameras_saw_are_points() -> None:
    evidence = gather(standing(3), standing(2))
    assert evidence.n_joints == 2 * 17
    assert len(evidence.joints.camera) == 2 * 2 * 17
    assert sorted(np.unique(evidence.joint_kind).tolist()) == list(range(17))
    assert (np.bincount(evidence.joints.point) == 2).all()
    pixels = LENS.project_rays(evidence.joints.bearing)
    kind = evidence.joint_kind[evidence.joints.point]
    np.testing.assert_allclose(pixels[:, 0], 500 + kind, atol=1e-4)
    assert len(gather(standing(40), standing(40), max_joints=100).joints.camera) <= 100


def test_doubtful_joints_weigh_less_and_lost_ones_nothing() -> None:
    seen = standing(4)
    score = seen.keypoints.score.copy()
    score[:, 3], score[:, 4] = 0.45, 0.1
    doubtful = replace(seen, keypoints=replace(seen.keypoints, score=score))
    o = (evidence := gather(doubtful, standing(4))).joints
    kind = evidence.joint_kind[o.point]
    assert not (kind == 4).any()
    own = o.camera == 0
    assert np.median(o.sigma_px[own & (kind == 3)]) >= 2 * np.median(o.sigma_px[own & (kind == 2)])


def test_people_with_joints_stand_between_head_and_ankles() -> None:
    s = gather(standing(2), standing(2)).sightings
    assert len(s) == 4
    np.testing.assert_allclose(s.top_fraction, 0.934, atol=0.01)
    np.testing.assert_allclose(s.bottom_fraction, 0.045)
    np.testing.assert_allclose(s.extent_px, 400 * (s.top_fraction - s.bottom_fraction), rtol=1e-2)
    assert (s.has_foot == 0).all()


def test_box_and_joints_of_one_person_are_one_sighting() -> None:
    both = CameraObservations(boxes((1, 7, *WHOLE[2:]), (9, 8, *WHOLE[2:])).boxes, standing(2).keypoints)
    evidence = gather(both, both)
    assert sorted(names(evidence)) == [(c, i, f) for c in (0, 1) for i, f in ((7, 1), (7, 2), (8, 9))]
    # The box is kept where there is one, and the joints stay points of their own.
    foot = {name: bool(value) for name, value in zip(names(evidence), evidence.sightings.has_foot, strict=True)}
    assert foot[(0, 7, 1)]
    assert not foot[(0, 7, 2)]
    assert evidence.n_joints == 2 * 17


def test_wrong_names_of_joints_are_noticed() -> None:
    shuffled = tuple(BODY_17[i] for i in np.random.default_rng(1).permutation(17))
    right, wrong = gather(standing(20), standing(20)), gather(standing(20, joints=shuffled), standing(20, joints=shuffled))
    assert right.findings == ()
    assert [doubt.code for doubt in wrong.findings] == ["keypoint_names_unfit"]
    # Head and feet are then found by position, not by name.
    assert len(wrong.sightings) == 40
    np.testing.assert_allclose(wrong.sightings.extent_px, right.sightings.extent_px, rtol=0.1)
    assert wrong.n_joints == right.n_joints


def test_nominal_heights_know_both_sides_and_no_free_limbs() -> None:
    found = nominal_heights(("left_ankle", "right_ankle", "mid_hip", "left_wrist", "tail"))
    assert found[0] == found[1]
    assert found[2] == pytest.approx(0.53)
    assert np.isnan(found[3:]).all()
