"""What the simulated detector reports: faults as large as stated, tracklets, appearance and clocks; and the truth of it."""

import numpy as np
import pytest

from metrics.identities import identity_agreement
from passerby.common.errors import InputError
from passerby.core.observations import UNKNOWN
from passerby.simulation import SimulationOptions, simulate
from passerby.simulation.observe import renumber
from passerby.simulation.scene import AREA_DISTANCE_M, share_out
from support.scenes.simulated import edges_of, faulty_scene, scene
from support.tiers import thinned

FREE = {"occlusion": False, "preset": "construction"}
FAULTS = {"box_noise": 0.02, "missing": 0.1, "false_boxes": 0.1, "identity_swaps": 0.2}
CUT = {"unrelated_ids": True, "tracklet_seconds": 4.0}


def found(simulated):
    return {name: seen.boxes for name, seen in simulated.observations.cameras.items()}


def count(simulated, kind="boxes"):
    return sum(len(getattr(seen, kind)) for seen in simulated.observations.cameras.values())


def differences(changed, camera="C1"):
    """(N, 4) edges with the fault minus edges without, and (N,) heights without, of boxes away from the picture's border."""
    clean, faulty = edges_of(faulty_scene(**FREE), camera), edges_of(faulty_scene(**FREE, **changed), camera)
    width, height = faulty_scene(**FREE).rig[camera].lens.size
    inner = (clean[..., :2] > 60).all(-1) & (clean[..., 2] < width - 60) & (clean[..., 3] < height - 60)
    inner &= np.isfinite(faulty[..., 0])
    return (faulty - clean)[inner], (clean[..., 3] - clean[..., 1])[inner]


@pytest.mark.slow
def test_box_noise_has_the_stated_deviation_on_each_edge():
    moved, height = differences({"box_noise": 0.03})
    relative = moved / height[:, None]
    np.testing.assert_allclose(relative.std(axis=0), 0.03, rtol=0.1)
    np.testing.assert_allclose(relative.mean(axis=0), 0, atol=0.004)
    np.testing.assert_allclose(np.corrcoef(relative.T), np.eye(4), atol=0.12)


def test_corner_noise_is_uniform_within_its_bound_and_slack_moves_every_edge_outwards():
    moved, _ = differences({"corner_noise_px": 5.0})
    assert np.abs(moved).max() <= 5.0
    np.testing.assert_allclose(moved.std(axis=0), 5 / np.sqrt(3), rtol=0.1)
    moved, height = differences({"box_slack": 0.05})
    np.testing.assert_allclose(moved / height[:, None], np.array([[-0.05, -0.05, 0.05, 0.05]]).repeat(len(moved), 0), atol=1e-9)


@pytest.mark.slow
def test_boxes_stay_in_the_picture_and_cut_edges_on_its_border():
    clean, noisy = faulty_scene(preset="terrace", seconds=30.0), faulty_scene(preset="terrace", seconds=30.0, box_noise=0.1)
    cut = 0
    for camera in noisy.rig:
        width, height = camera.lens.size
        a, b = edges_of(clean, camera.name), edges_of(noisy, camera.name)
        seen = np.isfinite(b[..., 0])
        assert (b[seen] >= 0).all()
        assert (b[seen] <= (width, height, width, height)).all()
        border = (a == (0, 0, width, height)) & seen[..., None]
        np.testing.assert_array_equal(a[border], b[border])
        cut += border.sum()
    assert cut > 10


def test_missing_boxes_false_boxes_and_joint_noise_are_as_many_and_as_large_as_stated():
    clean, fewer, more, noisy = (
        faulty_scene(**FREE, **fault) for fault in ({}, {"missing": 0.25}, {"false_boxes": 0.2}, {"joint_noise_px": 1.5})
    )
    assert 1 - count(fewer) / count(clean) == pytest.approx(0.25, abs=0.03)
    assert count(fewer) == count(fewer, "keypoints")
    for camera in clean.rig:
        a, b = clean.observations[camera.name].boxes, more.observations[camera.name].boxes
        false = b.take(b.identity == UNKNOWN)
        assert len(false) == round(0.2 * len(a))
        np.testing.assert_array_equal(b.take(b.identity != UNKNOWN).ltwh, a.ltwh)
        assert (np.diff(b.frame) >= 0).all()
        assert (false.ltwh[:, :2] >= 0).all()
        assert (false.ltwh[:, :2] + false.ltwh[:, 2:] <= camera.lens.size).all()
    a, b = clean.observations["C3"].keypoints, noisy.observations["C3"].keypoints
    true = clean.rig["C3"].project(clean.joints3d[a.frame - 1, a.identity - 1].reshape(-1, 3)).reshape(a.xy.shape)
    np.testing.assert_allclose(a.xy, true, atol=1e-6)
    assert (b.xy - a.xy).std() == pytest.approx(1.5, rel=0.03)
    assert set(np.unique(a.score)) == {0.0, 0.9}


@pytest.mark.slow
@thinned(("preset", "share"), [("terrace", 0.2), ("terrace", 1.0), ("construction", 0.1), ("construction", 0.3)], quick=2)
def test_the_stated_share_of_identities_is_swapped_within_camera_and_instant(preset, share):
    clean, swapped = faulty_scene(preset=preset, seconds=20.0), faulty_scene(preset=preset, seconds=20.0, identity_swaps=share)
    wrong = total = 0
    for name in clean.rig.names:
        a, b = clean.observations[name].boxes, swapped.observations[name].boxes
        np.testing.assert_array_equal(a.ltwh, b.ltwh)
        np.testing.assert_array_equal(swapped.observations[name].keypoints.identity, b.identity)
        wrong += (a.identity != b.identity).sum()
        total += len(a)
        for frame in np.unique(a.frame):
            np.testing.assert_array_equal(np.sort(a.identity[a.frame == frame]), np.sort(b.identity[b.frame == frame]))
    assert wrong / total == pytest.approx(share, abs=0.03)


@pytest.mark.slow
@pytest.mark.parametrize(
    "more",
    [{"unrelated_ids": True}, CUT, {"embeddings": "distinct"}, {"embeddings": "alike"}, {"camera_fps": (5.0,) * 4},
     {"groups": (4,)}],
)  # fmt: skip
def test_options_for_association_change_nothing_else(more):
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
def test_the_truth_says_which_person_each_box_shows():
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
        for number in np.unique(seen.boxes.identity):
            rows = seen.boxes.identity == number
            frames = seen.boxes.frame[rows]
            assert len(np.unique(simulated.true_identities[name][rows])) == 1
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


def rank_1(simulated, boxes_each):
    """How often the nearest of another camera's people is the right one, by means of boxes drawn from each person."""
    rng, means = np.random.default_rng(0), []
    for name, seen in simulated.observations.cameras.items():
        rows = [np.flatnonzero(simulated.true_identities[name] == person) for person in simulated.identities]
        drawn = [seen.boxes.embedding[rng.choice(own, boxes_each)].mean(axis=0) for own in rows]
        means.append(np.stack(drawn) / np.linalg.norm(drawn, axis=1, keepdims=True))
    people = np.arange(len(simulated.identities))
    return float(np.mean([(np.argmax(a @ b.T, axis=1) == people).mean() for a in means for b in means if a is not b]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "single", "eight"), [("distinct", (0.55, 0.8), (0.84, 0.96)), ("alike", (-1, 0.15), (-1, 0.15))]
)
def test_distinct_people_are_distinguished_as_well_as_by_networks_and_alike_ones_by_chance(kind, single, eight):
    """By chance it is one in fourteen."""
    options = {"preset": "basketball", "seconds": 4.0, "occlusion": False, "false_boxes": 0.2}
    scenes = [scene(**options, seed=seed, embeddings=kind) for seed in range(6)]
    for one in scenes:
        for seen in one.observations.cameras.values():
            assert seen.boxes.embedding.shape == (len(seen.boxes), 128)
            np.testing.assert_allclose(np.linalg.norm(seen.boxes.embedding, axis=1), 1, atol=1e-6)
    for boxes_each, (least, most) in ((1, single), (8, eight)):
        assert least < np.mean([rank_1(one, boxes_each) for one in scenes]) < most


def test_false_boxes_look_like_none_of_the_people():
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
        assert round(9 * fps) < seen.boxes.frame.max() <= round(10 * fps)
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
    agreement = identity_agreement(found(simulated), simulated.truth, simulated.true_clocks)
    assert agreement.precision == agreement.recall == 1.0
    again = scene()
    assert agreement.pairs_true > 0.5 * identity_agreement(found(again), again.truth).pairs_true


@pytest.mark.slow
def test_groups_have_no_common_ground():
    simulated = scene(preset="construction", people=20, cameras=8, groups=(6, 2))
    assert simulated.rig.names == tuple(f"C{i}" for i in range(1, 9))
    assert [np.round(camera.centre[0] / AREA_DISTANCE_M) for camera in simulated.rig] == [0] * 6 + [1] * 2
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


def test_people_are_shared_out_by_the_number_of_cameras():
    for people, cameras, shares in (
        (20, (6, 2), (13, 7)), (8, (6, 2), (4, 4)), (7, (4,), (7,)), (14, (1, 1, 1), (5, 5, 4)),
    ):  # fmt: skip
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
        ({"preset": "airport"}, "airport for a site"),
        *(({name: value}, name) for name, value in (
            ("preset", "harbour"), ("seed", -1), ("cameras", 0), ("people", 0), ("seconds", 0.0), ("fps", float("nan")),
            ("box_noise", -0.01), ("missing", 1.5), ("identity_swaps", 2.0), ("clock_offsets", 9.0),
            ("clock_offsets", (0.1, 0.2)), ("clock_offsets", (0.1, 0.2, 0.3, 7.0)), ("camera_height_m", 0.0),
            ("person_height_sd_m", -0.1), ("false_boxes", -1.0), ("corner_noise_px", float("inf")), ("lenses", "long"),
        )),
    ],
)  # fmt: skip
def test_bad_options_are_named(options, message):
    with pytest.raises(InputError, match=message) as error:
        SimulationOptions(**options)
    assert error.value.exit_status == 2
    assert "\n" not in str(error.value)
