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
    assert stated is not None
    assert max(stated.position_mm.values()) < 1e-6
    assert max(stated.orientation_deg.values()) < 1e-5
    assert stated.to_dict()["position_within_1_sigma"] == 1.0


def test_scale_height_and_tilt_are_errors():
    truth = ring_of(5)
    for moved in (
        truth.moved(np.eye(3), np.zeros(3), 1.05),
        truth.moved(np.eye(3), np.array([0.0, 0.0, 0.3])),
        truth.moved(Rotation.from_euler("x", 2, degrees=True).as_matrix(), np.zeros(3)),
    ):
        stated = compare(with_sigmas(moved), truth).stated
        assert stated is not None
        assert max(stated.position_mm.values()) > 100


def test_errors_are_told_as_multiples_of_the_sigmas():
    truth = ring_of(4)
    raised = with_sigmas(truth.moved(np.eye(3), np.array([0.0, 0.0, 0.075])))
    found = compare(raised, truth).stated
    assert found is not None
    assert list(found.position_sigmas.values()) == pytest.approx([1.5] * 4)
    told = found.to_dict()
    assert (told["position_within_1_sigma"], told["position_within_2_sigmas"]) == (0.0, 1.0)
    assert told["cameras"][0]["position_error_sigmas"] == pytest.approx(1.5)


def test_a_rig_without_sigmas_states_nothing():
    truth = ring_of(3)
    told = compare(truth, truth).to_dict()["stated"]
    assert told["position_within_1_sigma"] is None
    assert told["cameras"][0]["position_sigma_mm"] is None


def test_one_camera_cannot_be_placed():
    truth = ring_of(3)
    assert compare(Rig(truth.cameras[:1]), truth).stated is None
