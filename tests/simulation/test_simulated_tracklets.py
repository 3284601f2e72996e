"""Tracklets, appearance, clocks and groups: what association has to work with, and the truth that it is judged by."""

from __future__ import annotations

import numpy as np
import pytest

from metrics.identities import identity_agreement
from passerby.common.errors import InputError
from passerby.core.observations import UNKNOWN
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
from passerby.simulation.observe import renumber
from passerby.simulation.scene import AREA_DISTANCE_M, share_out
from support.scenes.simulated import scene

FAULTS = {"box_noise": 0.02, "missing": 0.1, "false_boxes": 0.1, "identity_swaps": 0.2}
CUT = {"unrelated_ids": True, "tracklet_seconds": 4.0}


def found(simulated: SimulatedScene) -> dict:
    return {name: seen.boxes for name, seen in simulated.observations.cameras.items()}


@pytest.mark.slow
@pytest.mark.parametrize(
    "more",
    [
        {"unrelated_ids": True},
        CUT,
        {"embeddings": "distinct"},
        {"embeddings": "alike"},
        {"camera_fps": (5.0,) * 4},
        {"groups": (4,)},
    ],
)
def test_what_association_gets_changes_nothing_else(more):
    plain, changed = scene(**FAULTS), scene(**FAULTS, **more)
    np.testing.assert_array_equal(plain.joints3d, changed.joints3d)
    for camera in plain.rig:
        a, b = plain.observations[camera.name], changed.observations[camera.name]
        np.testing.assert_array_equal(camera.centre, changed.rig[camera.name].centre)
        np.testing.assert_array_equal(a.boxes.ltwh, b.boxes.ltwh)
        np.testing.assert_array_equal(a.boxes.frame, b.boxes.frame)
        np.testing.assert_array_equal(a.keypoints.xy, b.keypoints.xy)
        np.testing.assert_array_equal(plain.true_identities[camera.name], changed.true_identities[camera.name])
        if "unrelated_ids" not in more:
            np.testing.assert_array_equal(a.boxes.identity, b.boxes.identity)


@pytest.mark.slow
def test_the_truth_says_whom_each_box_shows():
    """Swaps and false boxes are in what is reported; the truth is the clean scene's."""
    clean, faulty = scene(), scene(identity_swaps=0.3, false_boxes=0.2)
    wrong = 0
    for name, boxes in clean.truth.items():
        np.testing.assert_array_equal(boxes.identity, clean.observations[name].boxes.identity)
        reported = faulty.observations[name].boxes
        np.testing.assert_array_equal(faulty.truth[name].identity, boxes.identity)
        np.testing.assert_array_equal(faulty.truth[name].ltwh, boxes.ltwh)
        np.testing.assert_array_equal(faulty.true_identities[name] == UNKNOWN, reported.identity == UNKNOWN)
        wrong += (reported.identity != faulty.true_identities[name]).sum()
    assert wrong > 50
    agreement = identity_agreement(found(clean), clean.truth)
    assert (agreement.precision, agreement.recall) == (1.0, 1.0)
    assert 0.4 < identity_agreement(found(faulty), faulty.truth).precision < 0.7  # 0.7 of the boxes of either camera are right


@pytest.mark.slow
def test_unrelated_ids_are_one_to_one_in_a_camera_and_mean_nothing_in_another():
    simulated = scene(preset="construction", unrelated_ids=True, false_boxes=0.1)
    numbering = []
    for name, seen in simulated.observations.cameras.items():
        true, given = simulated.true_identities[name], seen.boxes.identity
        np.testing.assert_array_equal(given == UNKNOWN, true == UNKNOWN)
        np.testing.assert_array_equal(seen.keypoints.identity, given[given != UNKNOWN])
        pairs = np.unique(np.stack([true, given])[:, true != UNKNOWN], axis=1)
        assert len(np.unique(pairs[0])) == len(np.unique(pairs[1])) == pairs.shape[1]
        np.testing.assert_array_equal(np.sort(pairs[1]), np.arange(1, pairs.shape[1] + 1))
        numbering.append(dict(pairs.T.tolist()))
    alike = [a[person] == b[person] for i, a in enumerate(numbering) for b in numbering[:i] for person in a.keys() & b.keys()]
    assert np.mean(alike) < 0.15  # a twentieth, by chance
    assert identity_agreement(found(simulated), simulated.truth).precision < 0.15


@pytest.mark.slow
def test_tracklets_are_as_long_as_stated_and_hold_one_person():
    simulated = simulate(SimulationOptions(seed=2, seconds=120.0, occlusion=False, **CUT))
    lengths = []
    for name, seen in simulated.observations.cameras.items():
        boxes, true = seen.boxes, simulated.true_identities[name]
        for number in np.unique(boxes.identity):
            rows = boxes.identity == number
            frames = boxes.frame[rows]
            assert len(np.unique(true[rows])) == 1
            assert (np.diff(frames) <= 5).all()
            lengths.append(len(frames) / 5)
    # Exponential, a little shorter for the ends of the recording and the times out of view.
    assert 3.0 < np.mean(lengths) < 4.2
    assert np.std(lengths) == pytest.approx(np.mean(lengths), rel=0.15)


def test_a_person_who_was_out_of_sight_for_over_a_second_gets_a_new_number():
    """Cuts ten million seconds apart leave the gaps alone."""
    simulated, rng = scene(missing=0.6, seed=4), np.random.default_rng(0)
    gaps = continued = 0
    for name, seen in simulated.observations.cameras.items():
        numbered = renumber(seen, len(simulated.identities), 5.0, 1e7, rng).boxes
        for person in simulated.identities:
            rows = simulated.true_identities[name] == person
            steps = np.diff(numbered.frame[rows])
            np.testing.assert_array_equal(np.diff(numbered.identity[rows]) != 0, steps > 5)
            gaps += (steps > 5).sum()
            continued += ((steps > 1) & (steps <= 5)).sum()
    assert gaps > 20
    assert continued > 100


def rank_1(simulated: SimulatedScene, boxes_each: int) -> float:
    """How often the nearest of another camera's people is the right one, by means of boxes drawn from each person."""
    rng, means = np.random.default_rng(0), []
    for name, seen in simulated.observations.cameras.items():
        rows = [np.flatnonzero(simulated.true_identities[name] == person) for person in simulated.identities]
        drawn = [seen.boxes.embedding[rng.choice(own, boxes_each)].mean(axis=0) for own in rows]
        means.append(np.stack(drawn) / np.linalg.norm(drawn, axis=1, keepdims=True))
    people = np.arange(len(simulated.identities))
    return float(np.mean([(np.argmax(a @ b.T, axis=1) == people).mean() for a in means for b in means if a is not b]))


@pytest.mark.slow
def test_distinct_people_are_told_apart_as_well_as_networks_do_and_alike_ones_not():
    scenes = {
        kind: [
            scene(preset="basketball", seconds=4.0, seed=seed, occlusion=False, embeddings=kind, false_boxes=0.2)
            for seed in range(6)
        ]
        for kind in ("distinct", "alike")
    }
    for kind, simulated in scenes.items():
        for one in simulated:
            for seen in one.observations.cameras.values():
                assert seen.boxes.embedding.shape == (len(seen.boxes), 128)
                np.testing.assert_allclose(np.linalg.norm(seen.boxes.embedding, axis=1), 1, atol=1e-6)
        single, eight = (np.mean([rank_1(one, count) for one in simulated]) for count in (1, 8))
        if kind == "distinct":
            assert 0.55 < single < 0.8
            assert 0.84 < eight < 0.96
        else:
            assert single < 0.15  # one in fourteen, by chance
            assert eight < 0.15


def test_false_boxes_look_like_nobody():
    simulated = scene(embeddings="distinct", false_boxes=0.5)
    for name, seen in simulated.observations.cameras.items():
        true = simulated.true_identities[name]
        similarity = seen.boxes.embedding @ seen.boxes.embedding.T
        false = true == UNKNOWN
        assert np.abs(similarity[false][:, ~false]).mean() < 0.1
        same = (true[:, None] == true) & ~false[:, None] & ~np.eye(len(true), dtype=bool)
        other = (true[:, None] != true) & ~false[:, None] & ~false
        assert similarity[same].mean() > similarity[other].mean() + 0.4


@pytest.mark.slow
def test_each_camera_has_its_own_frame_rate_and_the_observations_do_not_tell_the_offsets():
    rates, offsets = (5.0, 10.0, 4.0, 12.5), (0.0, 0.3, -0.25, 2.0)
    simulated = scene(camera_fps=rates, clock_offsets=offsets, occlusion=False, people=2)
    for (name, seen), fps, offset in zip(simulated.observations.cameras.items(), rates, offsets, strict=True):
        assert simulated.observations.clocks[name].fps == fps
        assert simulated.observations.clocks[name].offset_s == 0
        assert (simulated.true_clocks[name].fps, simulated.true_clocks[name].offset_s) == (fps, offset)
        assert seen.boxes.frame.max() <= round(10 * fps)
        assert seen.boxes.frame.max() > round(9 * fps)
    assert simulated.observations.fps == 5.0
    assert len(simulated.frames) == 50
    assert not scene().observations.clocks
    # A camera at twice the rate sees in every other frame what it saw before.
    slow, fast = scene(occlusion=False), scene(occlusion=False, camera_fps=(5.0, 10.0, 5.0, 5.0))
    a, b = slow.observations["C2"].boxes, fast.observations["C2"].boxes
    b = b.take(b.frame % 2 == 1)
    np.testing.assert_array_equal(2 * a.frame - 1, b.frame)
    np.testing.assert_allclose(a.ltwh, b.ltwh, atol=1e-6)


def test_true_clocks_find_the_pairs_that_an_offset_hides():
    simulated = scene(clock_offsets=(0.0, 2.0, -2.0, 4.0), camera_fps=(5.0, 10.0, 5.0, 5.0))
    judged = identity_agreement(found(simulated), simulated.truth, simulated.true_clocks)
    assert judged.precision == judged.recall == 1.0
    again = scene()
    assert judged.pairs_true > 0.5 * identity_agreement(found(again), again.truth).pairs_true


@pytest.mark.slow
def test_groups_have_no_common_ground():
    simulated = scene(preset="construction", people=20, cameras=8, groups=(6, 2))
    assert simulated.rig.names == tuple(f"C{i}" for i in range(1, 9))
    areas = [np.round(camera.centre[0] / AREA_DISTANCE_M) for camera in simulated.rig]
    assert areas == [0] * 6 + [1] * 2
    seen = [set(simulated.true_identities[name].tolist()) for name in simulated.rig.names]
    first, second = set().union(*seen[:6]), set().union(*seen[6:])
    assert first == set(range(1, 14))
    assert second == set(range(14, 21))
    ground = simulated.ground_positions[:, :, 0]
    assert np.nanmax(np.abs(ground[:, :13])) < 12
    assert np.nanmax(np.abs(ground[:, 13:] - AREA_DISTANCE_M)) < 12
    for camera in simulated.rig:  # boxes are where the people are
        boxes = simulated.truth[camera.name]
        feet = np.column_stack([simulated.ground_positions[boxes.frame - 1, boxes.identity - 1], np.zeros(len(boxes))])
        inside = (camera.project(feet + [0, 0, 0.8]) - boxes.ltwh[:, :2]) / boxes.ltwh[:, 2:]
        assert ((inside > 0) & (inside < 1)).all(axis=1).mean() > 0.8


@pytest.mark.parametrize(
    ("people", "cameras", "shares"),
    [(20, (6, 2), (13, 7)), (8, (6, 2), (4, 4)), (7, (4,), (7,)), (14, (1, 1, 1), (5, 5, 4))],
)
def test_people_are_shared_out_by_the_number_of_cameras(people, cameras, shares):
    assert share_out(people, cameras) == shares


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tracklet_seconds": 4.0}, "set unrelated_ids"),
        ({"tracklet_seconds": -1.0, "unrelated_ids": True}, "tracklet_seconds = -1"),
        ({"embeddings": "uniform"}, "embeddings 'uniform'"),
        ({"camera_fps": (5.0, 5.0)}, "camera_fps has 2 values for 4 cameras"),
        ({"camera_fps": (5.0, 5.0, 0.0, 5.0)}, "camera_fps = 0"),
        ({"groups": (3, 2)}, "5 cameras, but there are 4"),
        ({"groups": (4, 0)}, "groups = 0"),
        ({"groups": (2.5, 1.5)}, "whole numbers"),
        ({"groups": (2, 2), "people": 7}, "people = 7 are too few"),
    ],
)
def test_bad_options_are_named(options, message):
    with pytest.raises(InputError, match=message) as error:
        SimulationOptions(**options)
    assert "\n" not in str(error.value)
