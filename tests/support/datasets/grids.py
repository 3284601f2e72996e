"""Small generated examples of WILDTRACK and MultiviewX, in their published layouts."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np

from passerby.core.cameras import Lens
from support.scenes.walking_area import MIRROR, Walk, around, paths

SIZE = (1920, 1080)
CORNERS = ("xmin", "ymin", "xmax", "ymax")
WILDTRACK_LABELS = ("CVLab1", "CVLab2", "CVLab3", "CVLab4", "IDIAP1", "IDIAP2", "IDIAP3")


def write_wildtrack(folder: Path, frames: int = 12, people: int = 10, pictures: int = 2) -> Walk:
    """Positions and cameras in centimetres, annotations 00000000, 00000005, ... of undistorted pictures."""
    lens = Lens(SIZE, np.array([[1100.0, 0, 950], [0, 1100, 530], [0, 0, 1]]), np.zeros(0))
    rig = around([f"C{number}" for number in range(1, 8)], lens, (3.0, 8.0), 9.0, seed=1)
    walk = Walk(rig, paths(people, frames, (3.0, 8.0), 6.0, 0.025, seed=2))
    for camera, label in zip(rig, WILDTRACK_LABELS, strict=True):
        distorted = np.array([-0.4, 0.6, 0.008, 0.002, -0.7])
        for kind, distortions in (("intrinsic_zero", np.zeros(5)), ("intrinsic_original", distorted)):
            write_storage(
                folder / "calibrations" / kind / f"intr_{label}.xml",
                camera_matrix=camera.lens.matrix, distortion_coefficients=distortions[None],
            )  # fmt: skip
        assert camera.pose is not None
        rvec, tvec = cv2.Rodrigues(np.array(camera.pose.R_cw))[0].ravel(), 100 * camera.pose.t_cw
        path = folder / "calibrations" / "extrinsic" / f"extr_{label}.xml"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(
            '<?xml version="1.0"?>\n<opencv_storage>\n'
            f"  <rvec>\n    {' '.join(map(repr, rvec.tolist()))}\n   </rvec>\n"
            f"  <tvec>\n    {' '.join(map(repr, tvec.tolist()))}\n  </tvec>\n</opencv_storage>\n"
        )
    cells = np.round((walk.positions - [-3.0, -9.0]) / 0.025).astype(int)
    _write_annotations(folder, walk, cells[..., 0] + 480 * cells[..., 1], 5, "{:08d}.json")
    _write_pictures(folder, 7, [5 * frame for frame in range(pictures)], "{:08d}.png")
    return walk


def write_multiviewx(folder: Path, frames: int = 12, people: int = 10, pictures: int = 2, annotated_from: int = 0) -> Walk:
    """A left-handed world whose calibration has everything behind the cameras."""
    lens = Lens(SIZE, np.array([[900.0, 0, 950], [0, 900, 545], [0, 0, 1]]), np.array([-0.01, 0.008, 0.0004, -0.002, -0.002]))
    rig = around([f"C{number}" for number in range(1, 7)], lens, (-12.0, 8.0), 9.0, seed=3)
    walk = Walk(rig, paths(people, frames, (-12.0, 8.0), 6.0, 0.025, seed=4))
    for number, camera in enumerate(rig, start=1):
        assert camera.pose is not None
        turned = -camera.pose.R_cw * MIRROR
        write_storage(
            folder / "calibrations" / "intrinsic" / f"intr_Camera{number}.xml",
            camera_matrix=camera.lens.matrix, distortion_coefficients=camera.lens.distortions[None],
        )  # fmt: skip
        write_storage(
            folder / "calibrations" / "extrinsic" / f"extr_Camera{number}.xml",
            rvec=cv2.Rodrigues(turned)[0], tvec=-camera.pose.t_cw[:, None],
        )  # fmt: skip
    cells = np.round(walk.positions * MIRROR[:2] / 0.025).astype(int)
    _write_annotations(folder, walk, cells[..., 0] + 1000 * cells[..., 1], 1, "{:05d}.json", annotated_from)
    _write_pictures(folder, 6, list(range(pictures)), "{:04d}.png")
    return walk


def annotation(folder: Path, number: int = 0) -> Path:
    """The path of an annotation, by its place among all."""
    return sorted((folder / "annotations_positions").iterdir())[number]


def write_storage(path: Path, **matrices: np.ndarray) -> None:
    """OpenCV's own XML."""
    path.parent.mkdir(parents=True, exist_ok=True)
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, matrix in matrices.items():
        storage.write(name, np.array(matrix))
    storage.release()


def _write_annotations(folder: Path, walk: Walk, cells: np.ndarray, step: int, name: str, first: int = 0) -> None:
    path = folder / "annotations_positions"
    path.mkdir(parents=True)
    for frame, here in enumerate(cells):
        content = []
        for person, cell in enumerate(here.tolist()):
            views = []
            for number, camera in enumerate(walk.rig):
                box = walk.cylinder_box(camera, walk.positions[frame, person]) or (-1, -1, -1, -1)
                views.append({"viewNum": number, **dict(zip(CORNERS, box, strict=True))})
            content.append({"personID": person, "positionID": cell, "views": views})
        (path / name.format(first + step * frame)).write_text(json.dumps(content, indent=4))


def _write_pictures(folder: Path, cameras: int, numbers: list[int], name: str) -> None:
    for camera in range(1, cameras + 1) if numbers else ():
        path = folder / "Image_subsets" / f"C{camera}"
        path.mkdir(parents=True)
        for number in numbers:
            cv2.imwrite(str(path / name.format(number)), np.full((SIZE[1], SIZE[0], 3), 90, np.uint8))
