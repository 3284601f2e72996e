"""A camera's view from its place in each stretch of a recording: kept with it, and compared to find moves between stretches."""

from __future__ import annotations

import base64
from collections.abc import Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.perception.steadiness import MOVED_PART, Move, Reference, centre_of, scale_of


def find_moves_between(views: Iterable[tuple[float, NDArray[np.uint8]]], size: tuple[int, int]) -> list[Move]:
    """Find the moves of a camera that stood still while each of some views was made.

    A view in which no earlier one is recognised gives no information: the light may have changed in between.

    Args:
        views: seconds at which the camera began to see each view, and the view (`SteadinessWatcher.view`), in order of time.
        size: (width, height) of the camera's pictures, pixels.
    """
    moves = list[Move]()
    known: list[tuple[Reference, Floats]] = []
    """Views in which no earlier one is recognised, each with the motion from it to the camera's last place."""
    for seconds, view in views:
        for number in reversed(range(len(known))):
            reference, rest = known[number]
            found = reference.motion_to(view, rest)
            if found is None:
                continue
            if (shift := found.shift_from(rest) * scale_of(size)) > MOVED_PART * size[0]:
                moves.append(Move(seconds, None, shift, found.zoom_from(rest, centre_of(size))))
                known[number] = reference, found.motion
            break
        else:
            known.append((Reference(view), np.eye(2, 3)))
    return moves


def text_of_view(view: NDArray[np.uint8]) -> str:
    """Convert a grey picture (H, W) to text: PNG in base 64."""
    return base64.b64encode(cv2.imencode(".png", view)[1].tobytes()).decode("ascii")


def view_of_text(text: str) -> NDArray[np.uint8]:
    """Convert the text of `text_of_view` back to the picture (H, W)."""
    picture = cv2.imdecode(np.frombuffer(base64.b64decode(text), dtype=np.uint8), cv2.IMREAD_GRAYSCALE)
    return np.asarray(picture, dtype=np.uint8)
