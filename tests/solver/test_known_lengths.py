"""Known lengths between marked points, measured in a rig whose poses are true."""

import numpy as np
import pytest

from passerby.core.cameras import Pose, Rig
from passerby.core.scale_cues import KnownLength
from passerby.solver.geopose.known_lengths import measured_lengths
from passerby.solver.geopose.pairs import PairGeometry
from passerby.solver.geopose.star import scale_from_lengths
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
    assert measured(rig, marked(rig, ENDS[[0, 0]], rig.names)) == [], "marks on one spot"


def test_the_scale_by_lengths_is_the_surer_the_more_there_are() -> None:
    """A rig of half the size is to be doubled, by one length to its own share of error and by four alike to half of that."""
    rig = ring(3)
    cue = marked(rig, ENDS, rig.names)
    metres = float(np.linalg.norm(ENDS[1] - ENDS[0]))
    doubled = KnownLength(2 * metres, 0.03, cue.points)
    first, second = rig.cameras[0].pose, rig.cameras[1].pose
    turn = second.R_cw @ first.R_cw.T
    pose = Pose(turn, second.t_cw - turn @ first.t_cw)
    pair = PairGeometry(1, pose, np.zeros((0, 3)), np.zeros(0, int), np.zeros((0, 2), int), 0, 0.0, 9.0)
    for count in (1, 4):
        scale = scale_from_lengths(rig, [doubled] * count, 0, [pair])
        assert scale.factor == pytest.approx(2.0)
        assert scale.relative_sd == pytest.approx(0.03 / (2 * metres) / np.sqrt(count))
