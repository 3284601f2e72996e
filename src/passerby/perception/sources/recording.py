"""One recording from the files of a camera: choice of the files, their places in time, and findings about them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.findings.finding import Finding, notice
from passerby.perception.pictures import VideoError
from passerby.perception.sources.file_times import FileTimes, PictureHead, read_picture_head, times_of
from passerby.perception.sources.files import (
    GAP_S,
    SLACK_S,
    VideoSource,
    WallSpan,
    differing_pieces,
    follow_at_once,
    gap_findings,
    gaps_between,
    list_files,
    long_recording,
    place_by_names,
    unreadable_pieces,
)
from passerby.perception.sources.name_times import are_all_chapters
from passerby.perception.video_camera import RecordingCamera
from passerby.perception.video_probe import VARIABLE_CLOCK_FPS, Piece, VideoInfo, WallTime, probe

MIXED = 0.5
"""Number of files of a second size, as a share of those of the most frequent one, from which a folder has several cameras."""
TWICE = 0.25
"""The same for the share of pieces whose whole time other pieces cover too."""
SAME_RATE, OTHER_RATE = 0.001, 0.1
"""Pieces whose rates differ by less than the first share count alike; by more than the second they are another stream."""
CREATED_RESOLUTION_S = 1.0
"""Creation times have no fractions of a second."""
LONGEST_PIECE_S = 6 * 3600.0
"""A piece that begins earlier than this before a span has ended when the span begins: it is not opened."""
PICTURE_GAP = 3.0
"""Distance of two pictures, in usual steps, above which there is a gap between them."""


@dataclass(frozen=True, eq=False)
class Recording:
    """A camera's video, and the findings about its files."""

    info: VideoInfo
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class WallExtent:
    """The wall times of a camera's files, before any of them is opened."""

    begins: tuple[float, ...]
    """Beginnings of the files, ascending; seconds since 1970."""
    utc: bool


def wall_extent(source: VideoSource) -> WallExtent | None:
    """Return when a camera's files begin; None where wall times are not known. Raises `InputError` as `open_source` does."""
    if source.single is not None:
        return None
    times = times_of(source, list_files(source))
    return WallExtent(tuple(np.sort(times.begin).tolist()), times.utc) if times is not None and times.wall else None


def open_source(source: VideoSource, name: str = "") -> Recording:
    """Open a camera's video, turned as the source states.

    Args:
        source: the scene file's description of it.
        name: the camera's name, for findings.

    Raises:
        InputError: no file, no readable file, files of several cameras, a file that grows, or as in `times_of`.
    """
    found = _open_video(source, name)
    return replace(found, info=found.info.turned(source.rotate))


def _open_video(source: VideoSource, name: str) -> Recording:
    """Open the video as filmed."""
    if source.single is not None:
        return Recording(probe(source.single))
    files = list_files(source)
    listed = len(files.paths)
    if files.kind == "pictures" and listed == 1:
        raise VideoError(source.place, "is a single image: name the folder of all images, or a pattern as FOLDER/*.jpg")
    heads = None if files.kind == "videos" else [_head(path) for path in files.paths]
    times = times_of(source, files, heads)
    order = np.arange(listed) if times is None else np.argsort(times.begin, kind="stable")
    if source.span is not None and times is not None and times.wall:
        order = order[_find_near_span(times.begin[order], source.span, files.kind == "pictures")]
        if not len(order):
            first, last = (WallTime(float(end), times.utc).text for end in (times.begin.min(), times.begin.max()))
            raise VideoError(
                source.place,
                f"has no file in the span that [scene] from and until choose: its {listed} files begin from {first} to {last}",
            )
    paths = [files.paths[k] for k in order]
    begin = None if times is None else times.begin[order]
    if heads is None:
        found = _join_videos(source, name, paths, begin, times, listed)
    else:
        found = _join_pictures(source, name, paths, [heads[k] for k in order], begin, times)
    if source.origin is not None and found.info.wall is not None:
        return replace(found, info=rebased(found.info, source.origin))
    return found


def rebased(info: VideoInfo, origin: float) -> VideoInfo:
    """Return the same recording with frame 1 at another wall time, seconds since 1970, not after its beginning."""
    assert info.wall is not None
    later = info.wall.seconds - origin
    pieces = tuple(replace(piece, begin_s=piece.begin_s + later) for piece in info.pieces)
    used = (info.used[0] + later, info.used[1] + later)
    return replace(info, pieces=pieces, used=used, wall=replace(info.wall, seconds=origin))


def gaps_of(info: VideoInfo) -> list[tuple[float, float]]:
    """Return the gaps between the pieces of a recording, or between its pictures: begin and end, seconds from frame 1."""
    found = []
    end = math.inf
    for piece in info.pieces:
        if piece.begin_s - end >= GAP_S:
            found.append((end, piece.begin_s))
        end = max(piece.begin_s + piece.seconds, -math.inf if end == math.inf else end)
    return found


def count_recorded_s(info: VideoInfo) -> float:
    """Return the seconds of the used part of a video of known length, without the gaps in it."""
    return (info.seconds or 0.0) - sum(last - first for first, last in gaps_of(info))


def _find_near_span(begin: Floats, span: WallSpan, pictures: bool) -> np.ndarray:
    """Return the indices of files, in order of time, that may cover a span: those in it and earlier ones that reach into it."""
    inside = (begin >= span.first) & (begin <= span.last)
    before = begin < span.first
    if not pictures and before.any():
        # Of the earlier pieces, the last one; and others that began at the same time.
        last = begin[before].max()
        inside |= before & (begin >= last) & (begin > span.first - LONGEST_PIECE_S)
    return np.flatnonzero(inside)


def _head(path: Path) -> PictureHead:
    try:
        return read_picture_head(path)
    except OSError:
        return PictureHead(None)


# Videos ---------------------------------------------------------------------------------------------------------------------


def _join_videos(
    source: VideoSource, name: str, paths: Sequence[Path], begin: Floats | None, times: FileTimes | None, listed: int
) -> Recording:
    """Join pieces in order of time to one recording."""
    place = source.place
    before = [_size_of(path) for path in paths]
    opened, failed = _probe_files(paths)
    grown = next((path for path, size in zip(paths, before, strict=True) if _size_of(path) != size), None)
    if grown is not None:
        raise VideoError(
            grown,
            "is still being written: run the command again when its recording has ended, name finished files only, or under "
            "[scene] choose a span that has ended (until)",
        )
    if not opened:
        number, why = failed[0]
        raise VideoError(place, f"none of its {len(paths)} videos can be read; the first, {paths[number].name}: {why}")
    size, rate = _find_commonest_form(place, paths, opened)
    alike = [k for k in opened if opened[k].size == size and not _is_other_rate(opened[k], rate)]
    other = [k for k in opened if k not in set(alike)]
    infos = [opened[k] for k in alike]
    variable = any(info.variable or abs(info.clock_fps / rate - 1) > SAME_RATE for info in infos)
    clock = VARIABLE_CLOCK_FPS if variable else rate
    seconds = np.array([_length(info, variable) for info in infos])
    stated = _read_creation_times(infos, seconds) if begin is None else None
    if begin is None:
        begins = follow_at_once(seconds) if stated is None else place_by_names(stated, seconds, CREATED_RESOLUTION_S)
    elif times is not None and times.resolution_s > 0:
        begins = place_by_names(begin[alike], seconds, times.resolution_s)
    else:
        begins = begin[alike]
    wall = None
    if times is not None and times.wall:
        wall = WallTime(float(begins[0]), times.utc)
    begins = begins - begins[0]
    resolution_s = CREATED_RESOLUTION_S if times is None else times.resolution_s
    gaps = gaps_between(begins, seconds, max(GAP_S, resolution_s))
    if len(alike) > 1 and gaps.inside >= max(1, TWICE * len(alike)):
        raise VideoError(
            place,
            f"{gaps.inside} of {len(alike)} videos were recorded at the time of others: these are files of several cameras, or "
            "their clock was set back; name those of one camera, with a pattern as video = "
            '"recordings/*/*/north/*.mp4", or under [scene] choose a span without that (from, until)',
        )
    pieces = tuple(
        Piece(paths[k], float(at), replace(info, clock_fps=clock, variable=variable), float(length))
        for k, at, info, length in zip(alike, begins, infos, seconds, strict=True)
    )
    used = _choose_span(source.span, wall)
    pieces = tuple(piece for piece in pieces if piece.begin_s + piece.seconds > used[0] and piece.begin_s <= used[1])
    if not pieces:
        raise VideoError(place, "shows nothing of the span that [scene] from and until choose: its files end before it")
    pictures = sum(round(piece.seconds * piece.info.average_fps) for piece in pieces if piece.info is not None)
    info = VideoInfo(
        path=place,
        size=size,
        codec=Counter(one.codec for one in infos).most_common(1)[0][0],
        clock_fps=clock,
        variable=variable,
        average_fps=float(np.median([one.average_fps for one in infos])),
        frames=max(1, pictures),
        seconds=None,
        rotation=infos[0].rotation,
        camera=infos[0].camera,
        clock=infos[0].clock,
        pieces=pieces,
        wall=wall,
        used=used,
    )
    info = replace(info, seconds=_span(info))
    findings = [
        *unreadable_pieces(name, place, paths, failed, listed),
        *differing_pieces(name, place, paths, other, opened, size, rate, listed),
        *(
            []
            if times is not None or stated is not None or len(paths) < 2 or are_all_chapters([path.stem for path in paths])
            else [notice("pieces_untimed", name, place=str(place), pieces=len(paths))]
        ),
        *gap_findings(name, place, gaps, wall, "pieces"),
        *long_recording(name, source, info),
    ]
    return Recording(info, tuple(findings))


def _read_creation_times(infos: Sequence[VideoInfo], seconds: Floats) -> Floats | None:
    """Return the creation times (N,) of pieces in order of names, if each is after the end of the one before; else None.

    Copies and exports have other creation times than recordings, and some makers store the end.
    """
    found = [info.clock.created_s for info in infos]
    created = np.array([one for one in found if one is not None])
    if len(created) < len(found) or len(found) < 2:
        return None
    apart = np.diff(created) >= seconds[:-1] - CREATED_RESOLUTION_S - SLACK_S
    return created if apart.all() else None


def _probe_files(paths: Sequence[Path]) -> tuple[dict[int, VideoInfo], list[tuple[int, str]]]:
    """Probe files: return the readable ones by index, and the unreadable ones with the reason."""
    opened: dict[int, VideoInfo] = {}
    failed: list[tuple[int, str]] = []
    for number, path in enumerate(paths):
        try:
            opened[number] = probe(path)
        except VideoError as error:
            failed.append((number, error.what))
        except InputError as error:
            failed.append((number, str(error)))
    return opened, failed


def _size_of(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return -1


def _find_commonest_form(place: Path, paths: Sequence[Path], opened: dict[int, VideoInfo]) -> tuple[tuple[int, int], float]:
    """Return the most frequent size, and the most frequent rate of pieces with it. Raises `VideoError` for mixed cameras."""
    (size, most), *others = Counter(info.size for info in opened.values()).most_common()
    if others and others[0][1] > MIXED * most:
        first = {one: next(paths[k].name for k in opened if opened[k].size == one) for one in (size, others[0][0])}
        told = " and ".join(f"{n} of {w} x {h} ({first[w, h]}, ...)" for (w, h), n in ((size, most), others[0]))
        raise VideoError(
            place, f"holds files of two sizes, {told}: these are several cameras or streams; name those of one with a pattern"
        )
    rates = [info.average_fps for info in opened.values() if info.size == size]
    near = [sum(abs(one / other - 1) <= OTHER_RATE for other in rates) for one in rates]
    chosen = rates[int(np.argmax(near))]
    constant = [info.clock_fps for info in opened.values() if info.size == size and not info.variable]
    alike = [rate for rate in constant if abs(rate / chosen - 1) <= OTHER_RATE]
    return size, float(np.median(alike)) if alike else chosen


def _is_other_rate(info: VideoInfo, rate: float) -> bool:
    return not info.variable and abs(info.clock_fps / rate - 1) > OTHER_RATE


def _length(info: VideoInfo, variable: bool) -> float:
    """Return the seconds from a piece's first picture to that of a piece that follows it at once."""
    if info.frames and not variable:
        return info.frames / info.clock_fps
    return info.seconds or (info.frames or 1) / info.average_fps


# Pictures -------------------------------------------------------------------------------------------------------------------


def _join_pictures(
    source: VideoSource,
    name: str,
    paths: Sequence[Path],
    heads: Sequence[PictureHead],
    begin: Floats | None,
    times: FileTimes | None,
) -> Recording:
    """Join pictures in order of time to one recording."""
    assert begin is not None
    assert times is not None
    place = source.place
    sizes = {k: size for k, (path, head) in enumerate(zip(paths, heads, strict=True)) if (size := _size(path, head))}
    if not sizes:
        raise VideoError(place, f"none of its {len(paths)} images can be read, {paths[0].name} among them: copy them again")
    (size, most), *others = Counter(sizes.values()).most_common()
    if others and others[0][1] > MIXED * most:
        raise VideoError(
            place,
            f"holds images of two sizes, {most} of {size[0]} x {size[1]} and {others[0][1]} of {others[0][0][0]} x "
            f"{others[0][0][1]}: these are several cameras; name those of one with a pattern",
        )
    alike = [k for k in range(len(paths)) if sizes.get(k) == size]
    wall = WallTime(float(begin[alike[0]]), times.utc) if times.wall else None
    begins = begin[alike] if times.numbered else begin[alike] - begin[alike[0]]
    steps = np.diff(begins)
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0 / (source.fps or 1.0)
    variable = not times.numbered
    clock = VARIABLE_CLOCK_FPS if variable or source.fps is None else source.fps
    pieces = tuple(Piece(paths[k], float(at), None, step) for k, at in zip(alike, begins, strict=True))
    first = heads[alike[0]]
    info = VideoInfo(
        path=place, size=size, codec=paths[0].suffix.lower().lstrip("."), clock_fps=clock, variable=variable,
        average_fps=1.0 / step, frames=len(pieces), seconds=None, camera=RecordingCamera(first.focal_35mm, first.device),
        pieces=pieces, wall=wall, used=_choose_span(source.span, wall),
    )  # fmt: skip
    info = replace(info, seconds=_span(info))
    failed = [(k, "it is no image that can be read") for k in range(len(paths)) if k not in sizes]
    other = [k for k in sizes if sizes[k] != size]
    gaps = gaps_between(begins, np.full(len(begins), step), PICTURE_GAP * step)
    findings = [
        *unreadable_pieces(name, place, paths, failed, len(paths)),
        *(
            [notice("pieces_differ", name, place=str(place), count=len(other), files=len(paths), first=paths[other[0]].name,
                    what=f"{sizes[other[0]][0]} x {sizes[other[0]][1]}", usual=f"{size[0]} x {size[1]}")]
            if other else []
        ),
        *gap_findings(name, place, gaps, wall, "images"),
        *long_recording(name, source, info),
    ]  # fmt: skip
    return Recording(info, tuple(findings))


def _size(path: Path, head: PictureHead) -> tuple[int, int] | None:
    """Return the size of an image, by decoding it if its head does not have it; None where it cannot be read."""
    if head.size is not None or path.suffix.lower() in (".jpg", ".jpeg", ".png"):
        return head.size
    import cv2

    picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
    return None if picture is None else (picture.shape[1], picture.shape[0])


# Both -----------------------------------------------------------------------------------------------------------------------


def _choose_span(span: WallSpan | None, wall: WallTime | None) -> tuple[float, float]:
    """Convert the span to seconds of the recording."""
    if span is None or wall is None:
        return -math.inf, math.inf
    return span.first - wall.seconds, span.last - wall.seconds


def _span(info: VideoInfo) -> float:
    """Return the length of the used part, with its gaps, seconds."""
    assert info.end_s is not None
    return max(0.0, info.end_s - info.begin_s)
