"""TUM Shelf and Campus: people in the view of five and three cameras, with 3D joints (Belagiannis et al., CVPR 2014).

Layout as published (http://campar.in.tum.de/Chair/MultiHumanPose): `Camera0/img_000000.png` (Shelf) or
`Camera0/campus4-c0-00000.png` (Campus), `Calibration/P0.txt` (3 x 4 projection matrix, metres, rows of numbers separated by
commas in Shelf and by spaces in Campus), `actorsGT.mat` with `actor3D`: one cell per actor, which holds one cell per frame
with 14 x 3 metres, empty if the actor is not seen. Picture n, from 0 on, is frame n + 1 here; actors are numbered from 1 on.
Lenses come from the projection matrices by RQ decomposition (the set's own `producePmat.m` builds them from such lenses,
without distortion).

If there is no `Calibration`, `calibration_shelf.json` or `calibration_campus.json` is read, in the format of
https://github.com/microsoft/voxelpose-pytorch: by camera number `R`, `T` (the camera's centre, millimetres), `fx`, `fy`, `cx`,
`cy`, `k` (k1, k2, k3) and `p` (p1, p2), with `x_c = R (X - T)`. Other derived layouts are not read.

z is up and z = 0 the floor. The frame rate is not published.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Lens
from passerby.datasets.parsing import (
    check_size,
    entry,
    index_by_number,
    mat_variable,
    numbers,
    picture_size,
    read_json,
    text_matrix,
)
from passerby.datasets.published import (
    LEFT_HANDED,
    Published,
    PublishedCamera,
    from_projection,
    right_handed,
    rotation,
    skew_note,
)
from passerby.datasets.skeletons import BETWEEN_ANKLES, PROJECTED, Skeletons, check_upright, ground_under, project_joints

JOINTS = (
    "right_ankle", "right_knee", "right_hip", "left_hip", "left_knee", "left_ankle", "right_wrist", "right_elbow",
    "right_shoulder", "left_shoulder", "left_elbow", "left_wrist", "head_bottom", "head_top",
)  # fmt: skip
"""Joints in the order of the set's README."""
TRUTH = "actorsGT.mat"
SETS = {5: ("shelf", (1032, 776)), 3: ("campus", (360, 288))}
"""Number of cameras -> name and picture size (width, height)."""
NO_FRAME_RATE = "The set does not state its frame rate: give fps where time matters."


def read(folder: Path) -> Published:
    """Read Shelf or Campus, distinguished by the number of cameras. Raises `InputError` for missing or broken files."""
    skeletons = _skeletons(folder / TRUTH)
    cameras, notes, place = _cameras(folder)
    rig, mirror = right_handed(place, cameras, {camera.name: _project_into_picture(camera, skeletons) for camera in cameras})
    if mirror[0] < 0:
        notes.append(LEFT_HANDED)
    skeletons = Skeletons(skeletons.frame, skeletons.identity, skeletons.xyz * mirror, skeletons.score, skeletons.joints)
    check_upright(skeletons, str(folder / TRUTH))
    pictures = {camera.name: index_by_number(folder / camera.name) for camera in rig}
    for camera in rig:
        if pictures[camera.name]:
            check_size(next(iter(pictures[camera.name].values())), camera.lens.size)
    if not any(pictures.values()):
        notes.append("No images were found (Camera0, Camera1, ...).")
    return Published(
        SETS[len(rig)][0] if len(rig) in SETS else "tum", rig, None,
        keypoints=project_joints(rig, skeletons, str(folder / TRUTH)),
        pictures={name: tuple(found.values()) for name, found in pictures.items() if found},
        picture_frames={name: tuple(number + 1 for number in found) for name, found in pictures.items() if found},
        ground=ground_under(skeletons), notes=(*notes, PROJECTED, BETWEEN_ANKLES, NO_FRAME_RATE),
    )  # fmt: skip


def _cameras(folder: Path) -> tuple[list[PublishedCamera], list[str], str]:
    """Read the cameras; also return notes, and the file or folder of the cameras."""
    matrices = {
        int(found[1]): path
        for path in sorted((folder / "Calibration").glob("P*.txt"))
        if (found := re.fullmatch(r"P(\d+)", path.stem))
    }
    derived = [path for name in ("shelf", "campus") if (path := folder / f"calibration_{name}.json").is_file()]
    if not matrices and not derived:
        raise InputError(
            f"{folder / 'Calibration'}: no projection matrices (P0.txt, P1.txt, ...), and no calibration_shelf.json or "
            f"calibration_campus.json in {folder}: give the folder as published (Shelf, CampusSeq1)"
        )
    if not matrices:
        cameras = _derive_cameras(folder, derived[0])
        return (
            cameras,
            [f"The cameras are from {derived[0].name}, not from the set's own projection matrices."],
            str(derived[0]),
        )
    size = _size(folder, len(matrices))
    posed: list[PublishedCamera] = []
    notes: list[str] = []
    for number, path in sorted(matrices.items()):
        camera, moved = from_projection(f"Camera{number}", text_matrix(path), size, f"{path}: the matrix")
        posed.append(camera)
        notes += skew_note(camera.name, moved)
    return posed, notes, str(folder / "Calibration")


def _size(folder: Path, cameras: int) -> tuple[int, int]:
    """Return the picture size: that of a picture, or otherwise that of the set with this number of cameras."""
    for path in index_by_number(folder / "Camera0").values():
        return picture_size(path)
    if cameras not in SETS:
        raise InputError(
            f"{folder}: has {cameras} cameras, but Shelf has 5 and Campus 3, and no images in Camera0 give the image size: "
            f"add some"
        )
    return SETS[cameras][1]


def _derive_cameras(folder: Path, path: Path) -> list[PublishedCamera]:
    """Read the cameras of VoxelPose's file."""
    content = read_json(path, "a calibration (JSON)")
    if not isinstance(content, dict) or not content:
        raise InputError(f"{path}: holds no cameras: a table for each camera number is needed")
    cameras = []
    for number, table in sorted(content.items(), key=lambda item: (len(item[0]), item[0])):
        place = f"{path}: camera {number}"
        value = {
            key: numbers(entry(table, key, place), shape, f"{place}: {key}", f"{int(np.prod(shape))} numbers")
            for key, shape in (("R", (3, 3)), ("T", (3,)), ("k", (3,)), ("p", (2,)))
        }
        f_x, f_y, c_x, c_y = (
            float(numbers(entry(table, key, place), (), f"{place}: {key}", "a number")) for key in ("fx", "fy", "cx", "cy")
        )
        R = rotation(value["R"], f"{place}: R")
        try:
            lens = Lens(
                _size(folder, len(content)), np.array([[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1]]),
                np.array([*value["k"][:2], *value["p"], value["k"][2]]),
            )  # fmt: skip
        except InputError as error:
            raise InputError(f"{place}: {error}") from None
        cameras.append(PublishedCamera(f"Camera{number}", lens, R, -R @ value["T"] / 1000.0))
    return cameras


def _skeletons(path: Path) -> Skeletons:
    """Read the joints of all actors in all frames."""
    actors = np.asarray(mat_variable(path, "actor3D"))
    if actors.dtype != object or not actors.size:
        raise InputError(f"{path}: actor3D is not a cell array of actors: take the file from the set again")
    frames, people, tables = [], [], []
    lengths = set()
    for who, actor in enumerate(actors.ravel(), start=1):
        cells = np.asarray(actor, dtype=object).ravel() if np.asarray(actor).dtype == object else np.empty(0, dtype=object)
        lengths.add(len(cells))
        for index, cell in enumerate(cells):
            joints = _joints(cell, f"{path}: actor3D{{{who}}}{{{index + 1}}}")
            if joints is not None:
                frames.append(index + 1)
                people.append(who)
                tables.append(joints)
    if len(lengths) > 1:
        raise InputError(
            f"{path}: the actors of actor3D have {' and '.join(map(str, sorted(lengths)))} frames: all need the same number; "
            "take the file from the set again"
        )
    if not tables:
        raise InputError(f"{path}: actor3D has no person in any frame: take the file from the set again")
    xyz = np.stack(tables)
    return Skeletons(np.array(frames), np.array(people), xyz, np.ones(xyz.shape[:2]), JOINTS)


def _joints(cell: Any, place: str) -> Floats | None:
    """Return the joints (14, 3), metres, of one actor in one frame, or None if the cell is empty."""
    value = np.asarray(cell)
    while value.dtype == object and value.size == 1:
        value = np.asarray(value.ravel()[0])
    if value.size == 0:
        return None
    if value.dtype.kind not in "fiu" or value.shape != (len(JOINTS), 3):
        raise InputError(f"{place} has the shape {value.shape}: 14 x 3 metres are needed, or nothing where no person is seen")
    if not np.isfinite(value).all():
        row = int(np.flatnonzero(~np.isfinite(value).all(axis=1))[0])
        raise InputError(f"{place}: keypoint {row + 1} is {value[row].tolist()}: finite metres are needed, or an empty cell")
    return np.asarray(value, dtype=np.float64)


def _project_into_picture(camera: PublishedCamera, skeletons: Skeletons) -> Floats:
    """Return the joints (K, 3) whose projections are in the picture, in front of the camera or behind it."""
    points = skeletons.xyz.reshape(-1, 3)
    rays = points @ camera.A.T + camera.t
    with np.errstate(all="ignore"):
        pixels = camera.lens.project_rays(rays * np.sign(rays[:, 2:]))
        inside = ((pixels >= 0) & (pixels < np.array(camera.lens.size))).all(axis=1)
    return np.asarray(points[inside])
