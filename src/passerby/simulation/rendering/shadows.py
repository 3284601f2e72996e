"""Shadows of people on the ground."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.cameras import Camera
from passerby.perception.pictures import Picture
from passerby.simulation.body import JOINTS
from passerby.simulation.observe import NEAREST_M
from passerby.simulation.rendering.drawing import Surface
from passerby.simulation.rendering.light import SHADOW, Light

Floats = NDArray[np.float64]

SCALE = 2
"""Shadows are drawn in a picture so many times smaller: their edges are soft anyway."""
SHIFT = 4
EDGE_PX = 1.5
"""Softness of the edge, pixels of the whole picture: half a degree of sun makes a centimetre per metre of height."""
CONTACT = 0.72
"""Brightness right under a foot, where even the sky is hidden."""
CONTACT_M = 0.16


class ShadowCaster:
    """Darkens the ground of one camera's frames."""

    def __init__(self, camera: Camera, light: Light) -> None:
        self._camera, self._light = camera, light
        width, height = camera.lens.size
        self._size = (-(-width // SCALE), -(-height // SCALE))

    def cast(
        self, frame: Picture, surfaces: list[Surface], worn: list[NDArray[np.bool_]], joints: Floats, heights: Floats
    ) -> None:
        """Draw the shadows of all people, in place.

        Args:
            frame: the background.
            surfaces: whose.
            worn: per surface, (F,) which of its quads there are.
            joints: (P, J, 3) world, metres.
            heights: (P,) metres.
        """
        brightness = np.full(self._size[::-1], 255, dtype=np.uint8)
        for surface in surfaces:
            self._contact(brightness, joints[surface.person], heights[surface.person], surface.depth)
        if self._light.sunny:
            for surface, there in zip(surfaces, worn, strict=True):
                self._sun(brightness, surface, there)
        touched = cv2.boundingRect(255 - brightness)
        if not touched[2]:
            return
        self._darken(frame, brightness, touched)

    def _darken(self, frame: Picture, brightness: Picture, touched: tuple[int, int, int, int]) -> None:
        """Multiply the part of the frame that shadows touch, with soft edges."""
        pad = 4
        left, top = max(touched[0] - pad, 0), max(touched[1] - pad, 0)
        right, bottom = min(touched[0] + touched[2] + pad, self._size[0]), min(touched[1] + touched[3] + pad, self._size[1])
        soft = cv2.GaussianBlur(brightness[top:bottom, left:right], (0, 0), EDGE_PX / SCALE)
        large = cv2.resize(soft, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_LINEAR)
        part = frame[top * SCALE : bottom * SCALE, left * SCALE : right * SCALE]
        large = cv2.cvtColor(large[: part.shape[0], : part.shape[1]], cv2.COLOR_GRAY2BGR)
        part[:] = cv2.multiply(part, large, scale=1 / 255)

    def _sun(self, brightness: Picture, surface: Surface, there: NDArray[np.bool_]) -> None:
        """The shadow of each nearly convex piece of a body is the hull of its points' shadows."""
        sun = self._light.towards_sun
        points = surface.points - (np.maximum(surface.points[:, 2:], 0.0) / sun[2]) * sun
        pixels, ahead = self._project(points)
        shape = surface.template
        seen = set(np.unique(shape.segment_of[there]).tolist())
        for number, members in enumerate(shape.segments):
            if number in seen and ahead[members].all():
                hull = cv2.convexHull(pixels[members])
                cv2.fillConvexPoly(brightness, hull, (round(255 * SHADOW),), cv2.LINE_AA, SHIFT)

    def _contact(self, brightness: Picture, joints: Floats, height: float, depth: float) -> None:
        """A dark blot around each foot that is on the ground; it fades as the foot rises."""
        for side in ("left", "right"):
            heel, toe = (joints[JOINTS.index(f"{side}_{end}")] for end in ("heel", "toe"))
            lifted = min(heel[2], toe[2]) - 0.02 * height
            strength = (1 - CONTACT) * float(np.exp(-max(lifted, 0.0) / 0.08))
            along = (toe - heel)[:2] / max(float(np.linalg.norm((toe - heel)[:2])), 1e-6)
            aside = np.array([-along[1], along[0]])
            middle = (heel + toe)[:2] / 2
            turns = np.linspace(0, 2 * np.pi, 12, endpoint=False)[:, None]
            for size, share in ((1.0, 0.5), (0.6, 1.0)):
                ring = middle + size * CONTACT_M * (1.35 * np.cos(turns) * along + 0.8 * np.sin(turns) * aside)
                pixels, ahead = self._project(np.column_stack([ring, np.zeros(len(ring))]))
                if ahead.all():
                    level = round(255 * (1 - share * strength))
                    cv2.fillConvexPoly(brightness, cv2.convexHull(pixels), (level,), cv2.LINE_AA, SHIFT)

    def _project(self, points: Floats) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
        """(N, 2) pixels of the small picture with `SHIFT` fractional bits; (N,) which points are far enough ahead."""
        pose = self._camera.pose
        assert pose is not None
        ahead = np.einsum("nk,k->n", points, pose.R_cw[2]) + pose.t_cw[2] > NEAREST_M
        safe = np.where(ahead[:, None], points, self._camera.centre + pose.R_cw[2])
        pixels = (self._camera.project(safe) - (SCALE - 1) / 2) / SCALE
        return np.round(np.clip(pixels, -4000, 4000) * (1 << SHIFT)).astype(np.int32), ahead
