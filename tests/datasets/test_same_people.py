"""Two annotations of the same people: who is who is found from the true poses."""

import numpy as np

from passerby.core.cameras import Camera, Rig
from passerby.datasets.annotations import match_identities
from passerby.datasets.published import GroundTruth
from support.datasets import tsai as tsai_sets


def annotated():
    """The simulated scene in its own cameras: boxes, rig, and positions under other numbers."""
    scene = tsai_sets.scene()
    frame, person = np.nonzero(np.isfinite(scene.ground_positions[:, :, 0]))
    ground = GroundTruth(frame + 1, 100 - person, scene.ground_positions[frame, person])
    return {camera: scene.observations[camera].boxes for camera in scene.rig.names}, scene.rig, ground


def test_positions_get_the_numbers_of_the_boxes():
    boxes, rig, ground = annotated()
    found, notes = match_identities(boxes, rig, ground)
    assert np.array_equal(found.identity, 101 - ground.identity)
    assert np.array_equal(found.xy, ground.xy)
    assert notes == ("Of 7 people with positions, 7 were found among those with boxes, and have their numbers.",)


def test_who_has_no_boxes_gets_a_number_of_his_own():
    boxes, rig, ground = annotated()
    fewer = {camera: seen.take(~np.isin(seen.identity, (2, 5))) for camera, seen in boxes.items()}
    found, notes = match_identities(fewer, rig, ground)
    without = np.isin(101 - ground.identity, (2, 5))
    assert np.array_equal(found.identity[~without], 101 - ground.identity[~without])
    assert sorted(set(found.identity[without].tolist())) == [8, 9]
    assert "Of 7 people with positions, 5 were found" in notes[0]


def test_without_poses_nothing_is_said():
    boxes, rig, ground = annotated()
    blind = Rig(tuple(Camera(camera.name, camera.lens) for camera in rig))
    assert (match_identities(boxes, blind, ground), match_identities({}, rig, ground)) == ((ground, ()), (ground, ()))
