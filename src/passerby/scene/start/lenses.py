"""Assignment of lenses to cameras, from the calibration files in a user's folder.

Rig files (TOML), files of OpenCV and files of every other tool with a reader in `passerby.interchange.formats` are searched in
the folder itself and in its subfolders whose name begins with `calib` or `intrinsic`. Rig files whose name begins with
`intrinsics` are also searched beside the scene file, and files of OpenCV in the subfolders of calibration folders and in the
folder of a camera's video. Notes name the files in calibration folders that are not used.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from passerby.common.errors import InputError
from passerby.common.text import natural_key
from passerby.core.cameras import Lens
from passerby.interchange.formats import Given, read_rig_as, recognise_format
from passerby.interchange.opencv_lens import ENDINGS, LARGEST_BYTES, StoredLens, read_opencv_lens
from passerby.interchange.rig_toml import METADATA, names_of_table, read_lens, tables_of_cameras
from passerby.interchange.storage.safe_parsing import read_toml
from passerby.perception.pieces import PICTURE_ENDINGS, VIDEO_ENDINGS
from passerby.scene.scene import CAMERA_NAME
from passerby.scene.start.folders import FoundCamera, visible_files, visible_folders
from passerby.scene.start.recordings import camera_names, match_names

FOLDERS = ("calib", "intrinsic")
FIRST_NAMES = ("intrinsic", "calib", "rig")
"""Beginnings of names: of rig files that serve the same number of cameras, those with these names come first, in this order."""

_GENERAL_WORDS = {"intrinsics", "intrinsic", "intri", "intr", "calibration", "calib", "params", "parameters", "opencv", "lens"}
"""Words of a calibration file's name that do not name the camera."""

CENTRED = 0.1
"""Maximum distance of the principal point from the middle, as a share of the video's size, if a file does not state its image
size. Lenses are centred within some per cent; a calibration of 1280 x 720 is off by 0.17 in 1920 x 1080."""


@dataclass(frozen=True, eq=False)
class CameraLens:
    """The lens that was found for one camera."""

    source: Path
    table: str | None
    """The table of the rig file `source`; None: a file of OpenCV, or a table with a name that no camera can have."""
    lens: Lens | None
    """None: the table exists, but is not a complete lens, see `fault`."""
    fault: str | None = None
    assumed_size: bool = False
    """Whether the file does not state the image size, and that of the video is used."""


@dataclass(frozen=True, eq=False)
class _Table:
    """A camera's table in a rig file or in another tool's file, or a file of OpenCV."""

    source: Path
    names: tuple[str, ...]
    rig: bool
    lens: Lens | StoredLens | None
    fault: str | None = None
    assumed_size: bool = False

    @property
    def size(self) -> tuple[int, int] | None:
        """(width, height) of the image that it states; None if it states none."""
        return None if self.lens is None or self.assumed_size else self.lens.size


def find_lenses(folder: Path, cameras: Sequence[FoundCamera], notes: list[str], besides: Path) -> dict[str, CameraLens]:
    """Find the lenses of the cameras, by name; cameras without a lens are left out.

    Args:
        folder: The folder to search.
        cameras: The cameras.
        notes: Notes for the user are added to it.
        besides: The scene file, which is no rig file.
    """
    rig_files = _rig_files(folder, notes, besides)
    opencv, seen = _opencv_files(folder, cameras, notes)
    seen |= {table.source for group in rig_files for table in group} | {besides}
    groups = [*rig_files, opencv, *_files_of_other_tools(folder, cameras, seen, notes)]
    groups = sorted((group for group in groups if group), key=lambda group: _rank_group(group, cameras), reverse=True)
    found: dict[str, CameraLens] = {}
    for group in groups:
        left = [camera for camera in cameras if camera.name not in found or found[camera.name].lens is None]
        pairs = match_names([camera.name for camera in left], [table.names for table in group])
        by_size = _match_sizes(left, group, pairs)
        used = False
        for index, other in (pairs | by_size).items():
            camera, table = left[index], group[other]
            lens = _camera_lens(table, camera, notes)
            if lens is not None and (lens.lens is not None or camera.name not in found):
                found[camera.name], used = lens, True
                notes += _describe_matches(camera, table, index in by_size)
        others = [table for other, table in enumerate(group) if other not in {**pairs, **by_size}.values()]
        unmatched = [camera for index, camera in enumerate(left) if index not in pairs | by_size]
        if (not used or others) and unmatched:
            others = others or group
            sources = sorted({str(table.source) for table in others}, key=natural_key)
            told = ", ".join(sources[:3]) + (f" and {len(sources) - 3} more" if len(sources) > 3 else "")
            notes.append(
                f"not used: {told}: {_list_names([table.names[0] for table in others])} cannot be matched with the cameras "
                f"{_list_names([camera.name for camera in unmatched])}: give them the same names"
            )
    return found


def _match_sizes(cameras: Sequence[FoundCamera], group: Sequence[_Table], known: dict[int, int]) -> dict[int, int]:
    """Match the remaining cameras and tables with an image size that is unique in both, in the form of `match_names`."""
    ours = [None if camera.info is None else camera.info.size for camera in cameras]
    theirs = [table.size for table in group]
    return {
        index: theirs.index(size)
        for index, size in enumerate(ours)
        if index not in known and size is not None and ours.count(size) == theirs.count(size) == 1
        and theirs.index(size) not in known.values()
    }  # fmt: skip


def _describe_matches(camera: FoundCamera, table: _Table, by_size: bool) -> list[str]:
    """Return a note about intrinsics that do not have the camera's name."""
    if not by_size and (table.rig or match_names([camera.name], [table.names], by_number=False)):
        return []
    how = "the image size, which no other has" if by_size else "the number in its name"
    return [f"camera {camera.name}: intrinsics of {table.names[-1]} in {table.source}, by {how}"]


def _rank_group(group: list[_Table], cameras: Sequence[FoundCamera]) -> tuple[int, bool, int]:
    """Return a sort key: the number of cameras for which a group has a lens, rig files first, the order of `FIRST_NAMES`."""
    pairs = match_names([camera.name for camera in cameras], [table.names for table in group])
    name = group[0].source.name.lower()
    rank = next((index for index, start in enumerate(FIRST_NAMES) if name.startswith(start)), len(FIRST_NAMES))
    return sum(group[other].lens is not None for other in pairs.values()), group[0].rig, -rank


def _camera_lens(table: _Table, camera: FoundCamera, notes: list[str]) -> CameraLens | None:
    """Make a camera's lens from a table; None, with a note, if this is impossible."""
    if isinstance(table.lens, StoredLens):
        size = table.lens.size or (camera.info.size if camera.info else None)
        if size is None:
            notes.append(f"not used: {table.source}: does not state the image size: add image_width and image_height")
            return None
        off = max(abs(table.lens.matrix[axis, 2] / size[axis] - 0.5) for axis in (0, 1))
        if table.lens.size is None and off >= CENTRED:
            notes.append(
                f"not used: {table.source}: does not state the image size, and its principal point "
                f"{table.lens.matrix[:2, 2].round(1).tolist()} is not that of the {size[0]} x {size[1]} video of "
                f"{camera.name}: add image_width and image_height"
            )
            return None
        return CameraLens(table.source, None, table.lens.lens(size), assumed_size=table.lens.size is None)
    usable = (name for name in sorted(table.names, key=lambda name: name != camera.name) if _is_camera_table(name))
    return CameraLens(
        table.source, next(usable, None) if table.rig else None, table.lens, table.fault, assumed_size=table.assumed_size
    )


def _is_camera_table(name: str) -> bool:
    return bool(CAMERA_NAME.fullmatch(name)) and name != METADATA


def _places(folder: Path) -> list[Path]:
    return [folder, *(inner for inner in visible_folders(folder) if inner.name.lower().startswith(FOLDERS))]


def _rig_files(folder: Path, notes: list[str], besides: Path) -> list[list[_Table]]:
    """Read the tables of each rig file."""
    paths = [path for place in _places(folder) for path in visible_files(place, (".toml",))]
    if besides.parent.is_dir():  # it may have a template that was written before and that the user has completed
        paths += [path for path in visible_files(besides.parent, (".toml",)) if path.name.startswith("intrinsics")]
    different = {path.resolve(): path for path in reversed(paths)}
    return [_tables(path, notes) for path in reversed(different.values()) if path.resolve() != besides.resolve()]


def _tables(path: Path, notes: list[str]) -> list[_Table]:
    """Read the cameras' tables of a TOML file; none if it is no rig file."""
    try:
        content = read_toml(path, "a rig file (TOML)")
    except InputError as error:
        notes.append(f"not used: {error}")
        return []
    found: list[_Table] = []
    for key, table in tables_of_cameras(content).items():
        names = names_of_table(key, table)
        try:
            found.append(_Table(path, names, True, read_lens(path, key)))
        except InputError as error:
            found.append(_Table(path, names, True, None, str(error)))
    return found


def _opencv_files(folder: Path, cameras: Sequence[FoundCamera], notes: list[str]) -> tuple[list[_Table], set[Path]]:
    """Find the files of OpenCV, each with the name of its camera, and all files that are used or named in a note.

    Files in one folder are distinguished by their names without words such as "intrinsics". A file that is alone in its folder
    gets the name of the folder, except in the user's folder and in a calibration folder.
    """
    calibrations = _places(folder)
    inner = [place for calibration in calibrations[1:] for place in visible_folders(calibration)]
    own = [camera.video if camera.video.is_dir() else camera.video.parent for camera in cameras if camera.video is not None]
    own = [place for place in own if place.is_dir()]  # the parent of a pattern may not be a folder
    found: list[_Table] = []
    seen: set[Path] = set()
    for place in dict.fromkeys([*calibrations, *inner, *own]):
        lenses: list[tuple[Path, StoredLens]] = []
        for path in visible_files(place, ENDINGS):
            try:
                stored = read_opencv_lens(path) if path.stat().st_size <= LARGEST_BYTES else None
            except InputError as error:
                if recognise_format(path) is None:
                    notes.append(f"not used: {error}")
                    seen.add(path)
                continue
            if stored is not None:
                lenses.append((path, stored))
                seen.add(path)
        if len(lenses) == 1 and place not in calibrations:
            names = [place.name]
        else:
            names = camera_names([_shorten_name(path.stem) for path, _ in lenses])
        found += [_Table(path, (name,), False, stored) for name, (path, stored) in zip(names, lenses, strict=True)]
    return found, seen


def _files_of_other_tools(
    folder: Path, cameras: Sequence[FoundCamera], seen: set[Path], notes: list[str]
) -> list[list[_Table]]:
    """Read the cameras of each file that a reader of `passerby.interchange.formats` recognises.

    Notes name the files that cannot be read, and those in calibration folders that no reader recognises.
    """
    sizes = {camera.info.size for camera in cameras if camera.info is not None}
    size = next(iter(sizes)) if len(sizes) == 1 else None
    groups: list[list[_Table]] = []
    for number, place in enumerate(_places(folder)):
        unknown: list[Path] = []
        whole: set[str] = set()
        for path in visible_files(place):
            if path in seen or path.suffix.lower() in VIDEO_ENDINGS + PICTURE_ENDINGS:
                continue
            form = recognise_format(path)
            if form is None:
                unknown.append(path)
                continue
            whole |= {path.suffix} if form.target == "folder" else set()
            try:
                groups.append(_cameras_in(path, form.name, size))
            except InputError as error:
                notes.append(f"not used: {error}")
        # In a format that is a whole folder, other files of this ending, such as poses, belong to it.
        unknown = [path for path in unknown if path.suffix not in whole]
        if number > 0 and unknown:
            told = ", ".join(map(str, unknown[:5])) + (f" and {len(unknown) - 5} more" if len(unknown) > 5 else "")
            notes.append(f"not used: {told}: no calibration that is known here (`passerby formats` lists those that are)")
    return groups


def _cameras_in(path: Path, name: str, size: tuple[int, int] | None) -> list[_Table]:
    """Read the lenses in a file of a format; `size` is used if the file does not state the image size. Raises `InputError`."""
    # Only poses have lengths, and they are not used here.
    given, assumed = Given(metres_per_unit=1.0), False
    try:
        rig, _ = read_rig_as(name, path, given, lossy=True)
    except InputError as error:
        rig, _ = read_rig_as(name, path, replace(given, size=size or (1, 1)), lossy=True)
        if size is None:
            raise InputError(f"{error}, by `passerby import {shlex.quote(str(path))} -f {name} -o intrinsics.toml`") from None
        assumed = True
    return [
        _Table(path, (camera.name,), False, camera.lens, assumed_size=assumed) for camera in rig if not camera.lens.uncalibrated
    ]


def _shorten_name(stem: str) -> str:
    """Remove the general words of calibration files from a name; return the whole name if no other word is left."""
    for separator in ("_", "-", ".", " "):
        words = stem.split(separator)
        left = [word for word in words if word.lower() not in _GENERAL_WORDS]
        if len(left) < len(words) and left:
            stem = separator.join(left)
    return stem


def _list_names(names: Sequence[str]) -> str:
    return ", ".join(names[:6]) + (", ..." if len(names) > 6 else "")
