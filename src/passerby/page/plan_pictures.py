"""The plan's picture as a browser is shown it: decoded as a calibration decodes it, so that both count the same pixels."""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from passerby.common.errors import InputError
from passerby.interchange.plan_picture import decode_plan_picture
from passerby.interchange.storage.safe_parsing import file_bytes
from passerby.page.plan_upload import MOST_PIXELS, UPLOADED, picture_header
from passerby.page.session import Session

LARGEST_PX = 4096
"""Of the longer side of what is shown: every browser draws so much."""
QUALITY = 90
KEPT = 3


@dataclass(frozen=True)
class ShownPlan:
    """A plan as it is sent to a browser."""

    data: bytes
    media_type: str
    size: tuple[int, int]
    """(width, height) of the file's picture, pixels; what is sent may be smaller."""


@dataclass(eq=False)
class PlanPictures:
    """The last plans that were shown."""

    _kept: OrderedDict[tuple[Path, int, int], ShownPlan] = field(default_factory=OrderedDict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def shown(self, path: Path) -> ShownPlan:
        """A plan's picture. Raises `InputError` where there is none that can be shown."""
        try:
            stat = path.stat()
        except (OSError, ValueError):
            raise InputError(f"{path.name}: the picture of the plan is not there: upload it again") from None
        key = path, stat.st_mtime_ns, stat.st_size
        with self._lock:
            if key not in self._kept:
                self._kept[key] = _shown(path)
                while len(self._kept) > KEPT:
                    self._kept.popitem(last=False)
            return self._kept[key]


def plan_path(session: Session, image: str | None) -> Path:
    """Where a plan's picture lies: an uploaded one by its name, or the scene file's own for None.

    Raises `InputError` for another name: a browser sends no paths.
    """
    if image is not None:
        if not UPLOADED.fullmatch(image):
            raise InputError("there is no such plan: upload it")
        return session.scene_file.parent / image
    scene, _ = session.scene()
    if scene.world is None or scene.world.plan is None:
        raise InputError("the scene file has no plan yet: upload one")
    return scene.resolve(scene.world.plan.image)


def _shown(path: Path) -> ShownPlan:
    """A plan's picture read, and made small enough for a browser."""
    content = file_bytes(path, "a picture of the plan (PNG or JPEG)")
    _, (width, height) = picture_header(content)
    if width * height > MOST_PIXELS:
        raise InputError(f"{path.name}: has {width} x {height} pixels: make it smaller to see it here")
    picture = decode_plan_picture(content, path.name)
    height, width = picture.shape[:2]
    factor = LARGEST_PX / max(width, height)
    if factor < 1:
        small = (max(1, round(width * factor)), max(1, round(height * factor)))
        picture = np.asarray(cv2.resize(picture, small, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    is_jpeg = path.suffix.lower() in (".jpg", ".jpeg")
    end, options = (".jpg", [cv2.IMWRITE_JPEG_QUALITY, QUALITY]) if is_jpeg else (".png", [])
    done, data = cv2.imencode(end, picture, options)
    if not done:
        raise InputError(f"{path.name}: the picture of the plan cannot be shown")
    return ShownPlan(data.tobytes(), "image/jpeg" if is_jpeg else "image/png", (width, height))
