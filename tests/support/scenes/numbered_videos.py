"""Videos of which every picture carries its number in its pixels."""

from pathlib import Path

import numpy as np

from passerby.interchange.video_writer import VideoWriter

SIZE = (96, 64)
BITS = 8


def numbered(number: int, size: tuple[int, int] = SIZE) -> np.ndarray:
    """A picture whose eight vertical stripes are the bits of its number; black in the upper left, red in the lower right."""
    picture = np.zeros((size[1], size[0], 3), dtype=np.uint8)
    for bit in range(BITS):
        picture[:, bit * size[0] // BITS : (bit + 1) * size[0] // BITS] = 215 if number >> bit & 1 else 40
    picture[-16:, -12:] = (0, 0, 255)
    return picture


def number_in(picture: np.ndarray) -> int:
    """What `numbered` wrote."""
    middle = picture[picture.shape[0] // 4 : picture.shape[0] // 2]
    return sum(int(part.mean() > 128) << bit for bit, part in enumerate(np.array_split(middle, BITS, axis=1)))


def written(path: Path, count: int = 100, fps: float = 25, seconds: list[float] | None = None) -> Path:
    """A video of the pictures 1 to `count`, a key frame every second."""
    with VideoWriter(path, SIZE, fps, crf=20, key_every=25) as video:
        for k in range(count):
            video.write(numbered(k + 1), None if seconds is None else seconds[k])
    return path
