"""`passerby formats`, `passerby export` and `passerby import`: files of other tools."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from passerby.common.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from passerby.core.trajectories import Trajectories
    from passerby.interchange.formats import Format, Given, People

KEYPOINTS_ENDING, BOXES_ENDING = ".json", ".txt"


def formats(
    name: Annotated[str | None, typer.Argument(metavar="[FORMAT]", help="Show the details of this format.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")] = False,
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Print the table and the conventions of the formats as Markdown.")
    ] = False,
) -> None:
    """List the formats of other tools that `passerby export` writes and `passerby import` reads."""
    from passerby.interchange.formats import all_formats, find_format
    from passerby.interchange.storage.text_formats import to_json

    found = [find_format(name)] if name is not None else list(all_formats())
    if json:
        print(to_json({"formats": [_as_plain_values(form) for form in found]}), end="")
    elif markdown:
        print(write_markdown(found), end="")
    elif name is None:
        _list(found)
    else:
        _detail(found[0])


def _as_plain_values(form: Format) -> dict[str, Any]:
    return {
        "name": form.name, "title": form.title, "tools": form.tools, "target": form.target, "suffixes": form.suffixes,
        "exports": form.write is not None, "imports_cameras": form.read is not None,
        "imports_people": form.read_people is not None, "conventions": form.conventions,
    }  # fmt: skip


def _describe_abilities(form: Format) -> str:
    """Describe whether a format can be exported and imported."""
    reads = [what for what, reader in (("cameras", form.read), ("people", form.read_people)) if reader is not None]
    return " ".join([*(["export"] if form.write else []), *([f"import ({', '.join(reads)})"] if reads else [])])


def _target(form: Format) -> str:
    """Return the kind of target that is written, in words."""
    return "folder or file" if form.write_one else form.target


def _list(found: list[Format]) -> None:
    width, can = (
        max((len(form.name) for form in found), default=0),
        max((len(_describe_abilities(form)) for form in found), default=0),
    )
    for form in found:
        print(f"{form.name.ljust(width)}  {_describe_abilities(form).ljust(can)}  {form.title}")
    print("\npasserby formats FORMAT shows the details of one.")


def write_markdown(found: Sequence[Format]) -> str:
    """Write the formats in Markdown: a table, and a section for each format."""
    lines = ["| format | what it is | target | export | import |", "|---|---|---|---|---|"]
    for form in found:
        reads = [what for what, reader in (("cameras", form.read), ("people", form.read_people)) if reader is not None]
        target = " ".join([_target(form), *(f"`{suffix}`" for suffix in form.suffixes)])
        export = "yes" if form.write else ""
        lines.append(
            f"| [`{form.name}`](#{form.name}) | {_escape_markdown(form.title)} | {target} | {export} | {', '.join(reads)} |"
        )
    for form in found:
        lines += [
            "",
            f"### {form.name}",
            "",
            f"{_escape_markdown(form.title)}. For {', '.join(form.tools)}.",
            "",
            _escape_markdown(form.conventions),
        ]
    return "\n".join(lines) + "\n"


def _escape_markdown(text: str) -> str:
    """Escape text so that Markdown finds no tag and no end of a column in it."""
    return text.replace("<", "&lt;").replace("|", "\\|")


def _detail(form: Format) -> None:
    print(f"{form.name}: {form.title}")
    print(f"for: {', '.join(form.tools)}")
    print(f"a {_target(form)}" + (f" ({', '.join(form.suffixes)})" if form.suffixes else ""))
    print(f"can: {_describe_abilities(form)}")
    print(form.conventions)
    if form.write is not None:
        print(f"passerby export out/rig.toml --format {form.name} -o {'rig' + (form.suffixes[0] if form.suffixes else '')}")
    if form.read is not None:
        print(f"passerby import PATH --format {form.name} -o rig.toml")
    if form.read_people is not None:
        print(f"passerby import PATH --format {form.name} -o C1.json")


def export(
    rig: Annotated[Path, typer.Argument(metavar="RIG", help="Rig file (TOML), or the output folder of `passerby calibrate`.")],
    form: Annotated[str, typer.Option("--format", "-f", metavar="FORMAT", help="A format that `passerby formats` lists.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="File or folder to write, depending on the format.")],
    tracks: Annotated[
        Path | None,
        typer.Option(
            help="People's trajectories: trajectories.csv, or an output folder. Default for PLY and glTF: those of RIG, if "
            "it is one."
        ),
    ] = None,
    name: Annotated[str | None, typer.Option(help="Name of the scene in the file; default: the rig file's name.")] = None,
    lossy: Annotated[
        bool, typer.Option("--lossy", help="Continue where the format cannot hold everything; losses are reported.")
    ] = False,
) -> None:
    """Write a rig in the format of another tool.

    What the format cannot hold, such as a lens model or a camera without a pose, is an error unless --lossy is given.
    Uncertainties and the verdict are dropped without a message: no other tool has a place for them.
    """
    from passerby.interchange.formats import Export, find_format
    from passerby.interchange.formats import export as write
    from passerby.interchange.output_folder import RIG_FILE, read_rig_at

    path = rig / RIG_FILE if rig.is_dir() else rig
    loaded = read_rig_at(rig)
    title = name or (rig.resolve().name if rig.is_dir() else rig.stem)
    ways = None
    if tracks is not None:
        ways = _read_trajectories(tracks)
    elif rig.is_dir() and find_format(form).draws_people:
        ways = _read_own_people(rig)
    for loss in write(Export(loaded, title, ways), form, out, lossy=lossy):
        print(f"note: lost: {' '.join(loss.split())}", file=sys.stderr)
    verdict = f", which is {loaded.verdict}" if loaded.verdict not in (None, "accepted") else ""
    if verdict:
        print(f"note: {path} is from a calibration{verdict}: do not rely on it", file=sys.stderr)
    print(f"written to {out}")


def _read_own_people(folder: Path) -> Trajectories | None:
    """Return the people's trajectories from the rig's output folder; None, with a message, if there are none."""
    from passerby.calibration.following import people_of_folder
    from passerby.cli.terminal import stages

    with stages() as tell:
        found, why = people_of_folder(folder, tell)
    if why:
        print(f"note: no people are drawn: {' '.join(why.split())}", file=sys.stderr)
    return found


def _read_trajectories(tracks: Path) -> Trajectories:
    """Read people's trajectories from a CSV file or an output folder."""
    from passerby.calibration.following import trajectories_of_result
    from passerby.cli.terminal import stages
    from passerby.interchange.output_folder import read_output
    from passerby.interchange.trajectories_csv import read_trajectories

    if not tracks.exists():
        raise InputError(f"{tracks}: no such file: give trajectories.csv of `passerby track`, or an output folder")
    if tracks.is_file():
        return read_trajectories(tracks)
    with stages() as tell:
        return trajectories_of_result(read_output(tracks), tell=tell)


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

    given = _read_given(size, units)
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


def _read_given(size: str | None, units: str | None) -> Given:
    """Return the facts about the file that the user gives as options. Raises `InputError` for invalid ones."""
    from passerby.interchange.formats import Given
    from passerby.interchange.rig_toml import METRES_PER_UNIT

    if units is not None and units not in METRES_PER_UNIT:
        raise InputError(f"--units {units!r}: choose one of {', '.join(METRES_PER_UNIT)}")
    found = None if size is None else re.fullmatch(r"([1-9]\d{0,5})[xX,]([1-9]\d{0,5})", size)
    if size is not None and found is None:
        raise InputError(f"--size {size!r}: give width and height in pixels, as in --size 1920x1080")
    return Given(None if found is None else (int(found[1]), int(found[2])), METRES_PER_UNIT[units] if units else None)


def _write_people(people: People, out: Path) -> str:
    """Write joints or boxes, as the file's suffix requires, and return a message with their number."""
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
