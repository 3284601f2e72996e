"""The plan's picture: an upload is checked by its header before it is decoded, with the decoder of a calibration."""

from __future__ import annotations

import hashlib
import re
import struct
import threading
from collections import OrderedDict
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from passerby.common.errors import InputError
from passerby.interchange.plan_picture import decode_plan_picture
from passerby.interchange.storage.atomic import write_bytes
from passerby.interchange.storage.safe_parsing import file_bytes
from passerby.page.session import Session

LARGEST_PX = 4096
"""Largest longer side of a shown picture: every browser can draw this size."""
QUALITY = 90
KEPT = 3
MOST_BYTES = 25_000_000
"""Largest size of a plan's file: a scanned sheet has some megabytes."""
MOST_PIXELS = 60_000_000
"""Most pixels of a plan: 180 MB after decoding. A sheet of A0 at 200 dots per inch has 62 million."""
MOST_SCANS = 64
"""Most scans of a progressive JPEG. Each takes as much time as a whole picture; usual files have ten."""
UPLOADED = re.compile(r"plan-[0-9a-f]{20}\.(png|jpg)")
PNG, PNG_END = b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"
JPEG, JPEG_SCAN, JPEG_END = b"\xff\xd8\xff", b"\xff\xda", b"\xff\xd9"
REMEDY = "choose a PNG or JPEG"
_DECODING = threading.Lock()
"""Lock for decoding one picture at a time: decoding many in parallel would need much memory."""


@dataclass(frozen=True)
class ShownPlan:
    """A plan as it is sent to a browser."""

    data: bytes
    media_type: str
    size: tuple[int, int]
    """(width, height) of the file's picture, pixels; the picture in `data` may be smaller."""


@dataclass(eq=False)
class PlanPictures:
    """The last plans that were shown."""

    _kept: OrderedDict[tuple[Path, int, int], ShownPlan] = field(default_factory=OrderedDict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def shown(self, path: Path) -> ShownPlan:
        """Return a plan's picture. Raises `InputError` if there is none that can be shown."""
        try:
            stat = path.stat()
        except (OSError, ValueError):
            raise InputError(f"{path.name}: the picture of the plan is not there: upload it again") from None
        key = path, stat.st_mtime_ns, stat.st_size
        with self._lock:
            if key not in self._kept:
                self._kept[key] = _read_shown_plan(path)
                while len(self._kept) > KEPT:
                    self._kept.popitem(last=False)
            return self._kept[key]


def plan_path(session: Session, image: str | None) -> Path:
    """Return the path of an uploaded picture of a plan by its name, or of the scene file's own picture for None.

    Raises `InputError` for any other name: a browser must not send paths.
    """
    if image is not None:
        if not UPLOADED.fullmatch(image):
            raise InputError("there is no such plan: upload it")
        return session.scene_file.parent / image
    scene, _ = session.scene()
    if scene.world is None or scene.world.plan is None:
        raise InputError("the scene file has no plan yet: upload one")
    return scene.resolve(scene.world.plan.image)


def _read_shown_plan(path: Path) -> ShownPlan:
    """Read a plan's picture, and make it small enough for a browser."""
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


def keep_plan(folder: Path, content: bytes) -> str:
    """Write a plan's picture unchanged into a folder, and return its file name; the same picture gives the same name.

    Raises `InputError`, and writes nothing, if the content is not a PNG or JPEG, is too large or broken.
    """
    kind = check_plan(content)
    name = f"plan-{hashlib.blake2b(content, digest_size=10).hexdigest()}.{kind}"
    if not (folder / name).is_file():
        write_bytes(folder / name, content)
    return name


def check_plan(content: bytes) -> str:
    """Check a picture by its header and by decoding it once; return the suffix of its file name. Raises `InputError`."""
    kind, (width, height) = picture_header(content)
    if width * height > MOST_PIXELS:
        raise InputError(
            f"the plan has {width} x {height} pixels, {width * height / 1e6:.0f} million: make it smaller, up to "
            f"{MOST_PIXELS / 1e6:.0f} million"
        )
    with _DECODING:
        decode_plan_picture(content, "the plan")
    return kind


def picture_header(content: bytes) -> tuple[str, tuple[int, int]]:
    """Read the kind (png, jpg) and (width, height) of a picture. Raises `InputError` for another kind or a cut-off file."""
    if content.startswith(PNG):
        if len(content) < 24 or content[12:16] != b"IHDR" or PNG_END not in content:
            raise InputError(f"the plan is a PNG that is cut off or broken: {REMEDY} that is whole")
        width, height = struct.unpack(">II", content[16:24])
        return "png", (width, height)
    if content.startswith(JPEG):
        return "jpg", _jpeg_size(content)
    raise InputError(f"the plan is neither a PNG nor a JPEG by its content: {REMEDY}")


def _jpeg_size(content: bytes) -> tuple[int, int]:
    """Read (width, height) from the first frame header of a JPEG."""
    broken = InputError(f"the plan is a JPEG that is cut off or broken: {REMEDY} that is whole")
    if content.rfind(JPEG_END) < content.rfind(JPEG_SCAN) or JPEG_SCAN not in content:
        raise broken
    if content.count(JPEG_SCAN) > MOST_SCANS:
        raise InputError(f"the plan is a JPEG of more than {MOST_SCANS} scans: save it again in a picture editor")
    at = 2
    while at + 9 <= len(content) and content[at] == 0xFF:
        marker = content[at + 1]
        if marker == 0xFF or marker == 0x01 or 0xD0 <= marker <= 0xD7:  # fill bytes, and markers without a length
            at += 1 if marker == 0xFF else 2
        elif 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack(">HH", content[at + 5 : at + 9])
            if not width or not height:
                raise broken
            return width, height
        elif marker in (0xD9, 0xDA):
            break
        else:
            at += 2 + int.from_bytes(content[at + 2 : at + 4], "big")
    raise broken
