"""One picture of a video to show to people, found by a key frame: a long recording need not be decoded up to it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from av.container import InputContainer
from av.error import FFmpegError
from av.video.frame import VideoFrame
from av.video.reformatter import VideoReformatter
from av.video.stream import VideoStream

from passerby.common.arrays import Floats, Ints
from passerby.perception.pictures import Frame, Picture
from passerby.perception.video import VideoInfo, VideoReader, convert_upright, decode_picture
from passerby.perception.video_probe import open_video

MOST_PIXELS = 1e8
"""Limit on the pixels that are decoded for one picture, half a second's work: 48 pictures of 1920 x 1080, 12 of 3840 x 2160."""

TRIED_PIECES = 5
"""Number of pictures of a recording in pieces that are tried before none is shown."""


def still(info: VideoInfo, number: Ints, worth: Floats, most_pixels: float = MOST_PIXELS) -> Frame | None:
    """Return the best picture that is near enough to the video's beginning, or to a key frame before the best of all.

    Args:
        info: the video, from `probe`.
        number: (N,) numbers of suitable pictures, ascending, as `VideoReader` counts them.
        worth: (N,) value of each; the first of equal ones is taken.
        most_pixels: limit on the pixels that are decoded.

    Returns:
        The picture; None where none of these could be reached.

    Raises:
        InputError: the file cannot be read, or no part of it can be decoded.
    """
    most = max(1, int(most_pixels / (info.size[0] * info.size[1])))
    if not len(number):
        return None
    if info.pieces:
        return _find_in_pieces(info, number, worth, most_pixels)
    best = int(number[np.argmax(worth)])
    if best > _numbers_of(info, most):
        found = _find_by_key_frame(info, number, worth, best, most)
        if found is not None:
            return found
    return _find_from_start(info, number, worth, most)


def key_picture(path: Path, second: float, rotation: int | None = None) -> tuple[float, Picture] | None:
    """Read the key frame before a second of a video file, or its first one; no other frame of the file is decoded.

    Args:
        path: the file.
        second: seconds from its beginning; after the end it is the last key frame.
        rotation: degrees counter-clockwise by which it is turned; None: the rotation that the file states.

    Returns:
        Its own second, and (H, W, 3) BGR, upright. None where no frame can be decoded there.

    Raises:
        InputError: the file cannot be opened.
    """
    with open_video(path) as (container, stream):
        stream.codec_context.thread_count = 1
        stream.codec_context.skip_frame = "NONKEY"
        begin = 0.0 if stream.start_time is None or stream.time_base is None else float(stream.start_time * stream.time_base)
        if second > 0 and stream.time_base is not None:
            try:
                container.seek(int((begin + second) / float(stream.time_base)), stream=stream, backward=True)
            except (FFmpegError, OverflowError):
                container.seek(0)
        frame = next(_decode_frames(container, stream), None)
        if frame is None:
            return None
        stated = frame.rotation % 360 if frame.rotation % 90 == 0 else 0
        picture = _convert_frame(frame, stated if rotation is None else rotation)
        return None if picture is None else ((_time(frame) or begin) - begin, picture)


def _find_in_pieces(info: VideoInfo, number: Ints, worth: Floats, most_pixels: float) -> Frame | None:
    """Return the best picture of a recording in pieces: from the piece that contains it, or from that of the next best one."""
    for wanted in number[np.argsort(-worth, kind="stable")][:TRIED_PIECES].tolist():
        held = [piece for piece in info.pieces if round(piece.begin_s * info.clock_fps) < wanted]
        if not held:
            continue
        piece = held[-1]
        before = round(piece.begin_s * info.clock_fps)
        if piece.info is None:
            picture = decode_picture(piece.path, info.size, info.rotation) if wanted == before + 1 else None
            if picture is not None:
                return Frame(wanted, before / info.clock_fps, picture)
            continue
        after = next((round(one.begin_s * info.clock_fps) for one in info.pieces if one.begin_s > piece.begin_s), None)
        inside = (number > before) & (True if after is None else number <= after)
        found = still(piece.info, number[inside] - before, worth[inside], most_pixels)
        if found is not None:
            return replace(found, number=found.number + before, seconds=found.seconds + before / info.clock_fps)
    return None


def _numbers_of(info: VideoInfo, pictures: int) -> float:
    """Return the numbers that `pictures` pictures take: at a variable rate, numbers are hundredths of a second."""
    return pictures * (info.clock_fps / info.average_fps if info.variable else 1.0)


def _find_from_start(info: VideoInfo, number: Ints, worth: Floats, most: int) -> Frame | None:
    """Return the best one of the first pictures, decoded in order."""
    near = number <= _numbers_of(info, most)
    if not near.any():
        return None
    wanted = int(number[near][np.argmax(worth[near])])
    frame = next(iter(VideoReader(info, after=wanted - 1)), None)
    return frame if frame is not None and frame.number == wanted else None


def _find_by_key_frame(info: VideoInfo, number: Ints, worth: Floats, best: int, most: int) -> Frame | None:
    """Return the best picture after the key frame before `best`; None where the file has no timestamps or cannot seek."""
    with open_video(info.path) as (container, stream):
        stream.codec_context.thread_count = 1
        origin = next((_time(frame) for frame in _decode_frames(container, stream)), None)
        if origin is None or stream.time_base is None:
            return None
        second = (best - 1) / info.clock_fps
        try:
            container.seek(int((origin + second) / float(stream.time_base)), stream=stream, backward=True)
        except (FFmpegError, OverflowError):
            return None
        wanted: int | None = None
        for count, frame in enumerate(_decode_frames(container, stream)):
            time = _time(frame)
            if time is None or count > most:
                return None
            here = round((time - origin) * info.clock_fps) + 1
            if wanted is None:
                reachable = (number >= here) & (number <= here + _numbers_of(info, most) - 1)
                # A position after the target, or at the very beginning, is not a key frame before it.
                if here > best or not reachable.any():
                    return None
                wanted = int(number[reachable][np.argmax(worth[reachable])])
            if here > wanted:
                return None
            if here == wanted and not frame.is_corrupt:
                picture = _convert_frame(frame, info.rotation)
                return None if picture is None else Frame(here, time - origin, picture)
    return None


def _convert_frame(frame: VideoFrame, rotation: int) -> Picture | None:
    """Convert a picture, upright; None where a damaged header states an invalid pixel format."""
    try:
        return convert_upright(VideoReformatter(), frame, rotation)
    except FFmpegError:
        return None


def _decode_frames(container: InputContainer, stream: VideoStream) -> Iterator[VideoFrame]:
    """Yield pictures from the file's present position, as long as it can be read; broken packets are left out."""
    try:
        for packet in container.demux(stream):
            try:
                yield from packet.decode()
            except FFmpegError:
                continue
    except FFmpegError:
        return


def _time(frame: VideoFrame) -> float | None:
    """Return the seconds; None for a picture without a timestamp."""
    return None if frame.pts is None or frame.time_base is None else float(frame.pts * frame.time_base)
