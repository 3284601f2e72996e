"""Cameras that keep turning while they film: reported as a drift, which is taken out of what they saw."""

from functools import cache

import numpy as np
import pytest

import passerby
from passerby.calibration.camera_motion import DetectedDrift, findings_of_motions
from passerby.core.cameras import Pose
from passerby.evaluation.metrics import compare
from passerby.hypotheses.camera_path import CameraPath
from passerby.hypotheses.changes import FoundChange, PoseDrift, drift_of, fit_drift, suspect_change
from passerby.hypotheses.correspondences import Correspondences, match_people
from passerby.people.body_centres import identified_body_centres, triangulate_people
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
from passerby.simulation.disturbances import Move, film_disturbed
from support.tiers import thinned

OPTIONS = SimulationOptions(seconds=40.0, people=6, box_noise=0.02, seed=3)
BODY_M = 1.72
DEGREES = 2.0


def turning(camera: str, degrees: float) -> tuple[Move, ...]:
    """A pan at one rate during the whole recording, a small step at each frame."""
    frames = round(OPTIONS.seconds * OPTIONS.fps)
    return tuple(Move(camera, k / OPTIONS.fps, turn_deg=(0.0, degrees * k / (frames - 1), 0.0)) for k in range(1, frames))


@cache
def filmed(moves: tuple[Move, ...]) -> SimulatedScene:
    return simulate(OPTIONS, film_disturbed(OPTIONS, moves))


def matched(scene: SimulatedScene, camera: str) -> tuple[Correspondences, Pose]:
    centres, c = identified_body_centres(scene.rig, scene.observations), scene.rig.names.index(camera)
    own, pose = centres[c], scene.rig[camera].pose
    assert own is not None
    assert pose is not None
    return match_people(own, triangulate_people(scene.rig, centres, BODY_M, excluding=c), BODY_M, given=True), pose


def compared(m: Correspondences, pose: Pose) -> FoundChange:
    """What is found."""
    suspect = suspect_change(m, pose, OPTIONS.fps, 4)
    found = suspect.compared()
    assert found is not None
    return found


def one_drift(m: Correspondences, pose: Pose) -> PoseDrift:
    """A drift at one rate."""
    path = fit_drift(m, CameraPath(pose), 1)
    assert path is not None
    return drift_of(m, path, 0.0)


def test_a_steady_turn_is_measured() -> None:
    m, pose = matched(filmed(turning("C2", DEGREES)), "C2")
    found = compared(m, pose)
    assert found.kind == "drifts"
    drift = drift_of(m, found.path, found.over_base.gain)
    assert drift.steady
    assert drift.degrees == pytest.approx(DEGREES, rel=0.1)
    assert drift.turn[-1, 1] - drift.turn[0, 1] == pytest.approx(np.radians(DEGREES), rel=0.1)


@thinned(
    "move",
    [
        Move("C2", 18.0, turn_deg=(0.0, 1.0, 0.0)),
        Move("C2", 16.0, turn_deg=(0.0, 2.0, 0.0), until_s=26.0),
        Move("C2", 20.0, turn_deg=(0.0, 6.0, 0.0), shift_m=(0.3, 0.0, 0.0)),
    ],
    ids=["step", "there and back", "knock"],
)
def test_a_step_is_no_drift(move: Move) -> None:
    assert compared(*matched(filmed((move,)), "C2")).kind == "moved"


def test_taking_a_drift_out_of_the_observations_stops_the_camera() -> None:
    scene = filmed(turning("C2", DEGREES))
    m, pose = matched(scene, "C2")
    drift = one_drift(m, pose)
    found = DetectedDrift("C2", (float(drift.knots[0]), float(drift.knots[-1])), OPTIONS.fps, drift)
    lens, seen = scene.rig["C2"].lens, scene.observations
    corrected = found.corrected(seen, lens)
    assert corrected["C1"] is seen["C1"]
    centre = identified_body_centres(scene.rig, corrected)
    own = centre[1]
    assert own is not None
    again = one_drift(match_people(own, m.people, BODY_M, given=True), pose)
    assert again.degrees < 0.1 * DEGREES
    cut = ~seen["C2"].boxes.inside(lens.size)
    np.testing.assert_array_equal(corrected["C2"].boxes.ltwh[cut], seen["C2"].boxes.ltwh[cut])
    np.testing.assert_allclose(corrected["C2"].boxes.ltwh[:, 2:], seen["C2"].boxes.ltwh[:, 2:])


def drifting(camera: str, pixels: float) -> DetectedDrift:
    turn = np.array([[0.0, -0.01, 0.0], [0.0, 0.01, 0.0]])
    return DetectedDrift(camera, (1.0, 601.0), 5.0, PoseDrift(np.array([1.0, 601.0]), turn, 100.0, pixels))


def test_a_drift_has_its_rate_and_cameras_that_all_drift_are_one_finding() -> None:
    rig = filmed(()).rig
    (alone,) = findings_of_motions([drifting("C2", 30.0)], rig)
    assert (alone.code, alone.severity, alone.cameras) == ("camera_drifts", "doubt", ("C2",))
    assert alone.values["minutes"] == pytest.approx(2.0)
    assert alone.values["degrees"] == pytest.approx(np.degrees(0.02))
    (together,) = findings_of_motions([drifting(name, 10.0 * k) for k, name in enumerate(("C3", "C1", "C4"), start=1)], rig)
    assert together.cameras == ("C1", "C3", "C4")
    assert together.values["pixels"] == [10.0, 30.0]
    assert len(findings_of_motions([drifting("C1", 10.0), drifting("C2", 10.0)], rig)) == 2


@pytest.mark.system
def test_a_camera_that_keeps_turning_is_one_finding_and_its_rig_is_right() -> None:
    scene = filmed(turning("C2", DEGREES))
    boxes = {name: scene.observations[name].boxes for name in scene.rig.names}
    found = passerby.calibrate_observations(scene.rig, boxes, fps=OPTIONS.fps, association={"mode": "given"})
    (reason,) = found.reasons
    assert reason.startswith("camera C2 drifts by ")
    assert "degrees) a minute" in reason
    assert found.verdict == "doubtful"
    assert not found.figures.moved
    (figures,) = found.figures.drifts
    assert figures.degrees == pytest.approx(DEGREES, rel=0.1)
    # Its mean orientation lies half of the drift away from that at the beginning.
    others = compare(found.rig, scene.rig).similarity
    assert others.mean_orientation_deg < 0.25 * DEGREES + 0.1
    assert others.mean_position_mm < 60
