"""Shadows of people on the ground."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.core.cameras import Camera
from passerby.perception.pictures import Picture
from passerby.simulation.body import JOINTS
from passerby.simulation.lenses import before_fold
from passerby.simulation.observe import NEAREST_M
from passerby.simulation.rendering.clothes import Outfit, dress
from passerby.simulation.rendering.drawing import LIMIT_PX
from passerby.simulation.rendering.light import SHADOW, Light
from passerby.simulation.rendering.mesh import pose_surface, template

SCALE = 2
"""Shadows are drawn in a picture so many times smaller: their edges are soft anyway."""
SHIFT = 4
EDGE_PX = 1.5
"""Softness of the edge, pixels of the whole picture: half a degree of sun makes a centimetre per metre of height."""
CONTACT = 0.72
"""Brightness right under a foot, where even the sky is hidden."""
CONTACT_M = 0.16
CONTACT_FADE_M = 0.08
"""Over this height of the foot the blot loses all but a third of its darkness."""


class ShadowCaster:
    """Darkens the ground of one camera's frames."""

    def __init__(self, camera: Camera, heights: Floats, outfits: tuple[Outfit, ...], light: Light) -> None:
        """Set up.

        Args:
            camera: with a pose.
            heights: (P,) metres.
            outfits: of the P people.
            light: of the scene.
        """
        self._camera, self._heights, self._light = camera, heights, light
        width, height = camera.lens.size
        self._size = (-(-width // SCALE), -(-height // SCALE))
        self._builds = np.array([outfit.build for outfit in outfits])
        self._shape = template(False)
        self._pieces = [np.unique(self._shape.piece[worn]).tolist() for worn in dress(self._shape, outfits).worn]

    def cast(self, frame: Picture, joints: Floats, present: NDArray[np.bool_]) -> None:
        """Draw the shadows of all people, in place; of people outside the picture too.

        Args:
            frame: the background.
            joints: (P, J, 3) world, metres.
            present: (P,) who is there.
        """
        people = np.flatnonzero(present)
        if not len(people):
            return
        brightness = np.full(self._size[::-1], 255, dtype=np.uint8)
        self._contacts(brightness, joints[people], self._heights[people])
        if self._light.sunny:
            self._sun(brightness, joints[people], people)
        touched = cv2.boundingRect(255 - brightness)
        if touched[2]:
            self._darken(frame, brightness, touched)

    def _darken(self, frame: Picture, brightness: Picture, touched: Sequence[int]) -> None:
        """Multiply the part of the frame that shadows touch, with soft edges."""
        pad = 4
        left, top = max(touched[0] - pad, 0), max(touched[1] - pad, 0)
        right, bottom = min(touched[0] + touched[2] + pad, self._size[0]), min(touched[1] + touched[3] + pad, self._size[1])
        soft = cv2.GaussianBlur(brightness[top:bottom, left:right], (0, 0), EDGE_PX / SCALE)
        large = cv2.resize(soft, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_LINEAR)
        part = frame[top * SCALE : bottom * SCALE, left * SCALE : right * SCALE]
        large = cv2.cvtColor(large[: part.shape[0], : part.shape[1]], cv2.COLOR_GRAY2BGR)
        part[:] = cv2.multiply(part, large, scale=1 / 255)

    def _sun(self, brightness: Picture, joints: Floats, people: NDArray[np.int64]) -> None:
        """The shadow of each nearly convex piece of a body is the hull of its points' shadows."""
        sun = self._light.towards_sun
        points = pose_surface(self._shape, joints, self._heights[people], self._builds[people])
        points -= (np.maximum(points[..., 2:], 0.0) / sun[2]) * sun
        pixels, ahead = self._project(points)
        for row, person in enumerate(people.tolist()):
            whole = bool(ahead[row].all())
            for piece in self._pieces[person]:
                members = self._shape.pieces[piece]
                if whole or ahead[row, members].all():
                    self._fill(brightness, pixels[row, members], SHADOW)

    def _contacts(self, brightness: Picture, joints: Floats, heights: Floats) -> None:
        """A dark blot around each foot that is on the ground; it fades as the foot rises."""
        ends = [[JOINTS.index(f"{side}_{end}") for side in ("left", "right")] for end in ("heel", "toe")]
        heel, toe = (joints[:, end] for end in ends)
        lifted = np.minimum(heel[..., 2], toe[..., 2]) - 0.02 * heights[:, None]
        strength = (1 - CONTACT) * np.exp(-np.maximum(lifted, 0.0) / CONTACT_FADE_M)
        along = (toe - heel)[..., :2]
        along = along / np.maximum(np.hypot(along[..., 0], along[..., 1]), 1e-6)[..., None]
        aside = np.stack([-along[..., 1], along[..., 0]], axis=-1)
        turns = np.linspace(0, 2 * np.pi, 12, endpoint=False)[:, None]
        ring = 1.35 * np.cos(turns) * along[..., None, :] + 0.8 * np.sin(turns) * aside[..., None, :]
        middle = (heel + toe)[..., None, :2] / 2
        for size, share in ((1.0, 0.5), (0.6, 1.0)):
            flat = middle + size * CONTACT_M * ring
            pixels, ahead = self._project(np.concatenate([flat, np.zeros_like(flat[..., :1])], axis=-1))
            for foot in np.argwhere(ahead.all(axis=-1)).tolist():
                self._fill(brightness, pixels[tuple(foot)], 1 - share * float(strength[tuple(foot)]))

    @staticmethod
    def _fill(brightness: Picture, pixels: NDArray[np.int32], level: float) -> None:
        cv2.fillConvexPoly(brightness, cv2.convexHull(pixels), (round(255 * level),), cv2.LINE_8, SHIFT)

    def _project(self, points: Floats) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
        """(..., 2) pixels of the small picture with `SHIFT` fractional bits; (...) which points are far enough ahead."""
        pose = self._camera.pose
        assert pose is not None
        ahead = np.einsum("...k,k->...", points, pose.R_cw[2]) + pose.t_cw[2] > NEAREST_M
        ahead &= before_fold(self._camera.lens, points @ pose.R_cw.T + pose.t_cw)
        safe = np.where(ahead[..., None], points, self._camera.centre + pose.R_cw[2])
        pixels = (self._camera.project(safe.reshape(-1, 3)).reshape(*points.shape[:-1], 2) - (SCALE - 1) / 2) / SCALE
        return np.round(np.clip(pixels, -LIMIT_PX, LIMIT_PX) * (1 << SHIFT)).astype(np.int32), ahead
