"""PETS 2009: up to eight cameras, pictures at about 7 frames per second, Tsai's calibration.

The files as published, in one folder or in folders below it:

- `View_001/frame_0000.jpg` ... (one recording: one `Time_...` folder), or `View_001.avi`
- `View_001.xml` ...: Tsai's calibration, millimetres, the ground at z = 0
- annotated boxes, any of: `PETS2009-S2L1.xml` (CVML, of View_001; of another view if its name has View_00N), `View_00N.txt`
  (VATIC, the same identities in all views, by Xu et al., CVPR 2016), `gt/gt.txt` (MOTChallenge, of View_001; that of the 3D
  benchmark also has positions on the ground)
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import cv2

from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.core.observations import Boxes
from passerby.datasets.annotations import match_identities, read_cvml, read_mot_truth, read_vatic
from passerby.datasets.published import GroundTruth, Published
from passerby.interchange.formats.tsai import TsaiCamera, is_tsai, read_tsai
from passerby.perception.video_probe import probe

FPS = 7.0
"""Frame rate by the set's page; the pictures have no times."""
ANNOTATED_VIEW = "View_001"
"""View of the annotations that name no view."""
UNSTEADY_VIEW = "View_004"
PICTURE_ENDINGS = (".jpg", ".jpeg", ".png")
VIDEO_ENDINGS = (".avi", ".mp4", ".mkv", ".mov", ".mpg")

_VIEW = re.compile(r"view[ _-]?0*(\d+)", re.IGNORECASE)
_FRAME = re.compile(r"frame_(\d+)")


def read(folder: Path) -> Published:
    """Read one recording.

    Raises:
        InputError: no calibration, neither pictures nor videos nor boxes, several recordings, or a broken file.
    """
    tsai = _calibrations(folder)
    pictures = {view: files for view, files in _pictures(folder).items() if view in tsai}
    videos = {view: path for view, path in _videos(folder).items() if view in tsai and view not in pictures}
    boxes, ground = _annotations(folder, tsai)
    if not pictures and not videos and not boxes:
        raise InputError(f"{folder}: holds no View_00N/frame_NNNN.jpg, View_00N.avi or boxes of the cameras {', '.join(tsai)}")
    sizes = {view: _size_of(files[min(files)]) for view, files in pictures.items()}
    sizes |= {view: probe(path).size for view, path in videos.items()}
    rig = Rig(tuple(camera.camera(view, sizes.get(view)) for view, camera in tsai.items()))
    who: tuple[str, ...] = ()
    if ground is not None:
        ground, who = match_identities(boxes, rig, ground)
    notes = [f"{view} has only a calibration." for view in tsai if view not in sizes and view not in boxes]
    if UNSTEADY_VIEW in tsai:
        notes.append(f"The set's page warns of slight delays and lost frames, most of all in {UNSTEADY_VIEW}.")
    if len(boxes) == 1:
        notes.append(
            f"Boxes are annotated only in {next(iter(boxes))}: people in the other views have to be detected in images."
        )
    if ground is None:
        notes.append("No positions on the ground are given (MOTChallenge's 3D gt.txt): trajectories cannot be compared.")
    return Published(
        name="pets2009",
        rig=rig,
        fps=FPS,
        boxes=boxes,
        videos=videos,
        pictures={view: tuple(files[number] for number in sorted(files)) for view, files in pictures.items()},
        picture_frames={view: tuple(number + 1 for number in sorted(files)) for view, files in pictures.items()},
        ground=ground,
        notes=(*notes, *who),
    )


def _index_by_view(paths: Iterable[Path], what: str) -> dict[str, Path]:
    """Return paths by view; the name of a path is that of its view. Raises `InputError` for two paths of one view."""
    found: dict[str, Path] = {}
    for path in sorted(paths):
        view = _view(_VIEW.fullmatch(path.stem))
        if view is None:
            continue
        if view in found:
            raise InputError(f"{path}: a second {what} of {view} beside {found[view]}: give the folder of one recording alone")
        found[view] = path
    return found


def _view(match: re.Match[str] | None) -> str | None:
    """Return the name of a view as View_001, for spellings such as View_001 and view-1; None without a match."""
    return f"View_{int(match[1]):03}" if match else None


def _calibrations(folder: Path) -> dict[str, TsaiCamera]:
    files = _index_by_view((path for path in folder.rglob("*.xml") if is_tsai(path)), "calibration")
    if len(files) < 2:
        raise InputError(
            f"{folder}: holds {len(files) or 'no'} calibration{'' if len(files) == 1 else 's'} View_00N.xml: put those of two "
            "cameras or more there"
        )
    return {view: read_tsai(path) for view, path in files.items()}


def _pictures(folder: Path) -> dict[str, dict[int, Path]]:
    """Find the pictures by view and by their number."""
    found: dict[str, dict[int, Path]] = {}
    for view, place in _index_by_view((path for path in folder.rglob("*") if path.is_dir()), "folder of images").items():
        for path in sorted(place.iterdir()):
            match = _FRAME.fullmatch(path.stem)
            if match and path.suffix.lower() in PICTURE_ENDINGS:
                found.setdefault(view, {})[int(match[1])] = path
    return found


def _videos(folder: Path) -> dict[str, Path]:
    return _index_by_view(
        (path for path in folder.rglob("*") if path.suffix.lower() in VIDEO_ENDINGS and path.is_file()), "video"
    )


def _size_of(picture: Path) -> tuple[int, int]:
    """Return (width, height) of a picture. Raises `InputError` if it cannot be read."""
    read = cv2.imread(str(picture))
    if read is None:
        raise InputError(f"{picture}: is not an image that can be read: fetch it again")
    return int(read.shape[1]), int(read.shape[0])


def _annotations(folder: Path, views: Iterable[str]) -> tuple[dict[str, Boxes], GroundTruth | None]:
    """Read the boxes by view, and the positions on the ground; None if no file has them."""
    boxes: dict[str, Boxes] = {}
    known = set(views)
    for view, path in _index_by_view(folder.rglob("*.txt"), "file of boxes").items():
        if view in known:
            boxes[view] = read_vatic(path)
    for path in sorted(folder.rglob("*.xml")):
        if is_tsai(path) or "<frame" not in path.read_text(encoding="utf-8", errors="replace")[:4000]:
            continue
        _add(boxes, known, _view(_VIEW.search(path.stem)) or ANNOTATED_VIEW, read_cvml(path), path)
    ground = None
    for path in sorted(folder.rglob("gt.txt")):
        seen, ground = read_mot_truth(path)
        if len(seen) and ANNOTATED_VIEW not in boxes:  # otherwise only the positions are used
            _add(boxes, known, ANNOTATED_VIEW, seen, path)
    return boxes, ground


def _add(boxes: dict[str, Boxes], known: set[str], view: str, seen: Boxes, path: Path) -> None:
    """Add the boxes of a view. Raises `InputError` for a view without calibration, or with boxes already."""
    if view not in known:
        raise InputError(f"{path}: boxes of {view}, which has no calibration {view}.xml: put it there, or remove the boxes")
    if view in boxes:
        raise InputError(f"{path}: a second annotation of {view}: identities of two annotations differ; remove one of them")
    boxes[view] = seen
