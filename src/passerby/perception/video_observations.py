"""Observations from one camera's video."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from passerby.core.observations import Boxes, Keypoints
from passerby.findings.finding import Finding, notice
from passerby.interchange.storage.text_formats import key
from passerby.perception.places import find_moves_between
from passerby.perception.video_probe import VideoInfo


@dataclass(frozen=True, eq=False)
class VideoObservations:
    """Observations from one camera's video."""

    boxes: Boxes
    """Boxes of all processed pictures; identities -1 or those that were given; embeddings if they were requested."""
    keypoints: Keypoints
    pictures: int
    """Number of processed pictures."""
    summary: dict[str, Any]
    """Result of decoding, and the camera's moves: `ended_early`, `broken`, `moves`."""
    seconds: dict[str, float] = field(default_factory=dict)
    """Time spent by each stage in this run."""
    made_again: bool = False
    """Whether there were finished results that could not be used: of another video, other options or other versions."""
    begin_s: float = 0.0
    """Beginning of the processed part, seconds of the video."""
    view: NDArray[np.uint8] | None = None
    """The camera's view from its place (`SteadinessWatcher.view`); only for a stretch that is processed separately."""

    def faults(self, name: str, info: VideoInfo, from_s: float = 0.0, until_s: float = math.inf, stated: int = 0) -> list[str]:
        """Return errors of the part of the video between two times, seconds; `stated` is the scene's `rotate`."""
        place, found = f"{info.path}: camera {name}", []
        early = self.summary["ended_early"]
        if early is not None:
            found.append(
                f"{place}: {early}: copy the video again, or save the readable part with `ffmpeg -i {info.path.name} -c copy "
                "whole.mp4`"
            )
        if (rotate := self.summary.get("rotate")) is not None:
            lie = "stand on their heads" if (rotate - stated) % 360 == 180 else "lie on their side"
            found.append(
                f"{place}: people {lie} in its images: under [cameras.{key(name)}] set rotate = {rotate} (degrees clockwise), "
                "and keep the intrinsics of the images as filmed"
                if rotate
                else f"{place}: people {lie} in its images after these are turned: under [cameras.{key(name)}] delete rotate"
            )
        found += [
            f"{place}: the camera {_what(move)} {move['seconds']:.1f} s after the start, {_name_progress(move)}, and stays "
            f"{_require(move)}: under [cameras.{key(name)}] set until_s = {math.floor(move['seconds'])} for "
            f"the part before, or from_s = {math.ceil(move['seconds']) + 1} for the part after, or delete [cameras.{key(name)}]"
            for move in self.summary["moves"]
            if move["until"] is None and from_s < move["seconds"] < until_s
        ]
        return found

    def findings(self, name: str, info: VideoInfo) -> list[Finding]:
        """Return the findings about the video that do not stop a calibration."""
        place, broken = str(info.path), self.summary["broken"]
        found = [
            notice("camera_bumped", name, place=place, from_s=move["seconds"], until_s=move["until"], pixels=move["pixels"])
            for move in self.summary["moves"]
            if move["until"] is not None
        ]
        if (rotate := self.summary.get("wide_shapes_rotate")) is not None:
            found.append(notice("people_seem_sideways", name, place=place, rotate=rotate, other=(rotate + 180) % 360))
        if broken:
            first = self.summary["first_broken_s"]
            found.append(notice("frames_undecodable", name, place=place, broken=broken, first_s=first))
        cut, failed = self.summary.get("cut_pieces", 0), self.summary.get("failed_pieces", 0)
        if cut or failed:
            found.append(notice("pieces_broken", name, place=place, cut=cut, failed=failed, files=len(info.files)))
        return found


def join_stretches(parts: Sequence[VideoObservations], size: tuple[int, int]) -> VideoObservations:
    """Join observations of stretches of one video, in order of time; `size` (width, height) of its pictures, pixels."""
    boxes, keypoints = [part.boxes for part in parts], [part.keypoints for part in parts]
    embeddings = [one.embedding for one in boxes if one.embedding is not None]
    joined = Boxes(
        frame=np.concatenate([one.frame for one in boxes]),
        identity=np.concatenate([one.identity for one in boxes]),
        ltwh=np.concatenate([one.ltwh for one in boxes]),
        score=np.concatenate([one.score for one in boxes]),
        embedding=np.concatenate(embeddings) if len(embeddings) == len(boxes) else None,
    )
    with_joints = [one for one in keypoints if len(one)] or keypoints[:1]
    joints = Keypoints(
        frame=np.concatenate([one.frame for one in with_joints]),
        identity=np.concatenate([one.identity for one in with_joints]),
        xy=np.concatenate([one.xy for one in with_joints]),
        score=np.concatenate([one.score for one in with_joints]),
        joints=with_joints[0].joints,
    )
    summaries = [part.summary for part in parts]
    first = [one["first_broken_s"] for one in summaries if one["first_broken_s"] is not None]
    moves = [move for one in summaries for move in one["moves"]]
    if all(move["until"] is not None for move in moves):
        views = [(part.begin_s, part.view) for part in parts if part.view is not None]
        moves += [asdict(move) for move in find_moves_between(views, size)]
    summary = {
        "pictures": sum(part.pictures for part in parts),
        "ended_early": next((early for one in summaries if (early := one["ended_early"]) is not None), None),
        "broken": sum(one["broken"] for one in summaries),
        "first_broken_s": min(first, default=None),
        "moves": moves,
        "shake_px": max(one["shake_px"] for one in summaries),
        "cut_pieces": sum(one.get("cut_pieces", 0) for one in summaries),
        "failed_pieces": sum(one.get("failed_pieces", 0) for one in summaries),
    }
    for turned in ("rotate", "wide_shapes_rotate"):
        turns = {one.get(turned) for one in summaries}
        summary |= {turned: turns.pop()} if len(turns) == 1 and None not in turns else {}
    seconds = Counter[str]()
    for part in parts:
        seconds.update(part.seconds)
    made_again = any(part.made_again for part in parts)
    return VideoObservations(joined, joints, summary["pictures"], summary, dict(seconds), made_again)


def _zooms(move: Mapping[str, Any]) -> bool:
    return bool(move.get("zoom", 1.0) != 1.0)  # results of older versions have none


def _what(move: Mapping[str, Any]) -> str:
    return "moves" if not _zooms(move) else "zooms in" if move["zoom"] > 1 else "zooms out"


def _name_progress(move: Mapping[str, Any]) -> str:
    if _zooms(move):
        return f"by a factor of {max(move['zoom'], 1 / move['zoom']):.2f}"
    return "by an unknown amount" if move["pixels"] is None else f"by {move['pixels']:.0f} pixels"


def _require(move: Mapping[str, Any]) -> str:
    return "so: a fixed focal length is needed" if _zooms(move) else "there: static cameras are needed"
