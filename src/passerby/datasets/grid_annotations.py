"""Sets with annotations like those of WILDTRACK: people in the cells of a grid on the ground, and their boxes in each camera.

`annotations_positions/NUMBER.json` is a list of people: `personID`, `positionID` (the cell, counted along x first) and `views`,
one per camera with `viewNum` from 0 on, `xmin`, `ymin`, `xmax` and `ymax` in pixels, all -1 if the camera does not see the
person. The pictures are `Image_subsets/C1/NUMBER.png`, C2 and so on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.common.text import shortened
from passerby.core.observations import UNKNOWN, Boxes
from passerby.datasets.parsing import check_size, entry, index_by_number, read_json, read_whole_number, real
from passerby.datasets.published import LEFT_HANDED, GroundTruth, Published, PublishedCamera, right_handed

Corners = tuple[float, float, float, float]

ANNOTATIONS = "annotations_positions"
CALIBRATIONS = "calibrations"
PICTURES = "Image_subsets"
CORNERS = ("xmin", "ymin", "xmax", "ymax")
UNSEEN = (-1.0, -1.0, -1.0, -1.0)
TOLD = 5
"""Maximum number of places that a note names."""


@dataclass(frozen=True)
class GridLayout:
    """The differences between the sets."""

    name: str
    labels: tuple[str, ...]
    """Names of the cameras in the calibration files, in the order of `viewNum`; camera i is C(i + 1)."""
    cells: tuple[int, int]
    """Numbers of cells along x and y."""
    cell_m: float
    origin_m: tuple[float, float]
    """World position of cell 0, as published."""
    numbers_per_frame: int
    """Increase of the file number from one annotated instant to the next."""
    fps: float
    size: tuple[int, int]


@dataclass
class _Rows:
    """The content of the annotations, collected file by file."""

    frames: list[int] = field(default_factory=list)
    people: list[int] = field(default_factory=list)
    cells: list[int] = field(default_factory=list)
    corners: list[list[Corners]] = field(default_factory=list)
    """For each person, corners in each camera."""
    turned: list[str] = field(default_factory=list)
    """Places of boxes whose right or lower edge is before the left or upper one."""
    repeated: list[str] = field(default_factory=list)


def read_grid(
    folder: Path, layout: GridLayout, read_camera: Callable[[Path, str, str], PublishedCamera], notes: tuple[str, ...]
) -> Published:
    """Read a set with a layout.

    Args:
        folder: folder of the set, as published.
        layout: layout of the set.
        read_camera: reads a camera, by the folder of the calibrations, the label in its file names and the camera's name.
        notes: notes about the set that always apply.

    Raises:
        InputError: for missing, broken or contradictory files.
    """
    cameras = [read_camera(folder / CALIBRATIONS, label, f"C{number}") for number, label in enumerate(layout.labels, start=1)]
    files = index_by_number(folder / ANNOTATIONS, (".json",))
    if not files:
        raise InputError(
            f"{folder / ANNOTATIONS}: no annotations (00000000.json, ...): give the folder that holds {ANNOTATIONS}"
        )
    pictures = {camera.name: index_by_number(folder / PICTURES / camera.name) for camera in cameras}
    first, shifted = _find_first_number(layout, list(files), pictures)
    rows = _read_annotations(files, layout, first)
    ground = _ground(rows.cells, layout)
    corners = np.array(rows.corners, dtype=np.float64).reshape(-1, len(cameras), 4)
    seen = (corners != UNSEEN).any(axis=2)
    points = np.column_stack([ground, np.zeros(len(ground))])
    rig, mirror = right_handed(
        str(folder / CALIBRATIONS), cameras, {camera.name: points[seen[:, i]] for i, camera in enumerate(cameras)}
    )
    frame, identity = np.array(rows.frames, dtype=np.int64), np.array(rows.people, dtype=np.int64)
    boxes, told = {}, list(notes)
    if mirror[0] < 0:
        told.append(LEFT_HANDED)
    cut = 0
    for i, name in enumerate(rig.names):
        boxes[name], cut_here = _boxes(frame[seen[:, i]], identity[seen[:, i]], corners[seen[:, i], i], layout.size)
        cut += cut_here
    if cut:
        told.append(
            f"{cut} boxes reach beyond the image as published and were cut at its border, or left out where wholly outside."
        )
    if rows.repeated:
        told.append(f"Identities that occur twice in one time step were made unknown (-1): {_list_some(rows.repeated)}.")
    if rows.turned:
        told.append(f"Boxes that end before they begin were left out: {_list_some(rows.turned)}.")
    known = identity != UNKNOWN
    paths, counted = _pictures(pictures, layout)
    if shifted:
        told.append("Annotations are numbered from 1 and images from 0: annotation 1 was taken to be of image 0.")
    if not paths:
        told.append(f"No images were found in {PICTURES}.")
    return Published(
        layout.name, rig, layout.fps, boxes, pictures=paths, picture_frames=counted,
        ground=GroundTruth(frame[known], identity[known], (ground * mirror[:2])[known]), notes=tuple(told),
    )  # fmt: skip


def _find_first_number(
    layout: GridLayout, annotated: list[int], pictures: Mapping[str, Mapping[int, Path]]
) -> tuple[int, bool]:
    """Find the file number of the annotation of frame 1, and whether pictures count from another number.

    Annotations usually have the numbers of their pictures, from 0 on. But the scripts of MultiviewX write annotations 1 to N
    for pictures 0 to N - 1.
    """
    if layout.numbers_per_frame != 1 or min(annotated) != 1:
        return 0, False
    numbers = [number for found in pictures.values() for number in found]
    shifted = bool(numbers) and min(numbers) == 0 and max(numbers) == max(annotated) - 1
    return int(shifted or not numbers), shifted


def _frame(number: int, first: int, layout: GridLayout, path: Path) -> int:
    """Return the frame, from 1 on, for the number of a file. Raises `InputError` for a number between two instants."""
    if (number - first) % layout.numbers_per_frame:
        raise InputError(
            f"{path}: the number {number} is not a multiple of {layout.numbers_per_frame}: files of {layout.name} are numbered "
            f"in steps of {layout.numbers_per_frame}; give them as published"
        )
    return (number - first) // layout.numbers_per_frame + 1


def _read_annotations(files: Mapping[int, Path], layout: GridLayout, first: int) -> _Rows:
    """Read all people of all files. Raises `InputError` for impossible values."""
    rows = _Rows()
    for number, path in files.items():
        frame = _frame(number, first, layout, path)
        content = read_json(path, "an annotation (JSON)")
        if not isinstance(content, list):
            raise InputError(f"{path}: is not a list of people: take the file from the set again")
        start = len(rows.people)
        places: dict[int, int] = {}
        for index, person in enumerate(content):
            place = f"{path}: person {index + 1}"
            who = read_whole_number(entry(person, "personID", place), f"{place}: personID")
            cell = read_whole_number(entry(person, "positionID", place), f"{place}: positionID")
            if cell >= layout.cells[0] * layout.cells[1]:
                raise InputError(
                    f"{place}: positionID is {cell}, but the grid of {layout.name} has {layout.cells[0]} x {layout.cells[1]} "
                    "cells, counted from 0: is this another set?"
                )
            views, turned = _views(entry(person, "views", place), len(layout.labels), place)
            rows.corners.append(views)
            rows.turned += [f"{path.name}, person {who}, viewNum {view}" for view in turned]
            if who in places:
                rows.repeated.append(f"{who} in {path.name}")
                rows.people[places[who]], who = UNKNOWN, UNKNOWN
            else:
                places[who] = start + index
            rows.frames.append(frame)
            rows.people.append(who)
            rows.cells.append(cell)
    if not rows.people:
        raise InputError(f"{next(iter(files.values())).parent}: no person is annotated: take the files from the set again")
    return rows


def _views(views: object, cameras: int, place: str) -> tuple[list[Corners], list[int]]:
    """Return the corners in each camera, and the cameras with reversed edges; a camera that is not listed sees no person."""
    if not isinstance(views, list):
        raise InputError(f"{place}: views is {shortened(views)}: a list with one entry per camera is needed")
    found: list[Corners | None] = [None] * cameras
    turned = []
    for view in views:
        number = read_whole_number(entry(view, "viewNum", f"{place}: views"), f"{place}: viewNum")
        if number >= cameras:
            raise InputError(
                f"{place}: viewNum is {number}, but there are {cameras} cameras, counted from 0: is this another set?"
            )
        here = f"{place}: viewNum {number}"
        if found[number] is not None:
            raise InputError(f"{here}: occurs twice: delete one of the two")
        left, top, right, bottom = (real(entry(view, key, here), f"{here}: {key}") for key in CORNERS)
        found[number] = (left, top, right, bottom)
        if right < left or bottom < top:
            turned.append(number)
            found[number] = UNSEEN
    return [UNSEEN if corners is None else corners for corners in found], turned


def _list_some(places: list[str]) -> str:
    """Return the text of the first places of a list, and of the number of further ones."""
    more = f" and {len(places) - TOLD} more" if len(places) > TOLD else ""
    return f"{'; '.join(places[:TOLD])}{more}"


def _ground(cells: list[int], layout: GridLayout) -> Floats:
    """Return the positions (N, 2) of cells in the published world, metres."""
    cell = np.array(cells, dtype=np.int64)
    steps = np.column_stack([cell % layout.cells[0], cell // layout.cells[0]])
    return np.asarray(np.array(layout.origin_m) + layout.cell_m * steps)


def _boxes(frame: Ints, identity: Ints, corners: Floats, size: tuple[int, int]) -> tuple[Boxes, int]:
    """Cut the boxes at the picture's border; also return the number of boxes that were cut or left out."""
    low, high = np.maximum(corners[:, :2], 0), np.minimum(corners[:, 2:], size)
    inside = (high > low).all(axis=1)
    changed = int(np.count_nonzero(~inside | (np.hstack([low, high]) != corners).any(axis=1)))
    ltwh = np.hstack([low, high - low])[inside]
    return Boxes(frame[inside], identity[inside], ltwh, np.ones(len(ltwh))), changed


def _pictures(
    pictures: Mapping[str, Mapping[int, Path]], layout: GridLayout
) -> tuple[dict[str, tuple[Path, ...]], dict[str, tuple[int, ...]]]:
    """Return the pictures of the cameras that have any, and their frames; the size of one picture per camera is checked."""
    paths, counted = {}, {}
    for name, found in pictures.items():
        if found:
            check_size(next(iter(found.values())), layout.size)
            paths[name] = tuple(found.values())
            counted[name] = tuple(_frame(number, 0, layout, path) for number, path in found.items())
    return paths, counted
