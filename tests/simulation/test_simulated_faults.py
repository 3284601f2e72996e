"""Each fault of the simulated detector is as large as it says, and no larger."""

from __future__ import annotations

import numpy as np
import pytest

from passerby.core.observations import UNKNOWN
from support.scenes.simulated import edges_of, faulty_scene
from support.tiers import thinned

FREE = {"occlusion": False, "preset": "construction"}


def differences(changed: dict, camera: str = "C1") -> tuple[np.ndarray, np.ndarray]:
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


def test_missing_drops_the_stated_share_of_boxes_and_joints():
    clean, thinned = faulty_scene(**FREE), faulty_scene(**FREE, missing=0.25)
    kept = sum(len(thinned.observations[n].boxes) for n in clean.rig.names)
    assert 1 - kept / sum(len(clean.observations[n].boxes) for n in clean.rig.names) == pytest.approx(0.25, abs=0.03)
    assert kept == sum(len(thinned.observations[n].keypoints) for n in clean.rig.names)


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


def test_false_boxes_are_as_many_as_stated_and_unknown():
    clean, faulty = faulty_scene(**FREE), faulty_scene(**FREE, false_boxes=0.2)
    for camera in clean.rig:
        a, b = clean.observations[camera.name].boxes, faulty.observations[camera.name].boxes
        false = b.take(b.identity == UNKNOWN)
        assert len(false) == round(0.2 * len(a))
        np.testing.assert_array_equal(b.take(b.identity != UNKNOWN).ltwh, a.ltwh)
        assert (np.diff(b.frame) >= 0).all()
        assert (false.ltwh[:, :2] >= 0).all()
        assert (false.ltwh[:, :2] + false.ltwh[:, 2:] <= camera.lens.size).all()


def test_joint_noise_has_the_stated_deviation_and_none_is_exact():
    clean, noisy = faulty_scene(**FREE), faulty_scene(**FREE, joint_noise_px=1.5)
    camera = clean.rig["C3"]
    a, b = clean.observations["C3"].keypoints, noisy.observations["C3"].keypoints
    true = camera.project(clean.joints3d[a.frame - 1, a.identity - 1].reshape(-1, 3)).reshape(a.xy.shape)
    np.testing.assert_allclose(a.xy, true, atol=1e-6)
    assert (b.xy - a.xy).std() == pytest.approx(1.5, rel=0.03)
    assert set(np.unique(a.score)) == {0.0, 0.9}
