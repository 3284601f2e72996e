"""Sound input that cannot fix a rig: exit status 3, and reasons that name what is missing."""

import json
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest

from passerby.calibration.diagnostics.verdict import people_positions, with_verdict
from passerby.cli.main import run
from passerby.core.observations import CameraObservations, Observations
from passerby.core.solution import Solution
from passerby.simulation import SimulationOptions, simulate, write_scene
from support.scenes.boxes_of_walks import boxes_of

METHODS = ["people", "geopose"] if find_spec("passerby.solver.people") else ["geopose"]
WANT_OF_EVIDENCE = 3


@pytest.fixture(scope="module")
def terrace():
    return simulate(SimulationOptions(preset="terrace", box_noise=0.02, seconds=30))


def calibrate(simulated, folder, method):
    scene = write_scene(simulated, folder / "scene")
    reference = '\nreference = "C1"' if method == "geopose" else ""
    scene.write_text(scene.read_text().replace('method = "people"', f'method = "{method}"{reference}'))
    status = run(["calibrate", str(scene), "-o", str(folder / "out")])
    return status, json.loads((folder / "out" / "calibration.json").read_text())


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_a_camera_that_shares_nobody_is_named(terrace, tmp_path, capsys, method):
    seen = dict(terrace.observations.cameras)
    boxes = seen["C3"].boxes
    seen["C3"] = CameraObservations(replace(boxes, identity=boxes.identity + 100))
    lone = replace(terrace, observations=Observations(seen, 5.0))
    status, report = calibrate(lone, tmp_path, method)
    assert status == WANT_OF_EVIDENCE
    assert report["verdict"] in ("doubtful", "refused")
    assert "camera C3 shares no people with C1, C2, C4" in capsys.readouterr().err
    assert [camera["registered"] for camera in report["cameras"]] == [True, True, False, True]


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_people_on_one_straight_line_are_told(terrace, tmp_path, capsys, method):
    way = np.linspace(-1, 1, 150)
    walks = {
        identity: (np.outer(np.roll(way * sign, 40 * identity), [2.0, 3.5]), height)
        for identity, (sign, height) in enumerate([(1, 1.75), (-1, 1.62), (1, 1.85)], start=1)
    }
    lined = replace(terrace, observations=boxes_of(terrace.rig, walks, np.random.default_rng(1)))
    status, report = calibrate(lined, tmp_path, method)
    assert status == WANT_OF_EVIDENCE
    assert any("line" in reason for reason in report["reasons"]), report["reasons"]
    assert "line" in capsys.readouterr().err


def test_people_on_one_spot_are_told(terrace):
    rng = np.random.default_rng(2)
    walks = {identity: (rng.normal(0.0, 0.03, (60, 2)), 1.7) for identity in (1, 2)}
    observations = boxes_of(terrace.rig, walks, rng)
    solution = with_verdict(Solution("people", terrace.rig, "accepted"), observations)
    assert solution.verdict == "doubtful"
    assert solution.findings[0].code == "rig_uncertain"
    assert solution.findings[0].values["why"]["code"] == "people_not_spread"
    assert "one spot" in solution.reasons[0]


def test_positions_of_people_are_where_they_walked(terrace):
    rng = np.random.default_rng(3)
    path = rng.uniform(-1.5, 1.5, (60, 2))
    positions = people_positions(terrace.rig, boxes_of(terrace.rig, {1: (path, 1.7)}, rng, noise=0.0))
    assert len(positions) == 60
    # A box's centre in the picture is not quite that of the body.
    np.testing.assert_allclose(positions[:, :2], path, atol=0.1)
    np.testing.assert_allclose(positions[:, 2], 0.85, atol=0.15)


def test_joints_need_no_walk(terrace):
    still = {name: CameraObservations(keypoints=seen.keypoints) for name, seen in terrace.observations.cameras.items()}
    assert with_verdict(Solution("people", terrace.rig, "accepted"), Observations(still)).verdict == "accepted"


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_hand_made_boxes_off_the_line_are_enough(terrace, tmp_path, method):
    """The same walkers, on curves: what is told above is the line, not how the boxes were made."""
    turn = np.linspace(0, 2 * np.pi, 150)
    walks = {
        identity: (np.column_stack([1.8 * np.cos(turn + identity), 3.2 * np.sin(2 * turn + 2 * identity)]), height)
        for identity, height in enumerate([1.75, 1.62, 1.85], start=1)
    }
    curved = replace(terrace, observations=boxes_of(terrace.rig, walks, np.random.default_rng(1)))
    status, report = calibrate(curved, tmp_path, method)
    assert status == 0, report["reasons"]
