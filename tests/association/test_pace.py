"""The frame rate that is assumed where none is stated, against that of walkers."""

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


@pytest.mark.parametrize(
    ("fps", "cameras"),
    [
        *((fps, [{"seed": seed}]) for fps in (1.0, 5.0, 25.0, 50.0) for seed in (0, 1)),
        (25.0, [{"noise_m": 0.2}]),
        (5.0, [{}, {"stand": True, "seed": 1}, {"seed": 2}, {"seed": 3}]),
    ],
)
def test_walkers_tell_the_rate(fps: float, cameras: list[dict]) -> None:
    """They walk at 1.0 to 1.6 m/s. Noise of 0.2 m lets feet jump by 7 m/s, and one camera of four sees people who stand."""
    assert rate_of_walkers([walked(fps, **how) for how in cameras]) == pytest.approx(fps, rel=0.3)


@pytest.mark.parametrize(("fps", "bound"), [(0.25, SLOWEST), (150.0, FASTEST)])
def test_rates_stay_within_what_is_believed(fps: float, bound: float) -> None:
    assert rate_of_walkers([walked(fps)]) == bound


def test_who_stands_or_is_near_the_horizon_or_seen_by_a_camera_without_level_tells_nothing() -> None:
    """The horizon: walkers 45 m off, beyond ten camera heights."""
    silent = walked(5.0, stand=True), walked(5.0, offset_m=60j), replace(walked(5.0), level=None)
    assert [rate_of_walkers(cameras) for cameras in ([], *([one] for one in silent))] == [None] * 4


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


def nobody_seen() -> tuple[Rig, Observations]:
    rig = Rig(simulated("terrace", 20.0, 2, unrelated_ids=True).rig.cameras[:1])
    return rig, Observations({rig.names[0]: CameraObservations()})


def test_the_estimate_is_what_walkers_tell_at_the_rate_that_agrees_with_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tracking at 2 and at 10 frames a second tells 4 and 9: the second comes nearer to what it was tracked at; at 9, 9.1."""
    found = {2.0: 4.0, 10.0: 9.0, 9.0: 9.1}
    monkeypatch.setattr(frame_rate, "build_camera_tracklets", lambda camera, seen, clock, *_: clock.fps)
    monkeypatch.setattr(frame_rate, "rate_of_walkers", lambda rates: found[rates[0]])
    assert estimate_frame_rate(*nobody_seen(), 1.72, np.random.default_rng(0)) == 9.1


def test_nobody_seen_leaves_the_usual_rate() -> None:
    assert estimate_frame_rate(*nobody_seen(), 1.72, np.random.default_rng(0)) == UNKNOWN_RATE
