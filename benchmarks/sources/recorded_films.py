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
from passerby.perception.video import VideoReader, probe
from passerby.scene.scene import Scene
from passerby.simulation import SimulationOptions, simulate, write_scene
from passerby.simulation.rendering import RenderOptions
from sources.packaging import PLAIN, Packaging, pack

PRESET, SEED, FPS = "terrace", 800_000, 10.0
CAMERAS, SECONDS = 4, 100.0
METHOD = """[perception]
detector = "background"
embedder = "stripes"
keypoints = "none"
[association]
mode = "combined"
"""  # of a scene file: no networks, clocks searched for as by default
CODED = replace(PLAIN, key="coded", b_frames=0)  # as network cameras send it: no picture refers to a later one
BEGIN = datetime(2026, 11, 22, 7, 59, 10, tzinfo=UTC)
"""Wall time of the films' second 0. Frigate has folders of hours: the recordings lie in two."""


def rendered_film(scenes: Path, cameras: int = 3, seconds: float = 40.0, seed: int = SEED) -> Path:
    """The folder of a film, as `passerby simulate --video` writes it; made unless it is there."""
    folder = scenes / f"sources-{PRESET}-{seed}-{cameras}-{seconds:g}-{FPS:g}"
    if not (folder / "scene.toml").is_file():
        options = SimulationOptions(preset=PRESET, seed=seed, cameras=cameras, seconds=seconds, fps=FPS, unrelated_ids=True)
        write_scene(simulate(options), folder, video=RenderOptions())
    return folder


def packed(packaging: Packaging, film: Path, name: str, folder: Path) -> str:
    """A camera's rendered film, packed into a folder; its lines in the scene file."""
    video = next(path for path in (film / "videos" / f"{name}.mp4", film / f"{name}.mp4") if path.is_file())
    pictures = (frame.picture for frame in VideoReader(video))
    return pack(packaging, pictures, probe(video).frames or 0, FPS, folder, name)


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

    Returns path -> second of the video at which it begins.
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
    lines = {name: f'video = "{video}"\n' for name, video in videos.items()}
    (folder / "scene.toml").write_text(scene_text(film, lines), encoding="utf-8")
    return folder / "scene.toml"


def scene_text(film: Path, lines: Mapping[str, str]) -> str:
    """The same with any lines for each camera; it ends with the table `[association]`."""
    intrinsics = f'intrinsics = "{(film / "intrinsics.toml").as_posix()}"\n'
    return "".join(f"[cameras.{name}]\n{intrinsics}{own}" for name, own in lines.items()) + METHOD


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
    clocks = found.association.clocks if found.association else {}
    if len(names) < 2 or not {*names} <= clocks.keys():
        return None
    # What is added to a clock that shows too much is negative.
    off = np.array([clocks[name].offset_s + clocks_off_s.get(name, 0.0) for name in names])
    return float(1000 * np.abs(off - off[0]).max())
