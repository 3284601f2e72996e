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


VIDEOS: Mapping[str, Kind] = {
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
