"""The frame rate that is assumed where none is stated, against that of walkers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from passerby.association.camera_tracklets import CameraTracklets
from passerby.association.clocks import frame_rate
from passerby.association.clocks.frame_rate import FASTEST, SLOWEST, UNKNOWN_RATE, estimate_frame_rate, rate_of_walkers
from passerby.core.cameras import Rig
from passerby.core.observations import UNKNOWN, CameraObservations, Clock, Observations
from passerby.geometry.single_view import Level
from support.scenes.people_and_rigs import simulated
from support.scenes.walkers_on_plane import UP, Station, bodies_at, standing, walkers

HEIGHT_M = 4.0


def walked(fps: float, *, stand: bool = False, seed: int = 0, noise_m: float = 0.1, offset_m: complex = 9j) -> CameraTracklets:
    """Eight people in front of a camera; half a minute, the rate known to nobody."""
    rng = np.random.default_rng(seed)
    people = standing(8, rng, half_m=6.0) if stand else walkers(8, rng, 30.0, half_m=6.0)
    frame = np.arange(1, int(30 * fps))
    place = np.concatenate([Station(place=-offset_m).ground(walker.at(frame / fps)) for walker in people])
    place = place + noise_m * (rng.standard_normal(len(place)) + 1j * rng.standard_normal(len(place)))
    bodies = replace(
        bodies_at(np.repeat(np.arange(8), len(frame)), np.zeros(len(place)), place, HEIGHT_M), step=np.tile(frame, 8)
    )
    bodies = bodies.take(rng.permutation(len(bodies)))
    none = np.zeros(0, np.int64)
    return CameraTracklets("C", CameraObservations(), Clock(5.0), bodies, Level(UP, HEIGHT_M, 0.0), None, (none, none))


@pytest.mark.parametrize("fps", [1.0, 5.0, 25.0, 50.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_walkers_tell_the_rate(fps: float, seed: int) -> None:
    """They walk at 1.0 to 1.6 m/s."""
    found = rate_of_walkers([walked(fps, seed=seed)])
    assert found is not None
    assert found == pytest.approx(fps, rel=0.3)


def test_noise_of_places_is_no_walk() -> None:
    """From frame to frame feet jump by 0.3 m: 7 m/s, if it were a walk."""
    found = rate_of_walkers([walked(25.0, noise_m=0.2)])
    assert found is not None
    assert found == pytest.approx(25.0, rel=0.3)


def test_all_cameras_count() -> None:
    """One in which most stand is outvoted by one in which they walk."""
    both = rate_of_walkers([walked(5.0), walked(5.0, stand=True, seed=1), walked(5.0, seed=2), walked(5.0, seed=3)])
    assert both is not None
    assert both == pytest.approx(5.0, rel=0.3)


def test_rates_stay_within_what_is_believed() -> None:
    slow, fast = rate_of_walkers([walked(0.25)]), rate_of_walkers([walked(150.0)])
    assert slow == SLOWEST
    assert fast == FASTEST


def test_who_stands_or_is_seen_by_a_camera_without_level_tells_nothing() -> None:
    assert rate_of_walkers([walked(5.0, stand=True)]) is None
    assert rate_of_walkers([replace(walked(5.0), level=None)]) is None
    assert rate_of_walkers([]) is None


def test_feet_near_the_horizon_do_not_count() -> None:
    """The same walkers 45 m off, beyond ten camera heights."""
    assert rate_of_walkers([walked(5.0, offset_m=60j)]) is None


@pytest.mark.slow
@pytest.mark.parametrize("given", [True, False])
def test_the_rate_of_a_simulated_scene(given: bool) -> None:
    """Five frames a second, told to nobody, from tracklets and from detections."""
    scene = simulated("terrace", 20.0, 2, unrelated_ids=True)
    rig = Rig(tuple(replace(camera, pose=None) for camera in scene.rig.cameras[:2]))
    cameras = {}
    for name in rig.names:
        boxes = scene.observations[name].boxes
        cameras[name] = CameraObservations(boxes if given else replace(boxes, identity=np.full(len(boxes), UNKNOWN)))
    found = estimate_frame_rate(rig, Observations(cameras), 1.72, np.random.default_rng(0))
    assert 2.5 < found < 10.0


def test_the_estimate_is_what_walkers_tell_at_the_rate_that_agrees_with_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tracking at 2 and at 10 frames a second tells 4 and 9: the second comes nearer to what it was tracked at; at 9, 9.1."""
    found = {2.0: 4.0, 10.0: 9.0, 9.0: 9.1}
    monkeypatch.setattr(frame_rate, "build_camera_tracklets", lambda camera, seen, clock, *_: clock.fps)
    monkeypatch.setattr(frame_rate, "rate_of_walkers", lambda rates: found[rates[0]])
    rig = Rig(simulated("terrace", 20.0, 2, unrelated_ids=True).rig.cameras[:1])
    nobody = Observations({rig.names[0]: CameraObservations()})
    assert estimate_frame_rate(rig, nobody, 1.72, np.random.default_rng(0)) == 9.1


def test_nobody_seen_leaves_the_usual_rate() -> None:
    scene = simulated("terrace", 20.0, 2, unrelated_ids=True)
    rig = Rig(scene.rig.cameras[:1])
    found = estimate_frame_rate(rig, Observations({rig.names[0]: CameraObservations()}), 1.72, np.random.default_rng(0))
    assert found == UNKNOWN_RATE
