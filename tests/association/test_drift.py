"""Clocks: frame rates that differ from the stated or assumed ones, against known rates, and offsets that are whole frames."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from passerby.association.camera_tracklets import CameraTracklets
from passerby.association.clocks import frame_rate
from passerby.association.clocks.drift import Drift, clock_drifts, drift_findings
from passerby.association.clocks.frame_rate import estimate_frame_rate, rate_of_walkers
from passerby.association.clocks.offsets import relative_to_reference, snap_to_whole_frames
from passerby.core.cameras import Pose, Rig
from passerby.core.observations import CameraObservations, Clock, Observations
from passerby.geometry.single_view import Level
from passerby.people.sightings import upright_sightings
from support.scenes.people_and_rigs import observe, ring, simulated, without_poses
from support.scenes.walkers_on_plane import UP, Station, Walker, bodies_at, standing, walkers

FPS = 10.0
SECONDS = 60.0


@dataclass(frozen=True, eq=False)
class Filmed:
    """Cameras of a rig, and who their tracklets are."""

    cameras: list[CameraTracklets]
    poses: list[Pose | None]
    person: list[np.ndarray]
    offset_s: np.ndarray

    def drifts(self) -> dict[int, Drift]:
        return clock_drifts(self.cameras, self.poses, self.person, self.offset_s)


def filmed(
    people: list[Walker], true_fps: tuple[float, ...], late_s: tuple[float, ...] | None = None, *, noise: float = 0.01
) -> Filmed:
    """By a ring of cameras with these frame rates, all stated as `FPS`, whose frame 1 shows the time `late_s`."""
    rig, rng = ring(len(true_fps), radius=11.0, height=4.0), np.random.default_rng(0)
    offset_s = np.array(late_s or np.zeros(len(rig)))
    cameras = []
    for camera, fps, offset in zip(rig, true_fps, offset_s.tolist(), strict=True):
        frame = np.arange(1, int(SECONDS * fps), dtype=np.int64)
        places = np.concatenate([walker.at((frame - 1) / fps + offset) for walker in people])
        ground = np.column_stack([places.real, places.imag])
        number = np.repeat(np.arange(len(people)), len(frame))
        seen = observe(Rig((camera,)), ground, np.full(len(number), 1.72), np.tile(frame, len(people)), number)[camera.name]
        bodies = upright_sightings(seen, camera.lens, Clock(FPS))
        shaken = bodies.bottom + noise * 0.1 * rng.standard_normal((len(bodies), 3))
        object.__setattr__(bodies, "bottom", shaken / np.linalg.norm(shaken, axis=1, keepdims=True))
        none = np.zeros(0, np.int64)
        cameras.append(CameraTracklets(camera.name, seen, Clock(FPS), bodies, None, None, (none, none)))
    return Filmed(cameras, [camera.pose for camera in rig], [np.arange(len(people))] * len(rig), offset_s)


def crowd(n: int = 8) -> list[Walker]:
    return walkers(n, np.random.default_rng(1), SECONDS, half_m=4.0)


@pytest.mark.parametrize("true_fps", [10.1, 9.8, 10.005])
def test_a_camera_of_another_frame_rate_runs_ahead_or_behind(true_fps: float) -> None:
    """More frames a second than stated: its clock shows too much."""
    found = filmed(crowd(), (FPS, FPS, true_fps, FPS), (0.0, 1.3, -0.7, 0.25)).drifts()
    assert list(found) == [0, 1, 2, 3]
    rate = true_fps / FPS - 1
    np.testing.assert_allclose(found[2].rate, rate, atol=0.1 * abs(rate) + 2e-4)
    assert found[2].span_s == pytest.approx(SECONDS, abs=4.0)
    for c in (0, 1, 3):
        assert not found[c].sure
        assert abs(found[c].seconds) < 0.04
    assert (found[2].sure, found[2].harmful) == (abs(rate) > 0.005, abs(rate) > 0.01)


def test_sound_clocks_of_noisy_cameras_do_not_drift() -> None:
    found = filmed(crowd(), (FPS,) * 4, (0.4, 0.0, -0.9, 2.0), noise=0.05).drifts()
    assert len(found) == 4
    assert not any(drift.sure for drift in found.values())
    assert all(drift.sigma > 0 for drift in found.values())


def test_people_that_few_of_many_cameras_see_show_the_drift_less_surely() -> None:
    """Each person is known in two neighbouring cameras of six, and is somebody else in each of the others."""
    n, people = 6, 12
    scene = filmed(crowd(people), tuple(10.1 if c == 2 else FPS for c in range(n)))
    by_all = scene.drifts()
    for c in range(n):
        known = (c - np.arange(people)) % n < 2
        scene.person[c] = np.where(known, np.arange(people), 100 * (c + 1) + np.arange(people))
    found = scene.drifts()
    assert list(found) == list(range(n))
    assert found[2].sure
    assert found[2].rate == pytest.approx(0.01, abs=0.0005)
    assert not any(found[c].sure for c in range(n) if c != 2)
    assert all(found[c].sigma > 1.5 * by_all[c].sigma for c in range(n)), "a third of the sightings: by its root at least"


@pytest.mark.parametrize("lost", ["shares one moment only", "no pose"])
def test_a_camera_that_shows_too_little_is_left_out(lost: str) -> None:
    """Three frames within a quarter of a second and one a second later make one sample, the only one of its camera."""
    scene = filmed(crowd(), (FPS, FPS, 10.2, FPS))
    if lost == "no pose":
        scene.poses[0] = None
    else:
        bodies = scene.cameras[0].bodies
        moment = (bodies.identity == 0) & np.isin(bodies.step, [3, 4, 5, 15])
        scene.cameras[0] = replace(scene.cameras[0], bodies=bodies.take(moment))
    found = scene.drifts()
    assert list(found) == [1, 2, 3]
    np.testing.assert_allclose(found[2].rate, 0.02, atol=0.002)


def test_people_who_stand_or_are_seen_by_one_camera_tell_no_time() -> None:
    assert filmed(standing(8, np.random.default_rng(0), half_m=4.0), (FPS, FPS, 10.2)).drifts() == {}
    scene = filmed(crowd(4), (FPS, 10.2))
    scene.person[1] = scene.person[1] + 100
    assert scene.drifts() == {}


@pytest.mark.parametrize(("fps", "severity"), [(10.4, "doubt"), (10.08, "notice")])
def test_the_doubt_or_notice_names_camera_drift_and_the_rate_that_fits(fps: float, severity: str) -> None:
    scene = filmed(crowd(), (FPS, FPS, fps, FPS))
    doubts, notices = drift_findings(scene.cameras, scene.drifts())
    (found,) = doubts + notices
    assert (found.code, found.severity, found.cameras, found.values["fps"]) == ("clock_drifts", severity, ("C3",), 10.0)
    assert doubts == ([found] if severity == "doubt" else [])
    assert found.values["fits_fps"] == pytest.approx(fps, abs=0.05)
    assert found.values["drift_s"] == pytest.approx(6 * (fps - 10), abs=0.3)


def test_of_two_cameras_neither_is_to_blame() -> None:
    scene = filmed(crowd(), (FPS, 10.4))
    (doubt,), notices = drift_findings(scene.cameras, scene.drifts())
    assert (notices, doubt.code, doubt.severity, doubt.cameras) == ([], "clock_drifts", "doubt", ("C1", "C2"))
    assert 2.0 <= doubt.values["drift_s"] < 3.0
    sound = filmed(crowd(), (FPS, FPS))
    assert drift_findings(sound.cameras, sound.drifts()) == ([], [])


def walked(fps: float, *, stand: bool = False, seed: int = 0, noise_m: float = 0.1, offset_m: complex = 9j) -> CameraTracklets:
    """Eight people in front of a camera; half a minute, at a rate that is not stated."""
    rng = np.random.default_rng(seed)
    people = standing(8, rng, half_m=6.0) if stand else walkers(8, rng, 30.0, half_m=6.0)
    frame = np.arange(1, int(30 * fps))
    place = np.concatenate([Station(place=-offset_m).ground(walker.at(frame / fps)) for walker in people])
    place = place + noise_m * (rng.standard_normal(len(place)) + 1j * rng.standard_normal(len(place)))
    bodies = replace(bodies_at(np.repeat(np.arange(8), len(frame)), np.zeros(len(place)), place), step=np.tile(frame, 8))
    bodies, none = bodies.take(rng.permutation(len(bodies))), np.zeros(0, np.int64)
    return CameraTracklets("C", CameraObservations(), Clock(5.0), bodies, Level(UP, 4.0, 0.0), None, (none, none))


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


def test_people_who_stand_or_are_near_the_horizon_or_seen_by_a_camera_without_level_tell_no_rate() -> None:
    """The horizon: walkers 45 m off, beyond ten camera heights."""
    silent = walked(5.0, stand=True), walked(5.0, offset_m=60j), replace(walked(5.0), level=None)
    assert [rate_of_walkers(cameras) for cameras in ([], *([one] for one in silent))] == [None] * 4


def test_the_estimated_rate_is_that_which_agrees_with_itself_or_the_usual_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tracking at 2 and at 10 frames a second tells 4 and 9: the second comes nearer to what it was tracked at; at 9, 9.1."""
    rig = Rig(simulated("terrace", 20.0, 2, unrelated_ids=True).rig.cameras[:1])
    nobody = Observations({rig.names[0]: CameraObservations()})
    assert estimate_frame_rate(rig, nobody, 1.72, np.random.default_rng(0)) == 10.0
    found = {2.0: 4.0, 10.0: 9.0, 9.0: 9.1}
    monkeypatch.setattr(frame_rate, "build_camera_tracklets", lambda camera, seen, clock, *_: clock.fps)
    monkeypatch.setattr(frame_rate, "rate_of_walkers", lambda rates: found[rates[0]])
    assert estimate_frame_rate(rig, nobody, 1.72, np.random.default_rng(0)) == 9.1


FRAME_S, RATES = 0.04, np.full(4, 25.0)
SIGMA_S = np.array([0.0, 0.002, 0.003, 0.002])
WHOLE = np.array([0.0, 0.04, 0.08, -0.04])


@pytest.mark.parametrize(("lost", "reference"), [((), 0), ((0,), 1), ((0, 1, 3), 2), ((0, 1, 2, 3), 0), (None, 0)])
def test_offsets_are_relative_to_the_first_registered_camera(lost: tuple[int, ...] | None, reference: int) -> None:
    offset_s, rig = np.array([0.5, -1.25, 3.0, 0.75]), ring(4)
    cameras = [bare if c in (lost or ()) else own for c, (own, bare) in enumerate(zip(rig, without_poses(rig), strict=True))]
    found = relative_to_reference(offset_s, None if lost is None else Rig(tuple(cameras)))
    assert found[reference] == 0.0
    np.testing.assert_allclose(found - found[0], offset_s - offset_s[0], err_msg="what is between two cameras stays")


def test_offsets_that_are_whole_within_their_sigmas_become_so() -> None:
    """An unregistered camera, whose sigma is unknown, keeps its offset."""
    stray = np.array([0.0, 0.0015, -0.003, 0.002])
    whole = 0.7 + np.array([0.0, 3.0, -7.0, 0.0]) * FRAME_S
    np.testing.assert_allclose(snap_to_whole_frames(whole + stray, SIGMA_S, RATES), whole, atol=1e-12)
    offset_s, sigma_s = np.array([0.013, 0.2, 0.2801, 0.1601]), np.array([np.nan, 0.0, 0.002, 0.003])
    found = snap_to_whole_frames(offset_s, sigma_s, np.array([30.0, 25.0, 25.0, 25.0]))
    np.testing.assert_allclose(found, [0.013, 0.2, 0.28, 0.16], atol=1e-12)


@pytest.mark.parametrize(
    ("offset_s", "sigma_s", "fps"),
    [
        *((np.array([0.0, 0.08, (2 + share) * FRAME_S, -0.04]), SIGMA_S, RATES) for share in (0.5, 0.3, -0.4)),
        (WHOLE, np.array([0.0, 0.002, 0.3 * FRAME_S, 0.002]), RATES),
        (WHOLE, SIGMA_S, np.array([25.0, 25.0, 50.0, 25.0])),
        (np.array([0.0, 0.4]), np.array([0.0, np.nan]), RATES[:2]),
        (np.array([0.0, 0.4]), np.array([np.nan, np.nan]), RATES[:2]),
        # An offset 1.9 sigmas from a whole frame is nothing unusual, each of ten is.
        (np.append(0.0, np.full(10, 0.04 + 1.9 * 0.002)), np.append(0.0, np.full(10, 0.002)), np.full(11, 25.0)),
    ],
    ids=["between", "nearer", "before", "too large a sigma", "other rates", "one camera", "none", "many strays"],
)
def test_offsets_that_are_not_surely_whole_stay_as_they_are(offset_s: np.ndarray, sigma_s: np.ndarray, fps: np.ndarray) -> None:
    assert snap_to_whole_frames(offset_s, sigma_s, fps) is None


def test_offsets_that_are_drawn_whole_are_mostly_found_so_and_others_never() -> None:
    assert snap_to_whole_frames(np.array([0.0, 0.04 + 1.9 * 0.002]), np.array([0.0, 0.002]), RATES[:2]) is not None
    rng = np.random.default_rng(0)
    whole, between = 0, 0
    for _ in range(400):
        frames, noise = rng.integers(-50, 50, 4), SIGMA_S * rng.standard_normal(4)
        whole += snap_to_whole_frames((frames - frames[0]) * FRAME_S + noise, SIGMA_S, RATES) is not None
        between += snap_to_whole_frames((frames + [0, 0.5, 0.5, 0.5]) * FRAME_S + noise, SIGMA_S, RATES) is not None
    assert 0.92 < whole / 400 < 0.98
    assert between == 0
