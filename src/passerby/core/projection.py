"""The mathematics of OpenCV's lens models, on plain arrays: its fisheye forward and back, its pinhole back."""

from __future__ import annotations

import cv2
import numpy as np

from passerby.common.arrays import Floats


def unproject_pinhole(pixels: Floats, matrix: Floats, distortions: Floats) -> Floats:
    """(N, 2) pixels to (N, 3) rays with z = 1: OpenCV's fixed point, finished by Newton steps.

    OpenCV's own iteration stops after five rounds, half a pixel short at the border of a strong lens.
    """
    zero, step = np.zeros(3), 1e-6

    def distort(plane: Floats) -> Floats:
        rays = np.column_stack([plane, np.ones(len(plane))])
        return np.asarray(cv2.projectPoints(rays[:, None], zero, zero, matrix, distortions)[0][:, 0], dtype=np.float64)

    plane = np.asarray(cv2.undistortPoints(pixels[:, None], matrix, distortions)[:, 0], dtype=np.float64)
    if distortions.size == 0 or not distortions.any():
        return np.column_stack([plane, np.ones(len(plane))])
    for _ in range(8):
        at = distort(plane)
        miss = pixels - at
        if np.nanmax(np.abs(miss)) < 1e-9:
            break
        by_x = (distort(plane + (step, 0.0)) - at) / step
        by_y = (distort(plane + (0.0, step)) - at) / step
        determinant = by_x[:, 0] * by_y[:, 1] - by_x[:, 1] * by_y[:, 0]
        with np.errstate(all="ignore"):
            dx = (miss[:, 0] * by_y[:, 1] - miss[:, 1] * by_y[:, 0]) / determinant
            dy = (by_x[:, 0] * miss[:, 1] - by_x[:, 1] * miss[:, 0]) / determinant
            plane = plane + np.clip(np.column_stack([dx, dy]), -0.2, 0.2)
    return np.column_stack([plane, np.ones(len(plane))])


def _fisheye_polynomial(theta: Floats, k: Floats) -> tuple[Floats, Floats]:
    """Distorted angle and its derivative, OpenCV's fisheye: theta_d = theta (1 + k1 theta^2 + ... + k4 theta^8)."""
    t2 = theta * theta
    k1, k2, k3, k4 = (*k, 0.0, 0.0, 0.0, 0.0)[:4]
    value = theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
    slope = 1 + t2 * (3 * k1 + t2 * (5 * k2 + t2 * (7 * k3 + t2 * 9 * k4)))
    return value, slope


def project_fisheye(points: Floats, matrix: Floats, distortions: Floats) -> Floats:
    """OpenCV's fisheye projection, valid beyond 90 degrees (cv2.fisheye.projectPoints is not)."""
    radius = np.hypot(points[:, 0], points[:, 1])
    theta = np.arctan2(radius, points[:, 2])
    distorted, _ = _fisheye_polynomial(theta, distortions)
    scale = np.where(radius > 1e-12, distorted / np.maximum(radius, 1e-12), 1.0 / np.maximum(np.abs(points[:, 2]), 1e-12))
    plane = points[:, :2] * scale[:, None]
    x = matrix[0, 0] * plane[:, 0] + matrix[0, 1] * plane[:, 1] + matrix[0, 2]
    y = matrix[1, 1] * plane[:, 1] + matrix[1, 2]
    return np.column_stack([x, y])


def unproject_fisheye(pixels: Floats, matrix: Floats, distortions: Floats) -> Floats:
    """Invert the fisheye polynomial by Newton's method; NaN where it does not converge."""
    y = (pixels[:, 1] - matrix[1, 2]) / matrix[1, 1]
    x = (pixels[:, 0] - matrix[0, 2] - matrix[0, 1] * y) / matrix[0, 0]
    target = np.hypot(x, y)
    theta = np.minimum(target, np.pi * 0.9)
    for _ in range(30):
        value, slope = _fisheye_polynomial(theta, distortions)
        theta = np.clip(theta - (value - target) / np.where(np.abs(slope) > 1e-6, slope, 1e-6), 0, np.pi)
    ratio = np.where(target > 1e-12, np.sin(theta) / np.maximum(target, 1e-12), 1.0)
    return np.column_stack([x * ratio, y * ratio, np.cos(theta)])
