"""Small videos whose people are puppets, drawn where a simulation has them: quick to make and quick to watch."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from passerby.core.cameras import Lens, Rig
from passerby.core.observations import Boxes
from passerby.interchange.motchallenge import write_boxes
from passerby.interchange.rig_toml import write_rig
from passerby.interchange.video_writer import VideoWriter
from passerby.simulation import SimulationOptions, simulate

SCALE = 0.5
"""The terrace's pictures, 720 x 576, at half their size."""
TEXTURE = 14.0
"""Standard deviation of the walls' grey levels."""


def halved(lens: Lens) -> Lens:
    """The lens of the same camera with half the pixels; (0, 0) is the middle of the first one."""
    shrink = np.array([[SCALE, 0, (SCALE - 1) / 2], [0, SCALE, (SCALE - 1) / 2], [0, 0, 1]])
    size = (int(lens.size[0] * SCALE), int(lens.size[1] * SCALE))
    return replace(lens, size=size, matrix=shrink @ lens.matrix)


@dataclass(frozen=True, eq=False)
class Puppets:
    """A scene whose pictures are small."""

    rig: Rig
    """With the true poses."""
    boxes: dict[str, Boxes]
    """As they are drawn; identities are the true ones."""
    fps: float
    count: int
    """Of the pictures of each camera."""


def puppets(
    seconds: float = 14.0, fps: float = 10.0, cameras: int = 3, people: int = 5, seed: int = 0, offsets: tuple[float, ...] = ()
) -> Puppets:
    """Puppets on the simulated terrace; `offsets` are the clocks', seconds, one for each camera."""
    options = SimulationOptions(
        cameras=cameras, people=people, seconds=seconds, fps=fps, seed=seed, occlusion=False, clock_offsets=offsets or 0.0
    )
    made = simulate(options)
    boxes = {
        name: replace(found, ltwh=(found.ltwh + [0.5, 0.5, 0, 0]) * SCALE - [0.5, 0.5, 0, 0])
        for name, found in made.truth.items()
    }
    rig = Rig(tuple(replace(camera, lens=halved(camera.lens)) for camera in made.rig))
    return Puppets(rig, boxes, fps, len(made.frames))


def wall(size: tuple[int, int], seed: int) -> np.ndarray:
    """(H, W, 3) a textured background."""
    coarse = np.random.default_rng(seed).normal(128, TEXTURE, (size[1] // 24, size[0] // 24, 3))
    return cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC).clip(0, 255).astype(np.uint8)


def draw(picture: np.ndarray, ltwh: np.ndarray, who: int) -> None:
    """A puppet that fills its box: head, shirt and trousers, each in colours of its own."""
    left, top, width, height = (ltwh + [0.5, 0.5, 0, 0]).tolist()
    rng = np.random.default_rng((7, who))
    dark = int(rng.integers(2))
    shirt, trousers = (np.array(c) for c in ((rng.integers(0, 60, 3), rng.integers(190, 255, 3))[:: 1 if dark else -1]))
    shirt[who % 3] = 255 - shirt[who % 3]

    def part(high: float, low: float, share: float, colour: np.ndarray | tuple[int, ...]) -> None:
        half = share * width / 2
        corners = np.array([[left + width / 2 - half, top + high * height], [left + width / 2 + half, top + low * height]])
        first, last = np.rint(corners * 16).astype(int) - 8
        cv2.rectangle(picture, first.tolist(), last.tolist(), [int(value) for value in colour], -1, shift=4)

    part(0.0, 0.2, 0.45, (120, 160, 220))
    part(0.15, 0.55, 1.0, shirt)
    part(0.5, 1.0, 0.9, trousers)


def pictures(made: Puppets, name: str, noise: float = 1.5) -> Iterator[np.ndarray]:
    """All pictures of one camera, the nearest people before the others."""
    boxes, names = made.boxes[name], made.rig.names
    rng, behind = np.random.default_rng(names.index(name)), wall(made.rig[name].lens.size, 100 + names.index(name))
    grain = np.rint(rng.normal(0, noise, behind.shape)).astype(np.int16)
    for number in range(1, made.count + 1):
        picture = behind.copy()
        rows = np.flatnonzero(boxes.frame == number)
        for row in rows[np.argsort(boxes.ltwh[rows, 1] + boxes.ltwh[rows, 3], kind="stable")]:
            draw(picture, boxes.ltwh[row], int(boxes.identity[row]))
        yield cv2.add(picture, np.roll(grain, int(rng.integers(grain.size))), dtype=cv2.CV_8U)


def film(made: Puppets, folder: Path, names: tuple[str, ...] | None = None, key_every: int = 250) -> None:
    """`CAMERA.mp4` of all cameras or of some, `rig.toml` of all lenses, `truth.toml`, and `CAMERA.txt`, the true boxes."""
    folder.mkdir(parents=True, exist_ok=True)
    write_rig(folder / "rig.toml", Rig(tuple(replace(camera, pose=None, sigma=None) for camera in made.rig)))
    write_rig(folder / "truth.toml", made.rig)
    for name in made.rig.names if names is None else names:
        write_video(folder / f"{name}.mp4", pictures(made, name), made.fps, key_every=key_every)
        write_boxes(folder / f"{name}.txt", in_order(made.boxes[name]))


def in_order(boxes: Boxes) -> Boxes:
    """Rows as they are written."""
    return boxes.take(np.lexsort((boxes.identity, boxes.frame)))


def write_video(
    path: Path, frames: Iterator[np.ndarray], fps: float, seconds: Iterator[float] | None = None, key_every: int = 250
) -> Path:
    """A video of these pictures, with times of their own where `seconds` gives them."""
    first = next(frames)
    with VideoWriter(path, (first.shape[1], first.shape[0]), fps, crf=18, key_every=key_every) as video:
        for picture in itertools.chain([first], frames):
            video.write(picture, None if seconds is None else next(seconds))
    return path


def scene_file(folder: Path, cameras: dict[str, str], extra: str = "", perception: str = "", name: str = "scene.toml") -> Path:
    """A scene file; `cameras` are the lines of each camera's table, or a video's name alone.

    Weight-free and with clocks that agree, unless `extra` and `perception` say otherwise: nothing is looked for elsewhere.
    """
    text = ""
    for camera, lines in cameras.items():
        lines = lines if "=" in lines else f'video = "{lines}"'
        text += f'[cameras.{camera}]\nintrinsics = "rig.toml"\n{lines}\n'
    perception = perception or 'detector = "background"\nembedder = "stripes"\nkeypoints = "none"'
    extra = extra or "[association]\nmax_offset_s = 0"
    (folder / name).write_text(f"{text}[perception]\n{perception}\n{extra}\n")
    return folder / name
