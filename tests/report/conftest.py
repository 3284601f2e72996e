"""Modules beside the tests can be imported; calibrations that several tests tell of are made once."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(scope="session")
def scene(tmp_path_factory):
    """A simulated scene of four cameras, boxes and joints, 15 seconds."""
    from passerby.cli import run

    folder = tmp_path_factory.mktemp("report") / "scene"
    assert run(["simulate", "-o", str(folder), "--people", "5", "--seconds", "15", "--keypoints"]) == 0
    return folder


@pytest.fixture(scope="session")
def calibrated(scene):
    """(calibration, output folder) of the scene's boxes."""
    return solved(scene, "boxes", lambda text: without(text, "keypoints"))


def solved(scene, name, change):
    """Calibrate a variant of a scene: (calibration, output folder)."""
    import passerby

    path, out = scene / f"{name}.toml", scene.parent / name
    path.write_text(change((scene / "scene.toml").read_text()))
    calibration = passerby.calibrate(path)
    calibration.write(out)
    return calibration, out


def without(text, key):
    """A scene file without the lines that set a key."""
    return "".join(line + "\n" for line in text.splitlines() if not line.startswith(f"{key} ="))
