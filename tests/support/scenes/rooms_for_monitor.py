"""Rooms side by side with four cameras each, too many cameras for a test of all at once: for tests of the monitor on sites."""

from dataclasses import replace

import numpy as np

from passerby.core.cameras import Pose, Rig
from passerby.core.observations import CameraObservations, Observations
from support.scenes.walkers_for_monitor import FPS, calibrated, true_rig, walkers

APART_M = 100.0


def rooms(count=4):
    """The true rig: C1 to C4 in the first room, C5 to C8 in the next one."""
    return Rig(tuple(camera for number in range(count) for camera in _shifted(true_rig(), number)))


def _shifted(rig, number):
    away = np.array([APART_M * number, 0.0, 0.0])
    for index, camera in enumerate(rig):
        pose = Pose.from_centre(camera.pose.R_cw, camera.pose.centre + away)
        yield replace(camera, name=f"C{4 * number + index + 1}", pose=pose)


def walkers_in_rooms(rig, seconds=180, knocks=None, people=5):
    """What the cameras see; `knocks` as for `walkers`, with poses in the rig's frame."""
    cameras = {}
    for number in range(len(rig) // 4):
        away = np.array([APART_M * number, 0.0, 0.0])
        room = Rig(tuple(_moved(camera, -away) for camera in rig.cameras[4 * number : 4 * number + 4]))
        here = {
            name: (when, Pose.from_centre(pose.R_cw, pose.centre - away))
            for name, (when, pose) in (knocks or {}).items()
            if name in room.names
        }
        seen = walkers(room, seconds, people=people, knocks=here, seed=2 + number)
        for name, own in seen.cameras.items():
            boxes = own.boxes
            cameras[name] = CameraObservations(replace(boxes, identity=boxes.identity + 100 * number))
    return Observations(cameras, FPS)


def _moved(camera, shift):
    return replace(camera, pose=Pose.from_centre(camera.pose.R_cw, camera.pose.centre + shift))


__all__ = ["calibrated", "rooms", "walkers_in_rooms"]
