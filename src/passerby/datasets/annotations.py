"""Annotated boxes in the formats of several data sets, and the matching of two annotations of the same people.

The formats count frames from 0 or 1; here the first picture is frame 1. Identities are those of the annotation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.common.text import shortened
from passerby.core.cameras import Camera, Rig
from passerby.core.observations import UNKNOWN, Boxes
from passerby.datasets.published import GroundTruth
from passerby.interchange.storage.safe_parsing import NotParsed, parse_xml, read_text

LARGEST = 2.0**53
"""Above it, float64 cannot represent all whole numbers."""
VATIC_COLUMNS = "track_id xmin ymin xmax ymax frame lost occluded generated label"
Row = tuple[int, int, float, float, float, float]
"""frame, identity, left, top, width, height."""
FARTHEST_M = 0.6
"""Maximum median distance between the foot points of a person's boxes and the person's positions: half a shoulder width, half
a cell of EPFL's grid (0.13 m), and some pixels at the far end. Different people are metres apart."""
LEAST_SIGHTINGS = 3


def read_vatic(path: Path, first_frame: int = 0) -> Boxes:
    """Read VATIC's text: `track_id xmin ymin xmax ymax frame lost occluded generated "label"`.

    Lost boxes (outside the view) are left out; partly hidden boxes are kept.

    Args:
        path: the file of one camera.
        first_frame: the number of the first picture in the file.

    Raises:
        InputError: the file is missing, or a row has another format.
    """
    rows: list[Row] = []
    for number, line in enumerate(read_text(path, "boxes as VATIC writes them").splitlines(), start=1):
        if not line.strip():
            continue
        place = f"{path}: line {number}"
        fields = line.split()
        if len(fields) < 9:
            raise InputError(f"{place}: {len(fields)} columns: {VATIC_COLUMNS} are needed")
        track, left, top, right, bottom, frame, lost = (_number(place, text) for text in fields[:7])
        if lost:
            continue
        rows.append((round(frame) - first_frame + 1, round(track), left, top, right - left, bottom - top))
        _check_row(place, rows[-1])
    return _boxes(path, rows)


def read_cvml(path: Path) -> Boxes:
    """Read CVML: `<dataset><frame number><objectlist><object id><box xc yc w h/></object></objectlist></frame></dataset>`.

    Frames count from 0; xc, yc is the box's centre. Raises `InputError` for a missing file, one that is not XML, or another
    kind of XML.
    """
    try:
        root = parse_xml(read_text(path, "boxes in CVML (XML)"))
    except NotParsed as error:
        raise InputError(f"{path}: is not XML: {error}: fetch the file again") from None
    frames = root.findall(".//frame")
    if not frames:
        raise InputError(f"{path}: holds no <frame>: annotated boxes in CVML are needed here")
    rows: list[Row] = []
    for frame in frames:
        place = f'{path}: <frame number="{str(frame.get("number"))[:20]}">'
        number = round(_number(place, frame.get("number")))
        for person in frame.iterfind("objectlist/object"):
            box = person.find("box")
            if box is None:
                raise InputError(f'{place}: <object id="{str(person.get("id"))[:20]}"> has no <box>')
            x, y, width, height = (_number(f"{place} <box> {key}", box.get(key)) for key in ("xc", "yc", "w", "h"))
            identity = round(_number(f"{place} <object> id", person.get("id")))
            rows.append((number + 1, identity, x - width / 2, y - height / 2, width, height))
            _check_row(place, rows[-1])
    return _boxes(path, rows)


def read_mot_truth(path: Path) -> tuple[Boxes, GroundTruth | None]:
    """Read MOTChallenge's `gt.txt`: `frame, id, left, top, width, height, flag[, x, y, z]`, in any order of rows.

    Returns:
        The boxes, without those flagged 0, and the positions on the ground in columns 8 and 9 (metres, as in the 3D benchmark
        of 2015); None if there are none.

    Raises:
        InputError: the file is missing, or a row has another format.
    """
    rows: list[Row] = []
    places: list[tuple[float, float]] = []
    for number, line in enumerate(read_text(path, "MOTChallenge's ground truth").splitlines(), start=1):
        if not line.strip():
            continue
        place = f"{path}: line {number}"
        fields = line.split(",")
        if len(fields) < 7:
            raise InputError(f"{place}: {len(fields)} columns: frame, id, left, top, width, height, flag are needed")
        values = [_number(place, text) for text in fields[:10]]
        if values[6] == 0:
            continue
        rows.append((round(values[0]), round(values[1]), values[2], values[3], values[4], values[5]))
        places.append((values[7], values[8]) if len(values) >= 9 else (-1.0, -1.0))
    positions = np.array(places).reshape(-1, 2)
    known = (positions != -1).any(axis=1)
    who = np.array([row[:2] for row in rows], dtype=np.int64).reshape(-1, 2)
    ground = GroundTruth(who[known, 0], who[known, 1], positions[known]) if known.any() else None
    drawn = [row for row in rows if row[2:] != (-1.0, -1.0, -1.0, -1.0)]  # the 3D benchmark hides some boxes
    for row in drawn:
        _check_row(f"{path}: frame {row[0]}", row)
    return _boxes(path, drawn), ground


def _number(place: str, text: str | None) -> float:
    """Convert a text to a finite number. Raises `InputError` for any other text."""
    try:
        number = float("nan" if text is None else text)
    except ValueError:
        number = math.nan
    if not abs(number) <= LARGEST:
        raise InputError(f"{place}: {shortened(text)} is not a finite number: is the file whole, and of this kind?")
    return number


def _check_row(place: str, row: Row) -> None:
    frame, identity, _, _, width, height = row
    if frame < 1:
        raise InputError(f"{place}: its frame would be number {frame}: frames before the first image cannot be used")
    if identity < 0:
        raise InputError(f"{place}: identity {identity}: a number from 0 on is needed")
    if min(width, height) <= 0:
        raise InputError(f"{place}: a box {width:g} wide and {height:g} high: both must be above 0; delete the row")


def _boxes(path: Path, rows: list[Row]) -> Boxes:
    """Return the boxes, sorted by frame and identity. Raises `InputError` for an identity twice in a frame."""
    if not rows:
        return Boxes.empty()
    rows = sorted(rows)
    for one, other in pairwise(rows):
        if one[:2] == other[:2]:
            raise InputError(f"{path}: identity {one[1]} has two boxes in frame {one[0]} (the first image is 1): delete one")
    table = np.array(rows)
    return Boxes(table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2:6], np.ones(len(table)))


def match_identities(boxes: Mapping[str, Boxes], rig: Rig, ground: GroundTruth) -> tuple[GroundTruth, tuple[str, ...]]:
    """Give the positions the identities of the boxes; also return notes.

    Boxes and positions are compared by the true poses: the middle of a box's lower edge is assumed to be on the ground. A
    person without boxes gets a number above all identities of the boxes.

    Args:
        boxes: camera -> boxes with true identities.
        rig: poses of these cameras, metres.
        ground: positions, with identities that do not depend on those of the boxes.
    """
    feet = [_feet(rig[camera], seen) for camera, seen in boxes.items() if rig[camera].pose is not None and len(seen)]
    if not feet or not len(ground):
        return ground, ()
    frame, who = (np.concatenate([part[column] for part in feet]) for column in (0, 1))
    xy = np.concatenate([part[2] for part in feet])
    ours, theirs = np.unique(who[who > UNKNOWN]), np.unique(ground.identity)
    if not len(ours):
        return ground, ()
    apart = np.array([[_distance(frame, who, xy, one, ground, other) for one in ours] for other in theirs])
    rows, columns = linear_sum_assignment(np.where(np.isfinite(apart), apart, 1e6))
    pairs = [pair for pair in zip(rows.tolist(), columns.tolist(), strict=True) if apart[pair] < FARTHEST_M]
    same = {int(theirs[row]): int(ours[column]) for row, column in pairs}
    strangers = [int(identity) for identity in theirs if int(identity) not in same]
    names = same | {identity: int(ours.max()) + number for number, identity in enumerate(strangers, start=1)}
    identity = np.array([names[int(one)] for one in ground.identity], dtype=np.int64)
    note = f"Of {len(theirs)} people with positions, {len(same)} were found among those with boxes, and have their numbers."
    return GroundTruth(ground.frame, identity, ground.xy), (note,)


def _feet(camera: Camera, boxes: Boxes) -> tuple[Ints, Ints, Floats]:
    """Compute frame, identity and place on the ground (N, 2) of a camera's boxes."""
    assert camera.pose is not None
    pixels = boxes.ltwh[:, :2] + boxes.ltwh[:, 2:] * (0.5, 1.0)
    rays = camera.lens.bearings(pixels) @ camera.pose.R_cw
    with np.errstate(divide="ignore", invalid="ignore"):
        xy = camera.centre[:2] - rays[:, :2] * (camera.centre[2] / rays[:, 2:])
    down = rays[:, 2] < 0
    return boxes.frame[down], boxes.identity[down], xy[down]


def _distance(frame: Ints, who: Ints, xy: Floats, one: int, ground: GroundTruth, other: int) -> float:
    """Compute the median distance of foot points from positions, metres; infinite below `LEAST_SIGHTINGS` common frames."""
    there = ground.identity == other
    place = dict(zip(ground.frame[there].tolist(), ground.xy[there], strict=True))
    rows = [row for row in np.flatnonzero(who == one).tolist() if int(frame[row]) in place]
    if len(rows) < LEAST_SIGHTINGS:
        return float("inf")
    return float(np.median(np.linalg.norm(xy[rows] - np.array([place[int(frame[row])] for row in rows]), axis=1)))
