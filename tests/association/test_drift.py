"""Clocks that do not keep step, against frame rates that are known."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from passerby.association.camera_tracklets import CameraTracklets
from passerby.association.clocks.drift import Drift, clock_drifts, drift_findings
from passerby.core.cameras import Pose, Rig
from passerby.core.observations import Clock
from passerby.people.sightings import upright_sightings
from support.scenes.people_and_rigs import observe, ring
from support.scenes.walkers_on_plane import Walker, standing, walkers

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


def test_people_whom_two_of_many_cameras_see_tell_the_drift_less_surely() -> None:
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
def test_a_camera_of_which_too_little_is_known_is_left_out(lost: str) -> None:
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


def test_people_who_stand_or_are_nobody_elses_tell_no_time() -> None:
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


@pytest.mark.parametrize(
    ("rate", "sigma", "span_s", "sure", "harmful"),
    [
        (0.04, 0.0005, 60.0, True, True),  # 24 frames a second for 25
        (0.04, 0.02, 60.0, False, True),  # too little is known of it
        (0.005, 0.0001, 120.0, True, False),  # a poor clock
        (0.005, 0.0001, 300.0, True, True),  # for so long that it spoils the rig
        (0.001, 0.00001, 60.0, False, False),  # too small to move people
        (0.04, 0.0005, 10.0, True, False),  # too short to
    ],
)
def test_what_is_sure_and_what_is_harmful(rate: float, sigma: float, span_s: float, sure: bool, harmful: bool) -> None:
    drift = Drift(rate, sigma, span_s)
    assert (drift.seconds, drift.sure, drift.harmful) == (pytest.approx(rate * span_s), sure, harmful)
