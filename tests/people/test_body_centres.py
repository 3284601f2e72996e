"""Where people are by several cameras, where hardly anybody is seen."""

import pytest

from passerby.core.observations import Boxes, CameraObservations, Keypoints, Observations
from passerby.people.body_centres import identified_body_centres, triangulate_people
from passerby.people.one_against_others import disagreements
from passerby.simulation import SimulationOptions, simulate


@pytest.mark.parametrize("seeing", [0, 1])
def test_nobody_is_where_no_other_camera_sees_anybody(seeing: int) -> None:
    scene = simulate(SimulationOptions(seconds=4.0))
    empty = CameraObservations(Boxes.empty(), Keypoints.empty())
    names = scene.rig.names
    some = Observations({name: scene.observations[name] if c < seeing else empty for c, name in enumerate(names)})
    centres = identified_body_centres(scene.rig, some)
    assert len(triangulate_people(scene.rig, centres, 1.72, excluding=0)) == 0
    assert all(len(one) == 0 for one in disagreements(scene.rig, some, 1.72).values())
