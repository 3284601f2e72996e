"""COLMAP's sparse models as files: `cameras`, `images` and `points3D`, as text (.txt) or binary (.bin, little endian).

Documented at https://colmap.github.io/format.html. Models since COLMAP 3.12 also have `rigs` and `frames`.
They are not written, because COLMAP generates missing ones, and not read, because the poses are also in `images`.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import shortened, shortened_text
from passerby.interchange.formats.colmap_models import MODELS
from passerby.interchange.storage.safe_parsing import file_bytes, read_text

LENGTHS = {model.number: model.length for model in MODELS.values()} | {17: 2}
"""Number of a model -> number of its parameters, including EQUIRECTANGULAR."""
NAMES = {model.number: model.name for model in MODELS.values()} | {17: "EQUIRECTANGULAR"}
GREY = 128


@dataclass(frozen=True)
class ColmapCamera:
    """An entry of `cameras`."""

    number: int
    model: str
    size: tuple[int, int]
    """(width, height), pixels."""
    parameters: tuple[float, ...]


@dataclass(frozen=True)
class ColmapImage:
    """An entry of `images` without its points."""

    number: int
    quaternion: tuple[float, ...]
    """w, x, y, z of the rotation from world to camera."""
    translation: tuple[float, ...]
    camera: int
    name: str
    points: bool = False
    """Whether it has 2D points, which are left out."""


@dataclass(frozen=True)
class ColmapModelFiles:
    """Content of a model's folder."""

    cameras: tuple[ColmapCamera, ...]
    images: tuple[ColmapImage, ...]
    others: tuple[str, ...] = ()
    """Names of other files of the model that are not empty and not read."""


def write_text_model(cameras: Sequence[ColmapCamera], images: Sequence[ColmapImage], points: Floats) -> dict[str, bytes]:
    """Format a model as text files, by name. No image sees the `points` (N, 3)."""
    lines = {
        "cameras.txt": [
            "# Camera list with one line of data per camera:",
            "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]",
            f"# Number of cameras: {len(cameras)}",
            *(_join_words(c.number, c.model, *c.size, *c.parameters) for c in cameras),
        ],
        "images.txt": [
            "# Image list with two lines of data per image:",
            "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME",
            "#   POINTS2D[] as (X, Y, POINT3D_ID)",
            f"# Number of images: {len(images)}, mean observations per image: 0",
            *(_join_words(i.number, *i.quaternion, *i.translation, i.camera, i.name) + "\n" for i in images),
        ],
        "points3D.txt": [
            "# 3D point list with one line of data per point:",
            "#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)",
            f"# Number of points: {len(points)}, mean track length: 0",
            *(_join_words(number, *xyz, GREY, GREY, GREY, 0) for number, xyz in enumerate(points.tolist(), start=1)),
        ],
    }
    return {name: "".join(f"{line}\n" for line in text).encode() for name, text in lines.items()}


def write_binary_model(cameras: Sequence[ColmapCamera], images: Sequence[ColmapImage], points: Floats) -> dict[str, bytes]:
    """Format a model as binary files, by name. No image sees the `points` (N, 3)."""
    numbers = {name: number for number, name in NAMES.items()}
    return {
        "cameras.bin": struct.pack("<Q", len(cameras))
        + b"".join(
            struct.pack(f"<IiQQ{len(c.parameters)}d", c.number, numbers[c.model], *c.size, *c.parameters) for c in cameras
        ),
        "images.bin": struct.pack("<Q", len(images))
        + b"".join(
            struct.pack("<I7dI", i.number, *i.quaternion, *i.translation, i.camera)
            + i.name.encode()
            + b"\0"
            + struct.pack("<Q", 0)
            for i in images
        ),
        "points3D.bin": struct.pack("<Q", len(points))
        + b"".join(
            struct.pack("<Q3d3BdQ", number, *xyz, GREY, GREY, GREY, 0.0, 0)
            for number, xyz in enumerate(points.tolist(), start=1)
        ),
    }


def _join_words(*values: float | str) -> str:
    return " ".join(value if isinstance(value, str) else repr(value) for value in values)


def read_model(folder: Path, binary_first: bool) -> ColmapModelFiles:
    """Read a model, if possible of the preferred kind of files, else of the other. Raises `InputError` (file, line, remedy)."""
    endings = (".bin", ".txt") if binary_first else (".txt", ".bin")
    ending = next((ending for ending in endings if (folder / f"cameras{ending}").is_file()), None)
    if ending is None:
        raise InputError(
            f"{folder}: has neither cameras.txt nor cameras.bin: give the folder of COLMAP's model, often sparse/0"
        )
    cameras, images = folder / f"cameras{ending}", folder / f"images{ending}"
    if ending == ".txt":
        found = tuple(_text_cameras(cameras)), tuple(_text_images(images)) if images.is_file() else ()
    else:
        found = _binary_cameras(cameras), _binary_images(images) if images.is_file() else ()
    return ColmapModelFiles(*found, _others(folder, ending))


def _others(folder: Path, ending: str) -> tuple[str, ...]:
    """List the files of a model that are not empty and not read: the other kind of files, 3D points, rigs and frames."""
    other = ".txt" if ending == ".bin" else ".bin"
    doubled = [folder / f"{part}{other}" for part in ("cameras", "images")]
    extra = [folder / f"{part}{ending}" for part in ("points3D", "rigs", "frames")]
    return tuple(file.name for file in (*doubled, *extra) if file.is_file() and _has_entries(file))


def _has_entries(file: Path) -> bool:
    """Check whether a model's file has an entry. A binary file begins with the number of entries."""
    if file.suffix == ".bin":
        with file.open("rb") as stream:
            return any(stream.read(8))
    return any(line.strip() for _, line in _lines(file))


def _text_cameras(path: Path) -> Iterator[ColmapCamera]:
    for place, line in _lines(path):
        words = line.split()
        if not words:
            continue
        if len(words) < 5:
            raise InputError(f"{place}: has {len(words)} values: CAMERA_ID, MODEL, WIDTH, HEIGHT and PARAMS are needed")
        number, width, height = _read_integers(place, words[0], words[2], words[3])
        yield ColmapCamera(number, words[1], (width, height), _read_numbers(place, words[4:]))


def _text_images(path: Path) -> Iterator[ColmapImage]:
    """Generate the images. Each image has two lines; the second line, its points, may be empty."""
    lines = _lines(path)
    for place, line in lines:
        words = line.split(maxsplit=9)
        if not words:
            continue
        if len(words) < 10:
            raise InputError(
                f"{place}: has {len(words)} values: IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME are needed"
            )
        number, camera = _read_integers(place, words[0], words[8])
        pose = _read_numbers(place, words[1:8])
        _, points = next(lines, ("", ""))
        yield ColmapImage(number, pose[:4], pose[4:], camera, words[9].strip(), bool(points.strip()))


def _lines(path: Path) -> Iterator[tuple[str, str]]:
    """Generate place and text of each line that is not a comment."""
    for number, line in enumerate(read_text(path, "a text model of COLMAP").split("\n"), start=1):
        if not line.lstrip().startswith("#"):
            yield f"{path}: line {number}", line.rstrip("\r")


def _read_integers(place: str, *words: str) -> list[int]:
    try:
        return [int(word) for word in words]
    except ValueError:
        raise InputError(f"{place}: {shortened(' '.join(words))}: whole numbers are needed") from None


def _read_numbers(place: str, words: Sequence[str]) -> tuple[float, ...]:
    try:
        numbers = tuple(map(float, words))
    except ValueError:
        numbers = (math.nan,)
    if not all(map(math.isfinite, numbers)):
        raise InputError(f"{place}: {shortened(' '.join(words))}: finite numbers are needed")
    return numbers


class _Reader:
    """Reader of values from binary data. Raises `InputError` where the file ends too early."""

    def __init__(self, path: Path) -> None:
        self.path, self.at = path, 0
        self.data = file_bytes(path, "a binary model of COLMAP")

    def take(self, form: str) -> tuple[float, ...]:
        """Read the next values in the format `form` of `struct`."""
        size = struct.calcsize(form)
        if self.at + size > len(self.data):
            raise self.fault()
        values = struct.unpack_from(form, self.data, self.at)
        self.at += size
        return values

    def whole(self, form: str) -> list[int]:
        """Read the next values in the format `form` of `struct` as whole numbers."""
        return [int(value) for value in self.take(form)]

    def text(self) -> str:
        """Read a text up to the next zero byte."""
        end = self.data.find(b"\0", self.at)
        if end < 0:
            raise self.fault()
        found, self.at = self.data[self.at : end].decode(errors="replace"), end + 1
        return found

    def skip(self, size: int) -> None:
        """Skip `size` bytes."""
        self.at += size
        if self.at > len(self.data):
            raise self.fault()

    def fault(self) -> InputError:
        """Return the error for a file that ends too early."""
        return InputError(f"{self.path}: ends at byte {len(self.data)}, in the middle of an entry: is it whole, and COLMAP's?")


def _binary_cameras(path: Path) -> tuple[ColmapCamera, ...]:
    reader, cameras = _Reader(path), []
    for _ in range(reader.whole("<Q")[0]):
        number, model, width, height = reader.whole("<IiQQ")
        if model not in LENGTHS:
            raise InputError(
                f"{path}: camera {number}: COLMAP's model number {model} is not known: convert it with COLMAP first"
            )
        parameters = reader.take(f"<{LENGTHS[model]}d")
        if not all(map(math.isfinite, parameters)):
            raise InputError(f"{path}: camera {number}: parameters {parameters}: finite numbers are needed")
        cameras.append(ColmapCamera(number, NAMES[model], (width, height), parameters))
    return tuple(cameras)


def _binary_images(path: Path) -> tuple[ColmapImage, ...]:
    reader, images = _Reader(path), []
    for _ in range(reader.whole("<Q")[0]):
        (number,), pose, (camera,) = reader.whole("<I"), reader.take("<7d"), reader.whole("<I")
        name = reader.text()
        points = reader.whole("<Q")[0]
        reader.skip(24 * points)
        if not all(map(math.isfinite, pose)):
            raise InputError(f"{path}: image {shortened_text(name)}: pose {pose}: finite numbers are needed")
        images.append(ColmapImage(number, pose[:4], pose[4:], camera, name, points > 0))
    return tuple(images)
