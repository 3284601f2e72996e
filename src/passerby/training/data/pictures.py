"""Picture files: listed, read, and all of them tried before anybody relies on them."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np

from passerby.common.errors import InputError
from passerby.common.progress import Progress, silent
from passerby.perception.crops import MIN_HEIGHT_PX, MIN_WIDTH_PX
from passerby.perception.pictures import Picture

PICTURE_ENDINGS = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")
NAMED = 5
"""So many faulty files are named one by one."""
THREADS = 8
AT_ONCE = 1000
"""Pictures between two reports of progress."""


def picture_files(folder: Path) -> list[Path]:
    """The picture files in a folder, by name; hidden ones are not looked at. Raises `InputError` where it cannot be listed."""
    try:
        found = [path for path in folder.iterdir() if path.suffix.lower() in PICTURE_ENDINGS and not path.name.startswith(".")]
    except OSError as error:
        raise InputError(f"{folder}: cannot be read ({error.strerror or error}): give a folder that you may read") from None
    return sorted(found, key=lambda path: path.name)


def read_picture(path: Path) -> Picture:
    """(H, W, 3) BGR. Raises `InputError` for a file that is no whole picture."""
    picture = decode_pictures(path)
    if picture is None:
        raise InputError(f"{path}: is not an image that can be read: copy it again, or delete it")
    return picture


def decode_pictures(path: Path) -> Picture | None:
    """(H, W, 3) BGR; None for a file that cannot be read, is empty, cut off, or no picture."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    if not content or _is_cut_off(content):
        return None
    try:
        picture = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:  # a size beyond OpenCV's bounds, among others
        return None
    return None if picture is None or picture.size == 0 else np.asarray(picture, dtype=np.uint8)


def faults_of_pictures(paths: Sequence[Path], tell: Progress = silent) -> dict[int, str]:
    """Row -> what is wrong with the picture, of those that cannot be used; all are decoded, in threads."""
    faults: dict[int, str] = {}
    with ThreadPoolExecutor(THREADS) as pool:
        for start in range(0, len(paths), AT_ONCE):
            tell("checking images", start, len(paths))
            found = pool.map(_fault, paths[start : start + AT_ONCE])
            faults |= {start + row: fault for row, fault in enumerate(found) if fault is not None}
    tell("checking images", len(paths), len(paths))
    return faults


def describe_faults(files: Sequence[Path | str], what: str) -> list[str]:
    """A note about faulty files: the first `NAMED` by name, then how many more; nothing where there are none."""
    if not files:
        return []
    more = f" and {len(files) - NAMED} more" if len(files) > NAMED else ""
    return [f"{what}: {', '.join(str(file) for file in files[:NAMED])}{more}"]


def _fault(path: Path) -> str | None:
    """What is wrong with a picture."""
    picture = decode_pictures(path)
    if picture is None:
        return "cannot be read"
    # What is smaller tells nothing of anybody (`perception.crops.tellable`).
    return "is too small" if picture.shape[1] < MIN_WIDTH_PX or picture.shape[0] < MIN_HEIGHT_PX else None


def _is_cut_off(content: bytes) -> bool:
    """Whether a JPEG or PNG lacks its end, behind which some cameras write more; decoders make grey of the rest and go on."""
    if content.startswith(b"\xff\xd8"):
        return b"\xff\xd9" not in content[-65536:]
    return content.startswith(b"\x89PNG") and b"IEND" not in content[-65536:]
