"""Whether offsets are whole frames."""

import numpy as np
import pytest

from passerby.association.clocks.offsets import relative_to_reference, snap_to_whole_frames
from passerby.core.cameras import Rig
from support.scenes.people_and_rigs import ring, without_poses

FPS = np.full(4, 25.0)
FRAME_S = 0.04
SIGMA_S = np.array([0.0, 0.002, 0.003, 0.002])


@pytest.mark.parametrize(("lost", "reference"), [((), 0), ((0,), 1), ((0, 1, 3), 2), ((0, 1, 2, 3), 0), (None, 0)])
def test_offsets_are_told_against_the_first_registered_camera(lost: tuple[int, ...] | None, reference: int) -> None:
    offset_s, rig = np.array([0.5, -1.25, 3.0, 0.75]), ring(4)
    cameras = [bare if c in (lost or ()) else own for c, (own, bare) in enumerate(zip(rig, without_poses(rig), strict=True))]
    found = relative_to_reference(offset_s, None if lost is None else Rig(tuple(cameras)))
    assert found[reference] == 0.0
    np.testing.assert_allclose(found - found[0], offset_s - offset_s[0], err_msg="what is between two cameras stays")


def test_offsets_that_are_whole_within_their_sigmas_become_so() -> None:
    frames = np.array([0.0, 3.0, -7.0, 0.0])
    stray = np.array([0.0, 0.0015, -0.003, 0.002])
    found = snap_to_whole_frames(0.7 + frames * FRAME_S + stray, SIGMA_S, FPS)
    assert found is not None
    np.testing.assert_allclose(found, 0.7 + frames * FRAME_S, atol=1e-12)


WHOLE = np.array([0.0, 0.04, 0.08, -0.04])


@pytest.mark.parametrize(
    ("offset_s", "sigma_s", "fps"),
    [
        *((np.array([0.0, 0.08, (2 + share) * FRAME_S, -0.04]), SIGMA_S, FPS) for share in (0.5, 0.3, -0.4)),
        (WHOLE, np.array([0.0, 0.002, 0.3 * FRAME_S, 0.002]), FPS),
        (WHOLE, SIGMA_S, np.array([25.0, 25.0, 50.0, 25.0])),
        (np.array([0.0, 0.4]), np.array([0.0, np.nan]), FPS[:2]),
        (np.array([0.0, 0.4]), np.array([np.nan, np.nan]), FPS[:2]),
    ],
    ids=["between frames", "nearer", "before", "whole within too large a sigma", "other rates", "one camera", "none"],
)
def test_offsets_that_are_not_surely_whole_stay_as_they_are(offset_s: np.ndarray, sigma_s: np.ndarray, fps: np.ndarray) -> None:
    assert snap_to_whole_frames(offset_s, sigma_s, fps) is None


def test_many_small_strays_speak_together() -> None:
    """One offset 1.9 sigmas from a whole frame is nothing unusual, each of ten is."""
    for count, is_whole in ((1, True), (10, False)):
        offset_s = np.concatenate([[0.0], np.full(count, 0.04 + 1.9 * 0.002)])
        sigma_s = np.concatenate([[0.0], np.full(count, 0.002)])
        assert (snap_to_whole_frames(offset_s, sigma_s, np.full(count + 1, 25.0)) is not None) == is_whole


def test_offsets_that_are_drawn_whole_are_mostly_found_so_and_others_never() -> None:
    rng = np.random.default_rng(0)
    whole, between = 0, 0
    for _ in range(400):
        frames, noise = rng.integers(-50, 50, 4), SIGMA_S * rng.standard_normal(4)
        whole += snap_to_whole_frames((frames - frames[0]) * FRAME_S + noise, SIGMA_S, FPS) is not None
        between += snap_to_whole_frames((frames + [0, 0.5, 0.5, 0.5]) * FRAME_S + noise, SIGMA_S, FPS) is not None
    assert 0.92 < whole / 400 < 0.98
    assert between == 0


def test_a_camera_that_is_not_registered_keeps_its_offset_and_says_nothing() -> None:
    offset_s, fps = np.array([0.013, 0.2, 0.2801, 0.1601]), np.array([30.0, 25.0, 25.0, 25.0])
    sigma_s = np.array([np.nan, 0.0, 0.002, 0.003])
    found = snap_to_whole_frames(offset_s, sigma_s, fps)
    assert found is not None
    np.testing.assert_allclose(found, [0.013, 0.2, 0.28, 0.16], atol=1e-12)
