"""A plan of the simulated scene: white, with the true rig placed on it."""

import cv2
import numpy as np

UNIT, MARGIN_M = 0.02, 2.0
"""Metres per pixel, and metres around the cameras."""


class DrawnPlan:
    """A plan that shows the world of a true rig, whose axes run to its right and up."""

    def __init__(self, truth):
        centres = np.array([camera.centre[:2] for camera in truth])
        self.truth = truth
        self.corner = np.array([centres[:, 0].min() - MARGIN_M, centres[:, 1].max() + MARGIN_M])
        self.size = tuple(np.ceil((np.ptp(centres, axis=0) + 2 * MARGIN_M) / UNIT).astype(int).tolist())

    @property
    def png(self):
        return cv2.imencode(".png", np.full((*self.size[::-1], 3), 235, np.uint8))[1].tobytes()

    def pixel(self, place):
        """Of a place in the world."""
        return ((np.asarray(place)[:2] - self.corner) * (1, -1) / UNIT - 0.5).round(2).tolist()

    def cameras(self, *names):
        return {name: self.pixel(self.truth[name].centre) for name in names}

    def point(self, place, *names):
        """A point of the ground, on the plan and in cameras."""
        return {
            "at": self.pixel(place),
            "pixels": {name: self.truth[name].project(place)[0].round(2).tolist() for name in names},
        }
