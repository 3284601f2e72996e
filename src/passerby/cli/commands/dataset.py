"""`passerby dataset`: a scene folder, with its truth, from a published data set."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from passerby.common.errors import InputError

if TYPE_CHECKING:
    from passerby.datasets.published import Published
    from passerby.datasets.scene_folder import SceneFolder


def dataset(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="The data set; without it, list those that can be read.")
    ] = None,
    folder: Annotated[Path | None, typer.Argument(metavar="[FOLDER]", help="Folder of its files, as published.")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Scene folder to write; an earlier one of this kind is replaced.")
    ] = None,
    videos: Annotated[
        bool, typer.Option("--videos", help="Make videos from the images of the set, to detect people in them.")
    ] = False,
    listing: Annotated[bool, typer.Option("--list", help="List the data sets that can be read, and exit.")] = False,
) -> None:
    """Turn a published data set into a scene folder with its truth.

    The scene has mode "given" (known identities) if the set identifies people across at least two cameras; otherwise people
    are detected in its videos or images.
    """
    from passerby.cli.terminal import stages
    from passerby.common.parallel import local_processes
    from passerby.datasets import read_published
    from passerby.datasets.scene_folder import write_scene_folder

    if listing or name is None:
        _list()
        return
    if folder is None or out is None:
        missing = "the folder of its files" if folder is None else "the scene folder to write, -o scene"
        raise InputError(f"passerby dataset {name}: give {missing}: passerby dataset {name} FOLDER -o scene")
    with stages() as tell:
        tell("reading")
        published = read_published(name, folder)
        with local_processes(0, len(published.rig), len(published.pictures)) as executor:
            written = write_scene_folder(published, out, folder, film=videos, executor=executor, tell=tell)
    _show(published, written, out)


def _list() -> None:
    """The names, one line each, and where the sets are published."""
    from passerby.datasets import READERS

    width = max(map(len, READERS))
    for name, reader in READERS.items():
        print(f"{name.ljust(width)}  {reader.what}")
        print(f"{' ' * width}  {reader.where}")
    print("\nDownload the files from there, under the terms of each set: passerby dataset NAME FOLDER -o scene")


def _show(published: Published, written: SceneFolder, out: Path) -> None:
    """What was found, what is missing, and the next commands."""
    from passerby.cli.terminal import MISSING, show_table

    def count(value: int) -> str:
        return str(value) if value else MISSING

    rows = []
    for camera in published.rig:
        boxes, joints = published.boxes.get(camera.name), published.keypoints.get(camera.name)
        width, height = camera.lens.size
        rows.append(
            [
                camera.name,
                f"{width} x {height}",
                count(0 if boxes is None else len(boxes)),
                count(0 if joints is None else len(joints)),
                count(len(published.pictures.get(camera.name, ()))),
                published.videos[camera.name].name if camera.name in published.videos else MISSING,
                MISSING if camera.pose is None else "known",
            ]
        )
    title = f"{published.name}: {len(rows)} cameras" + (f", {published.people} people" if published.people else "")
    show_table(title, ("camera", "size", "boxes", "keypoints", "images", "video", "pose"), rows)
    frames = [boxes.frame for boxes in published.boxes.values() if len(boxes)]
    frames += [joints.frame for joints in published.keypoints.values() if len(joints)]
    if frames:
        rate = "" if published.fps is None else f", {published.fps:g} per second"
        print(f"annotated frames {min(f.min() for f in frames)} to {max(f.max() for f in frames)}{rate}")
    if published.ground is not None:
        print(f"{len(published.ground)} positions on the ground")
    for note in written.notes:
        print(f"note: {note}")
    scene, rig = shlex.quote(str(written.scene)), shlex.quote(f"{out}-rig")
    print(f"written to {out}, identities: {written.mode}")
    print("\nNext:")
    print(f"  passerby check {scene}")
    print(f"  passerby calibrate {scene} -o {rig}")
    if written.truth is not None:
        print(f"  passerby evaluate {rig}/rig.toml {shlex.quote(str(written.truth))}")
    if written.videos is not None:
        print(f"from the videos alone: passerby calibrate {shlex.quote(str(written.videos))} -o {rig}")
