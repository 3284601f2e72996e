"""What z is: the normal of the ground, and what people's bodies say of gravity."""

from functools import cache

import numpy as np
import pytest

from passerby.calibration.calibration import Calibration
from passerby.calibration.in_memory import calibrate_observations
from passerby.core.observations import Keypoints
from passerby.geometry.rotations import direction_angle
from support.scenes.people_and_rigs import part, simulated, without_poses

TRUTH = simulated("terrace", seconds=10.0)


@cache
def calibrated(tilt_deg: float) -> Calibration:
    """People who stand along gravity on a ground that is tilted, seen as keypoints."""
    joints = TRUTH.joints3d.copy()
    joints[..., 2] += np.tan(np.radians(tilt_deg)) * TRUTH.ground_positions[:, :, None, 0]
    rng, keypoints, shape = np.random.default_rng(0), {}, joints.shape[:3]
    for camera in TRUTH.rig:
        pixels = camera.project(joints.reshape(-1, 3)).reshape(*shape, 2) + rng.normal(0, 1.0, (*shape, 2))
        with np.errstate(invalid="ignore"):
            inside = ((pixels > 0) & (pixels < np.array(camera.lens.size))).all(axis=-1)
        frame, person = np.nonzero(inside.sum(axis=-1) >= 10)
        seen = inside[frame, person]
        xy = np.where(seen[..., None], pixels[frame, person], 0.0)
        keypoints[camera.name] = Keypoints(TRUTH.frames[frame], TRUTH.identities[person], xy, seen.astype(float))
    return calibrate_observations(
        without_poses(TRUTH.rig), keypoints=keypoints, fps=TRUTH.options.fps, association={"mode": "given"}
    )


def off_gravity(found: Calibration) -> float:
    """Degrees between z and gravity."""
    up = [
        camera.pose.R_cw.T @ TRUTH.rig[camera.name].pose.R_cw[:, 2] for camera in found.rig.posed() if camera.pose is not None
    ]
    return float(np.degrees(direction_angle(np.mean(up, axis=0), np.array([0.0, 0.0, 1.0]))))


def test_a_ramp_is_reported_and_z_is_its_normal() -> None:
    found = calibrated(3.0)
    up = found.figures.up
    assert up.direction == "ground normal"
    assert off_gravity(found) == pytest.approx(3.0, abs=0.3)
    assert up.tilt_deg == pytest.approx(3.0, abs=3 * up.tilt_sigma_deg)
    assert off_gravity(found) < 2 * up.gravity_sigma_deg
    (told,) = [one for one in found.diagnostics if one.code == "ground_tilted"]
    assert told.severity == "notice"
    assert found.verdict == "accepted"
    assert found.rig.metadata["up"].startswith("ground normal; gravity within")


@pytest.mark.slow
def test_level_ground_is_not_reported() -> None:
    found = calibrated(0.0)
    up = found.figures.up
    assert up is not None
    assert up.tilt_deg < 3 * up.tilt_sigma_deg
    assert off_gravity(found) < up.gravity_sigma_deg < 1.0
    assert not [one for one in found.diagnostics if one.code == "ground_tilted"]


@pytest.mark.slow
def test_boxes_leave_the_slope_of_the_ground_open() -> None:
    boxes = {name: seen.boxes for name, seen in part(TRUTH.observations).cameras.items()}
    found = calibrate_observations(without_poses(TRUTH.rig), boxes, fps=TRUTH.options.fps, association={"mode": "given"})
    up = found.figures.up
    assert up is not None
    assert up.tilt_deg is None
    assert up.gravity_sigma_deg > 1.0 > found.figures.vertical_sigma_deg
