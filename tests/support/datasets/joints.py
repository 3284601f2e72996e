"""Small generated examples of CMU Panoptic and of TUM Shelf and Campus, in their published layouts."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from scipy.io import savemat

from passerby.common.arrays import Floats
from passerby.core.cameras import Lens, Rig
from passerby.core.observations import BODY_17
from passerby.datasets.panoptic import COCO19
from passerby.datasets.tum import JOINTS
from passerby.simulation import SimulationOptions, simulate

Y_DOWN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""From z up to Panoptic's axes: (x, y, z) becomes (x, -z, y)."""
FIRST = 140
"""Panoptic's joints begin some frames after the videos."""


@dataclass(frozen=True, eq=False)
class People:
    """What was put into a data set: T instants, P people."""

    rig: Rig
    joints: Floats
    """(T, P, 17, 3) COCO's joints, metres, z up; NaN where a person is not there."""

    def there(self, frame: int, person: int) -> bool:
        return bool(np.isfinite(self.joints[frame, person]).all())

    def named(self, frame: int, person: int, names: tuple[str, ...]) -> Floats:
        """(J, 3) the joints of those names."""
        at = dict(zip(BODY_17, self.joints[frame, person], strict=True))
        at["neck"] = (at["left_shoulder"] + at["right_shoulder"]) / 2
        at["body_centre"] = (at["left_hip"] + at["right_hip"]) / 2
        at["head_bottom"], at["head_top"] = at["neck"] + [0, 0, 0.05], at["nose"] + [0, 0, 0.15]
        return np.stack([at[name] for name in names])


@cache
def people(cameras: int, distorted: bool) -> People:
    """A few seconds of a simulated scene, its lenses with or without distortion."""
    scene = simulate(SimulationOptions(cameras=cameras, people=4, seconds=6.0, fps=5.0, seed=5))
    distortions = np.array([-0.2, 0.15, 0.0003, -0.0005, -0.02]) if distorted else np.zeros(0)
    rig = Rig(
        tuple(
            replace(camera, name=f"00_{number:02d}", lens=Lens(camera.lens.size, camera.lens.matrix, distortions))
            for number, camera in enumerate(scene.rig)
        )
    )
    return People(rig, scene.joints3d)


def write_panoptic(folder: Path, media: str = "none") -> People:
    """A sequence, named like its folder. `media` of 00_00 and 00_02: none, pictures (hdImgs) or videos (empty files)."""
    truth = people(4, True)
    folder.mkdir(parents=True)
    cameras = []
    for number, camera in enumerate(truth.rig):
        assert camera.pose is not None
        cameras.append(
            {
                "name": camera.name, "type": "hd", "resolution": list(camera.lens.size), "panel": 0, "node": number,
                "K": camera.lens.matrix.tolist(), "distCoef": camera.lens.distortions.tolist(),
                "R": np.round(camera.pose.R_cw @ Y_DOWN.T, 10).tolist(), "t": (100 * camera.pose.t_cw)[:, None].tolist(),
            }
        )  # fmt: skip
    vga = cameras[0] | {"name": "01_01", "type": "vga", "resolution": [640, 480]}
    (folder / f"calibration_{folder.name}.json").write_text(
        json.dumps({"calibDataSource": "made", "cameras": [vga, *cameras]}, indent=1)
    )
    poses = folder / "hdPose3d_stage1_coco19"
    poses.mkdir()
    for frame in range(len(truth.joints)):
        bodies = []
        for person in range(truth.joints.shape[1]):
            if truth.there(frame, person):
                joints = np.column_stack([100 * truth.named(frame, person, COCO19) @ Y_DOWN.T, np.full(19, 0.6)])
                joints[COCO19.index("left_ear"), 3] = -1.0
                bodies.append({"id": person, "joints19": joints.ravel().tolist()})
        content = {"version": 0.7, "univTime": 53541.542 + frame, "fpsType": "hd_29_97", "bodies": bodies}
        (poses / f"body3DScene_{FIRST + frame:08d}.json").write_text(json.dumps(content))
    for camera in (truth.rig.names[0], truth.rig.names[2]) if media != "none" else ():
        if media == "videos":
            (folder / "hdVideos").mkdir(exist_ok=True)
            (folder / "hdVideos" / f"hd_{camera}.mp4").write_bytes(b"")
        else:
            _write_picture(folder / "hdImgs" / camera / f"{camera}_{FIRST:08d}.jpg", truth.rig[camera].lens.size)
    return truth


def write_tum(folder: Path, separator: str = ",", scale: float = 1.0, calibration: str = "P", cameras: int = 3) -> People:
    """Shelf or Campus: projection matrices of any scale and sign, or VoxelPose's file (`calibration`)."""
    truth = people(cameras, calibration != "P")
    folder.mkdir(parents=True)
    derived = {}
    for number, camera in enumerate(truth.rig):
        assert camera.pose is not None
        pose, lens = camera.pose, camera.lens
        if calibration == "P":
            matrix = scale * lens.matrix @ np.column_stack([pose.R_cw, pose.t_cw])
            path = folder / "Calibration" / f"P{number}.txt"
            path.parent.mkdir(exist_ok=True)
            path.write_text("".join(separator.join(f"{value:.12g}" for value in row) + "\n" for row in matrix))
        else:
            k1, k2, p1, p2, k3 = lens.distortions.tolist()
            derived[str(number)] = {
                "R": pose.R_cw.tolist(), "T": (1000 * pose.centre)[:, None].tolist(),
                "fx": lens.matrix[0, 0], "fy": lens.matrix[1, 1], "cx": lens.matrix[0, 2], "cy": lens.matrix[1, 2],
                "k": [[k1], [k2], [k3]], "p": [[p1], [p2]],
            }  # fmt: skip
        _write_picture(folder / f"Camera{number}" / "img_000004.png", lens.size)
    if derived:
        (folder / f"calibration_{calibration}.json").write_text(json.dumps(derived))
    actors = np.empty((1, truth.joints.shape[1]), dtype=object)
    for person in range(truth.joints.shape[1]):
        cells = np.empty((len(truth.joints), 1), dtype=object)
        for frame in range(len(truth.joints)):
            there = truth.there(frame, person)
            cells[frame, 0] = truth.named(frame, person, JOINTS) if there else np.zeros((1, 0))
        actors[0, person] = cells
    savemat(folder / "actorsGT.mat", {"actor3D": actors})
    return truth


def _write_picture(path: Path, size: tuple[int, int]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((size[1], size[0], 3), 90, np.uint8))
