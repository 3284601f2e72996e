"""Identities over the cameras of a rig that is in use, if they are not known: tracklets that meet in space, camera by camera.

As in a calibration (`association.associate`), but from poses that are known from the first. A camera that has moved by a few
degrees still sees people nearer to where the others see them than to anybody else.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np

from passerby.association.associate import Tracklets, cluster_by_rig
from passerby.association.camera_tracklets import CameraTracklets, build_tracklets
from passerby.association.graph import ViewGraph
from passerby.common.arrays import Ints
from passerby.common.progress import Progress, silent
from passerby.core.cameras import Rig
from passerby.core.observations import UNKNOWN, Boxes, CameraObservations, Clock, Keypoints, Observations, once_in_frame
from passerby.core.stature import PERSON_HEIGHT_M

SEED = 0
"""Of the draw of the people that determine each camera's vertical without known identities."""


def identify_by_rig(
    rig: Rig, observations: Observations, clocks: Mapping[str, Clock], rng: np.random.Generator, *, ground_m: float = 0.0,
    executor: Executor | None = None, tell: Progress = silent, candidates: Container[tuple[int, int]] | None = None,
) -> Observations:  # fmt: skip
    """The people whom tracklets belong to, in each camera's own frames.

    Args:
        rig: cameras with poses.
        observations: identities are each camera's own tracklets, or -1 for detections.
        clocks: of every camera.
        rng: draws the people that each camera's vertical is fitted to.
        ground_m: height of the ground.
        executor: works on cameras side by side.
        tell: called for every camera that is done.
        candidates: the pairs of cameras, a < b by their places in the rig, that are compared; None: all.
    """
    level = rig.moved(np.eye(3), np.array([0.0, 0.0, -ground_m]))
    cameras = build_tracklets(level, observations, clocks, PERSON_HEIGHT_M, rng, executor, tell=tell)
    tracklets = Tracklets.of(cameras)
    offsets = np.array([clocks[camera.name].offset_s for camera in level])
    # The cameras' own times include their offsets: none is left to add.
    nothing = ViewGraph((), (), np.zeros_like(offsets))
    person = cluster_by_rig(
        tracklets, cameras, nothing, [camera.pose for camera in level], np.zeros_like(offsets), PERSON_HEIGHT_M,
        candidates=candidates,
    )  # fmt: skip
    return Observations({
        camera.name: _named(camera, person[low:high])
        for camera, low, high in zip(cameras, tracklets.first[:-1], tracklets.first[1:], strict=True)
    }, observations.fps, dict(clocks))  # fmt: skip


def _named(camera: CameraTracklets, person: Ints) -> CameraObservations:
    """What a camera saw, under the people's numbers (one for each of its tracklets) from 1 on."""
    boxes, joints = (_renamed(part, person) for part in (camera.seen.boxes, camera.seen.keypoints))
    assert isinstance(boxes, Boxes)
    assert isinstance(joints, Keypoints)
    return CameraObservations(boxes, joints)


def _renamed(part: Boxes | Keypoints, person: Ints) -> Boxes | Keypoints:
    """Rows of a person, once in a frame: of two the one of the longer tracklet."""
    rows = np.flatnonzero(part.identity > UNKNOWN)
    tracklet = part.identity[rows]
    who = person[tracklet] + 1
    length = np.bincount(tracklet, minlength=1)[tracklet]
    kept = once_in_frame(part.frame[rows], who, -length)
    found = part.take(rows[kept])
    return replace(found, identity=who[kept])
