"""Small files that stand for much: each is read in this process, whose memory is bounded. Prints one line a bomb.

Run as `python bombs.py FOLDER`.
"""

from __future__ import annotations

import io
import resource
import struct
import sys
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path

from numpy.lib import format as npy

from support.untrusted import example_files as example
from support.untrusted.readers import READERS

MEMORY = 768 << 20
"""On top of what the libraries take when they are loaded."""
GREAT = 10**9


def lying_table(shape: tuple[int, ...], content: bytes = b"", compressed: bool = False) -> bytes:
    """An archive whose array has a header that promises this shape."""
    head = io.BytesIO()
    npy.write_array_header_1_0(head, {"descr": "<f4", "fortran_order": False, "shape": shape})
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED) as file:
        file.writestr("embeddings.npy", head.getvalue() + content)
    return held.getvalue()


def swollen_table() -> bytes:
    """An archive of some megabytes that unfolds to four gigabytes, as its header says."""
    head, held = io.BytesIO(), io.BytesIO()
    npy.write_array_header_1_0(head, {"descr": "<f4", "fortran_order": False, "shape": (1 << 20, 1 << 10)})
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as file, file.open("embeddings.npy", "w", force_zip64=True) as member:
        member.write(head.getvalue())
        zeros = bytes(1 << 24)
        for _ in range(256 // 8):  # half a gigabyte is enough: the header is found to lie, or the rest to be missing
            member.write(zeros)
    return held.getvalue()


def entities() -> bytes:
    """A billion laughs."""
    lines = "".join(f'<!ENTITY e{n} "{f"&e{n - 1};" * 10}">' for n in range(1, 10))
    return f'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY e0 "ha">{lines}]><Camera><Geometry>&e9;</Geometry></Camera>'.encode()


def aliases(key: str) -> bytes:
    """Lists of lists of lists, 10 of each, ten deep."""
    lines = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 10)]
    return "\n".join([*lines, f"{key}: *a9", "D: [0, 0, 0, 0]", ""]).encode()


def merges() -> bytes:
    """Tables that merge others, ten times over, ten deep."""
    lines = ["a0: &a0 {b0: 1, b1: 2, b2: 3}"]
    lines += [f"a{n}: &a{n} {{<<: [{', '.join([f'*a{n - 1}'] * 10)}]}}" for n in range(1, 10)]
    return "\n".join(lines).encode()


def great_film() -> bytes:
    """An AVI whose pictures promise 65,500 x 65,500 pixels, and which promises 10^9 of them."""
    film = bytearray(example.video(".avi")["film.avi"])
    at = film.find(b"\xff\xc0")
    while at >= 0:
        film[at + 5 : at + 9] = struct.pack(">HH", 65500, 65500)
        at = film.find(b"\xff\xc0", at + 4)
    head = film.find(b"avih")
    film[head + 24 : head + 28] = struct.pack("<I", GREAT)
    film[head + 40 : head + 48] = struct.pack("<II", 65500, 65500)
    return bytes(film)


def great_picture() -> bytes:
    """A PNG whose head promises 30,000 x 30,000 pixels."""
    picture = bytearray(example.picture(".png"))
    picture[16:24] = struct.pack(">II", 30000, 30000)
    picture[29:33] = struct.pack(">I", zlib.crc32(bytes(picture[12:29])))
    return bytes(picture)


def great_network() -> bytes:
    """An ONNX file whose table says that it has 10^12 numbers, of which it holds none."""
    import onnx

    model = onnx.load_from_string(example.network())
    model.graph.initializer[0].dims[:] = [10**6, 10**6]
    return bytes(model.SerializeToString())


def bombs() -> Iterator[tuple[str, str, bytes]]:
    """(reader, file, content)."""
    deep = 200_000  # levels
    yield "embeddings", "A.npz", lying_table((GREAT, 512))
    yield "embeddings", "A.npz", lying_table((GREAT,) * 4)
    yield "embeddings", "A.npz", lying_table((10**6, 100), bytes(400))
    yield "embeddings", "A.npz", swollen_table()
    yield "format colmap-bin", "cameras.bin", struct.pack("<Q", GREAT)
    yield "format colmap-bin", "images.bin", struct.pack("<Q", 2**63)
    yield "format colmap-bin", "images.bin", struct.pack("<QI7dI", 1, 1, *[1.0] * 7, 1) + b"a\0" + struct.pack("<Q", 2**60)
    for name in ("format tsai", "format qualisys", "CVML", "OpenCV lens, XML", "OpenCV storage, XML"):
        yield name, "", entities()
        yield name, "", b"<opencv_storage>" + b"<a>" * deep + b"</a>" * deep + b"</opencv_storage>"
    for name in ("joints", "format coco", "format alphapose", "format openpose", "format nerfstudio", "output folder",
                 "OpenCV lens, JSON", "Panoptic cameras"):  # fmt: skip
        yield name, "", b"[" * deep
        yield name, "", b'{"a":' * deep + b"1" + b"}" * deep
        yield name, "", b"9" * (1 << 20)
    for name in ("scene file", "rig file", "known points, TOML", "description of a network"):
        yield name, ".toml", b"a = " + b"[" * deep
        yield name, ".toml", b"a = " + b"9" * (1 << 20)
        yield name, ".toml", b"a" + b".a" * 50_000 + b" = 1"  # the parser keeps every beginning of a key
    for name in ("format kalibr", "format ros", "format easymocap", "format mv3dt", "format opencv", "OpenCV lens, of ROS"):
        yield name, "", b"[" * deep
        yield name, "", b"- " * 100_000
        yield name, "", aliases("K")
        yield name, "", merges()
        yield name, "", b"a: &a [*a, *a]\nK: *a\nD: *a\n"
        yield name, "", b"a: " + b"9" * (1 << 19)
    yield "boxes", "", b"1,1,1,1,1,1," + b"9" * (1 << 22)
    yield "EPFL positions", "", b"x\n1000000000 1000000000 30 44 25 0 75\n1\n"
    yield "video, AVI", "", great_film()
    yield "picture, PNG", "", great_picture()
    yield "network", "", great_network()


def main(folder: Path) -> None:
    """Read all bombs."""
    readers = {reader.name: reader for reader in READERS}
    for warm in ("boxes", "network", "video, AVI", "projection matrix, MATLAB", "format tsai"):
        list(readers[warm].files())
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    limit = int(status["VmSize"].split()[0]) * 1024 + MEMORY
    contents = list(bombs())
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    for number, (name, which, content) in enumerate(contents):
        reader = readers[name]
        case = folder / str(number) / "case"
        files = dict(reader.files())
        target = next((file for file in files if file.endswith(which)), next(iter(files)))
        for file, sound in files.items():
            (case / file).parent.mkdir(parents=True, exist_ok=True)
            (case / file).write_bytes(content if file == target else sound)
        try:
            reader.read(case / next(iter(files)))
        except reader.refuses as error:
            told = "refused" if str(case) in str(error) else f"does not name the file: {error}"
        except BaseException as error:
            told = f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
        else:
            told = "read"
        print(f"{number}\t{name}\t{content[:30]!r}\t{told}", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
