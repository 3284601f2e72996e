"""Findings about videos, and about the networks that detect people."""

from __future__ import annotations

from collections.abc import Mapping

from passerby.findings.texts.kinds import NOTICE, Fields, Kind

_INSTEAD = {
    "detector": "people are detected by background subtraction, without a neural network",
    "embedder": "appearance is described by colour histograms of horizontal stripes, without a neural network",
    "keypoints": "keypoints are not detected",
}


def _to_fetch(v: Fields) -> str:
    text = f"{v['why']}, and so does `passerby calibrate`"
    if v["otherwise"] is None:
        return text
    return f"{text}; {'no keypoints are' if v['otherwise'] == 'none' else v['otherwise'] + ' is'} used if it is unavailable"


def _gaps(v: Fields) -> str:
    where = f"{v['longest_at_s']:.0f} s after the start" if v["longest_at"] is None else f"at {v['longest_at']}"
    gaps = "1 gap" if v["count"] == 1 else f"{v['count']} gaps"
    return (
        f"camera {v['camera']}: the recording has {gaps} between its {v['between']}, {v['seconds']:.0f} s in all; the longest, "
        f"{v['longest_s']:.0f} s, is {where}"
    )


def _broken(v: Fields) -> str:
    parts = [f"{v['failed']} could not be decoded"] if v["failed"] else []
    parts += [f"{v['cut']} end before the length that they state"] if v["cut"] else []
    return f"camera {v['camera']}: of {v['files']} files, {' and '.join(parts)}: the rest is used"


def _long(v: Fields) -> str:
    when = "" if v["first"] is None else f", from {v['first']} to {v['last']}"
    return f"camera {v['camera']}: the recording is {v['hours']:.1f} hours long ({v['files']} files{when})"


VIDEOS: Mapping[str, Kind] = {
    "people_seem_sideways": Kind(
        NOTICE, "Few people are detected in the video, and many more once its images are turned by 90 degrees.",
        "camera {camera}: few people are detected in its images, and many more once these are turned by 90 degrees",
        "if people lie on their side there, set rotate = {rotate} (degrees clockwise), or {other} if they are then upside down",
    ),
    "camera_bumped": Kind(
        NOTICE, "The camera is bumped: it moves for a while and comes back.",
        lambda v: f"camera {v['camera']}: the camera is bumped {v['from_s']:.1f} s after the start, "
        f"{'by an unknown amount' if v['pixels'] is None else 'by {:.0f} pixels'.format(v['pixels'])}, and is back in place "
        f"after {v['until_s']:.1f} s",
    ),
    "frames_undecodable": Kind(
        NOTICE, "Some frames of the video could not be decoded.",
        "camera {camera}: {broken} frames or packets could not be decoded, the first after {first_s:.1f} s",
    ),
    "stream_unrecorded": Kind(
        NOTICE, "The camera's video is a stream, which a calibration records first.",
        "camera {camera}: its stream ({stream}) is not recorded yet: `passerby calibrate` records {seconds:.0f} s of it first, "
        "into {folder}",
    ),
    "pieces_unreadable": Kind(
        NOTICE, "Some files of a recording in pieces cannot be read; the others are used.",
        "camera {camera}: {count} of {files} files cannot be read and are left out; the first is {first}: {why}",
    ),
    "pieces_broken": Kind(
        NOTICE, "Some files of a recording in pieces turned out to be damaged while they were decoded.", _broken,
    ),
    "pieces_differ": Kind(
        NOTICE, "Some files of a recording have another image size or frame rate than most; they are left out.",
        "camera {camera}: {count} of {files} files are left out, because their size or rate is not that of the others; the "
        "first, {first}, has {what} instead of {usual}",
    ),
    "pieces_untimed": Kind(
        NOTICE, "The names of a recording's pieces do not tell their times: each is assumed to follow the one before it.",
        "camera {camera}: the names of its {pieces} pieces do not tell when they were recorded: each is assumed to begin when "
        "the one before it ends, in the order of their names",
        "if pieces are missing, state how the names tell the time (video_names), or give a table of times (video_times)",
    ),
    "pieces_overlap": Kind(
        NOTICE, "Pieces of a recording overlap; frames that were shown already are passed over.",
        "camera {camera}: {count} pieces begin before the piece before them ends, by {seconds:.0f} s in all: what is there "
        "twice is used once",
        lambda v: ""
        if not v["irregular"] or v["longest_at"] is None
        else f"if the clock of the recorder was set back about {v['longest_at']}, choose a span without that: under [scene] "
        "set from and until",
    ),
    "recording_gaps": Kind(
        NOTICE, "A recording in pieces, or in images, has gaps.", _gaps,
    ),
    "recording_long": Kind(
        NOTICE, "The recording lasts for hours, and no span of it is chosen.", _long,
        lambda v: "choose about half an hour with many people: "
        + (
            'under [scene] set from = "08:00" and until = "08:30", for example'
            if v["first"] is not None
            else f"under [cameras.{v['camera']}] set until_s"
        ),
    ),
    "wall_clock_missing": Kind(
        NOTICE, "Some cameras' files tell their wall times, and those of these cameras do not.",
        "{who}: it is not known when the recording began, but that of other cameras is: it is assumed to begin at {origin}, as "
        "the first of them",
        "state the times of its files (video_names or video_times), or let a larger clock offset be searched for: under "
        "[association] set max_offset_s", common=True,
    ),
    "field_of_view_seen": Kind(
        NOTICE, "A network sees the camera's field of view in its video; its focal length is sought about that.",
        "camera {camera}: {network} sees a horizontal field of view of {hfov_deg:.0f} degrees in its video (1 sigma of the "
        "focal length: {sd_percent:.0f} %)",
    ),
    "network_missing": Kind(
        NOTICE, "The network for this `role` is unavailable; `why` is the text of the error.",
        lambda v: f"{v['why']}: {_INSTEAD[v['role']]}",
    ),
    "network_to_fetch": Kind(
        NOTICE, "A network would be fetched; `otherwise` is used instead if that fails.", _to_fetch,
    ),
}  # fmt: skip
