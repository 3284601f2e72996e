"""What is odd about the files of a recording, and does not stop a calibration."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from passerby.findings.finding import Finding, notice
from passerby.perception.sources.files import VideoSource
from passerby.perception.sources.placing import Gaps
from passerby.perception.video_probe import VideoInfo, WallTime

LONG_S = 3600.0
"""Longer recordings are reported: half an hour with people determines a rig, and watching takes about as long as filming."""


def unreadable_pieces(
    name: str, place: Path, paths: Sequence[Path], failed: Sequence[tuple[int, str]], listed: int
) -> list[Finding]:
    """Files that could not be read; `failed` are their numbers among `paths`, with the reason."""
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
    """Files of another size or rate than most; `other` are their numbers among `paths`."""
    if not other:
        return []
    first = opened[other[0]]
    by_size = first.size != size
    what = f"{first.size[0]} x {first.size[1]}" if by_size else f"{first.clock_fps:.4g} frames per second"
    usual = f"{size[0]} x {size[1]}" if by_size else f"{rate:.4g}"
    values = {"count": len(other), "files": listed, "first": paths[other[0]].name, "what": what, "usual": usual}
    return [notice("pieces_differ", name, place=str(place), **values)]


def gap_findings(name: str, place: Path, gaps: Gaps, wall: WallTime | None, what: str) -> list[Finding]:
    """Gaps between the pieces or images of a recording (`what`), and pieces that overlap."""
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
    """Recordings of hours, of which no span is chosen."""
    if source.span is not None or info.seconds is None or info.seconds <= LONG_S:
        return []
    first = last = None
    if info.wall is not None and info.end_s is not None:
        first = WallTime(round(info.wall.seconds + info.begin_s), info.wall.utc).text
        last = WallTime(round(info.wall.seconds + info.end_s), info.wall.utc).text
    values = {"hours": info.seconds / 3600.0, "files": len(info.files), "first": first, "last": last}
    return [notice("recording_long", name, place=str(info.path), **values)]
