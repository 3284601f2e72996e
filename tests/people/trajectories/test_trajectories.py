"""People followed: exactly without noise, robustly with faults, with honest sigmas; the smoother against a dense one."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Rig
from passerby.core.observations import CameraObservations, Clock, Observations
from passerby.people.trajectories import smoothing
from passerby.people.trajectories.smoothing import START_SPEED, smooth
from passerby.people.trajectories.trajectories import METHODS, TrackOptions, trajectories
from support.scenes.people_and_rigs import without_poses
from support.scenes.people_to_track import POLES, clocks_of, followed, pole_errors, ring, scene_errors, swapped, watched
from support.tiers import thinned

PRESETS = ("terrace", "basketball", "construction")


@pytest.fixture(scope="module")
def rig():
    return ring(4)


@pytest.fixture(scope="module")
def seen(rig):
    return watched(rig)


def tracked(rig, seen, options=POLES):
    return trajectories(rig, seen, clocks_of(rig), options)


def without(observations, wrong):
    """The observations without the boxes for which `wrong(camera, boxes)` holds."""
    return Observations({
        name: CameraObservations(seen.boxes.take(~wrong(name, seen.boxes))) for name, seen in observations.cameras.items()
    })  # fmt: skip


@pytest.mark.parametrize("method", METHODS)
def test_poles_without_noise_are_followed_exactly(rig, seen, method):
    parts = []
    tell = lambda stage, done=0, total=0, **_: parts.append((done, total))  # noqa: E731
    found = trajectories(rig, seen, clocks_of(rig), replace(POLES, method=method), tell=tell)
    # What is left is the smoother's: a curve is not a straight line. The box's middle is not that of the projected pole's ends.
    assert pole_errors(found).max() < 0.02
    assert found.figures["people"] == 3
    assert np.isfinite(found.sigma_m).all()
    if method == POLES.method:
        assert list(found.people) == [1, 2, 3]
        assert len(found) == 3 * 60
        assert parts[-1] == (3, 3)
        assert (found.cameras == 4).mean() > 0.9
        heights = np.array([found.xyz[found.identity == one, 2].mean() for one in (1, 2, 3)])
        assert heights == pytest.approx(np.linspace(1.6, 1.85, 3) / 2, abs=0.02)
        assert (np.diff(found.identity) >= 0).all()
        assert (np.diff(found.time_s)[np.diff(found.identity) == 0] > 0).all()
        for way in found.figures["ways"]:
            number = way["id"] - 1
            speed = 0.35 * (1 + 0.2 * number) * (2.0 + 0.5 * number)
            assert way["length_m"] == pytest.approx(speed * 11.8, rel=0.03)


def test_one_camera_knows_where_people_are_but_less_well(rig, seen):
    alone = without(seen, lambda name, boxes: (boxes.frame >= 20) & (boxes.frame < 35) & (name != "C2"))
    found = tracked(rig, alone)
    one = (found.frame >= 22) & (found.frame < 33)
    assert (found.cameras[one] == 1).all()
    assert np.median(found.sigma_m[one]) > 1.5 * np.median(found.sigma_m[~one])
    # Of a person of unknown height; the neighbouring instants, and the height learnt there, help.
    assert pole_errors(found)[one].max() < 0.5
    assert found.figures["by_one_camera"] >= one.sum()


def test_short_gaps_are_bridged_and_marked_and_long_ones_are_not(rig, seen):
    """And a passer-by of two frames is left out and counted."""

    def gone(name, boxes):
        short, long = (boxes.frame > 10) & (boxes.frame <= 16), (boxes.frame > 30) & (boxes.frame <= 45)
        return ((boxes.identity == 2) & (short | long)) | ((boxes.identity == 3) & (boxes.frame > 2))

    found = tracked(rig, without(seen, gone))
    own = found.identity == 2
    filled = own & (found.cameras == 0)
    assert set(found.frame[filled]) == set(range(11, 17))
    assert not (own & (found.frame > 30) & (found.frame <= 45)).any()
    assert list(np.unique(found.part[own])) == [1, 2]
    assert found.sigma_m[filled].min() > np.median(found.sigma_m[own & ~filled])
    assert pole_errors(found)[filled].max() < 0.15
    assert list(found.people) == [1, 2]
    assert (found.figures["filled"], found.figures["fleeting_parts_left_out"]) == (6, 1)


def test_a_camera_that_shows_somebody_else_is_voted_down(rig, seen):
    boxes = seen["C3"].boxes
    wrong = (boxes.frame > 15) & (boxes.frame < 45) & (boxes.identity <= 2)
    other = replace(boxes, identity=np.where(wrong, 3 - boxes.identity, boxes.identity))
    found = tracked(rig, Observations({**seen.cameras, "C3": CameraObservations(other)}))
    assert pole_errors(found).max() < 0.05
    used = {camera["name"]: camera["used"] / camera["boxes"] for camera in found.figures["cameras"]}
    assert used["C3"] < 0.75
    assert min(used["C1"], used["C2"], used["C4"]) > 0.97


def test_scattered_swaps_survive(rig):
    seen = swapped(watched(rig, 6), 0.3, np.random.default_rng(1))
    errors, paper = (pole_errors(tracked(rig, seen, one), 6) for one in (POLES, replace(POLES, method="pairwise")))
    assert np.mean(errors) < 0.05
    assert np.percentile(errors, 95) < 0.15
    assert np.mean(paper) > 5 * np.mean(errors)


def test_cameras_with_clocks_of_their_own(rig):
    clocks = {"C1": Clock(5.0), "C2": Clock(5.0, 0.73), "C3": Clock(4.0, -0.35), "C4": Clock(5.0, -1.1)}
    seen = watched(rig, seconds=14.0, clocks=clocks)
    found = trajectories(rig, seen, clocks, POLES)
    assert (found.cameras > 2).mean() > 0.5
    # Before the first and after the last camera has begun and ended, one alone sees people.
    assert pole_errors(found)[found.cameras > 1].max() < 0.05
    assert np.mean(pole_errors(tracked(rig, seen))) > 5 * np.mean(pole_errors(found))


@pytest.mark.slow
@thinned("preset", PRESETS, quick=2)
def test_simulated_people_are_within_the_goal_and_better_than_pairwise(preset):
    scene, found = followed(preset)
    errors = scene_errors(scene, found)
    _, paper = followed(preset, "pairwise")
    assert np.nanmean(errors) < 0.15
    assert np.nanmean(errors) < 0.98 * np.nanmean(scene_errors(scene, paper))


@thinned("preset", PRESETS, quick=2)
def test_sigmas_are_honest(preset):
    scene, found = followed(preset)
    within = scene_errors(scene, found) / found.sigma_m
    within = within[np.isfinite(within)]
    # 63 % of two-dimensional normal errors; the scenes differ in how much their people bend.
    assert 0.5 < np.mean(within < 1) < 0.92
    # Not 96 %: somebody who crouches is off by more than anybody who stands, for as long as that lasts.
    assert np.mean(within < 2.5) > 0.85


def test_simulated_swaps_cost_little_and_the_paper_dearly_and_noisier_boxes_have_larger_sigmas():
    scene, quiet = followed("terrace")
    plain = np.nanmean(scene_errors(scene, quiet))
    assert np.nanmean(scene_errors(*followed("terrace", identity_swaps=0.3))) < plain + 0.02
    assert np.nanmean(scene_errors(*followed("terrace", "pairwise", identity_swaps=0.3))) > 0.5
    scene, noisy = followed("terrace", box_noise=0.1)
    assert np.median(noisy.sigma_m) > 1.2 * np.median(quiet.sigma_m)
    assert np.nanmean(scene_errors(scene, noisy)) < 0.15


@pytest.mark.parametrize("method", METHODS)
def test_the_same_input_gives_the_same_bits_in_any_grouping(method, monkeypatch):
    rig = ring(3)
    seen = watched(rig, 5)
    first, second = (tracked(rig, seen, TrackOptions(method)) for _ in range(2))
    assert np.array_equal(first.xyz, second.xyz)
    assert first.figures == second.figures
    monkeypatch.setattr("passerby.people.trajectories.trajectories.BOXES_AT_ONCE", 1)
    assert np.allclose(tracked(rig, seen, TrackOptions(method)).xyz, first.xyz, atol=1e-9)


def test_boxes_without_a_name_and_cameras_without_a_pose_are_left_out():
    rig = ring(3)
    seen = watched(rig)
    found = tracked(Rig((*rig.cameras[:2], replace(rig.cameras[2], pose=None))), seen)
    assert [camera["name"] for camera in found.figures["cameras"]] == ["C1", "C2"]
    assert pole_errors(found).max() < 0.05
    unnamed = Observations({
        name: CameraObservations(replace(one.boxes, identity=np.full(len(one.boxes), -1))) for name, one in seen.cameras.items()
    })  # fmt: skip
    with pytest.raises(EvidenceError, match="no person can be tracked"):
        tracked(rig, unnamed)
    with pytest.raises(EvidenceError, match="no camera with a pose"):
        tracked(without_poses(rig), seen)


@pytest.mark.parametrize("wrong", [{"method": "magic"}, {"max_gap_s": -1.0}, {"person_height_m": 4.0}, {"min_instants": 0}])
def test_options_out_of_range(wrong):
    with pytest.raises(InputError, match=next(iter(wrong))):
        TrackOptions(**wrong)


def walk(count=60, step=0.2, seed=0):
    rng = np.random.default_rng(seed)
    seconds = np.cumsum(rng.uniform(0.5, 1.5, count) * step)
    true = np.column_stack([seconds, np.sin(seconds)])
    root = rng.normal(size=(count, 2, 2)) * 0.2
    covariance = root @ root.transpose(0, 2, 1) + 0.01 * np.eye(2)
    seen = true + np.array([rng.multivariate_normal(np.zeros(2), S) for S in covariance])
    return seconds, true, seen, covariance


def dense(seconds, place, covariance, acceleration):
    """Mean and covariance of the same Gaussian problem, written down as one system of all states."""
    n = len(seconds)
    information, pull = np.zeros((4 * n, 4 * n)), np.zeros(4 * n)
    information[2:4, 2:4] += np.eye(2) / START_SPEED**2
    for k in range(n):
        if np.isfinite(place[k, 0]):
            W = np.linalg.inv(covariance[k])
            information[4 * k : 4 * k + 2, 4 * k : 4 * k + 2] += W
            pull[4 * k : 4 * k + 2] += W @ place[k]
        if k == 0:
            continue
        h = seconds[k] - seconds[k - 1]
        block = np.array([[h**3 / 3, h**2 / 2], [h**2 / 2, h]])
        Q = acceleration * np.kron(block, np.eye(2))
        F = np.eye(4)
        F[0, 2] = F[1, 3] = h
        J = np.concatenate([-F, np.eye(4)], axis=1)
        rows = slice(4 * k - 4, 4 * k + 4)
        information[rows, rows] += J.T @ np.linalg.inv(Q) @ J
    spread = np.linalg.inv(information)
    mean = (spread @ pull).reshape(n, 4)
    return mean[:, :2], np.array([spread[4 * k : 4 * k + 2, 4 * k : 4 * k + 2] for k in range(n)])


def test_it_solves_the_whole_problem_part_by_part():
    """With a gap, in which people are between and less sure; parts know nothing of each other."""
    seconds, _, seen, covariance = walk()
    seen[30:37] = np.nan
    part = (np.arange(len(seconds)) >= 20).astype(int)
    place, spread = smooth(seconds, seen, covariance, part)
    for rows in (slice(20), slice(20, None)):
        want, want_spread = dense(seconds[rows], seen[rows], covariance[rows], smoothing.ACCELERATION)
        # The start is held to within 100 m here, not at all there.
        assert np.abs(place[rows] - want).max() < 1e-4
        assert np.abs(spread[rows] / want_spread - 1)[:, [0, 1], [0, 1]].max() < 1e-3


def test_blocks_change_nothing_and_few_places_are_enough(monkeypatch):
    seconds, _, seen, covariance = walk(700)
    one = np.zeros(len(seconds), int)
    whole = smooth(seconds, seen, covariance, one)
    monkeypatch.setattr(smoothing, "BLOCK", 90)
    monkeypatch.setattr(smoothing, "CELLS", 400)
    cut = smooth(seconds, seen, covariance, one)
    assert np.abs(cut[0] - whole[0]).max() < 1e-5
    assert np.abs(cut[1] - whole[1]).max() < 1e-5
    for count in (0, 1, 2):
        place, covariance = np.ones((count, 2)), np.tile(0.01 * np.eye(2), (count, 1, 1))
        out, spread = smooth(np.arange(count) * 0.2, place, covariance, np.zeros(count, int))
        assert np.allclose(out, 1.0, atol=1e-4)
        assert spread.shape == (count, 2, 2)


def test_it_is_nearer_than_the_measurements_and_its_covariance_is_honest():
    off, sigmas2, raw = [], [], []
    for seed in range(12):
        seconds, true, seen, covariance = walk(seed=seed)
        place, spread = smooth(seconds, seen, covariance, np.zeros(len(seconds), int))
        d = place - true
        off.append(d)
        raw.append(seen - true)
        sigmas2.append(np.einsum("ni,nij,nj->n", d, np.linalg.inv(spread), d))
    assert np.square(off).mean() < 0.4 * np.square(raw).mean()
    # Two degrees of freedom each; a sine of 1 m/s^2 is about as wild as the model takes people to be.
    assert 1.0 < np.mean(sigmas2) < 3.0
