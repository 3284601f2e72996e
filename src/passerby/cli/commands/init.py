"""`passerby init`: a scene file from a folder of videos."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from passerby.common.errors import InputError

if TYPE_CHECKING:
    from passerby.scene.start.start import Started


def init(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder of the videos, one per camera.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Scene file to write; default: scene.toml in the folder.", show_default=False),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an earlier scene file; no other file is touched.")] = False,
) -> None:
    """Write a scene file, with comments, for a folder of videos.

    Intrinsics in the folder, or in its subfolder calibration or intrinsics, are used: a rig file (TOML of Anipose, Caliscope
    or Pose2Sim), OpenCV files (YAML, XML, JSON), or a file of another tool that `passerby formats` lists. The exit status is
    2 where a camera's video cannot be read.
    """
    from passerby.scene.start.start import start

    started = start(folder, out, force)
    _show(started)
    if started.unreadable:
        raise typer.Exit(InputError.exit_status)


def _show(started: Started) -> None:
    """Print the cameras, the notes, and the next steps."""
    import shlex

    from passerby.cli.terminal import MISSING, number, show_table
    from passerby.interchange.storage.text_formats import relative

    rows = []
    for camera in started.cameras:
        found, info = camera.found, camera.found.info
        source = found.video or next(iter(found.files.values()), None)
        rows.append(
            [
                found.name,
                MISSING if source is None else relative(source, started.scene),
                MISSING if info is None else f"{info.size[0]} x {info.size[1]}",
                MISSING if info is None else f"{info.average_fps:.4g}" + (" (varies)" if info.variable else ""),
                MISSING if info is None else number(info.seconds, 1, " s"),
                MISSING if info is None else info.codec,
                camera.state,
            ]
        )
    show_table(f"{len(rows)} cameras", ("camera", "video", "size", "frames/s", "length", "codec", "intrinsics"), rows)
    for note in started.notes:
        print(" ".join(note.split()))
    print(f"written: {', '.join(map(str, started.written))}")
    print("\nNext:")
    steps = [*started.to_do]
    scene = shlex.quote(str(started.scene))
    steps += [
        f"passerby check {scene}",
        f"passerby calibrate {scene} -o out",
    ]
    for index, step in enumerate(steps, start=1):
        print(f"  {index}. {step}")
