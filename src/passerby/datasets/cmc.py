"""CMC: five sequences of people in one room with four cameras (Ong et al., IEEE TPAMI 2020).

Published at https://github.com/researchwork888/Multi-view-3D-multi-object-tracking-dataset. Its README gives 1920 x 1024
pixels, 4 frames per second and a room of 7.67 x 3.41 x 2.7 m. For a sequence, for example CMC1, this module reads the same
files as the set's own scripts (`release/gen_truth.m`, `gen_meas.m`, `gen_model.m`): the folder `CMC1` with `Cam_1/*.png` to
`Cam_4` in the order of their names, `GT_CMC1_WORLD_CENTROID.txt` (frame, identity, five times -1, centroid and half extents in
metres, world z up), and the 3 x 4 projection matrices `cam1_cam_mat.mat`, which are in the folder of the scripts; for CMC5,
those of cameras 3 and 4 are `cam3_cam_mat__.mat` and `cam4_cam_mat__.mat`. The boxes are in `GT_CMC1_Cam1.txt` (frame,
identity, left, top, width, height, ...: see `detection/fairmot/cmc/gen_labels_cmc.py` of
https://github.com/linh-gist/3D-Visual-MOT; the README spells `Cam_1`).

The matrices are searched for in the sequence's folder, the one above it, and `release` or `cmc` there; a text file of the same
name (.txt, three rows of four numbers) is read too. The layout is known from those scripts and that README; of the files
themselves only centroids were available. Therefore the set is rejected if the centroids do not lie on the boxes.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.core.cameras import Camera
from passerby.core.observations import UNKNOWN, Boxes
from passerby.datasets.parsing import check_size, index_by_number, mat_matrix, numbers, text_matrix
from passerby.datasets.published import (
    LEFT_HANDED,
    GroundTruth,
    Published,
    PublishedCamera,
    from_projection,
    right_handed,
    skew_note,
)
from passerby.interchange.storage.safe_parsing import read_text

CAMERAS = (1, 2, 3, 4)
SIZE = (1920, 1024)
FPS = 4.0
RECALIBRATED = {("CMC5", 3), ("CMC5", 4)}
"""(sequence, camera) with a separate matrix."""
WITHIN = 1.5
"""A centroid counts as on its box if it is within the box enlarged by this factor."""
LEAST_WITHIN = 0.5
"""Minimum share of a camera's centroids on their boxes; calibrations of another recording give a far smaller one."""
BOX_COLUMNS, WORLD_COLUMNS = (6, 10), (10, 13)


def read(folder: Path) -> Published:
    """Read one sequence, for example the folder CMC1. Raises `InputError` for missing, broken or contradictory files."""
    world_path, sequence = _world_file(folder)
    world = _table(world_path, WORLD_COLUMNS, "frame, identity, five times -1, x, y, z and half extents")
    world = world[world[:, 1] != UNKNOWN]
    _check_once(world, world_path)
    centroid = dict(zip(map(tuple, world[:, :2].astype(int).tolist()), world[:, 7:10], strict=True))
    boxes = {f"Cam_{number}": _boxes(_box_file(folder, sequence, number)) for number in CAMERAS}
    cameras, notes = _cameras(folder, sequence)
    seen = {name: _centroids(of, centroid)[1] for name, of in boxes.items()}
    rig, mirror = right_handed(str(folder), cameras, seen)
    if mirror[0] < 0:
        notes.append(LEFT_HANDED)
    for camera in rig:
        rows, points = _centroids(boxes[camera.name], centroid)
        _check_fit(camera, boxes[camera.name].take(rows), points * mirror, folder)
    pictures = {name: index_by_number(folder / name) for name in boxes}
    for found in pictures.values():
        if found:
            check_size(next(iter(found.values())), SIZE)
    ground = GroundTruth(world[:, 0], world[:, 1], world[:, 7:9] * mirror[:2])
    notes.append("Ground positions are below the centroids, whether people stand or have fallen.")
    return Published(
        sequence.lower(), rig, FPS, boxes, ground=ground,
        pictures={name: tuple(found.values()) for name, found in pictures.items() if found}, notes=tuple(notes),
    )  # fmt: skip


def _world_file(folder: Path) -> tuple[Path, str]:
    """Find the file of the centroids, and the name of the sequence."""
    found = [path for path in sorted(folder.glob("GT_*.txt")) if re.fullmatch(r"GT_.+_WORLD_CENTROID", path.stem)]
    if len(found) != 1:
        what = f"{found[0].name} and {found[1].name}" if found else "no GT_CMC1_WORLD_CENTROID.txt or the like"
        raise InputError(f"{folder}: has {what}: give the folder of one sequence, with its ground truth")
    return found[0], found[0].stem.removeprefix("GT_").removesuffix("_WORLD_CENTROID")


def _box_file(folder: Path, sequence: str, number: int) -> Path:
    """Return the file of a camera's boxes, in one of the two spellings."""
    spelled = [folder / f"GT_{sequence}_Cam{number}.txt", folder / f"GT_{sequence}_Cam_{number}.txt"]
    return next((path for path in spelled if path.is_file()), spelled[0])


def _table(path: Path, columns: tuple[int, int], meaning: str) -> Floats:
    """Read the numbers (N, `columns[0]` or more) of a text file, separated by spaces or commas; sort by frame and identity."""
    rows: list[Floats] = []
    width = 0
    for number, line in enumerate(read_text(path, f"a text file of rows ({meaning})").splitlines(), start=1):
        words = line.replace(",", " ").split()
        if not words:
            continue
        place = f"{path}: line {number}"
        width = width or len(words)
        if not columns[0] <= len(words) <= columns[1] or len(words) != width:
            raise InputError(
                f"{place}: has {len(words)} columns: {columns[0]} to {columns[1]}, as in all rows, are needed ({meaning})"
            )
        try:
            values: list[Any] = [float(word) for word in words]
        except ValueError:
            values = words
        row = numbers(values, (width,), place, "numbers")
        if (row[:2] != np.floor(row[:2])).any() or row[0] < 1 or row[1] < UNKNOWN:
            raise InputError(
                f"{place}: frame and identity are {words[0]} and {words[1]}: whole numbers are needed, frames from 1 on"
            )
        rows.append(row)
    if not rows:
        raise InputError(f"{path}: is empty: take the file from the set again")
    table = np.stack(rows)
    return np.asarray(table[np.lexsort((table[:, 1], table[:, 0]))])


def _check_once(table: Floats, path: Path) -> None:
    """Check that no person is twice in a frame. Raises `InputError` otherwise."""
    keys, counts = np.unique(table[:, :2], axis=0, return_counts=True)
    if (counts > 1).any():
        frame, who = keys[counts > 1][0].astype(int)
        raise InputError(f"{path}: identity {who} occurs twice in frame {frame}: delete one of the two rows")


def _boxes(path: Path) -> Boxes:
    """Read the boxes of one camera."""
    table = _table(path, BOX_COLUMNS, "frame, identity, left, top, width, height")
    _check_once(table[table[:, 1] != UNKNOWN], path)
    flat = np.flatnonzero((table[:, 4:6] <= 0).any(axis=1))
    if len(flat):
        frame, who = table[flat[0], :2].astype(int)
        raise InputError(
            f"{path}: the box of identity {who} in frame {frame} is {table[flat[0], 4]:g} x {table[flat[0], 5]:g} px: width "
            "and height must be above 0; delete the row"
        )
    return Boxes(table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2:6], np.ones(len(table)))


def _cameras(folder: Path, sequence: str) -> tuple[list[PublishedCamera], list[str]]:
    """Read the cameras from their projection matrices; also return notes."""
    cameras: list[PublishedCamera] = []
    notes: list[str] = []
    for number in CAMERAS:
        key = f"cam{number}_cam_mat" + ("__" if (sequence, number) in RECALIBRATED else "")
        places = (folder, folder.parent, folder.parent / "release", folder.parent / "cmc")
        candidates = [place / f"{key}{suffix}" for place in places for suffix in (".txt", ".mat")]
        path = next((candidate for candidate in candidates if candidate.is_file()), None)
        if path is None:
            raise InputError(
                f"{folder / key}.mat: no such file, and none in {folder.parent}, or release or cmc there: camera {number} "
                "needs its projection matrix, which lies with the scripts of the set; copy it here"
            )
        matrix = text_matrix(path) if path.suffix == ".txt" else mat_matrix(path, key, (3, 4))
        camera, moved = from_projection(f"Cam_{number}", matrix, SIZE, f"{path}: the matrix")
        cameras.append(camera)
        notes += skew_note(camera.name, moved)
    return cameras, notes


def _centroids(boxes: Boxes, centroid: dict[tuple[int, ...], Floats]) -> tuple[Ints, Floats]:
    """Find the rows (K,) of the boxes whose people have a centroid, and these centroids (K, 3), published world, metres."""
    keys = list(zip(boxes.frame.tolist(), boxes.identity.tolist(), strict=True))
    rows = [row for row, key in enumerate(keys) if key in centroid]
    return np.array(rows, dtype=np.int64), np.array([centroid[keys[row]] for row in rows]).reshape(-1, 3)


def _check_fit(camera: Camera, boxes: Boxes, points: Floats, folder: Path) -> None:
    """Check that a camera sees the centroids in its boxes. Raises `InputError` if calibration and boxes are contradictory."""
    if not len(boxes):
        raise InputError(
            f"{folder}: no box of camera {camera.name} is of a person in the ground truth: the files do not belong together"
        )
    middle = boxes.ltwh[:, :2] + boxes.ltwh[:, 2:] / 2
    with np.errstate(invalid="ignore"):
        within = (np.abs(camera.project(points) - middle) <= WITHIN * boxes.ltwh[:, 2:] / 2).all(axis=1)
    share = float(within.mean())
    if share < LEAST_WITHIN:
        raise InputError(
            f"{folder}: camera {camera.name} sees {share:.0%} of the centroids on the boxes of the same people: its "
            "projection matrix is of another recording (cameras 3 and 4 of CMC5 have their own); copy the right one here"
        )
