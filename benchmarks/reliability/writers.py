"""The commands that write, on a machine that fails at any moment: what they leave is the old or the new, and whole."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from passerby.common.errors import InputError
from passerby.interchange.storage.transaction import recover
from reliability.machine import Ended, Fault, passerby, tree

Files = Mapping[str, bytes]

PLACE = "place"
"""In a command: the folder in which it works."""


@dataclass(frozen=True)
class Writer:
    """A command, in a folder in which something finished lies."""

    name: str
    command: tuple[str, ...]
    """Arguments of `passerby`; `place/...` and `made/...` are paths."""
    before: str = ""
    """What lies in the folder at the beginning: a folder of `made/`; empty: nothing."""
    again: bool = True
    """Whether the command, run once more on its own result, gives the same bytes."""


WRITERS = (
    Writer("calibrate", ("calibrate", "made/box/scene.toml", "-o", "place/out", "--no-report"), "other"),
    Writer("calibrate with report", ("calibrate", "made/box/scene.toml", "-o", "place/out")),
    Writer("calibrate videos", ("calibrate", "made/video/scene.toml", "-o", "place/out", "--no-report")),
    Writer("report", ("report", "place/out"), "out"),
    Writer("align in place", ("align", "place/out", "-o", "place/out", "--camera", "C2"), "out", again=False),
    Writer("align", ("align", "made/out", "-o", "place/out", "--camera", "C2"), again=False),
    Writer("track", ("track", "place/out"), "out"),
    Writer("export", ("export", "made/out", "-f", "colmap", "-o", "place/out"), "exported"),
    Writer(
        "simulate", ("simulate", "-o", "place/out", "--seed", "2", "--cameras", "3", "--people", "2", "--seconds", "4"), "box"
    ),
)


def make(folder: Path) -> None:
    """What the writers begin with. Raises `RuntimeError` where a command fails that must not."""
    box = ("simulate", "-o", folder / "box", "--cameras", "3", "--people", "4", "--seconds", "15", "--fps", "4")
    video = ("simulate", "-o", folder / "video", "--cameras", "2", "--people", "3", "--seconds", "8", "--fps", "5", "--video")
    for command in (box, video):
        _must(command, folder)
    scene = folder / "video" / "scene.toml"
    scene.write_text(f'{scene.read_text()}\n[perception]\ndetector = "background"\nembedder = "stripes"\nkeypoints = "none"\n')
    _must(("calibrate", folder / "box" / "scene.toml", "-o", folder / "out", "--no-report"), folder)
    _must(("calibrate", folder / "box" / "scene.toml", "-o", folder / "other", "--no-report", "--seed", "7"), folder)
    _must(("align", folder / "other", "-o", folder / "other", "--camera", "C2"), folder)
    _must(("export", folder / "other", "-f", "colmap", "-o", folder / "exported"), folder)


def _must(command: tuple[str | Path, ...], folder: Path) -> None:
    ended = passerby(command, folder)
    if ended.status not in (0, 3):
        raise RuntimeError(f"{' '.join(map(str, command))}: {ended.errors}")


def undisturbed(writer: Writer, made: Path) -> tuple[Ended, Files, Files]:
    """How the command ends where nothing fails; the folder before and after it."""
    with tempfile.TemporaryDirectory(prefix="passerby-faults-") as scratch:
        place = _place(writer, made, Path(scratch))
        before = tree(place)
        ended = passerby(_arguments(writer, made, place), place.parent)
        return ended, before, tree(place)


def fate(writer: Writer, made: Path, fault: Fault, at: int, before: Files, after: Files, *, repeat: bool = True) -> list[str]:
    """What is wrong after a fault and after the command was run once more; nothing, where all is well.

    Args:
        writer: the command.
        made: what it begins with.
        fault: what happens to it.
        at: at which change of a file.
        before: the folder as it was.
        after: the folder as the undisturbed command leaves it.
        repeat: run it once more, on a sound machine.
    """
    with tempfile.TemporaryDirectory(prefix="passerby-faults-") as scratch:
        place = _place(writer, made, Path(scratch))
        command = _arguments(writer, made, place)
        ended = passerby(command, place.parent, fault, at)
        wrong = [] if ended.status is None or ended.told else [f"ends with {ended.status}: {ended.errors[-300:]}"]
        if fault == "full" and ended.status == 2 and ended.errors.count("error: ") != 1:
            wrong.append(f"says more than a line: {ended.errors[:300]}")
        found = _settled(place)
        state = _state(found, before, after)
        if state == "neither":
            wrong.append(f"leaves neither the old nor the new: {_difference(found, before)} and {_difference(found, after)}")
        if not repeat or (state == "after" and not writer.again):
            return wrong
        repeated = passerby(command, place.parent)
        if repeated.status not in (0, 3):
            wrong.append(f"run once more it ends with {repeated.status}: {repeated.errors[-300:]}")
        if tree(place) != after:
            wrong.append(f"run once more it gives something else: {_difference(tree(place), after)}")
        return wrong


def _place(writer: Writer, made: Path, scratch: Path) -> Path:
    """A folder of this name, so that what is written does not depend on where it lies."""
    place = scratch / PLACE / "out"
    place.parent.mkdir()
    if writer.before:
        shutil.copytree(made / writer.before, place)
    return place


def _arguments(writer: Writer, made: Path, place: Path) -> list[str | Path]:
    ways = {"made": made, PLACE: place.parent}
    return [ways[head] / rest if (head := part.split("/")[0]) in ways and (rest := part[len(head) + 1 :]) else part
            for part in writer.command]  # fmt: skip


def _settled(place: Path) -> Files:
    """What a reader finds, but for hidden files, which nobody reads."""
    if place.is_dir():
        try:
            recover(place, "reads")
            recover(place / "trajectories", "reads")
        except InputError:
            pass
    return {name: content for name, content in tree(place).items() if not any(part[0] == "." for part in name.split("/"))}


def _state(found: Files, before: Files, after: Files) -> str:
    """Whether a folder is as before or as after the command; a report that is not there can be made again."""
    for name, whole in (("after", after), ("before", before)):
        if found == whole or found == {key: value for key, value in whole.items() if key != "report.html"}:
            return name
    return "neither"


def _difference(found: Files, wanted: Files) -> str:
    """The names that differ."""
    names = sorted({*found, *wanted})
    return ", ".join(name for name in names if found.get(name) != wanted.get(name)) or "nothing"
