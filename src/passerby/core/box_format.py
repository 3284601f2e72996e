"""The conventions in which tools write boxes: which four numbers a box is, and in which unit.

Four numbers are left, top, width, height (MOTChallenge, COCO); left, top, right, bottom (most detectors in memory); or
centre x, centre y, width, height. Each is in pixels or, normalised, in shares of the image's width and height (YOLO text:
centres).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.text import shortened

Convention = Literal["ltwh", "corners", "centres"]
CONVENTIONS: tuple[Convention, ...] = get_args(Convention)

_COLUMNS: dict[Convention, tuple[str, str, str, str]] = {
    "ltwh": ("left", "top", "width", "height"),
    "corners": ("left", "top", "right", "bottom"),
    "centres": ("centre x", "centre y", "width", "height"),
}


@dataclass(frozen=True)
class BoxFormat:
    """How four numbers are a box."""

    convention: Convention = "ltwh"
    normalised: bool = False
    """Whether the numbers are shares of the image's width and height, and not pixels."""

    @classmethod
    def of_text(cls, text: str) -> BoxFormat:
        """The format that a word names, as "corners" or "normalised centres"; "normalized" and "centers" are accepted.

        Raises `ValueError` with the words that exist.
        """
        words = re.findall(r"[a-z]+", text.lower().replace("centers", "centres").replace("normalized", "normalised"))
        found = [format for format in FORMATS if sorted(words) == sorted(str(format).split())]
        if not found:
            raise ValueError(f"{shortened(text)} is no box format: write one of {', '.join(map(str, FORMATS))}")
        return found[0]

    def __str__(self) -> str:
        return f"normalised {self.convention}" if self.normalised else self.convention

    @property
    def columns(self) -> tuple[str, str, str, str]:
        """Names of the four numbers."""
        return _COLUMNS[self.convention]

    def to_ltwh(self, numbers: Floats, size: tuple[int, int] | None = None) -> Floats:
        """(N, 4) left, top, width, height; widths and heights are negative where corners are exchanged.

        Args:
            numbers: (N, 4) in this format.
            size: width and height of the image, pixels: shares become pixels. None: the unit stays.
        """
        first, last = numbers[:, :2], numbers[:, 2:]
        if self.convention == "corners":
            last = last - first
        elif self.convention == "centres":
            first = first - last / 2
        return np.asarray(np.concatenate([first, last], axis=1) * self._scale(size))

    def of_ltwh(self, ltwh: Floats, size: tuple[int, int] | None = None) -> Floats:
        """(N, 4) numbers in this format; the inverse of `to_ltwh`.

        Args:
            ltwh: (N, 4) left, top, width, height, pixels.
            size: width and height of the image, pixels: pixels become shares where the format has them.
        """
        ltwh = ltwh / self._scale(size)
        first, last = ltwh[:, :2], ltwh[:, 2:]
        if self.convention == "corners":
            last = first + last
        elif self.convention == "centres":
            first = first + last / 2
        return np.asarray(np.concatenate([first, last], axis=1))

    def _scale(self, size: tuple[int, int] | None) -> Floats:
        return np.tile(np.array(size if self.normalised and size is not None else (1, 1), dtype=np.float64), 2)


FORMATS = tuple(BoxFormat(convention, normalised) for normalised in (False, True) for convention in CONVENTIONS)
LTWH = BoxFormat()
"""Left, top, width, height in pixels: what Passerby computes with and writes."""
