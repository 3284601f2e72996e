"""Estimates of a rig by all footage: their errors are as large as stated, even where windows differ by more than they state."""

import numpy as np
import pytest

from passerby.monitoring.comparison import compare
from passerby.monitoring.evidence import MODEL_DEG, MODEL_M
from passerby.monitoring.windows import Part, estimate_by_parts, estimate_by_scores
from passerby.people.scores import Scores
from passerby.people.sightings import poses_of
from passerby.solver.gauge import similarity_moves
from reliability.room import room_rig

CAMERAS = 4
RIG = room_rig(3, CAMERAS)
R, CENTRE = poses_of(RIG, RIG.names)
SD = np.tile(np.repeat([0.03, np.radians(0.3)], 3), CAMERAS)
"""Of one window."""
MOVES = similarity_moves(R, CENTRE, CENTRE.mean(axis=0)).reshape(-1, 7)
THRESHOLD = 4.7


def information():
    """Of one window: nothing along similarities."""
    weight = np.diag(SD**-2)
    along = weight @ MOVES
    return weight - along @ np.linalg.solve(MOVES.T @ along, along.T)


def parts(rng, turned=0.0, excess=1.0, count=12, stretches=4.0):
    """Windows of a rig, of which camera 1 is turned about the vertical."""
    true = np.zeros((CAMERAS, 6))
    true[1, 3:] = np.radians(turned) * R[1][:, 2]
    return [
        Part(60.0 * k, 60.0 * (k + 1), true.ravel() + excess * SD * rng.standard_normal(6 * CAMERAS), information(),
             np.full(CAMERAS, stretches)) for k in range(count)
    ]  # fmt: skip


def compared(found, rig_sd=(0.01, 0.05)):
    before = np.diag(np.tile(np.repeat([rig_sd[0] ** 2, np.radians(rig_sd[1]) ** 2], 3), CAMERAS))
    return compare(R, CENTRE, (np.zeros(6 * CAMERAS), before), found, THRESHOLD)


@pytest.mark.parametrize("excess", [1.0, 3.0])
def test_still_cameras_are_steady_however_much_windows_differ(excess):
    scores = []
    for seed in range(40):
        found = estimate_by_parts(R, CENTRE, parts(np.random.default_rng(seed), excess=excess))
        scores.append(max(test.score for test in compared(found).tests))
    assert max(scores) < THRESHOLD
    assert np.median(scores) < 1.5


def test_windows_that_show_nothing_show_a_turn_together():
    windows = parts(np.random.default_rng(1), turned=0.8)
    alone = [compared(estimate_by_parts(R, CENTRE, [one])).moved for one in windows]
    assert sum(len(one) > 0 for one in alone) == 0
    (moved,) = compared(estimate_by_parts(R, CENTRE, windows)).moved
    assert (moved.camera, moved.others) == (1, ())
    off = moved.shift - np.concatenate([np.zeros(3), np.radians(0.8) * R[1][:, 2]])
    assert off @ np.linalg.solve(moved.covariance, off) < 22.5  # 99.9 % of a chi squared of six


def test_what_people_seem_to_move_a_camera_by_does_not_average_out():
    many = estimate_by_parts(R, CENTRE, parts(np.random.default_rng(0), count=3000))
    spread = np.sqrt(np.diag(many.covariance)).reshape(CAMERAS, 6)
    assert (spread[:, :3] >= MODEL_M).all()
    assert (spread[:, 3:] >= np.radians(MODEL_DEG)).all()


def test_cameras_with_few_people_are_left_out():
    few = parts(np.random.default_rng(0), count=1, stretches=1.0)
    assert estimate_by_parts(R, CENTRE, few) is None
    nothing = Scores(
        np.zeros(0), np.zeros((0, 24)), np.zeros((0, 24, 24)), np.zeros((0, CAMERAS), np.int64)
    )  # fmt: skip
    assert estimate_by_scores(R, CENTRE, nothing) is None


def test_scatter_of_people_is_in_the_estimate_by_scores():
    """Clusters that scatter three times as much as they state are three times as uncertain."""

    def spread(excess):
        rng, n = np.random.default_rng(5), 400
        one = information() / 100
        value, vector = np.linalg.eigh(one)
        noise = (vector * np.sqrt(np.maximum(value, 0.0))) @ rng.standard_normal((6 * CAMERAS, n))
        scores = Scores(6.0 * np.arange(n), excess * noise.T, np.repeat(one[None], n, axis=0), np.ones((n, CAMERAS), np.int64))
        found = estimate_by_scores(R, CENTRE, scores)
        weak = found.covariance - np.diag(np.tile(np.repeat([MODEL_M**2, np.radians(MODEL_DEG) ** 2], 3), CAMERAS))
        return np.sqrt(np.trace(information() @ weak))

    assert spread(3.0) == pytest.approx(3 * spread(1.0), rel=0.05)
