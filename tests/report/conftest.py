"""Calibrations that several tests tell of are made once."""

import pytest


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
    from support.report.pages import solved

    return solved(scene, "boxes", "keypoints")
