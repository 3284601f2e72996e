"""What speaks against an optimum: each figure beyond its limit is a doubt that names the camera, and no other is."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.findings.finding import Finding
from passerby.solver import findings
from passerby.solver.consistency import LEAST_AGREEING, MOST_CHANGE, STRETCHES, JointConsistency
from passerby.solver.gauge import Free
from passerby.solver.uncertainty import RigCovariance

LENS = Lens((800, 600), np.array([[700.0, 0, 400], [0, 700, 300], [0, 0, 1]]), np.zeros(0))
CENTRES = np.array([[0.0, 0, 3], [8.0, 0, 3], [0.0, 8, 3]])
RIG = Rig(tuple(Camera(f"C{k}", LENS, Pose.from_centre(np.eye(3), centre)) for k, centre in enumerate(CENTRES, start=1)))
SURE = np.diag([1e-4, 1e-4, 1e-4, 1e-6, 1e-6, 1e-6])
"""1.7 cm and 0.1 degrees."""
COVARIANCE = RigCovariance(
    metric=np.stack([SURE] * 3), shape=np.stack([SURE] * 3), vertical_deg=0.2, scale=0.01, inflation=1.0,
    distances=np.full((3, 3), 0.01),
)  # fmt: skip
AGREES = JointConsistency(np.full(3, 500), np.full(3, 480), np.full((3, STRETCHES), 0.96))


def told(
    monkeypatch: pytest.MonkeyPatch,
    covariance: RigCovariance = COVARIANCE,
    agrees: JointConsistency = AGREES,
    *,
    noise: float = 0.02,
    converged: bool = True,
    ground_sd_m: float | None = None,
) -> list[Finding]:
    """What is said of an optimum with these figures."""
    monkeypatch.setattr(findings, "joint_consistency", lambda evidence, model: agrees)
    monkeypatch.setattr(findings, "height_noise", lambda fit, evidence: noise)
    cues = SimpleNamespace(world=SimpleNamespace(ground_sd_m=ground_sd_m))
    result = SimpleNamespace(state=SimpleNamespace(centre=CENTRES), converged=converged)
    fit: Any = SimpleNamespace(result=result, model=SimpleNamespace(problem=SimpleNamespace(cues=cues)))
    start: Any = SimpleNamespace(rig=RIG, evidence=None)
    found = findings.doubts_about(start, fit, covariance)
    assert all(one.severity == "doubt" for one in found)
    return found


def of_camera(values: np.ndarray, camera: int, value: Any) -> np.ndarray:
    """The same with another value of one camera."""
    out = values.copy()
    out[camera] = value
    return out


def test_nothing_speaks_against_a_sound_optimum(monkeypatch: pytest.MonkeyPatch) -> None:
    assert told(monkeypatch) == []


@pytest.mark.parametrize(
    ("variances", "position_mm", "orientation_deg"),
    [(np.diag([1.0, 0, 0, 0, 0, 0]), 1000.0, 0.0), (np.diag([0, 0, 0, np.radians(3.0) ** 2, 0, 0]), 0.0, 3.0)],
)
def test_a_camera_whose_place_or_direction_is_hardly_known(
    monkeypatch: pytest.MonkeyPatch, variances: np.ndarray, position_mm: float, orientation_deg: float
) -> None:
    vague = replace(COVARIANCE, shape=of_camera(COVARIANCE.shape, 1, variances))
    (doubt,) = told(monkeypatch, vague)
    assert (doubt.code, doubt.cameras) == ("camera_uncertain", ("C2",))
    assert doubt.values == {"position_mm": pytest.approx(position_mm), "orientation_deg": pytest.approx(orientation_deg)}
    # What nothing fixes at all is told as that.
    (doubt,) = told(monkeypatch, replace(vague, free=Free(cameras=(1,))))
    assert (doubt.code, doubt.cameras) == ("camera_undetermined", ("C2",))


@pytest.mark.parametrize(("extent_m", "certain_m", "uncertain_m"), [(2.0, 0.14, 0.16), (20.0, 0.24, 0.26), (200.0, 0.9, 1.1)])
def test_how_well_a_place_has_to_be_known_goes_by_the_size_of_the_rig(
    monkeypatch: pytest.MonkeyPatch, extent_m: float, certain_m: float, uncertain_m: float
) -> None:
    far = np.max(np.linalg.norm(CENTRES - CENTRES.mean(axis=0), axis=1))
    monkeypatch.setattr(f"{__name__}.CENTRES", CENTRES * extent_m / far)
    for sigma_m, codes in ((certain_m, []), (uncertain_m, ["camera_uncertain"])):
        vague = replace(COVARIANCE, shape=of_camera(COVARIANCE.shape, 1, np.diag([sigma_m**2, 0, 0, 0, 0, 0])))
        assert [doubt.code for doubt in told(monkeypatch, vague)] == codes


def test_a_vertical_that_is_hardly_known(monkeypatch: pytest.MonkeyPatch) -> None:
    leaning = replace(COVARIANCE, vertical_deg=6.0)
    (doubt,) = told(monkeypatch, leaning)
    assert (doubt.code, doubt.cameras, doubt.values) == ("vertical_uncertain", (), {"sigma_deg": 6.0})
    (doubt,) = told(monkeypatch, replace(leaning, free=Free(vertical=True, scale=True)))
    assert (doubt.code, doubt.values) == ("world_undetermined", {"lacks": ["scale", "vertical"]})


def test_few_sightings_say_nothing_of_agreement(monkeypatch: pytest.MonkeyPatch) -> None:
    (doubt,) = told(monkeypatch, agrees=replace(AGREES, agreeing=of_camera(AGREES.agreeing, 2, 12)))
    assert (doubt.code, doubt.cameras, doubt.values) == ("few_observations", ("C3",), {"agreeing": 12})


def test_a_camera_that_contradicts_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    little = int(500 * LEAST_AGREEING) - 1
    (doubt,) = told(monkeypatch, agrees=replace(AGREES, agreeing=of_camera(AGREES.agreeing, 0, little)))
    assert (doubt.code, doubt.cameras, doubt.values) == ("camera_disagrees", ("C1",), {"agreeing": little, "seen": 500})


def test_a_camera_that_contradicts_the_others_for_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    """Told with the time; also where all of the time together agrees well enough."""
    by_time = AGREES.by_time.copy()
    by_time[1, 2:4] = [0.96 - MOST_CHANGE - 0.1, 0.96 - MOST_CHANGE - 0.05]
    by_time[1, 7] = np.nan
    (doubt,) = told(monkeypatch, agrees=replace(AGREES, by_time=by_time))
    assert (doubt.code, doubt.cameras) == ("camera_disagrees_at_times", ("C2",))
    assert doubt.values == {
        "most": pytest.approx(0.96), "least": pytest.approx(0.86 - MOST_CHANGE), "from_percent": 25.0, "to_percent": 37.5,
    }  # fmt: skip
    by_time[1, 2:4] = 0.96 - MOST_CHANGE + 0.01
    assert told(monkeypatch, agrees=replace(AGREES, by_time=by_time)) == []
    # One stretch that holds enough cannot differ from another.
    by_time[1] = [0.1, *[np.nan] * (STRETCHES - 1)]
    assert told(monkeypatch, agrees=replace(AGREES, by_time=by_time)) == []


def test_what_is_wrong_with_the_boxes_the_ground_or_the_adjustment(monkeypatch: pytest.MonkeyPatch) -> None:
    found = told(monkeypatch, noise=0.31, converged=False, ground_sd_m=0.05)
    assert [(one.code, one.cameras, one.values) for one in found] == [
        ("ground_by_hips", (), {"sigma_m": 0.05}),
        ("boxes_noisy", (), {"noise_percent": pytest.approx(31.0)}),
        ("adjustment_not_converged", (), {}),
    ]


def test_groups_that_nobody_joins_are_told_each_with_the_main_one() -> None:
    found = findings.apart(RIG, [[0], [1], [2]])
    assert [(one.code, one.cameras, one.values) for one in found] == [
        ("cameras_disconnected", ("C2",), {"main": ["C1"]}),
        ("cameras_disconnected", ("C3",), {"main": ["C1"]}),
    ]
    assert findings.apart(RIG, [[0, 1, 2]]) == []


@pytest.mark.parametrize(("instants", "expected"), [(40, np.log(1.05) / (0.3186 * np.sqrt(2))), (10, 0.03)])
def test_boxes_that_flicker_are_noisy_however_well_the_rig_fits_them(instants: int, expected: float) -> None:
    """Two heights in turn, 5 % apart: of too few changes nothing is learnt, and what the rig leaves over counts."""
    rows = np.arange(instants)
    sightings = SimpleNamespace(
        block=rows, camera=np.zeros(instants, dtype=int), has_foot=np.ones(instants), extent_px=100.0 * 1.05 ** (rows % 2)
    )
    evidence: Any = SimpleNamespace(sightings=sightings, frame=rows, person=np.zeros(instants, dtype=int))
    problem = SimpleNamespace(
        sightings=SimpleNamespace(has_foot=np.ones(instants)), scale_px=np.full(instants, 100.0),
        noise=SimpleNamespace(box_px=0.0, height=0.03),
    )  # fmt: skip
    fit: Any = SimpleNamespace(model=SimpleNamespace(problem=problem))
    assert findings.height_noise(fit, evidence) == pytest.approx(expected, rel=1e-3)
    problem.sightings.has_foot = np.zeros(instants)
    assert findings.height_noise(fit, evidence) == 0.0


class Sightings(SimpleNamespace):
    """Of these cameras."""

    def __len__(self) -> int:
        return len(self.camera)


def test_each_camera_counts_what_was_seen_in_it() -> None:
    """Four boxes in the first camera, one in the second, none in the third; those that agree are 1, 2, 6 and 5 pixels off."""
    residual = np.array([[0.1, 0.0], [0.0, 0.2], [0.0, -0.6], [0.3, 0.4]])
    problem = SimpleNamespace(
        sightings=Sightings(camera=np.array([0, 0, 0, 1])), joints=SimpleNamespace(camera=np.array([1, 2, 2])),
        terms=lambda state, jacobians: [SimpleNamespace(residual=residual)], centre_sigma=lambda: np.full(4, 10.0),
    )  # fmt: skip
    evidence = SimpleNamespace(sightings=Sightings(camera=np.array([0, 0, 0, 0, 1])))
    start: Any = SimpleNamespace(rig=RIG, levels=[None] * 3, evidence=evidence)
    state = SimpleNamespace(slack=np.array([0.01, -0.01, 0.0]))
    fit: Any = SimpleNamespace(result=SimpleNamespace(state=state), model=SimpleNamespace(problem=problem))
    checks: Any = [SimpleNamespace(change=0.0, sigma=0.01)] * 3
    found = findings._cameras(start, fit, COVARIANCE, checks)
    assert [camera.name for camera in found] == ["C1", "C2", "C3"]
    assert [(camera.sightings, camera.agreeing, camera.joints) for camera in found] == [(4, 3, 0), (1, 1, 1), (0, 0, 2)]
    assert [camera.median_residual_px for camera in found] == [pytest.approx(2.0), pytest.approx(5.0), None]
    assert [camera.slack for camera in found] == [0.01, -0.01, 0.0]
    assert found[0].shape_position_sigma_mm == pytest.approx(1000 * np.sqrt(3e-4))
    assert found[0].shape_orientation_sigma_deg == pytest.approx(np.degrees(np.sqrt(3e-6)))
