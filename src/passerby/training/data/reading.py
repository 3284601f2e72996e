"""Any set of pictures of people that Passerby understands, recognised by what lies in the folder."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path

from passerby.common.errors import InputError
from passerby.common.progress import Progress, silent
from passerby.scene.start.folders import visible_folders
from passerby.training.crops import DataSet
from passerby.training.data.folders import folder_per_identity, has_identities
from passerby.training.data.listing import data_set
from passerby.training.data.published import is_market, is_msmt17, market, msmt17
from passerby.training.data.tracks import (
    camera_of_sequence,
    cameras_of_folder,
    cameras_of_scene,
    sequences_of,
    tracked_people,
    videos_of,
)

UNDERSTOOD = (
    "Market-1501 or DukeMTMC-reID (bounding_box_train, query, bounding_box_test), MSMT17 (list_train.txt, ...), a folder per "
    "identity (ID/*.png; or train/ID, query/ID, gallery/ID), a scene file (.toml) whose cameras have video and tracks, a "
    "folder of videos with MOTChallenge text, or MOTChallenge sequences (seqinfo.ini)"
)


def read_data(
    path: Path, cache: Path, tell: Progress = silent, *, name: str | None = None, executor: Executor | None = None
) -> DataSet:
    """A data set, recognised by its content; every picture was decoded once, so that all that are left can be read.

    Understood are Market-1501 and DukeMTMC-reID, MSMT17, a folder per identity (see `folders`), and tracks with a video (see
    `tracks`), out of which crops are cut and kept.

    Args:
        path: a folder, or a scene file.
        cache: crops cut out of videos are kept in a folder of the data set's name there; else it is not touched.
        tell: called with the pictures as they are tried, and with the cutting.
        name: of the data set; None: the folder's, or the scene's.
        executor: cuts the cameras' crops side by side.

    Raises `InputError` for a place that holds nothing known, a query without gallery, and sets without people.
    """
    path = Path(path)
    name = name or _own_name(path)
    if path.is_file():
        if path.suffix.lower() != ".toml":
            raise InputError(f"{path}: is a file, but no scene file (.toml): give {UNDERSTOOD}")
        cameras, given, notes = cameras_of_scene(path)
        return tracked_people(name, cameras, cache, given=given, notes=notes, executor=executor, tell=tell)
    if not path.is_dir():
        raise InputError(f"{path}: no such folder: give {UNDERSTOOD}")
    if is_market(path):
        return data_set(name, path, market(path), tell)
    if is_msmt17(path):
        return data_set(name, path, msmt17(path), tell)
    if sequences := sequences_of(path):
        cameras = [camera_of_sequence(folder) for folder in sequences]
        return tracked_people(name, cameras, cache, given=False, executor=executor, tell=tell)
    if videos_of(path):
        cameras, notes = cameras_of_folder(path)
        return tracked_people(name, cameras, cache, given=True, notes=notes, executor=executor, tell=tell)
    if has_identities(path):
        return data_set(name, path, folder_per_identity(path), tell)
    inside = [inner for inner in visible_folders(path) if is_market(inner) or is_msmt17(inner) or has_identities(inner)]
    hint = f"; {inside[0]} holds one" if inside else ""
    raise InputError(f"{path}: holds no images of people in a known layout{hint}: give {UNDERSTOOD}")


def read_all(paths: Sequence[Path], cache: Path, tell: Progress = silent, *, executor: Executor | None = None) -> list[DataSet]:
    """Several data sets, whose people do not collide: those of the same name are distinguished by the folders that they lie in.

    Raises `InputError` as `read_data`, and where one set is, or lies in, another.
    """
    whole = [Path(path).resolve() for path in paths]
    for number, one in enumerate(whole):
        for other in (*whole[:number], *whole[number + 1 :]):
            if one == other:
                raise InputError(f"{one}: is given twice: give every data set once")
            if one.is_relative_to(other):
                raise InputError(f"{one}: lies in {other}, which is given too: give one of the two")
    return [
        read_data(Path(path), cache, tell, name=name, executor=executor)
        for path, name in zip(paths, _names(whole), strict=True)
    ]


def _own_name(path: Path) -> str:
    """What a data set is called after."""
    whole = path.resolve()
    if path.is_file():
        return whole.parent.name if whole.stem == "scene" else whole.stem
    return whole.name or "data"


def _names(paths: Sequence[Path]) -> list[str]:
    """Names that differ: those of the sets, and before those that are alike as many of their folders as it takes."""
    names = [_own_name(path) for path in paths]
    levels = [0] * len(paths)
    while True:
        count = Counter(names)
        alike = [row for row, name in enumerate(names) if count[name] > 1]
        if not alike:
            return names
        for row in alike:
            above = paths[row].parent.parent if _called_by_folder(paths[row]) else paths[row].parent
            levels[row] += 1
            parts = above.parts[1:][-levels[row] :]
            names[row] = "/".join((*parts, _own_name(paths[row])))
            if levels[row] > len(above.parts):
                names[row] += f"-{row}"


def _called_by_folder(path: Path) -> bool:
    return path.is_file() and path.stem == "scene"
