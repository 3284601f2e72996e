"""People of whom no detector found the legs, or two ends of any segment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from passerby.core.observations import Boxes, CameraObservations, Keypoints, Observations

LEGS = ("knee", "ankle")
SEGMENT_ENDS = ("shoulder", "elbow", *LEGS)
"""Without these no segment of the body is left that tells scale or up direction."""


def without_joints(observations: Observations, parts: Sequence[str] = LEGS) -> Observations:
    """The keypoints alone, those of the given parts of the body with a score of 0."""
    seen = {}
    for name, camera in observations.cameras.items():
        keypoints, score = camera.keypoints, np.array(camera.keypoints.score)
        score[:, [any(part in joint for part in parts) for joint in keypoints.joints]] = 0.0
        seen[name] = CameraObservations(Boxes.empty(), replace(keypoints, score=score))
    return Observations(seen, observations.fps)


def in_turns(observations: Observations, turns: Mapping[str, Sequence[int]]) -> Observations:
    """Each camera's keypoints of the frames whose number is even (0) or odd (1), as `turns` says."""
    seen = {}
    for name, wanted in turns.items():
        keypoints = observations.cameras[name].keypoints
        seen[name] = CameraObservations(Boxes.empty(), keypoints.take(np.isin(keypoints.frame % 2, wanted)))
    return Observations(seen, observations.fps)


def office_joints(keypoints: Keypoints, joints: Sequence[str]) -> Keypoints:
    """The joints of these names alone, as of a detector that knows no others."""
    at = [keypoints.joints.index(joint) for joint in joints]
    return Keypoints(keypoints.frame, keypoints.identity, keypoints.xy[:, at], keypoints.score[:, at], tuple(joints))
