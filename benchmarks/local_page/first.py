"""From the command to the first picture in the browser, sixteen cameras with an hour of video each."""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np

from local_page.hand import SIZE, chromium
from local_page.serving import TIMEOUT_S, served
from pages.tables import load
from passerby.interchange.storage.atomic import write_text
from passerby.interchange.video_writer import VideoWriter

CAMERAS, SECONDS = 16, 3600
FILM_SIZE, FPS, KEY_EVERY = (1920, 1080), 25, 250  # as cameras record: a key frame every ten seconds
CLIP_S = 20
LOOKS = 4  # different clips; cameras of the same clip differ by where their films begin


def hour_scene(folder: Path) -> Path:
    """The scene file; the films are made once. They hold clips again and again, copied without encoding them anew."""
    scene = folder / "scene.toml"
    if scene.is_file():
        return scene
    folder.mkdir(parents=True, exist_ok=True)
    clips = [_clip(folder / f"clip{number}.mp4", number) for number in range(LOOKS)]
    lines = ["[scene]", 'name = "an hour"']
    for number in range(CAMERAS):
        name = f"C{number + 1}"
        _repeat(clips[number % LOOKS], folder / f"{name}.mp4", SECONDS // CLIP_S + number // LOOKS)
        lines += [f"[cameras.{name}]", f'video = "{name}.mp4"']
    write_text(scene, "\n".join([*lines, ""]))
    return scene


def _clip(path: Path, seed: int) -> Path:
    """A still background, with a rectangle that walks through it."""
    rng = np.random.default_rng(seed)
    width, height = FILM_SIZE
    coarse = rng.integers(40, 200, (height // 60, width // 60, 3), dtype=np.uint8)
    background = np.kron(coarse, np.ones((60, 60, 1), dtype=np.uint8))
    with VideoWriter(path, FILM_SIZE, FPS, crf=32, key_every=KEY_EVERY) as video:
        for number in range(CLIP_S * FPS):
            picture = background.copy()
            left = (seed * 300 + 3 * number) % (width - 80)
            picture[500:800, left : left + 80] = 20
            video.write(picture)
    return path


def _repeat(clip: Path, path: Path, times: int) -> None:
    """A film of the same packets again and again."""
    with av.open(str(clip)) as source:
        stream = source.streams.video[0]
        packets = [packet for packet in source.demux(stream) if packet.pts is not None]
        content = [(bytes(packet), packet.pts, packet.dts, packet.is_keyframe) for packet in packets]
        base = stream.time_base
        assert base is not None
        length = round(Fraction(CLIP_S) / base)
        with av.open(str(path), "w") as film:
            copied = film.add_stream_from_template(stream)
            for again in range(times):
                for data, pts, dts, is_key in content:
                    packet = av.Packet(data)
                    packet.stream, packet.time_base, packet.is_keyframe = copied, base, is_key
                    packet.pts, packet.dts = pts + again * length, dts + again * length
                    film.mux(packet)


REPEATS = 5
SHOWN = "() => [...document.querySelectorAll('.stage img')].filter((one) => one.complete && one.naturalWidth > 0).length"


@dataclass(frozen=True)
class FirstCase:
    """Where the films are, and which repetition it is."""

    films: Path
    repeat: int


def cases(films: Path, repeats: int) -> dict[str, FirstCase]:
    """By key."""
    return {f"first {repeat}": FirstCase(films, repeat) for repeat in range(repeats)}


def work(case: FirstCase) -> dict[str, Any]:
    """Seconds until the address is printed, the first picture is shown, and all are. The browser runs already."""
    scene = hour_scene(case.films)
    with tempfile.TemporaryDirectory() as scratch, chromium() as browser:
        page = browser.new_page(viewport=SIZE)  # type: ignore[arg-type]
        page.goto("about:blank")
        with served(scene, Path(scratch) / "out") as server:
            address_s = time.perf_counter() - server.began
            page.goto(server.address, wait_until="commit")
            first_s, cpu_s = _until(server.began, page, 1), server.cpu_s
            all_s = _until(server.began, page, CAMERAS)
    return {"address_s": address_s, "first_s": first_s, "all_s": all_s, "first_cpu_s": cpu_s, "load": load()}


def _until(began: float, page: Any, count: int) -> float:
    while page.evaluate(SHOWN) < count:
        if time.perf_counter() - began > TIMEOUT_S:
            raise TimeoutError(f"{count} pictures")
        time.sleep(0.01)
    return time.perf_counter() - began
