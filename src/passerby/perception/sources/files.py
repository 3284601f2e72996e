"""The files that a camera's `video` names: one file, a folder, a pattern, or a list of these."""

from __future__ import annotations

import re
from dataclasses import dataclass
from glob import glob
from itertools import islice
from pathlib import Path
from typing import Literal

from passerby.common.text import natural_key
from passerby.perception.pictures import VideoError
from passerby.perception.pieces import PICTURE_ENDINGS, VIDEO_ENDINGS, walk_below
from passerby.perception.sources.name_times import order_of

Kind = Literal["videos", "pictures"]

MOST_FILES = 500_000
"""A camera's recording in pieces of ten seconds has as many in eight weeks."""
_PATTERN, _NUMBERED = re.compile(r"[*?\[]"), re.compile(r"%0?\d*d")


@dataclass(frozen=True)
class WallSpan:
    """A span of wall time, seconds since 1970 by the clock of the names of files; either end may be open (infinite)."""

    first: float
    last: float


@dataclass(frozen=True)
class VideoSource:
    """What a scene file says of a camera's video. All paths can be opened as they are."""

    paths: tuple[Path, ...]
    """Files, folders or patterns."""
    names: str | None = None
    """How the files' names tell their times: see `NamePattern`. None: by the usual names."""
    times: Path | None = None
    """A table of the files' times, CSV."""
    fps: float | None = None
    """Pictures a second, for numbered pictures."""
    span: WallSpan | None = None
    """What is used of it."""
    origin: float | None = None
    """Wall time of frame 1, seconds since 1970. None: the first picture is frame 1."""
    rotate: int = 0
    """Degrees clockwise by which its pictures are turned, after the rotation that the files state."""

    @property
    def single(self) -> Path | None:
        """The one file that it is, with nothing said of its time; None for pieces and pictures."""
        (path, *more) = self.paths
        if more or self.names is not None or self.times is not None or path.is_dir():
            return None
        if not path.is_file() and is_pattern(path):
            return None
        return None if path.suffix.lower() in PICTURE_ENDINGS and path.is_file() else path

    @property
    def place(self) -> Path:
        """What messages call it."""
        if len(self.paths) == 1:
            return self.paths[0]
        shared = [parts[0] for parts in zip(*(path.parts for path in self.paths), strict=False) if len(set(parts)) == 1]
        return Path(*shared) if shared else self.paths[0].parent


@dataclass(frozen=True)
class ListedFiles:
    """The files of one camera, in natural order of their names, the chapters of a recording in order."""

    kind: Kind
    paths: tuple[Path, ...]


def is_pattern(path: Path) -> bool:
    """Whether a path stands for several files; a file that is called so is a file."""
    return bool(_PATTERN.search(str(path)) or _NUMBERED.search(path.name))


def list_files(source: VideoSource) -> ListedFiles:
    """The files that a source names, each once.

    Raises `VideoError` where there are none, or both videos and pictures.
    """
    found: dict[Path, None] = {}
    for path in source.paths:
        found |= dict.fromkeys(_named_by(path))
    videos = [path for path in found if path.suffix.lower() in VIDEO_ENDINGS]
    pictures = [path for path in found if path.suffix.lower() in PICTURE_ENDINGS]
    if videos and pictures:
        raise VideoError(
            source.place,
            f"holds {len(videos)} videos ({videos[0].name}, ...) and {len(pictures)} images ({pictures[0].name}, ...): name "
            'one kind with a pattern, as video = "FOLDER/*.mp4"',
        )
    chosen = videos or pictures
    if not chosen:
        raise VideoError(source.place, "no video and no image is there: check the path, the pattern and the names' endings")
    chosen.sort(key=lambda path: ([natural_key(part) for part in path.parent.parts], order_of(path.stem), str(path)))
    return ListedFiles("videos" if videos else "pictures", tuple(chosen))


def _named_by(path: Path) -> list[Path]:
    """The videos and pictures of one path of a list."""
    endings = VIDEO_ENDINGS + PICTURE_ENDINGS
    if path.is_dir():
        return [one for one in islice(walk_below(path), MOST_FILES) if one.suffix.lower() in endings]
    if path.is_file():
        if path.suffix.lower() not in endings:
            raise VideoError(path, f"is neither a video nor an image by its ending: use one of {', '.join(endings)}")
        return [path]
    if not is_pattern(path):
        raise VideoError(path, "no such file or folder: a video is needed here; check the path and its spelling")
    numbered = _NUMBERED.search(path.name)
    pattern = str(path.with_name(_NUMBERED.sub("*", path.name))) if numbered else str(path)
    matched = [Path(name) for name in islice(sorted(glob(pattern, recursive=True)), MOST_FILES)]
    if numbered:
        expression = re.compile(r"\d+".join(map(re.escape, _NUMBERED.split(path.name))))
        matched = [one for one in matched if expression.fullmatch(one.name)]
    matched = [one for one in matched if one.suffix.lower() in endings and not one.name.startswith(".") and one.is_file()]
    if not matched:
        raise VideoError(path, "no video and no image matches this pattern: check it (* any text in one name, ** any folders)")
    return matched
