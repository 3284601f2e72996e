"""Known lengths between marked points, measured in a rig whose poses are true."""

from __future__ import annotations

import numpy as np
import pytest

from passerby.core.cameras import Rig
from passerby.core.scale_cues import KnownLength
from passerby.solver.geopose.known_lengths import measured_lengths
from support.scenes.people_and_rigs import ring

ENDS = np.array([[0.4, -0.3, 0.0], [0.4, 0.9, 0.5]])


def measured(rig: Rig, cue: KnownLength, cameras: tuple[int, ...] = (0, 1, 2)) -> list[float]:
    poses = [rig.cameras[camera].pose for camera in cameras]
    rotations, translations = np.array([pose.R_cw for pose in poses if pose]), np.array([pose.t_cw for pose in poses if pose])
    return [length for _, length in measured_lengths(rig, [cue], np.array(cameras), rotations, translations)]


def marked(rig: Rig, ends: np.ndarray, names: tuple[str, ...]) -> KnownLength:
    return KnownLength(1.3, 0.01, {name: rig[name].project(ends) for name in names})


def test_a_length_is_measured_where_two_posed_cameras_see_it() -> None:
    rig = ring(3)
    cue = marked(rig, ENDS, rig.names[:2])
    assert measured(rig, cue) == [pytest.approx(1.3)]
    assert measured(rig, cue, (0, 2)) == []


def test_marks_on_one_spot_measure_nothing() -> None:
    rig = ring(3)
    assert measured(rig, marked(rig, ENDS[[0, 0]], rig.names)) == []
