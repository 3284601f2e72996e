"""Rigs with every kind of lens that Passerby knows, written for a tool: the cases that checks are given. Needs Passerby."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from format_tools.case import Case
from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.interchange.formats import Export, Given, export, find_format, read_rig_as

SIZE = (1920, 1080)
NAMES = ("C1", "yard 2.north", "door")
POINTS = 600
WIDEST_DEG = 75.0
"""Points are within so many degrees of a camera's axis; OpenCV's own fisheye projection does not hold beyond 90."""

_RADTAN, _PRISM = (-0.21, 0.06, 0.0012, -0.0017), (0.0011, -0.0006, 0.0008, 0.0003)
_RATIONAL = (*_RADTAN, 0.01, 0.021, -0.012, 0.004)
KINDS: dict[str, tuple[float, ...]] = {
    "pinhole": (), "radtan 4": _RADTAN, "radtan 5": (*_RADTAN, -0.009), "rational 8": _RATIONAL,
    "thin prism 12": (*_RATIONAL, *_PRISM), "tilted 14": (*_RATIONAL, *_PRISM, 0.013, -0.021),
    "fisheye": (0.031, -0.012, 0.0021, -0.0004),
}  # fmt: skip
"""Distortion coefficients."""


def rig_of(kind: str, seed: int = 3) -> Rig:
    """Three cameras with lenses of a kind that look at the same place from several sides, all a little rolled."""
    rng = np.random.default_rng(seed)
    cameras = []
    for index, name in enumerate(NAMES):
        focal = rng.uniform(600, 650) if kind == "fisheye" else rng.uniform(1200, 1500)
        middle = np.array([959.5, 539.5]) + rng.uniform(-20, 20, 2)
        matrix = np.array([[focal, 0, middle[0]], [0, 1.003 * focal, middle[1]], [0, 0, 1]])
        coefficients = np.array(KINDS[kind]) * rng.uniform(0.9, 1.1, len(KINDS[kind]))
        turn = 2 * np.pi * (index + rng.uniform(0, 0.5)) / len(NAMES)
        centre = np.array([9 * np.cos(turn), 9 * np.sin(turn), rng.uniform(2.5, 5)])
        ahead = (np.array([0, 0, 1.0]) - centre) / np.linalg.norm(np.array([0, 0, 1.0]) - centre)
        right = np.cross(ahead, (0, 0, 1.0)) / np.linalg.norm(np.cross(ahead, (0, 0, 1.0)))
        rolled = np.asarray(cv2.Rodrigues(rng.normal(0, 0.06, 3))[0])
        pose = Pose.from_centre(rolled @ np.array([right, np.cross(ahead, right), ahead]), centre)
        cameras.append(Camera(name, Lens(SIZE, matrix, coefficients, kind == "fisheye"), pose))
    return Rig(tuple(cameras))


def cases_of(format_name: str, scratch: Path) -> Iterator[tuple[str, Rig, Path]]:
    """Each kind of lens that a format holds without loss, its rig, and the folder of its case, written."""
    form = find_format(format_name)
    for kind in KINDS:
        rig, folder = rig_of(kind), scratch / format_name / kind.replace(" ", "-")
        target = folder / "written" / ("rig" + form.suffixes[0] if form.target == "file" else "rig")
        try:
            export(Export(rig, "a scene"), format_name, target)
        except InputError:
            continue
        world = np.random.default_rng(7).uniform((-5, -5, 0), (5, 5, 2.5), (POINTS, 3))
        case = Case(NAMES, world, np.array([_pixels(camera, world) for camera in rig]), target, folder / "back" / target.name)
        case.write(folder)
        yield kind, rig, folder


def read_back(format_name: str, folder: Path) -> float | None:
    """The largest difference in pixels of what the tool wrote itself, read by Passerby; None where it wrote nothing."""
    case = Case.read(folder)
    if not case.back.exists():
        return None
    rig, _ = read_rig_as(format_name, case.back, Given(SIZE))
    cameras = [rig[name] if name in rig.names else rig.cameras[index] for index, name in enumerate(case.names)]
    return case.largest([camera.project(case.seen(index)) for index, camera in enumerate(cameras)])


def _pixels(camera: Camera, world: Floats) -> Floats:
    """(N, 2) where a camera has the points; NaN outside of its picture."""
    assert camera.pose is not None
    rays = world @ camera.pose.R_cw.T + camera.pose.t_cw
    pixels = camera.project(world)
    inside = ((pixels >= 0) & (pixels <= np.array(SIZE) - 1)).all(axis=1)
    inside &= rays[:, 2] > np.cos(np.radians(WIDEST_DEG)) * np.linalg.norm(rays, axis=1)
    return np.where(inside[:, None], pixels, np.nan)
