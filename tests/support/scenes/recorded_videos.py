"""Short videos with the metadata that phones and cameras write into theirs."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path

import av
import numpy as np

FOCAL = "com.apple.quicktime.camera.focal_length.35mm_equivalent"
SIGNED, FLOAT, TEXT = 21, 23, 1
Item = tuple[int, bytes]


def write_recorded(
    path: Path, metadata: Mapping[str, str], track: Mapping[str, Item] | None = None, size: tuple[int, int] = (64, 48)
) -> Path:
    """A video of ten pictures, 25 frames per second.

    Args:
        path: where; the ending says which container.
        metadata: of the whole file.
        track: of the track, where QuickTime's phones have it: name -> well-known type and bytes of the value.
        size: width and height, pixels.
    """
    options = {"movflags": "use_metadata_tags"} if path.suffix in (".mp4", ".mov") else {}
    with av.open(str(path), "w", options=options) as container:
        container.metadata.update(metadata)
        stream = container.add_stream("mpeg4", rate=25)
        stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
        for shade in range(10):
            picture = np.full((size[1], size[0], 3), 20 * shade, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())
    if track is not None:
        path.write_bytes(_with_track_metadata(path.read_bytes(), track))
    return path


def box(kind: bytes, content: bytes) -> bytes:
    """A box of ISO 14496-12."""
    return struct.pack(">I", 8 + len(content)) + kind + content


def _with_track_metadata(data: bytes, items: Mapping[str, Item]) -> bytes:
    """A file whose `moov` comes last, with metadata at the end of its first track."""
    keys = struct.pack(">II", 0, len(items)) + b"".join(box(b"mdta", name.encode()) for name in items)
    values = b"".join(
        box(struct.pack(">I", number), box(b"data", struct.pack(">II", kind, 0) + value))
        for number, (kind, value) in enumerate(items.values(), start=1)
    )
    new = box(b"meta", box(b"hdlr", bytes(8) + b"mdta" + bytes(14)) + box(b"keys", keys) + box(b"ilst", values))
    moov = _find(data, b"moov", 0)
    track = _find(data, b"trak", moov + 8)
    end = track + struct.unpack(">I", data[track : track + 4])[0]
    out = bytearray(data[:end] + new + data[end:])
    for place in (moov, track):
        out[place : place + 4] = struct.pack(">I", struct.unpack(">I", out[place : place + 4])[0] + len(new))
    return bytes(out)


def _find(data: bytes, wanted: bytes, place: int) -> int:
    """First byte of the first box of a kind from a place on, beside the box there."""
    while True:
        size, kind = struct.unpack(">I4s", data[place : place + 8])
        if kind == wanted:
            return place
        place += size
