"""People followed: exactly without noise, robustly with faults, honestly in their sigmas."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Rig
from passerby.core.observations import CameraObservations, Clock, Observations
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
    found = tracked(rig, seen, replace(POLES, method=method))
    # What is left is the smoother's: a curve is not a straight line. The box's middle is not that of the projected pole's ends.
    assert pole_errors(found).max() < 0.02
    assert found.figures["people"] == 3
    assert np.isfinite(found.sigma_m).all()
    if method == POLES.method:
        assert list(found.people) == [1, 2, 3]
        assert len(found) == 3 * 60
        assert (found.cameras == 4).mean() > 0.9
        heights = np.array([found.xyz[found.identity == one, 2].mean() for one in (1, 2, 3)])
        assert heights == pytest.approx(np.linspace(1.6, 1.85, 3) / 2, abs=0.02)


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


def test_columns_are_sorted_and_figures_add_up(rig, seen):
    told = []
    found = trajectories(rig, seen, clocks_of(rig), POLES, tell=lambda stage, done=0, total=0, **_: told.append((done, total)))
    assert (np.diff(found.identity) >= 0).all()
    assert (np.diff(found.time_s)[np.diff(found.identity) == 0] > 0).all()
    assert told[-1] == (3, 3)
    for way in found.figures["ways"]:
        number = way["id"] - 1
        speed = 0.35 * (1 + 0.2 * number) * (2.0 + 0.5 * number)
        assert way["length_m"] == pytest.approx(speed * 11.8, rel=0.03)


def test_boxes_of_nobody_and_cameras_without_a_pose_are_left_out():
    rig = ring(3)
    seen = watched(rig)
    found = tracked(Rig((*rig.cameras[:2], replace(rig.cameras[2], pose=None))), seen)
    assert [camera["name"] for camera in found.figures["cameras"]] == ["C1", "C2"]
    assert pole_errors(found).max() < 0.05
    nobody = Observations({
        name: CameraObservations(replace(one.boxes, identity=np.full(len(one.boxes), -1))) for name, one in seen.cameras.items()
    })  # fmt: skip
    with pytest.raises(EvidenceError, match="no person can be tracked"):
        tracked(rig, nobody)
    with pytest.raises(EvidenceError, match="no camera with a pose"):
        tracked(without_poses(rig), seen)


@pytest.mark.parametrize("wrong", [{"method": "magic"}, {"max_gap_s": -1.0}, {"person_height_m": 4.0}, {"min_instants": 0}])
def test_options_out_of_range(wrong):
    with pytest.raises(InputError, match=next(iter(wrong))):
        TrackOptions(**wrong)
