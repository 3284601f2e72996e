"""`passerby import`: cameras, or people, from another tool's files."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from passerby.common.errors import InputError

if TYPE_CHECKING:
    from passerby.interchange.formats import Given, People

KEYPOINTS_ENDING, BOXES_ENDING = ".json", ".txt"


def import_(
    source: Annotated[Path, typer.Argument(metavar="PATH", help="File or folder of the other tool.")],
    form: Annotated[str, typer.Option("--format", "-f", metavar="FORMAT", help="A format that `passerby formats` lists.")],
    out: Annotated[
        Path,
        typer.Option("--out", "-o", help="Cameras: a rig file (.toml). People: keypoints (.json, COCO) or boxes (.txt, MOT)."),
    ],
    size: Annotated[
        str | None, typer.Option(metavar="WxH", help="Image size in pixels, if the file does not state it.")
    ] = None,
    units: Annotated[str | None, typer.Option(help="Unit of lengths, if the file does not state it: m, cm or mm.")] = None,
    lossy: Annotated[
        bool, typer.Option("--lossy", help="Continue where not everything in the file can be kept; losses are reported.")
    ] = False,
) -> None:
    """Read cameras, or one camera's people, from another tool's files.

    Cameras are written as a rig file: a scene file can name it as `intrinsics`, and `passerby evaluate` compares its poses.
    People are written as a file that a scene file names as `keypoints`, `tracks` or `detections` of a camera.
    """
    from passerby.interchange.formats import find_format, read_people_as, read_rig_as
    from passerby.interchange.rig_toml import write_rig

    given = _given(size, units)
    known = find_format(form)
    if known.read_people is not None and (known.read is None or out.suffix.lower() != ".toml"):
        people = read_people_as(form, source, given)
        _tell(*people.notes, *given.unread.told)
        print(_write_people(people, out))
        return
    rig, losses = read_rig_as(form, source, given, lossy=lossy)
    if out.suffix.lower() != ".toml":
        raise InputError(f"{out}: cameras are written as a rig file: name it {out.with_suffix('.toml')}")
    write_rig(out, rig)
    _tell(*(f"lost: {loss}" for loss in losses), *given.unread.told)
    posed = len(rig.posed())
    print(f"{len(rig)} cameras, {posed} with poses: written to {out}")


def _given(size: str | None, units: str | None) -> Given:
    """What the user says of the file. Raises `InputError`."""
    from passerby.interchange.formats import Given
    from passerby.interchange.rig_toml import METRES_PER_UNIT

    if units is not None and units not in METRES_PER_UNIT:
        raise InputError(f"--units {units!r}: choose one of {', '.join(METRES_PER_UNIT)}")
    found = None if size is None else re.fullmatch(r"([1-9]\d{0,5})[xX,]([1-9]\d{0,5})", size)
    if size is not None and found is None:
        raise InputError(f"--size {size!r}: give width and height in pixels, as in --size 1920x1080")
    return Given(None if found is None else (int(found[1]), int(found[2])), METRES_PER_UNIT[units] if units else None)


def _write_people(people: People, out: Path) -> str:
    """Write joints or boxes, as the file's ending asks for, and tell how many."""
    from passerby.interchange.coco import write_keypoints
    from passerby.interchange.motchallenge import write_boxes

    ending = out.suffix.lower()
    if ending == KEYPOINTS_ENDING and len(people.keypoints):
        write_keypoints(out, people.keypoints)
        return f"{len(people.keypoints)} skeletons: written to {out}"
    if ending == BOXES_ENDING and len(people.boxes):
        write_boxes(out, people.boxes)
        return f"{len(people.boxes)} boxes: written to {out}"
    held = [
        f"{len(part)} {what}, which a {wanted} file takes"
        for part, what, wanted in ((people.keypoints, "skeletons", KEYPOINTS_ENDING), (people.boxes, "boxes", BOXES_ENDING))
        if len(part)
    ]
    raise InputError(
        f"{out}: the input has nothing for a file with this suffix: there are "
        f"{' and '.join(held) or 'neither keypoints nor boxes'}"
    )


def _tell(*notes: str) -> None:
    for note in notes:
        print(f"note: {' '.join(note.split())}", file=sys.stderr)
