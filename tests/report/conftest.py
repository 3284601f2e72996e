"""Modules beside the tests can be imported; calibrations that several tests tell of are made once."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(scope="session")
def scene(tmp_path_factory):
    """A simulated scene of four cameras, boxes and joints, 15 seconds."""
    from passerby.cli.main import run

    folder = tmp_path_factory.mktemp("report") / "scene"
    assert run(["simulate", "-o", str(folder), "--people", "5", "--seconds", "15", "--keypoints"]) == 0
    return folder


@pytest.fixture(scope="session")
def calibrated(scene):
    """(calibration, output folder) of the scene's boxes."""
    from reported import solved, without

    return solved(scene, "boxes", lambda text: without(text, "keypoints"))
