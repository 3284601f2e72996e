"""The files that a camera's `video` names, their places in its recording, and findings about them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from glob import glob
from itertools import islice
from pathlib import Path
from typing import Literal

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.text import natural_key
from passerby.findings.finding import Finding, notice
from passerby.perception.pictures import VideoError
from passerby.perception.pieces import PICTURE_ENDINGS, VIDEO_ENDINGS, walk_below
from passerby.perception.sources.name_times import order_of
from passerby.perception.video_probe import VideoInfo, WallTime

Kind = Literal["videos", "pictures"]
MOST_FILES = 500_000
"""A camera's recording in pieces of ten seconds has this many files in eight weeks."""
_PATTERN, _NUMBERED = re.compile(r"[*?\[]"), re.compile(r"%0?\d*d")
SLACK_S = 0.1
"""Errors, from piece to piece, of the lengths that containers state and of the times that recorders write."""
GAP_S = 1.0
"""Shorter gaps are within the resolution of whole seconds in names."""
OVERLAP_S = 1.0
"""The same for overlaps: recorders begin a piece at a key frame before the last piece has ended."""
LONG_S = 3600.0
"""Longer recordings are reported: half an hour with people determines a rig, and processing takes about as long as filming."""


@dataclass(frozen=True)
class WallSpan:
    """A span of wall time, seconds since 1970 by the clock of the files' names; either end may be open (infinite)."""

    first: float
    last: float


@dataclass(frozen=True)
class VideoSource:
    """The scene file's description of a camera's video. All paths can be opened as they are."""

    paths: tuple[Path, ...]
    """Files, folders or patterns."""
    names: str | None = None
    """Format of the times in the files' names: see `NamePattern`. None: the usual names."""
    times: Path | None = None
    """A table of the files' times, CSV."""
    fps: float | None = None
    """Pictures per second, for numbered pictures."""
    span: WallSpan | None = None
    """The part of it that is used; None: all."""
    origin: float | None = None
    """Wall time of frame 1, seconds since 1970. None: the first picture is frame 1."""
    rotate: int = 0
    """Degrees clockwise by which its pictures are turned, after the rotation that the files state."""

    @property
    def single(self) -> Path | None:
        """The path of a single file without a statement of its time; None for pieces and pictures."""
        (path, *more) = self.paths
        if more or self.names is not None or self.times is not None or path.is_dir():
            return None
        if not path.is_file() and is_pattern(path):
            return None
        return None if path.suffix.lower() in PICTURE_ENDINGS and path.is_file() else path

    @property
    def place(self) -> Path:
        """Its name in messages."""
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
    """Check whether a path stands for several files; an existing file with such a name is a file."""
    return bool(_PATTERN.search(str(path)) or _NUMBERED.search(path.name))


def list_files(source: VideoSource) -> ListedFiles:
    """List the files that a source names, each once.

    Raises `VideoError` where there are none, or both videos and pictures.
    """
    found: dict[Path, None] = {}
    for path in source.paths:
        found |= dict.fromkeys(_list_named(path))
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


def _list_named(path: Path) -> list[Path]:
    """List the videos and pictures of one path of a source."""
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


@dataclass(frozen=True)
class Gaps:
    """Gaps and overlaps between pieces."""

    count: int
    seconds: float
    """Total length of the gaps."""
    longest_s: float
    longest_at_s: float
    """Time at which the longest gap begins."""
    overlaps: int
    overlap_s: float
    longest_overlap_at_s: float
    """Time at which the longest overlap begins."""
    irregular: bool
    """Whether most pieces do not overlap: recorders that begin a piece early always overlap."""
    inside: int
    """Number of pieces whose whole time others cover too: another camera's, copies, or of a clock that was set back."""


def follow_at_once(seconds: Floats) -> Floats:
    """Return the beginnings (N,) of pieces with lengths (N,) that follow one another."""
    return np.concatenate([[0.0], np.cumsum(seconds)[:-1]])


def place_by_names(named: Floats, seconds: Floats, resolution_s: float) -> Floats:
    """Estimate the beginnings (N,) of pieces whose names state them without fractions.

    Pieces that were recorded without a break share one phase: each begins where the previous one ends, and all begin within the
    second that their names state. The middle of the remaining interval is taken. Missing pieces are assumed to be as long as
    the others, as far as the names allow it; where they do not, a new phase begins.

    Args:
        named: (N,) the times in the names, seconds, ascending.
        seconds: (N,) lengths of the pieces.
        resolution_s: the true beginnings are later than the names by up to this.

    Returns:
        (N,) beginnings on the clock of `named`.
    """
    seconds = _rescale_lengths(named, seconds, resolution_s)
    usual = float(np.median(seconds))
    begins = np.empty(len(named))
    first = 0
    relative = np.zeros(len(named))
    low, high = named[0] - SLACK_S, named[0] + resolution_s + SLACK_S
    for k in range(1, len(named) + 1):
        if k < len(named):
            ahead = relative[k - 1] + seconds[k - 1]
            # Missing pieces have the usual length; without missing ones the piece follows at once.
            late = named[k] + 0.5 * resolution_s - 0.5 * (low + high) - ahead
            missing = round(late / usual) if usual > 0 and late > resolution_s + SLACK_S else 0
            ahead += missing * usual
            below, above = named[k] - ahead - SLACK_S, named[k] + resolution_s - ahead + SLACK_S
            if max(low, below) <= min(high, above):
                low, high, relative[k] = max(low, below), min(high, above), ahead
                continue
        begins[first:k] = 0.5 * (low + high) + relative[first:k]
        if k < len(named):
            # After a drift the phase continues at the nearest time that the name allows; any other phase begins in the middle.
            predicted = begins[k - 1] + seconds[k - 1]
            first, relative[k] = k, 0.0
            low, high = named[k] - SLACK_S, named[k] + resolution_s + SLACK_S
            if low - GAP_S < predicted < high + GAP_S:
                low = high = float(np.clip(predicted, named[k], named[k] + resolution_s))
                low, high = low - SLACK_S, high + SLACK_S
    return begins


def _rescale_lengths(named: Floats, seconds: Floats, resolution_s: float) -> Floats:
    """Return the lengths (N,) on the clock of the names, if many pieces show that its rate differs from that of the videos."""
    if len(named) < 2:
        return seconds
    steps = np.diff(named)
    adjacent = np.abs(steps - seconds[:-1]) <= resolution_s + SLACK_S
    more, own = float((steps - seconds[:-1])[adjacent].sum()), float(seconds[:-1][adjacent].sum())
    # Names may be wrong by their resolution at both ends.
    return seconds if abs(more) <= 2 * resolution_s or own <= 0 else seconds * (1 + more / own)


def gaps_between(begins: Floats, seconds: Floats, least_s: float = GAP_S) -> Gaps:
    """Find gaps of at least `least_s`, and overlaps, of pieces in order of their beginnings."""
    ends = np.maximum.accumulate(begins + seconds)
    gap = begins[1:] - ends[:-1]
    missing = gap[gap >= least_s]
    overlapping = gap <= -OVERLAP_S
    twice = -gap[overlapping]
    inside = overlapping & (begins[1:] + seconds[1:] <= ends[:-1] + SLACK_S)
    # Two recordings that alternate: each piece ends only after the piece after the next one has begun.
    inside[:-1] |= overlapping[:-1] & overlapping[1:] & (begins[2:] <= ends[:-2] + least_s)
    longest = int(np.argmax(gap)) if len(missing) else 0
    return Gaps(
        len(missing), float(missing.sum()), float(missing.max(initial=0.0)), float(ends[longest]) if len(ends) else 0.0,
        len(twice), float(twice.sum()), float(begins[1 + int(np.argmin(gap))]) if len(twice) else 0.0,
        len(twice) <= 0.5 * len(gap), int(inside.sum()),
    )  # fmt: skip


def unreadable_pieces(
    name: str, place: Path, paths: Sequence[Path], failed: Sequence[tuple[int, str]], listed: int
) -> list[Finding]:
    """Report files that could not be read; `failed` has their indices in `paths`, with the reason."""
    if not failed:
        return []
    number, why = failed[0]
    return [
        notice("pieces_unreadable", name, place=str(place), count=len(failed), files=listed, first=paths[number].name, why=why)
    ]


def differing_pieces(
    name: str, place: Path, paths: Sequence[Path], other: Sequence[int], opened: dict[int, VideoInfo], size: tuple[int, int],
    rate: float, listed: int,
) -> list[Finding]:  # fmt: skip
    """Report files of another size or rate than most; `other` has their indices in `paths`."""
    if not other:
        return []
    first = opened[other[0]]
    by_size = first.size != size
    what = f"{first.size[0]} x {first.size[1]}" if by_size else f"{first.clock_fps:.4g} frames per second"
    usual = f"{size[0]} x {size[1]}" if by_size else f"{rate:.4g}"
    values = {"count": len(other), "files": listed, "first": paths[other[0]].name, "what": what, "usual": usual}
    return [notice("pieces_differ", name, place=str(place), **values)]


def gap_findings(name: str, place: Path, gaps: Gaps, wall: WallTime | None, what: str) -> list[Finding]:
    """Report gaps between the pieces or images of a recording (`what`), and pieces that overlap."""
    found = []
    if gaps.count:
        longest_at = None if wall is None else WallTime(round(wall.seconds + gaps.longest_at_s), wall.utc).text
        values = {"count": gaps.count, "seconds": gaps.seconds, "longest_s": gaps.longest_s, "between": what}
        found.append(
            notice("recording_gaps", name, place=str(place), **values, longest_at_s=gaps.longest_at_s, longest_at=longest_at)
        )
    if gaps.overlaps:
        at = None if wall is None else WallTime(round(wall.seconds + gaps.longest_overlap_at_s), wall.utc).text
        values = {"count": gaps.overlaps, "seconds": gaps.overlap_s, "irregular": gaps.irregular, "longest_at": at}
        found.append(notice("pieces_overlap", name, place=str(place), **values))
    return found


def long_recording(name: str, source: VideoSource, info: VideoInfo) -> list[Finding]:
    """Report recordings of hours for which no span is chosen."""
    if source.span is not None or info.seconds is None or info.seconds <= LONG_S:
        return []
    first = last = None
    if info.wall is not None and info.end_s is not None:
        first = WallTime(round(info.wall.seconds + info.begin_s), info.wall.utc).text
        last = WallTime(round(info.wall.seconds + info.end_s), info.wall.utc).text
    values = {"hours": info.seconds / 3600.0, "files": len(info.files), "first": first, "last": last}
    return [notice("recording_long", name, place=str(info.path), **values)]
