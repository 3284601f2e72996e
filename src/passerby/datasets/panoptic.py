"""CMU Panoptic Studio: people in a dome of 31 HD cameras, with 3D joints (Joo et al., ICCV 2015 and TPAMI 2017).

Layout as the toolbox writes it (https://github.com/CMU-Perceptual-Computing-Lab/panoptic-toolbox): `calibration_SEQUENCE.json`
with `cameras` (`name`, `type`, `resolution`, `K`, `distCoef` in OpenCV's order, `R`, `t` with `x_c = R X + t`, centimetres),
`hdPose3d_stage1_coco19/body3DScene_00000000.json` (`bodies` with `id` and `joints19`: x, y, z, confidence of 19 joints),
`hdVideos/hd_00_03.mp4`, `hdImgs/00_03/00_03_00000000.jpg`. The demo of MMPose is read too: `camera_parameters.json`, with the
same content, and folders of pictures in the same folder. HD videos have 29.97 frames per second; number n is frame n + 1 here.

The published world has y down, with the floor at y = 0: the published cameras all have y < 0, and the toolbox's example of a
person has the nose at -163 cm and the ankles at -8 cm. It is turned so that z is up: (x, y, z) becomes (x, z, -y) / 100.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.core.observations import BODY_17, UNKNOWN
from passerby.datasets.parsing import check_size, entry, index_by_number, numbers, read_json, read_whole_number
from passerby.datasets.published import Published
from passerby.datasets.skeletons import BETWEEN_ANKLES, PROJECTED, Skeletons, check_upright, ground_under, project_joints
from passerby.interchange.formats import Given
from passerby.interchange.formats.krt_json import CENTIMETRES, Y_DOWN_TO_Z_UP, read_panoptic

FPS = 29.97
POSES = "hdPose3d_stage1_coco19"
COCO19 = (
    "neck", "nose", "body_centre", "left_shoulder", "left_elbow", "left_wrist", "left_hip", "left_knee", "left_ankle",
    "right_shoulder", "right_elbow", "right_wrist", "right_hip", "right_knee", "right_ankle", "left_eye", "left_ear",
    "right_eye", "right_ear",
)  # fmt: skip
"""Joints in the order of the toolbox's README."""
KEPT = [COCO19.index(name) for name in BODY_17]
"""Indices of COCO's joints: all but the neck and the middle of the hips."""


def read(folder: Path) -> Published:
    """Read one sequence; its cameras are those with a video or pictures, or all HD cameras if there are neither.

    Raises `InputError` for missing, broken or contradictory files.
    """
    path = _calibration(folder)
    rig = _rig(path)
    videos, pictures, counted = _media(folder, rig)
    with_media = {*videos, *pictures}
    notes = []
    if with_media:
        rig = Rig(tuple(camera for camera in rig if camera.name in with_media))
    else:
        notes.append("There are neither videos (hdVideos) nor images (hdImgs): all HD cameras of the calibration were taken.")
    poses = folder / POSES
    files = index_by_number(poses, (".json",)) or index_by_number(poses / "hd", (".json",))
    tar = " (unpack the .tar first: tar -xf)" if (folder / f"{POSES}.tar").exists() else ""
    if not files and not with_media:
        raise InputError(
            f"{poses}: no keypoints (body3DScene_00000000.json, ...){tar}, and {folder} has no videos or images either"
        )
    keypoints, ground = {}, None
    if files:
        skeletons = _skeletons(files)
        check_upright(skeletons, str(poses))
        keypoints, ground = project_joints(rig, skeletons, str(poses)), ground_under(skeletons)
        notes += [PROJECTED, BETWEEN_ANKLES, "A person who left and came back can have several identities."]
    else:
        notes.append(f"There are no 3D keypoints in {POSES}{tar}, so the positions of people are unknown.")
    name = path.stem.removeprefix("calibration_") if path.stem.startswith("calibration_") else "panoptic"
    return Published(
        name, rig, FPS, keypoints=keypoints, videos=videos, pictures=pictures, picture_frames=counted, ground=ground,
        notes=tuple(notes),
    )  # fmt: skip


def _calibration(folder: Path) -> Path:
    """Find the only calibration file of the folder."""
    found = [*sorted(folder.glob("calibration_*.json")), *sorted(folder.glob("camera_parameters.json"))]
    if not found:
        raise InputError(f"{folder}: no calibration_SEQUENCE.json: give the folder of one sequence")
    if len(found) > 1:
        raise InputError(f"{folder}: has {found[0].name} and {found[1].name}: give a folder with the files of one sequence")
    return found[0]


def _rig(path: Path) -> Rig:
    """Read all HD cameras, which are those of the keypoints, in metres with z up."""
    return read_panoptic(path, Given(), kinds=("hd",))


def _media(folder: Path, rig: Rig) -> tuple[dict[str, Path], dict[str, tuple[Path, ...]], dict[str, tuple[int, ...]]]:
    """Find the videos, the pictures and the pictures' frames, by camera; a camera with a video needs no pictures."""
    videos, pictures, counted = {}, {}, {}
    for camera in rig:
        video = folder / "hdVideos" / f"hd_{camera.name}.mp4"
        found = index_by_number(folder / "hdImgs" / camera.name) or index_by_number(folder / camera.name)
        if video.is_file():
            videos[camera.name] = video
        elif found:
            check_size(next(iter(found.values())), camera.lens.size)
            pictures[camera.name] = tuple(found.values())
            counted[camera.name] = tuple(number + 1 for number in found)
    return videos, pictures, counted


def _skeletons(files: dict[int, Path]) -> Skeletons:
    """Read COCO's joints of all people from all files."""
    frames, people, tables = [], [], []
    for number, path in files.items():
        bodies = entry(read_json(path, "the keypoints of a time step (JSON)"), "bodies", str(path))
        if not isinstance(bodies, list):
            raise InputError(f"{path}: bodies is not a list: take the file from the set again")
        here = []
        for index, body in enumerate(bodies):
            place = f"{path}: bodies[{index}]"
            who = read_whole_number(entry(body, "id", place), f"{place}: id", UNKNOWN)
            if who != UNKNOWN and who in here:
                raise InputError(f"{place}: id {who} occurs twice in one time step: delete one of the two")
            here.append(who)
            frames.append(number + 1)
            tables.append(numbers(entry(body, "joints19", place), (19, 4), f"{place}: joints19", "19 x 4 numbers"))
        people += here
    if not tables:
        raise InputError(f"{next(iter(files.values())).parent}: none of the {len(files)} files has a person: take others")
    joints = np.stack(tables)[:, KEPT]
    xyz = CENTIMETRES * joints[..., :3] @ Y_DOWN_TO_Z_UP.T
    score = np.clip(joints[..., 3], 0.0, 1.0)
    return Skeletons(np.array(frames), np.array(people), xyz, score, BODY_17)
