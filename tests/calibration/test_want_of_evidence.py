"""Sound input that cannot fix a rig: exit status 3, and reasons that name what is missing."""

import json
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest

from passerby.cli.main import run
from passerby.core.observations import CameraObservations, Observations
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
