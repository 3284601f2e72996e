"""A folder per identity: FOLDER/ID/PICTURE, with splits or without.

Splits are train/, query/ and gallery/ in the folder, or train/ and val/ with query/ and gallery/ in it; where there are any,
whatever else lies beside them is not looked at. Without splits all are to learn from.

The camera of a picture is read from its name, by the first of these ways that fits all names of the set:

- `_c` and a number behind the identity's, as in Market-1501: 0002_c1s1_000451_03.jpg;
- CAMERA_VIEW, such as 01_8.png: what stands before the only underscore, where there are two such cameras or more, and one of
  them saw two people or more (in 17_1.png and 17_2.png, all in the folder 17, it is no camera's).
"""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path

from passerby.common.errors import InputError
from passerby.training.data.listing import UNKNOWN_CAMERA, Listed, Listing
from passerby.training.data.pictures import describe_faults, picture_files
from passerby.training.data.published import MARKET_NAME

TRAIN, QUERY, GALLERY = "train", "query", "gallery"
TESTS = ("val", "test")
"""Folders in which query and gallery may lie."""
CAMERA_VIEW = re.compile(r"([^_]+)_[^_]+")


def identity_folders(path: Path) -> list[Path]:
    """The folders with pictures in them, by name."""
    return [folder for folder in _folders(path) if picture_files(folder)]


def has_identities(path: Path) -> bool:
    """Whether a folder holds folders per identity, split or not."""
    train, tested = _splits(path)
    return train is not None or tested is not None or bool(identity_folders(path))


def folder_per_identity(path: Path) -> Listing:
    """The pictures of a folder per identity; see the module. Raises `InputError` for a query without gallery, and for no
    person.

    A name is a person: the same one in two splits is the same person.
    """
    train, tested = _splits(path)
    if train is None and tested is None:
        train = path
    listing = Listing()
    if train is not None:
        listing.train = _people(train, listing.notes)
    if tested is not None:
        for part, other in ((QUERY, GALLERY), (GALLERY, QUERY)):
            if not (tested / part).is_dir():
                raise InputError(
                    f"{tested / part}: no such folder, but there is {other}: evaluation needs both: add it, or move {other} "
                    "elsewhere to train only"
                )
            setattr(listing, part, _people(tested / part, listing.notes))
    cameras = _cameras([*listing.train, *listing.query, *listing.gallery], listing.notes)
    for part in (TRAIN, QUERY, GALLERY):
        named = [Listed(row.path, row.person, cameras.get(row.path, UNKNOWN_CAMERA)) for row in getattr(listing, part)]
        setattr(listing, part, named)
    return listing


def _splits(path: Path) -> tuple[Path | None, Path | None]:
    """The folder to learn from, and the one with query and gallery; None for what there is not."""
    train = path / TRAIN if (path / TRAIN).is_dir() else None
    for tested in (path, *(path / name for name in TESTS)):
        if (tested / QUERY).is_dir() or (tested / GALLERY).is_dir():
            return train, tested
    return train, None


def _people(path: Path, notes: list[str]) -> list[Listed]:
    """The pictures of the people in a folder. Raises `InputError` if there is none."""
    rows, empty = [], []
    for folder in _folders(path):
        files = picture_files(folder)
        if not files:
            empty.append(folder)
        rows += [Listed(file, folder.name, UNKNOWN_CAMERA) for file in files]
    notes += describe_faults(empty, f"{len(empty)} folder{'s' * (len(empty) > 1)} without images")
    if not rows:
        raise InputError(f"{path}: holds no folder with images in it: a folder per person is needed there")
    loose = picture_files(path)
    notes += describe_faults(loose, f"{len(loose)} images in no person's folder, left out")
    return rows


def _cameras(rows: list[Listed], notes: list[str]) -> dict[Path, str]:
    """Each file's camera by its name; empty, with a note, where the names tell none."""
    market = {row.path: MARKET_NAME.match(row.path.name) for row in rows}
    if all(market.values()):
        return {path: f"c{named[2]}" for path, named in market.items() if named is not None}
    viewed = {row.path: CAMERA_VIEW.fullmatch(row.path.stem) for row in rows}
    if all(viewed.values()):
        cameras = {path: named[1] for path, named in viewed.items() if named is not None}
        seen = defaultdict(set)
        for row in rows:
            seen[cameras[row.path]].add(row.person)
        if len(seen) > 1 and any(len(people) > 1 for people in seen.values()):
            return cameras
    notes.append(
        f"the names of the images do not state their cameras (as {rows[0].path.name}): the cameras are unknown; name them "
        f"CAMERA_VIEW.png"
    )
    return {}


def _folders(path: Path) -> list[Path]:
    """The subfolders that are not hidden, by name. Raises `InputError` where they cannot be listed."""
    try:
        return sorted(inner for inner in path.iterdir() if inner.is_dir() and not inner.name.startswith("."))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}): give a folder that you may read") from None
