"""A stick that a person carries through a simulated scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from passerby.core.observations import WAND_ENDS, Keypoints, Observations
from passerby.simulation import SimulatedScene


def carried_wand(
    truth: SimulatedScene, rng: np.random.Generator, *, metres: float = 1.0, noise_px: float = 2.0, carrier: int = 0
) -> dict[str, Keypoints]:
    """Both ends of a stick, in each camera's own frames, where they are inside the image.

    Args:
        truth: the scene, with its clocks.
        rng: of the noise.
        metres: length of the stick.
        noise_px: standard deviation of a pixel's coordinates.
        carrier: index of the person who carries it; it turns about once in two seconds before the chest.
    """
    options, seen = truth.options, {}
    for camera, fps in zip(truth.rig, options.frame_rates, strict=True):
        frames = np.arange(1, round(options.seconds * fps) + 1)
        seconds = (frames - 1) / fps + truth.clock_offsets[camera.name]
        state, present = truth.motion.at(seconds)
        middle = np.column_stack([state.xy[:, carrier], 1.3 + 0.1 * np.sin(2 * seconds)])
        along = np.column_stack([np.cos(3 * seconds), np.sin(3 * seconds), 0.5 * np.sin(1.7 * seconds)])
        along *= 0.5 * metres / np.linalg.norm(along, axis=1, keepdims=True)
        pixels = camera.project(np.concatenate([middle - along, middle + along])).reshape(2, -1, 2).transpose(1, 0, 2)
        pixels = pixels + rng.normal(0, noise_px, pixels.shape)
        with np.errstate(invalid="ignore"):
            inside = ((pixels > 0) & (pixels < np.array(camera.lens.size))).all(axis=(1, 2)) & present[:, carrier]
        score = np.ones((int(inside.sum()), 2))
        seen[camera.name] = Keypoints(frames[inside], np.zeros(len(score)), pixels[inside], score, WAND_ENDS)
    return seen


def with_wands(observations: Observations, wands: Mapping[str, Keypoints]) -> Observations:
    """The observations with the ends of wands."""
    cameras = {name: replace(seen, wands=wands[name]) for name, seen in observations.cameras.items()}
    return replace(observations, cameras=cameras)


def as_annotations(people: Keypoints, wand: Keypoints, names: tuple[str, str]) -> Keypoints:
    """People with two more keypoints, and the wand in annotations of its own among them, as a file has them."""
    n, m, joints = len(people), len(wand), len(people.joints)
    xy, score = np.zeros((n + m, joints + 2, 2)), np.zeros((n + m, joints + 2))
    xy[:n, :joints], score[:n, :joints] = people.xy, people.score
    xy[n:, joints:], score[n:, joints:] = wand.xy, wand.score
    frame, identity = np.concatenate([people.frame, wand.frame]), np.concatenate([people.identity, np.full(m, -1)])
    return Keypoints(frame, identity, xy, score, (*people.joints, *names))
