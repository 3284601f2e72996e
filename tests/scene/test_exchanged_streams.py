"""Two cameras whose files change places while they film are a doubt; others are left alone."""

from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest

import passerby
from passerby.core.observations import Boxes
from passerby.scene.camera_input import CameraInput
from passerby.scene.exchanged_streams import ExchangedStreams, find_exchanged_streams
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
from passerby.simulation.disturbances import Move, film_disturbed
from support.tiers import thinned

OPTIONS = SimulationOptions(seconds=16.0, people=7, box_noise=0.02, missing=0.05, false_boxes=0.03, seed=5)
SINCE = 41
TURNS = (Move("C1", 8.0, turn_deg=(0.0, 6.0, 0.0)), Move("C3", 8.0, turn_deg=(0.0, -6.0, 0.0)))


@cache
def scene(moves: tuple[Move, ...] = ()) -> SimulatedScene:
    return simulate(OPTIONS, film_disturbed(OPTIONS, moves))


def joined(before: Boxes, after: Boxes) -> Boxes:
    """The boxes of one recording before the exchange and of another one from then on."""
    parts = before.take(before.frame < SINCE), after.take(after.frame >= SINCE)
    columns = {one.name for one in fields(Boxes)} - {"embedding"}
    return Boxes(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in columns})


def exchanged(first: str, second: str) -> dict[str, Boxes]:
    boxes = {name: scene().observations[name].boxes for name in scene().rig.names}
    own = boxes[first], boxes[second]
    return {**boxes, first: joined(*own), second: joined(*own[::-1])}


def sought(boxes: dict[str, Boxes], fps: float = OPTIONS.fps, given: bool = True) -> list[ExchangedStreams]:
    return find_exchanged_streams([CameraInput(name, boxes=one, fps=fps, given=given) for name, one in boxes.items()])


@pytest.mark.parametrize("known", [True, False], ids=["identities", "detections"])
def test_an_exchange_is_found_with_both_cameras_and_its_time(known: bool) -> None:
    boxes = exchanged("C1", "C3")
    if not known:
        boxes = {name: replace(one, identity=np.full(len(one), -1)) for name, one in boxes.items()}
    (one,) = sought(boxes, given=known)
    assert (set(one.cameras), one.frames) == ({"C1", "C3"}, (SINCE, SINCE))


@pytest.mark.slow
def test_an_exchange_is_a_doubt_about_the_rig() -> None:
    found = passerby.calibrate_observations(scene().rig, exchanged("C1", "C3"), fps=OPTIONS.fps)
    (one,) = (one for one in found.diagnostics if one.code == "streams_seem_exchanged")
    assert found.verdict != "accepted"
    assert (set(one.cameras), one.values["frames"]) == ({"C1", "C3"}, [SINCE, SINCE])


@thinned("seed", range(3))
def test_wrong_identities_and_noisy_boxes_are_no_exchange(seed: int) -> None:
    """Many boxes then have another identity in the next frame, and places in a crowd are alike by chance."""
    options = SimulationOptions(seconds=40.0, people=12, cameras=6, box_noise=0.06, identity_swaps=0.2, seed=seed)
    made = simulate(options)
    assert not sought({name: camera.boxes for name, camera in made.observations.cameras.items()}, options.fps)


@pytest.mark.parametrize("moves", [(), TURNS], ids=["still", "two cameras turned at one time"])
def test_no_exchange_is_found_where_there_is_none(moves: tuple[Move, ...]) -> None:
    assert not sought({name: scene(moves).observations[name].boxes for name in scene(moves).rig.names})


def test_a_cut_in_one_camera_alone_is_no_exchange() -> None:
    """A recording with a jump, as of a file from which a part was cut out."""
    boxes = {name: scene().observations[name].boxes for name in scene().rig.names}
    own = boxes["C2"]
    later = own.take(own.frame > SINCE + 20)
    assert not sought({**boxes, "C2": joined(own, replace(later, frame=later.frame - 20))})
