"""Focal lengths that nobody knows: those tried, and the choice that all pairs of cameras like best."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.unknown_focals import begin_with, choose_focals, focals_to_try, needs_focal_search, shared_lenses

GRID = np.geomspace(0.5, 2.0, 5)


@pytest.mark.parametrize("seed", range(20))
def test_the_choice_is_the_best_of_all(seed):
    """Costs as grounds have them: least where both focal lengths are right, more the farther off they are."""
    rng = np.random.default_rng(seed)
    counts = [5, 5, 1, 5]
    right = [int(rng.integers(count)) for count in counts]
    costs = {}
    for a, b in itertools.combinations(range(4), 2):
        off_a, off_b = np.arange(counts[a]) - right[a], np.arange(counts[b]) - right[b]
        costs[a, b] = rng.uniform(5, 20) * np.log1p(off_a[:, None] ** 2 + off_b**2) + rng.uniform(0, 2, (counts[a], counts[b]))

    def total(chosen):
        return sum(table[chosen[a], chosen[b]] for (a, b), table in costs.items())

    best = min(itertools.product(*map(range, counts)), key=total)
    assert total(choose_focals(counts, costs)) == pytest.approx(total(best))


def test_a_camera_of_which_no_pair_tells_takes_any_and_changes_nothing():
    table = np.array([[1.0, 5.0], [5.0, 0.0]])
    assert choose_focals([2, 3, 2], {(0, 2): table})[0::2] == [1, 1]
    assert choose_focals([], {}) == []


def test_only_what_may_be_is_tried():
    unknown, stated = Lens.unknown((1280, 720)), Lens.unknown((1280, 720), hfov_deg=90.0, focal_sd=0.2)
    np.testing.assert_allclose(np.exp(focals_to_try(unknown, GRID)) * unknown.focal, GRID * 1280)
    near = np.exp(focals_to_try(stated, GRID)) * stated.focal / 1280
    assert set(near.round(6)) == {round(share, 6) for share in GRID if abs(np.log(share / 0.5)) <= 0.5}
    for known in (Lens.unknown((1280, 720), hfov_deg=90.0, focal_sd=0.05), Lens((1280, 720), unknown.matrix, np.zeros(5))):
        assert focals_to_try(known, GRID).tolist() == [0.0]
    fisheye = Lens.unknown((1280, 720), fisheye=True)
    np.testing.assert_allclose(np.exp(focals_to_try(fisheye, GRID)) * fisheye.focal, 0.5 * GRID * 1280)


def test_the_next_estimate_begins_with_the_focal_length_alone():
    """The rest is found anew each time, about what is known beforehand."""
    unknown, known = Lens.unknown((640, 480)), Lens((640, 480), np.diag([500.0, 500.0, 1.0]), np.zeros(5))
    stated = Rig((Camera("A", unknown), Camera("B", known), Camera("C", unknown)))
    matrix, pose = np.array([[700.0, 0, 333], [0, 700, 222], [0, 0, 1]]), Pose(np.eye(3), np.zeros(3))
    found = Lens((640, 480), matrix, np.array([-0.2, 0, 0, 0]), focal_sd=0.02)
    begun = begin_with(stated, Rig((Camera("A", found, pose), Camera("B", known, pose), Camera("C", unknown))))
    first = begun["A"].lens
    assert (first.focal, first.matrix[:2, 2].tolist(), first.uncalibrated) == (pytest.approx(700.0), [320.0, 240.0], True)
    assert not first.distortions.any()
    assert begun["B"].lens is known
    assert begun["C"].lens is unknown, "it has no pose"
    assert [needs_focal_search(rig) for rig in (stated, Rig(begun.cameras[:2]))] == [True, False]


def test_cameras_of_one_model_choose_together():
    """Each on its own would take another: what all pairs like best decides, with those among themselves on equal terms."""
    among, beside = np.array([[4.0, 0.0], [9.0, 3.0]]), np.array([[0.0, 8.0], [2.0, 2.0]])
    costs = {(0, 1): among, (0, 2): beside, (1, 2): beside}
    chosen = choose_focals([2, 2, 2], costs, [[0, 1], [2]])
    assert chosen[0] == chosen[1]

    def total(own, other):
        return among[own, own] + 2 * beside[own, other]

    assert total(chosen[0], chosen[2]) == min(total(own, other) for own, other in itertools.product(range(2), repeat=2))


def test_cameras_of_one_model_are_those_that_nobody_calibrated():
    size = (640, 480)
    own, of_model = Lens.unknown(size), Lens.unknown(size, group="dome")
    known = replace(of_model, uncalibrated=False, focal_sd=None)
    rig = Rig(tuple(Camera(name, lens) for name, lens in zip("ABCDE", (of_model, own, of_model, known, own), strict=True)))
    assert shared_lenses(rig) == [[0, 2], [1], [3], [4]]


def test_a_camera_without_a_pose_begins_with_the_lens_of_its_model():
    size = (640, 480)
    stated = Rig(tuple(Camera(name, Lens.unknown(size, group="dome")) for name in "ABC"))
    pose = Pose(np.eye(3), np.zeros(3))
    found = Rig((
        Camera("A", stated["A"].lens.with_focal(1.2, 0.02), pose), Camera("B", stated["B"].lens.with_focal(1.25, 0.02), pose),
        stated["C"],
    ))  # fmt: skip
    focals = [camera.lens.focal for camera in begin_with(stated, found)]
    assert focals == pytest.approx([640 * np.sqrt(1.2 * 1.25)] * 3)
