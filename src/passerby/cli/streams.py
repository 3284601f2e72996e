"""Scenes whose videos are streams, for the commands that calibrate and check them."""

from __future__ import annotations

import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from passerby.common.progress import ProgressForm

if TYPE_CHECKING:
    from passerby.recording.scene_streams import StreamedScene
    from passerby.scene.check import SceneCheck
    from passerby.scene.scene import Scene


def recorded(streamed: StreamedScene, out: Path, verbose: bool, form: ProgressForm) -> Scene:
    """The scene of a recording that is made now, or that is there already.

    Raises `InputError` as `record_scene` and `recorded_scene` do, and `typer.Exit` where the recording was stopped.
    """
    from passerby.cli.commands.record import INTERRUPTED, stopping
    from passerby.cli.terminal import stages
    from passerby.common.progress import tell_warning
    from passerby.interchange.storage.transaction import folder_lock
    from passerby.recording.scene_streams import is_recorded, record_scene, recorded_scene

    folder, stop = streamed.folder_for(out), threading.Event()
    with stages(verbose, form) as tell, folder_lock(folder, "passerby calibrate"):
        if is_recorded(folder):
            scene = recorded_scene(streamed, folder)
            tell_warning(tell, f"{folder}: the recording that is there is used; to record anew, remove that folder")
            return scene
        with stopping(stop):
            ended = record_scene(streamed, folder, tell, stop)
    if ended == "stopped":
        print(f"error: the recording was stopped before its time; what was recorded is kept in {folder}", file=sys.stderr)
        raise typer.Exit(INTERRUPTED)
    return recorded_scene(streamed, folder)


def checked(path: Path) -> SceneCheck:
    """What a scene holds; of one whose streams are not recorded yet, everything else, and what would be recorded."""
    from passerby.common.errors import InputError
    from passerby.interchange.storage.faults import faults_of
    from passerby.recording.scene_streams import is_recorded, read_streamed, recorded_scene
    from passerby.scene.check import SceneCheck, check_scene

    try:
        streamed = read_streamed(path)
        if streamed is None:
            return check_scene(path)
        if streamed.folder is not None and is_recorded(streamed.folder):
            return check_scene(recorded_scene(streamed, streamed.folder))
    except InputError as error:
        return SceneCheck(path.stem, None, (), faults_of(error), ())
    return check_scene(streamed.plain, streamed.findings(streamed.folder))
