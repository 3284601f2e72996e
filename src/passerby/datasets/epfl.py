"""EPFL's multi-camera pedestrian videos (CVLAB): Terrace, Basketball, Laboratory, Campus, Passageway.

A folder holds one sequence. Its files, as published, are in the folder or in folders below it:

- `SEQUENCE-cN.avi` (terrace1-c0.avi, match5-c0.avi, 6p-c0.avi, campus4-c0.avi, ...): 25 frames per second, 360 x 288
- `*-cN.xml`: Tsai's calibration, for pictures of 720 x 576; Terrace has it. Other sequences publish only homographies of the
  ground and of head height (calibration-*.txt). These give neither a lens nor a pose: such a sequence needs lenses from another
  source, as `intrinsics.toml` in the folder, and has no true poses.
- `gt_SEQUENCE.txt`: "1"; then `frames people columns rows step first last`; then one row per frame with a number for each
  person: the cell of a grid on the ground, counted row by row; -1 if it was not annotated; -2 if the person is outside. Every
  `step`th frame was annotated.
- `SEQUENCE-cN.txt`: boxes in each view in VATIC's format, with the same identities in all views, annotated by Xu et al.
  ("Multi-view People Tracking via Hierarchical Trajectory Composition", CVPR 2016).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from passerby.common.errors import InputError
from passerby.common.text import shortened
from passerby.core.cameras import Camera, Rig
from passerby.core.observations import Boxes
from passerby.datasets.annotations import match_identities, read_vatic
from passerby.datasets.published import GroundTruth, Published
from passerby.interchange.formats.tsai import is_tsai, read_tsai
from passerby.interchange.rig_toml import read_lens
from passerby.interchange.storage.safe_parsing import read_text
from passerby.perception.video_probe import VideoInfo, probe

VIDEO_ENDINGS = (".avi", ".mp4", ".mkv", ".mov", ".mpg")
OWN_LENSES = "intrinsics.toml"

_VIDEO = re.compile(r"(?P<sequence>.+)-c(?P<number>\d+)")
_NUMBER = re.compile(r"c(\d+)$")


LARGEST = 2**31
"""Largest absolute value of the numbers in a file of positions."""


@dataclass(frozen=True)
class Area:
    """The rectangle of a sequence's grid, in the world of its Tsai calibration, metres."""

    x: float
    y: float
    width: float
    depth: float


AREAS = {"terrace": Area(-0.5, -1.5, 7.5, 11.0)}
"""Beginning of the sequence's name -> area. For other sequences the grid's size in metres is not published."""


@dataclass(frozen=True)
class Header:
    """The second line of a file of ground truth."""

    frames: int
    people: int
    columns: int
    rows: int
    step: int
    first: int
    last: int


def read(folder: Path) -> Published:
    """Read one sequence.

    Raises:
        InputError: no videos or videos of several sequences, no calibration with lenses, or a broken file.
    """
    sequence, videos = _videos(folder)
    infos = {number: probe(path) for number, path in videos.items()}
    cameras, notes = _cameras(folder, sequence, infos)
    ground, more = _ground(folder, sequence)
    boxes = _boxes(folder, sequence, videos)
    if not boxes:
        more.append(f"No boxes are given in the views ({sequence}-cN.txt): people have to be detected in the videos.")
    rig = Rig(tuple(cameras))
    if ground is not None:
        ground, who = match_identities(boxes, rig, ground)
        more += who
    rates = {round(info.average_fps, 3) for info in infos.values()}
    if len(rates) > 1:
        more.append(
            f"The videos say they have {', '.join(map(str, sorted(rates)))} frames per second; the first one's is taken."
        )
    return Published(
        name=sequence,
        rig=rig,
        fps=next(iter(infos.values())).average_fps,
        boxes=boxes,
        videos={f"c{number}": path for number, path in videos.items()},
        ground=ground,
        notes=(*notes, *more),
    )


def _videos(folder: Path) -> tuple[str, dict[int, Path]]:
    """Find the name of the sequence, and its videos by camera number."""
    found: dict[str, dict[int, Path]] = {}
    for path in sorted(folder.rglob("*")):
        match = _VIDEO.fullmatch(path.stem)
        if match and path.suffix.lower() in VIDEO_ENDINGS and path.is_file():
            cameras = found.setdefault(match["sequence"], {})
            number = int(match["number"])
            if number in cameras:
                raise InputError(f"{path}: a second video of camera c{number} beside {cameras[number]}: remove one of them")
            cameras[number] = path
    if not found:
        raise InputError(f"{folder}: holds no videos SEQUENCE-cN.avi (as terrace1-c0.avi): put those of one sequence there")
    if len(found) > 1:
        raise InputError(f"{folder}: holds the sequences {', '.join(sorted(found))}: give each a folder of its own")
    sequence, cameras = next(iter(found.items()))
    if len(cameras) < 2:
        raise InputError(f"{folder}: holds one video of {sequence}: a calibration needs two cameras or more")
    return sequence, dict(sorted(cameras.items()))


def _cameras(folder: Path, sequence: str, infos: dict[int, VideoInfo]) -> tuple[list[Camera], list[str]]:
    """Read cameras with poses from Tsai's files, or with the user's lenses and without poses; also return notes."""
    tsai: dict[int, Path] = {}
    for path in sorted(folder.rglob("*.xml")):
        match = _NUMBER.search(path.stem)
        if match and is_tsai(path):
            number = int(match[1])
            if number in tsai:
                raise InputError(f"{path}: a second calibration of camera c{number} beside {tsai[number]}: remove one")
            tsai[number] = path
    if tsai:
        missing = [f"c{number}" for number in infos if number not in tsai]
        if missing:
            raise InputError(
                f"{folder}: no calibration *-{missing[0]}.xml for the video {infos[int(missing[0][1:])].path.name}: put it "
                f"there, or remove the video"
            )
        return [read_tsai(tsai[number]).camera(f"c{number}", info.size) for number, info in infos.items()], []
    own = folder / OWN_LENSES
    if own.is_file():
        lenses = [Camera(f"c{number}", read_lens(own, f"c{number}")) for number in infos]
        return lenses, [
            f"The lenses are those of {own}; the sequence gives no true poses, so there is no truth to compare with."
        ]
    plain = sorted(folder.rglob("calibration*.txt"))
    told = (
        f"{plain[0]} has homographies of planes, which contain no intrinsics"
        if plain
        else "there is no *-cN.xml of Tsai's calibration"
    )
    raise InputError(
        f"{folder}: {told}: Terrace publishes terrace-tsai-cN.xml; for {sequence}, calibrate the intrinsics yourself and put "
        f"them there as {OWN_LENSES} with the tables {', '.join(f'[c{number}]' for number in infos)}"
    )


def _boxes(folder: Path, sequence: str, videos: dict[int, Path]) -> dict[str, Boxes]:
    """Read the boxes by camera from VATIC's files; a camera without a file is left out."""
    boxes: dict[str, Boxes] = {}
    for number in videos:
        files = sorted(folder.rglob(f"{sequence}-c{number}.txt"))
        if len(files) > 1:
            raise InputError(f"{files[1]}: a second file of boxes beside {files[0]}: remove one of them")
        if files:
            boxes[f"c{number}"] = read_vatic(files[0])
    return boxes


def _ground(folder: Path, sequence: str) -> tuple[GroundTruth | None, list[str]]:
    """Read the positions of people in metres, None if they are unknown; also return notes."""
    files = [path for path in sorted(folder.rglob("gt_*.txt")) if sequence in path.stem.split("_")]
    if not files:
        return None, [f"No positions are given (gt_{sequence}.txt): trajectories cannot be compared."]
    if len(files) > 1:
        raise InputError(f"{files[1]}: a second file of positions beside {files[0]}: remove one of them")
    header, cells = read_grid(files[0])
    area = next((area for name, area in AREAS.items() if sequence.startswith(name)), None)
    if area is None:
        return None, [f"The size of the grid of {files[0].name} in metres is unknown: its positions are left out."]
    wide, deep = area.width / header.columns, area.depth / header.rows
    annotated = np.zeros(len(cells), dtype=bool)
    annotated[header.first : header.last + 1 : header.step] = True
    frame, identity = np.nonzero((cells >= 0) & annotated[:, None])
    cell = cells[frame, identity]
    xy = np.column_stack(
        [area.x + (cell % header.columns + 0.5) * wide, area.y + (cell // header.columns + 0.5) * deep],
    )
    note = f"Positions are given for every {header.step}th frame, as cells of {100 * wide:.0f} x {100 * deep:.0f} cm."
    return GroundTruth(frame + 1, identity, xy), [note]


def read_grid(path: Path) -> tuple[Header, np.ndarray[tuple[int, ...], np.dtype[np.int64]]]:
    """Read a file of positions.

    Returns:
        The header, and numbers (frames, people) of cells; -1 if unknown, -2 if outside.

    Raises:
        InputError: another kind of file, another number of frames or people than in the header, a cell outside the grid.
    """
    lines = [(n, line.split()) for n, line in enumerate(read_text(path, "positions on a grid").splitlines(), 1) if line.strip()]
    if len(lines) < 2 or len(lines[1][1]) != 7:
        raise InputError(f"{path}: line 2 must be `frames people columns rows step first last`: is it EPFL's ground truth?")
    header = Header(*_read_integers(path, *lines[1]))
    if min(header.frames, header.people, header.columns, header.rows, header.step) < 1 or not 0 <= header.first <= header.last:
        raise InputError(
            f"{path}: line 2 is {shortened(' '.join(lines[1][1]))}: frames, people, columns, rows and step must be above 0"
        )
    if len(lines) - 2 != header.frames:
        raise InputError(f"{path}: {len(lines) - 2} rows of positions, but line 2 says {header.frames}: fetch the file again")
    cells = np.zeros((header.frames, header.people), dtype=np.int64)
    for row, (number, fields) in enumerate(lines[2:]):
        if len(fields) != header.people:
            raise InputError(f"{path}: line {number}: {len(fields)} numbers, but line 2 says {header.people} people")
        cells[row] = _read_integers(path, number, fields)
        if not ((cells[row] >= -2) & (cells[row] < header.columns * header.rows)).all():
            raise InputError(
                f"{path}: line {number}: {shortened(' '.join(fields))}: cells are 0 to {header.columns * header.rows - 1}, "
                "or -1 or -2"
            )
    return header, cells


def _read_integers(path: Path, number: int, fields: list[str]) -> list[int]:
    """Convert the fields of a line to whole numbers. Raises `InputError` for any other field."""
    try:
        found = [int(field) for field in fields]
    except ValueError:
        found = [LARGEST + 1]
    if max(map(abs, found), default=0) > LARGEST:
        raise InputError(f"{path}: line {number}: {shortened(' '.join(fields))}: whole numbers are needed") from None
    return found
