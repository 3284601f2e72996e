"""Boxes in another format than stated lie half a body off: people of different statures show it."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.core.observations import CameraObservations, Observations
from passerby.findings.texts import text_of
from passerby.hypotheses.box_formats import find_shifted_boxes
from passerby.hypotheses.findings import boxes_in_other_format
from passerby.simulation import SimulationOptions, simulate
from passerby.solver.people import PeopleOptions, PeopleSolution
from support.scenes.people_and_rigs import part, simulated, solve
from support.tiers import thinned

SOLVING = PeopleOptions(max_sightings=4000)


def solved(preset: str, share: float, *names: str) -> PeopleSolution:
    """A solution by the boxes of a scene of 20 s, those of some cameras shifted right and down by a share of their size."""
    scene = simulated(preset)
    cameras = {}
    for name, seen in part(scene.observations).cameras.items():
        ltwh = np.array(seen.boxes.ltwh)
        ltwh[:, :2] += (share if name in names else 0.0) * ltwh[:, 2:]
        cameras[name] = CameraObservations(replace(seen.boxes, ltwh=ltwh))
    solution = solve(scene.rig, Observations(cameras, scene.observations.fps), options=SOLVING)
    assert isinstance(solution, PeopleSolution)
    return solution


@thinned("preset", ["terrace", "basketball", "construction"])
@pytest.mark.parametrize("share", [0.0, 0.06])
def test_boxes_as_stated_raise_nothing(preset: str, share: float) -> None:
    assert find_shifted_boxes(solved(preset, share, *simulated(preset).rig.names)) is None


def test_exact_boxes_raise_nothing() -> None:
    """Their lower edges move with the feet: as boxes do whose middles were read as corners, but statures do not show it."""
    scene = simulate(SimulationOptions(people=6, seconds=20.0, fps=10.0, box_noise=0.0))
    solution = solve(scene.rig, part(scene.observations), options=SOLVING)
    assert isinstance(solution, PeopleSolution)
    assert find_shifted_boxes(solution) is None


@thinned(("preset", "share"), [("basketball", 0.5), ("terrace", 0.5), ("construction", -0.5), ("basketball", -0.5)], quick=1)
def test_centres_read_as_corners_in_all_cameras_are_found(preset: str, share: float) -> None:
    names = simulated(preset).rig.names
    found = find_shifted_boxes(solved(preset, share, *names))
    assert found.cameras == names
    assert abs(found.shift - share) < 3 * np.hypot(found.sigma, 0.05)
    finding = boxes_in_other_format(found)
    assert finding.values["box_format"] == ("centres" if share > 0 else "ltwh")
    assert f'set boxes = "{finding.values["box_format"]}"' in text_of(finding)


def test_centres_read_as_corners_in_one_camera_are_found() -> None:
    found = find_shifted_boxes(solved("basketball", 0.5, "C2"))
    assert found.cameras == ("C2",)
