"""Pictures of a textured floor and wall, by cameras whose poses are known: for matchers of picture points."""

from __future__ import annotations

import cv2
import numpy as np

from passerby.core.cameras import Camera, Lens, Pose, Rig

SIZE = (400, 300)
LENS = Lens(SIZE, np.array([[380.0, 0, 199.5], [0, 380.0, 149.5], [0, 0, 1]]), np.zeros(0))
WALL_Y = 3.0
PIXELS_A_METRE = 110
REACH_M = 6.0


def looking(name: str, centre: tuple[float, float, float], at: tuple[float, float, float]) -> Camera:
    """A camera at a place that looks at another, its picture's rows level."""
    ahead = np.array(at) - np.array(centre)
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return Camera(name, LENS, Pose.from_centre(np.stack([right, np.cross(ahead, right), ahead]), np.array(centre)))


def pictures(rig: Rig, seed: int = 0) -> dict[str, np.ndarray]:
    """Camera -> (H, W, 3) of the floor z = 0 and the wall y = `WALL_Y`, each with a random texture."""
    rng = np.random.default_rng(seed)
    textures = [_texture(rng) for _ in range(2)]
    return {camera.name: _view(camera, textures) for camera in rig}


def _texture(rng: np.random.Generator) -> np.ndarray:
    side = int(2 * REACH_M * PIXELS_A_METRE)
    picture = np.zeros((side, side), dtype=np.float32)
    for blur in (2, 5, 12):
        noise = cv2.GaussianBlur(rng.standard_normal((side, side)).astype(np.float32), (0, 0), blur)
        picture += noise / noise.std()
    grey = np.clip(128 + 35 * picture, 0, 255).astype(np.uint8)
    return np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR))


def _view(camera: Camera, textures: list[np.ndarray]) -> np.ndarray:
    assert camera.pose is not None
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    ray = LENS.bearings(np.column_stack([x.ravel(), y.ravel()]).astype(float)) @ camera.pose.R_cw
    with np.errstate(divide="ignore"):
        floor = np.where(ray[:, 2] < 0, -camera.centre[2] / ray[:, 2], np.inf)
        wall = np.where(ray[:, 1] > 0, (WALL_Y - camera.centre[1]) / ray[:, 1], np.inf)
    place = camera.centre + ray * np.minimum(floor, wall)[:, None]
    shown = []
    for texture, (u, v) in zip(textures, (place[:, [0, 1]].T, place[:, [0, 2]].T), strict=True):
        columns, rows = ((part + REACH_M) * PIXELS_A_METRE for part in (u, v))
        across, down = (part.reshape(SIZE[::-1]).astype(np.float32) for part in (columns, rows))
        shown.append(cv2.remap(texture, across, down, cv2.INTER_LINEAR))
    return np.asarray(np.where((floor <= wall).reshape(SIZE[::-1])[..., None], shown[0], shown[1]))
