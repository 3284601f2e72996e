"""Whatever joints people show: a verdict with reasons that hold, and no number that is none, in values, files and texts."""

import json
import re
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import passerby
from passerby.cli.tables import show_calibration, tell_reasons
from passerby.core.observations import BODY_17, Keypoints
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
from support.scenes.upper_bodies import office_joints

pytestmark = pytest.mark.system

NOT_A_NUMBER = re.compile(r"(?<![\w-])(nan|inf|infinity)(?!\w)", re.IGNORECASE)
HEAD = BODY_17[:5]
ARMS = ("left_elbow", "right_elbow", "left_wrist", "right_wrist")
TRUNK = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")
UPPER = ("nose", *TRUNK[:2], *ARMS, *TRUNK[2:])
SUBSETS: Mapping[str, tuple[str, ...]] = {
    "all": BODY_17,
    "upper": UPPER,
    "trunk": TRUNK,
    "arms": (*TRUNK[:2], *ARMS),
    "heads": HEAD,
    "hips and legs": BODY_17[11:],
    "left side": tuple(joint for joint in BODY_17 if joint.startswith("left")),
    "left side above the knee": ("left_eye", "left_ear", "left_shoulder", "left_elbow", "left_wrist", "left_hip"),
    "feet": BODY_17[15:],
    "one joint": ("left_wrist",),
}
NOTHING_TO_GO_ON = ("feet", "one joint")
"""Fewer joints than a person has to show."""


@cache
def office() -> SimulatedScene:
    return simulate(SimulationOptions("terrace", seed=3, cameras=3, people=4, seconds=12.0, joint_noise_px=1.0))


def calibrated(joints: tuple[str, ...]) -> passerby.Calibration:
    truth = office()
    seen: dict[str, Keypoints] = {name: office_joints(truth.observations[name].keypoints, joints) for name in truth.rig.names}
    return passerby.calibrate_observations(truth.rig, keypoints=seen, fps=5.0, association={"mode": "given"})


def numbers(value: object) -> list[float]:
    """All floating-point numbers of a value of dataclasses, mappings and sequences."""
    if is_dataclass(value) and not isinstance(value, type):
        return [x for item in fields(value) for x in numbers(getattr(value, item.name))]
    if isinstance(value, Mapping):
        return [x for item in value.values() for x in numbers(item)]
    if isinstance(value, list | tuple):
        return [x for item in value for x in numbers(item)]
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        return [float(x) for x in value.ravel()]
    return [float(value)] if isinstance(value, float | np.floating) else []


def refuse(constant: str) -> float:
    raise AssertionError(f"{constant} stands in the JSON")


@pytest.mark.parametrize("which", SUBSETS)
def test_every_number_is_one_and_every_text_makes_sense(which: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = calibrated(SUBSETS[which])
    assert np.isfinite(numbers(found.figures)).all()
    poses = [(camera.pose.R_cw, camera.pose.centre) for camera in found.rig if camera.pose is not None]
    assert np.isfinite(numbers(poses)).all()
    assert not any(NOT_A_NUMBER.search(text) for text in found.reasons)
    assert found.reasons or found.verdict == "accepted"
    assert (found.verdict == "refused") == (which in NOTHING_TO_GO_ON)
    found.write(tmp_path)
    for path in tmp_path.rglob("*.json"):
        json.loads(path.read_text(), parse_constant=refuse)
    assert not NOT_A_NUMBER.search((tmp_path / "rig.toml").read_text() if (tmp_path / "rig.toml").exists() else "")
    show_calibration(found, verbose=True)
    tell_reasons(found)
    shown = capsys.readouterr()
    assert not NOT_A_NUMBER.search(shown.out + shown.err + repr(found))


@pytest.mark.parametrize("which", [which for which in SUBSETS if which not in NOTHING_TO_GO_ON])
def test_no_lens_is_blamed_that_is_right(which: str) -> None:
    """Distortion and focal length are as stated; what is missing is a part of the bodies."""
    assert not any("distortion" in text or "intrinsics" in text for text in calibrated(SUBSETS[which]).reasons)
