"""Tiny sets of pictures of people in the layouts of published ones, and a tiny video with tracks."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from passerby.core.observations import Boxes
from passerby.interchange.motchallenge import write_boxes
from passerby.interchange.video_writer import VideoWriter

SIZE = (160, 120)
"""Of the video's pictures, width and height."""


def picture(path: Path, seed: int = 0, size: tuple[int, int] = (16, 32)) -> Path:
    """A picture of noise, width and height `size`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    values = np.random.default_rng(seed).integers(0, 256, (size[1], size[0], 3)).astype(np.uint8)
    assert cv2.imwrite(str(path), values)
    return path


def pictures(folder: Path, names: str) -> Path:
    """Pictures of these names, parted by spaces."""
    for number, name in enumerate(names.split()):
        picture(folder / name, number)
    return folder


def market(folder: Path) -> Path:
    """Two people to learn from, two to search for, junk and a distractor."""
    pictures(
        folder / "bounding_box_train",
        "0002_c1s1_000451_03.jpg 0002_c2s1_000500_01.jpg 0007_c1s1_000451_01.jpg 0007_c3s2_000451_01.jpg",
    )
    pictures(folder / "query", "0001_c1s1_001051_00.jpg 0003_c2s1_001051_00.jpg")
    pictures(
        folder / "bounding_box_test",
        "-1_c1s1_000401_03.jpg 0000_c4s1_000401_03.jpg 0001_c2s1_001976_01.jpg 0003_c1s1_000076_01.jpg 0003_c2s1_000077_01.jpg",
    )
    (folder / "query" / "Thumbs.db").write_bytes(b"what Windows leaves behind")
    return folder


def msmt17(folder: Path, train: str = "train", test: str = "test") -> Path:
    """Person 0 in train and val, person 1 in train; another person 0 in query and gallery."""
    lists = {
        "list_train.txt": (train, "0000/0000_000_01_0303morning_0015_0.jpg 0\n0001/0001_000_14_0303noon_0015_0.jpg 1\n"),
        "list_val.txt": (train, "0000/0000_001_02_0303morning_0020_0.jpg 0\n0001/0001_001_05_0303noon_0015_0.jpg 1\n"),
        "list_query.txt": (test, "0000/0000_000_03_0303morning_0015_0.jpg 0\n"),
        "list_gallery.txt": (test, "0000/0000_001_04_0303morning_0015_0.jpg 0\n"),
    }
    for name, (place, text) in lists.items():
        (folder / place).mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
        pictures(folder / place, " ".join(line.split()[0] for line in text.splitlines()))
    return folder


def scene(seed: int) -> np.ndarray:
    """(H, W, 3) a picture whose pixels all differ, smooth enough for a codec."""
    coarse = np.random.default_rng(seed).integers(40, 216, (6, 8, 3)).astype(np.float32)
    return cv2.resize(coarse, SIZE, interpolation=cv2.INTER_CUBIC).clip(0, 255).astype(np.uint8)


def film(path: Path, count: int = 30, seed: int = 0) -> Path:
    """A video whose picture k is `scene(seed + k)`, k from 1."""
    with VideoWriter(path, SIZE, 10.0, crf=0, key_every=5) as video:
        for number in range(1, count + 1):
            video.write(scene(seed + number))
    return path


def tracks(path: Path, rows: list[tuple[int, int, float, float, float, float]]) -> Boxes:
    """MOTChallenge text of (frame, identity, left, top, width, height)."""
    table = np.array(sorted(rows), dtype=float).reshape(-1, 6)
    boxes = Boxes(table[:, 0].astype(int), table[:, 1].astype(int), table[:, 2:], np.ones(len(table)))
    write_boxes(path, boxes)
    return boxes


def two_walkers(
    first: int = 1, last: int = 30, ids: tuple[int, int] = (4, 9)
) -> list[tuple[int, int, float, float, float, float]]:
    """Two people who walk far from each other."""
    return [
        (frame, identity, left + 0.7 * frame, 20.3, 19.6, 50.2)
        for frame in range(first, last + 1)
        for identity, left in zip(ids, (10.2, 100.4), strict=True)
    ]
