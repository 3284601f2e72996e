"""The one file of a camera's video: crops of people are cut out of files, not of recordings in pieces."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from passerby.common.errors import InputError
from passerby.perception.sources.files import is_pattern


def one_file(videos: Sequence[Path], name: str, folders: bool = False) -> Path:
    """The path of camera `name`'s video.

    Raises `InputError` for several files and patterns and, unless `folders` of images can be read, for a folder.
    """
    (path, *more) = videos
    if more or (path.is_dir() and not folders) or (is_pattern(path) and not path.is_file()):
        raise InputError(
            f"{path}: camera {name}: crops of people are cut out of one video file so far: join the pieces or images, for "
            "example with `ffmpeg -f concat -safe 0 -i list.txt -c copy camera.mp4`, and calibrate with that file"
        )
    return path
