"""Walkers as poles in front of a ring of cameras, and simulated scenes, followed; what the tests of tracks share."""

from functools import cache

import numpy as np

from passerby.core.observations import Boxes, CameraObservations, Clock, Observations
from passerby.people.trajectories.trajectories import TrackOptions, trajectories
from support.scenes.people_and_rigs import observe, ring, simulated

FPS = 5.0
POLES = TrackOptions(foot_shift=0.0)
"""A pole has no foot that stands nearer to the camera."""


def walkers(people=3, seconds=12.0, fps=FPS, offset=0.0):
    """(T, P, 2) ground positions of people who walk round on curves of their own, at frames of a clock."""
    t = np.arange(round(seconds * fps)) / fps + offset
    number = np.arange(people)
    angle = 0.35 * t[:, None] * (1 + 0.2 * number) + 2 * np.pi * number / people
    radius = 2.0 + 0.5 * number
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=2)


def watched(rig, people=3, seconds=12.0, clocks=None):
    """Boxes of walkers without any error, each camera by its own clock."""
    cameras = {}
    for camera in rig:
        clock = (clocks or {}).get(camera.name, Clock(FPS))
        place = walkers(people, seconds, clock.fps, clock.offset_s)
        frame, identity = np.meshgrid(np.arange(1, len(place) + 1), np.arange(1, people + 1), indexing="ij")
        heights = np.linspace(1.6, 1.85, people)
        seen = observe(
            type(rig)((camera,)), place.reshape(-1, 2), np.tile(heights, len(place)), frame.ravel(), identity.ravel()
        )
        cameras[camera.name] = seen[camera.name]
    return Observations(cameras)


def clocks_of(rig, fps=FPS):
    return {name: Clock(fps) for name in rig.names}


def pole_errors(found, people=3):
    """(N,) distances of places from the walkers."""
    number = found.identity - 1
    angle = 0.35 * found.time_s * (1 + 0.2 * number) + 2 * np.pi * number / people
    radius = 2.0 + 0.5 * number
    return np.linalg.norm(found.xyz[:, :2] - np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]), axis=1)


def scene_errors(scene, found):
    """(N,) distances of places from a simulated scene's truth; NaN where it tells none."""
    frame = np.round(found.time_s * scene.options.fps).astype(int)
    inside = (frame >= 0) & (frame < len(scene.frames))
    place = np.full((len(found), 2), np.nan)
    column = np.searchsorted(scene.identities, found.identity[inside])
    place[inside] = scene.ground_positions[frame[inside], column]
    return np.linalg.norm(found.xyz[:, :2] - place, axis=1)


def swapped(observations, share, rng):
    """Identities exchanged among a share of each frame's boxes of each camera."""
    cameras = {}
    for name, seen in observations.cameras.items():
        identity = np.array(seen.boxes.identity)
        for frame in np.unique(seen.boxes.frame):
            rows = rng.permutation(np.flatnonzero(seen.boxes.frame == frame))
            rows = rows[: max(2, round(share * len(rows)))] if rng.uniform() < 0.8 else rows[:0]
            identity[rows] = np.roll(identity[rows], 1)
        cameras[name] = CameraObservations(Boxes(seen.boxes.frame, identity, seen.boxes.ltwh, seen.boxes.score))
    return Observations(cameras)


@cache
def followed(preset, method="smoothed", **faults):
    """A simulated scene and its people, followed by the true cameras."""
    scene = simulated(preset, 12.0, 3, **faults)
    found = trajectories(scene.rig, scene.observations, scene.true_clocks, TrackOptions(method))
    return scene, found


__all__ = ["POLES", "clocks_of", "followed", "pole_errors", "ring", "scene_errors", "swapped", "walkers", "watched"]
