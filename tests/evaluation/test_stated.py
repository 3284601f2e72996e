"""Errors in stated sigmas: the placement along the ground that they are of, and the shares within one and two."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from passerby.core.cameras import PoseSigma, Rig
from passerby.evaluation.metrics import compare
from support.scenes.people_and_rigs import ring as ring_of


def with_sigmas(rig: Rig, position_m: float = 0.05, orientation_deg: float = 0.5) -> Rig:
    return Rig(tuple(replace(camera, sigma=PoseSigma(position_m, orientation_deg)) for camera in rig))


def test_a_turn_about_the_vertical_and_a_shift_along_the_ground_are_no_errors():
    truth = ring_of(5)
    turn = Rotation.from_euler("z", 40, degrees=True).as_matrix()
    stated = compare(with_sigmas(truth.moved(turn, np.array([7.0, -3.0, 0.0]))), truth).stated
    assert max(stated.position_mm.values()) < 1e-6
    assert max(stated.orientation_deg.values()) < 1e-5
    assert stated.to_dict()["position_within_1_sigma"] == 1.0


@pytest.mark.parametrize(
    ("tilt_deg", "raised", "scale"), [(0, 0, 1.05), (0, 0.3, 1.0), (2, 0, 1.0)], ids=["scale", "height", "tilt"]
)
def test_scale_height_and_tilt_are_errors(tilt_deg, raised, scale):
    tilt = Rotation.from_euler("x", tilt_deg, degrees=True).as_matrix()
    stated = compare(with_sigmas(ring_of(5).moved(tilt, np.array([0.0, 0.0, raised]), scale)), ring_of(5)).stated
    assert max(stated.position_mm.values()) > 100


def test_errors_are_told_as_multiples_of_the_sigmas():
    found = compare(with_sigmas(ring_of(4).moved(np.eye(3), np.array([0.0, 0.0, 0.075]))), ring_of(4)).stated
    assert list(found.position_sigmas.values()) == pytest.approx([1.5] * 4)
    told = found.to_dict()
    assert (told["position_within_1_sigma"], told["position_within_2_sigmas"]) == (0.0, 1.0)
    assert told["cameras"][0]["position_error_sigmas"] == pytest.approx(1.5)


def test_a_rig_without_sigmas_states_nothing_and_one_camera_cannot_be_placed():
    told = compare(ring_of(3), ring_of(3)).to_dict()["stated"]
    assert told["position_within_1_sigma"] is told["cameras"][0]["position_sigma_mm"] is None
    assert compare(Rig(ring_of(3).cameras[:1]), ring_of(3)).stated is None
