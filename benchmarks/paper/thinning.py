"""Scenes with little evidence: each camera shares a given number of people's instants with the reference, and nothing more."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from passerby.common.arrays import Ints
from passerby.common.errors import InputError
from passerby.core.observations import Boxes, CameraObservations, Keypoints
from passerby.simulation import SimulatedScene
from passerby.solver.geopose.correspondences import whole_boxes


def thinned(simulated: SimulatedScene, shared: int, rng: np.random.Generator) -> SimulatedScene:
    """The scene with so few boxes that every camera shares `shared` person-instants with the first one, the reference.

    A person-instant is one person at one instant; it is shared where both cameras have a box of the person that lies wholly
    inside the picture. All that the reference sees are put in one random order. Every other camera keeps the first `shared` of
    those that it sees too, and no other box; the reference keeps those that any camera has kept. So two cameras other than the
    reference share at most `shared` too: those among them that both see.

    Args:
        simulated: the scene; its identities hold in all cameras.
        shared: person-instants that each camera shares with the reference.
        rng: draws the order; that of fewer is the beginning of that of more.

    Raises:
        InputError: a camera shares fewer with the reference.
    """
    whole = {camera.name: simulated.observations[camera.name].boxes for camera in simulated.rig}
    whole = {name: boxes.take(whole_boxes(boxes, simulated.rig[name].lens)) for name, boxes in whole.items()}
    n_people = 1 + max(int(boxes.identity.max(initial=0)) for boxes in whole.values())
    reference, *others = simulated.rig.names
    order = rng.permutation(_numbers(whole[reference], n_people))
    kept: dict[str, Ints] = {}
    for name in others:
        common = order[np.isin(order, _numbers(whole[name], n_people))]
        if len(common) < shared:
            raise InputError(
                f"camera {name} shares {len(common)} person-instants with camera {reference}, {shared} are wanted: "
                "simulate more seconds or more people"
            )
        kept[name] = common[:shared]
    kept[reference] = np.unique(np.concatenate(list(kept.values())))
    return _taken(simulated, kept, n_people)


def _taken(simulated: SimulatedScene, kept: Mapping[str, Ints], n_people: int) -> SimulatedScene:
    """The scene with the kept person-instants alone, of whole boxes, and the joints that go with them."""
    cameras, true = {}, {}
    for name, seen in simulated.observations.cameras.items():
        inside = whole_boxes(seen.boxes, simulated.rig[name].lens) & np.isin(_numbers(seen.boxes, n_people), kept[name])
        joints = np.isin(_numbers(seen.keypoints, n_people), kept[name])
        cameras[name] = CameraObservations(seen.boxes.take(inside), seen.keypoints.take(joints))
        true[name] = simulated.true_identities[name][inside]
    return replace(simulated, observations=replace(simulated.observations, cameras=cameras), true_identities=true)


def _numbers(people: Boxes | Keypoints, n_people: int) -> Ints:
    """(N,) a number for each person-instant."""
    return np.asarray(people.frame * n_people + people.identity)
