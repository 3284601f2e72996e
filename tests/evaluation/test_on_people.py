"""Two rigs held against the same people."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Pose, Rig
from passerby.evaluation.on_people import compare_on_people
from passerby.simulation import SimulationOptions, simulate

HEIGHT_M = 1.72


@pytest.fixture(scope="module")
def scene():
    return simulate(SimulationOptions(preset="terrace", seed=960, seconds=60.0, box_noise=0.01))


def turned(rig, name, degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    camera, about_up = rig[name], np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    pose = Pose.from_centre(about_up @ camera.pose.R_cw, camera.pose.centre)
    return Rig(tuple(replace(one, pose=pose) if one.name == name else one for one in rig.cameras))


def until(scene, frame):
    cameras = {name: replace(seen, boxes=seen.boxes.take(seen.boxes.frame < frame), keypoints=seen.keypoints.take(slice(0)))
               for name, seen in scene.observations.cameras.items()}  # fmt: skip
    return replace(scene.observations, cameras=cameras)


def test_the_turned_camera_is_the_worse_rig_whichever_comes_first(scene):
    good, bad = scene.rig, turned(scene.rig, "C2", 0.5)
    found, other, same = (
        compare_on_people(*rigs, scene.observations, HEIGHT_M) for rigs in ((good, bad), (bad, good), (good, good))
    )
    assert (found.better, other.better, found.stretches) == ("first", "second", 6)
    assert found.difference_px > 5 * found.sigma_px > 0
    assert found.cameras["C2"].second_px > 1.3 * found.cameras["C2"].first_px
    assert other.difference_px == pytest.approx(-found.difference_px)
    assert (same.better, same.difference_px, same.first) == ("neither", 0, same.second)
    short = compare_on_people(good, turned(good, "C2", 2.0), until(scene, 100), HEIGHT_M)
    assert (short.sigma_px, short.better) == (None, "neither"), "a short recording has no sigma"


def test_another_frame_counts_unless_the_shape_alone_is_asked_for(scene):
    """A world that hangs 0.5 m too high and is 8 % too small puts people elsewhere; its shape is the same."""
    moved = scene.rig.moved(np.eye(3), np.array([3.0, -2.0, 0.5]), 0.92)
    as_it_is = compare_on_people(scene.rig, moved, scene.observations, HEIGHT_M)
    assert as_it_is.better == "first"
    shape = compare_on_people(scene.rig, moved, scene.observations, HEIGHT_M, shape=True)
    assert shape.better == "neither"
    assert shape.difference_px == pytest.approx(0, abs=1e-6)


def test_what_cannot_be_compared(scene):
    rig = scene.rig
    alone = Rig(tuple(camera if camera.name == "C1" else replace(camera, pose=None) for camera in rig.cameras))
    with pytest.raises(InputError, match=r"have one camera in common .* two are needed"):
        compare_on_people(rig, alone, scene.observations, HEIGHT_M)
    with pytest.raises(EvidenceError, match=r"too few people whom two cameras see at once"):
        compare_on_people(rig, rig, until(scene, 3), HEIGHT_M)
