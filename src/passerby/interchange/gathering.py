"""A rig from the cameras of a file, with all their faults reported at once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Rig
from passerby.interchange.storage.faults import FileFaults


def gathered_rig(
    path: str | Path,
    cameras: Iterable[tuple[str, Callable[[], Camera]]],
    verdict: str | None = None,
    metadata: Mapping[str, str] | None = None,
) -> Rig:
    """The rig of the cameras that are read.

    Args:
        path: of the file, for messages.
        cameras: of each, its place in the file, and what reads it and raises `InputError` without the place.
        verdict: of the rig.
        metadata: of the rig.

    Raises:
        FileFaults: with the faults of all cameras that cannot be read.
        InputError: two cameras with one name.
    """
    found: list[Camera] = []
    faults: list[str] = []
    for place, read in cameras:
        try:
            found.append(read())
        except InputError as error:
            faults.append(f"{path}: {place}: {error}")
    if faults:
        raise FileFaults(faults)
    try:
        return Rig(tuple(found), verdict, dict(metadata or {}))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
