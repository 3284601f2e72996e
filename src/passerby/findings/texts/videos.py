"""Findings about videos, and about the networks that people are found with."""

from __future__ import annotations

from collections.abc import Mapping

from passerby.findings.texts.kinds import NOTICE, Fields, Kind

_INSTEAD = {
    "detector": "people are found by background subtraction, without a network",
    "embedder": "people are told apart by the colours of stripes, without a network",
}


def _to_fetch(v: Fields) -> str:
    text = f"{v['why']}, and so does calibrating"
    return text if v["otherwise"] is None else f"{text}; {v['otherwise']} takes its place where it cannot be had"


VIDEOS: Mapping[str, Kind] = {
    "camera_bumped": Kind(
        NOTICE, "The camera moves for a while and comes back.",
        lambda v: f"camera {v['camera']}: the camera is knocked {v['from_s']:.1f} s after the beginning, "
        f"{'farther than can be told' if v['pixels'] is None else 'by {:.0f} pixels'.format(v['pixels'])}, and is back after "
        f"{v['until_s']:.1f} s",
    ),
    "frames_undecodable": Kind(
        NOTICE, "Some pictures of the video could not be decoded.",
        "camera {camera}: {broken} pictures or packets could not be decoded, the first after {first_s:.1f} s",
    ),
    "network_missing": Kind(
        NOTICE, "The network for this `role` could not be had; `why` has the words of the fault.",
        lambda v: f"{v['why']}: {_INSTEAD[v['role']]}",
    ),
    "network_to_fetch": Kind(
        NOTICE, "A network would be fetched; `otherwise` is what takes its place.", _to_fetch,
    ),
}  # fmt: skip
