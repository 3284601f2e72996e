"""What makes an optimum uncertain: each figure beyond its limit is a notice that names the camera, and no other is."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.findings.finding import Finding
from passerby.solver import findings
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


def notices(
    monkeypatch: pytest.MonkeyPatch,
    agreeing: tuple[int, ...] = (480, 480, 480),
    *,
    noise: float = 0.02,
    converged: bool = True,
    ground_sd_m: float | None = None,
) -> list[Finding]:
    """What is said of an optimum with these figures."""
    monkeypatch.setattr(findings, "height_noise", lambda fit, evidence: noise)
    cues = SimpleNamespace(world=SimpleNamespace(ground_sd_m=ground_sd_m, ground_by="hips", upright=("trunks",), segments=()))
    cameras = SimpleNamespace(camera=np.repeat([0, 1, 2], agreeing)), SimpleNamespace(camera=np.zeros(0, np.int64))
    problem = SimpleNamespace(cues=cues, sightings=cameras[0], joints=cameras[1])
    fit: Any = SimpleNamespace(result=SimpleNamespace(converged=converged), model=SimpleNamespace(problem=problem))
    start: Any = SimpleNamespace(rig=RIG, evidence=None)
    found = findings.notices_about(start, fit)
    assert all(one.severity == "notice" for one in found)
    return found


def test_what_is_wrong_with_a_camera_the_boxes_the_ground_or_the_adjustment(monkeypatch: pytest.MonkeyPatch) -> None:
    assert notices(monkeypatch) == []
    (few,) = notices(monkeypatch, agreeing=(480, 480, 12))
    assert (few.code, few.cameras, few.values) == ("few_observations", ("C3",), {"agreeing": 12})
    found = notices(monkeypatch, noise=0.31, converged=False, ground_sd_m=0.05)
    assert [(one.code, one.cameras, one.values) for one in found] == [
        ("ground_by_hips", (), {"sigma_m": 0.05, "by": "hips", "up": ["trunks"], "scale": []}),
        ("boxes_noisy", (), {"noise_percent": pytest.approx(31.0)}),
        ("adjustment_not_converged", (), {}),
    ]
    found = findings.find_separate_groups(RIG, [[0], [1], [2]])
    assert [(one.code, one.cameras, one.values) for one in found] == [
        ("cameras_disconnected", ("C2",), {"main": ["C1"]}),
        ("cameras_disconnected", ("C3",), {"main": ["C1"]}),
    ]
    assert findings.find_separate_groups(RIG, [[0, 1, 2]]) == []


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
    residual = np.array([[0.1, 0.0], [0.0, 0.2], [0.0, -0.6], [0.3, 0.4]])
    problem = SimpleNamespace(
        sightings=Sightings(camera=np.array([0, 0, 0, 1])), joints=SimpleNamespace(camera=np.array([1, 2, 2])),
        terms=lambda state, jacobians: [SimpleNamespace(residual=residual)], centre_sigma=lambda: np.full(4, 10.0),
    )  # fmt: skip
    evidence = SimpleNamespace(sightings=Sightings(camera=np.array([0, 0, 0, 0, 1])))
    start: Any = SimpleNamespace(rig=RIG, levels=[None] * 3, evidence=evidence)
    state = SimpleNamespace(slack=np.array([0.01, -0.01, 0.0]))
    fit: Any = SimpleNamespace(result=SimpleNamespace(state=state), model=SimpleNamespace(problem=problem))
    found = findings._cameras(start, fit, COVARIANCE)
    assert [camera.name for camera in found] == ["C1", "C2", "C3"]
    assert [(camera.sightings, camera.agreeing, camera.joints) for camera in found] == [(4, 3, 0), (1, 1, 1), (0, 0, 2)]
    assert [camera.median_residual_px for camera in found] == [pytest.approx(2.0), pytest.approx(5.0), None]
    assert [camera.slack for camera in found] == [0.01, -0.01, 0.0]
    assert found[0].shape_position_sigma_mm == pytest.approx(1000 * np.sqrt(3e-4))
    assert found[0].shape_orientation_sigma_deg == pytest.approx(np.degrees(np.sqrt(3e-6)))
