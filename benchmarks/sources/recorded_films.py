"""Films of four cameras as recorders have them, with key frames every two seconds, and what is calibrated from them."""

from __future__ import annotations

import contextlib
import io
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import av
import numpy as np

from passerby.calibration.calibrate import calibrate
from passerby.calibration.calibration import Calibration
from passerby.evaluation.metrics import compare
from passerby.interchange.rig_toml import read_rig
from passerby.scene.scene import Scene
from sources.containers import PERCEPTION, SEED, packed, rendered_film
from sources.packaging import PLAIN

CAMERAS, SECONDS = 4, 100.0
CODED = replace(PLAIN, key="coded", b_frames=0)
"""As network cameras send it: no picture refers to a later one."""
BEGIN = datetime(2026, 11, 22, 7, 59, 10, tzinfo=UTC)
"""Wall time of the films' second 0. Frigate has folders of hours: the recordings lie in two."""


METHOD = f'{PERCEPTION}[association]\nmode = "combined"\n'
"""Of a scene file: no networks, clocks searched for as by default."""


def coded_films(scenes: Path, seconds: float = SECONDS, seed: int = SEED) -> Path:
    """The folder of the films, `coded/NAME.mp4`, with `truth.toml` and `intrinsics.toml`; made unless it is there."""
    film = rendered_film(scenes, CAMERAS, seconds, seed)
    if not (film / "coded").is_dir():
        part = film / f"coded-{os.getpid()}.part"
        part.mkdir()
        for name in names_of(film):
            packed(CODED, film, name, part)
        part.rename(film / "coded")
    return film


def names_of(film: Path) -> tuple[str, ...]:
    """The cameras of a film's folder."""
    return read_rig(film / "truth.toml").names


def cut(video: Path, piece_s: float, path_of: Callable[[float], Path], from_s: float = 0.0) -> dict[Path, float]:
    """Cut a video as recorders do: packets are copied, and each piece begins with a key frame.

    Args:
        video: any video file.
        piece_s: least length of a piece.
        path_of: the file of the piece that begins at a second of the video.
        from_s: what is before is left out.

    Returns:
        Path -> second of the video at which it begins.
    """
    pieces: list[list[av.Packet[Any]]] = []
    with av.open(str(video)) as source:
        stream = source.streams.video[0]
        for packet in source.demux(stream):
            if packet.pts is None:
                continue
            second = float(packet.pts * packet.time_base)
            if packet.is_keyframe and second >= from_s + piece_s * len(pieces) - 0.01:
                pieces.append([])
            if pieces:
                pieces[-1].append(packet)
        begins = {}
        for packets in pieces:
            first, second = packets[0].dts, float(packets[0].pts * packets[0].time_base)
            path = path_of(second)
            path.parent.mkdir(parents=True, exist_ok=True)
            with av.open(str(path), "w") as target:
                copy = target.add_stream_from_template(stream)
                for packet in packets:
                    packet.pts, packet.dts, packet.stream = packet.pts - first, packet.dts - first, copy
                    target.mux(packet)
            begins[path] = second
    return begins


def scene_of(film: Path, videos: Mapping[str, str], folder: Path) -> Path:
    """A scene file of what was recorded."""
    text = "".join(
        f'[cameras.{name}]\nintrinsics = "{(film / "intrinsics.toml").as_posix()}"\nvideo = "{video}"\n'
        for name, video in videos.items()
    )
    (folder / "scene.toml").write_text(text + METHOD, encoding="utf-8")
    return folder / "scene.toml"


def calibrated(scene: Path, film: Path, clocks_off_s: Mapping[str, float]) -> dict[str, Any]:
    """A scene's rig, clock offsets and gaps against the truth: plain values.

    `clocks_off_s` is how much more each camera's clock shows than the true time.
    """
    began = time.process_time()
    truth = read_rig(film / "truth.toml")
    with contextlib.redirect_stderr(io.StringIO()):
        found = calibrate(Scene.load(scene))
    out: dict[str, Any] = {
        "cpu_s": time.process_time() - began, "verdict": found.verdict, "registered": len(found.rig.posed()),
        "mm": None, "deg": None, "offset_ms": _worst_offset_ms(found, clocks_off_s),
        "gaps": [[*one.cameras, one.values["count"], one.values["seconds"]] for one in _gaps(found)],
    }  # fmt: skip
    if len(found.rig.posed()) < 2:
        return out
    similar = compare(found.rig.posed(), truth).similarity
    return out | {"mm": similar.mean_position_mm, "deg": similar.mean_orientation_deg}


def _gaps(found: Calibration) -> list[Any]:
    return [one for one in found.diagnostics if one.code == "recording_gaps"]


def _worst_offset_ms(found: Calibration, clocks_off_s: Mapping[str, float]) -> float | None:
    """The largest error of a registered camera's offset against the first one's."""
    names = found.rig.posed().names
    if found.association is None or len(names) < 2:
        return None
    clocks = found.association.clocks
    # What is added to a clock that shows too much is negative.
    off = np.array([clocks[name].offset_s + clocks_off_s.get(name, 0.0) for name in names])
    return float(1000 * np.abs(off - off[0]).max())
