"""Paths that users give in place of one video (recordings in pieces, still pictures), and how to join them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from glob import glob
from itertools import islice
from pathlib import Path

VIDEO_ENDINGS = (".mp4", ".avi", ".mov", ".mkv", ".m4v", ".mpg", ".mpeg", ".ts", ".webm", ".wmv")
PICTURE_ENDINGS = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp", ".ppm", ".pgm")

JOIN_PIECES = (
    "recordings in pieces are not read here: join each camera's into one file, in the order of their times, with "
    "`ffmpeg -f concat -safe 0 -i list.txt -c copy camera.mp4`, where list.txt has a line `file 'NAME'` for each piece"
)
JOIN_PICTURES = (
    "still images are not read here: make one video of each camera's with `ffmpeg -framerate FPS -pattern_type glob -i '*.jpg' "
    "-c:v libx264 -crf 17 camera.mp4`"
)
PATTERN = re.compile(r"[*?]|%0?\d*d")
DEPTH, MOST = 4, 5000
"""Limits on nested folders and on files that are searched: a network video recorder keeps day/hour/camera/piece."""


def walk_below(folder: Path) -> Iterator[Path]:
    """Yield the files in a folder and its subfolders, up to `DEPTH`, without hidden ones."""
    return _list_below(folder, DEPTH)


def files_below(folder: Path, endings: tuple[str, ...]) -> list[Path]:
    """Return the files with one of these endings in a folder and its subfolders, within `DEPTH` and `MOST`; no hidden ones."""
    return [path for path in islice(_list_below(folder, DEPTH), MOST) if path.suffix.lower() in endings]


def _list_below(folder: Path, depth: int) -> Iterator[Path]:
    """Yield files, a folder's own before those of its subfolders."""
    try:
        entries = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    except OSError:
        return
    yield from (path for path in entries if not path.is_dir())
    for inner in entries if depth else ():
        if inner.is_dir():
            yield from _list_below(inner, depth - 1)


def why_no_video_is_there(folder: Path) -> str:
    """Return the error and remedy for a folder where a video is needed."""
    videos = files_below(folder, VIDEO_ENDINGS)
    if len(videos) > 1:
        return f"is a folder of {len(videos)} videos, not one: {JOIN_PIECES}, and name that file"
    if not videos and len(files_below(folder, PICTURE_ENDINGS)) > 1:
        return f"is a folder of images: {JOIN_PICTURES}, and name that file"
    return "is a folder: name a video file"


def why_a_pattern_is_no_video(path: Path) -> str | None:
    """Return the error and remedy for a name that stands for many files; None for another name."""
    if not PATTERN.search(str(path)) and not ("[" in path.name and glob(str(path))):
        return None
    join = JOIN_PICTURES if path.suffix.lower() in PICTURE_ENDINGS else JOIN_PIECES
    return f"matches many files, not one: {join}, and name that file"
