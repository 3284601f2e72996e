"""`passerby record`: record streams of cameras to files, also for the commands that calibrate and check scenes with streams."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from passerby.common.progress import ProgressForm

if TYPE_CHECKING:
    from passerby.recording.capture import Recording
    from passerby.recording.scene_streams import StreamedScene
    from passerby.scene.check import SceneCheck
    from passerby.scene.scene import Scene

INTERRUPTED = 130
_ENDED = {
    "stopped": "stopped before its time; what was recorded is kept",
    "space": "stopped: it is as large as --max-gb allows",
    "disk": "stopped: the disk is nearly full",
}


def record(
    cameras: Annotated[Path, typer.Argument(metavar="CAMERAS", help="File (TOML) with the stream of each camera.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the recordings and their scene file.")],
    seconds: Annotated[float, typer.Option(help="Length of the recording.")] = 600.0,
    piece: Annotated[float, typer.Option(help="Length of each file, in seconds.")] = 10.0,
    timeout: Annotated[float, typer.Option(help="A camera that sends nothing for so many seconds counts as gone.")] = 10.0,
    max_gb: Annotated[
        float | None, typer.Option("--max-gb", help="Most gigabytes of all files; default: until the disk is nearly full.")
    ] = None,
    without_missing: Annotated[
        bool, typer.Option("--without-missing", help="Record the others if a camera cannot be reached.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")] = False,
    progress: Annotated[
        ProgressForm, typer.Option("--progress", help="How progress is written on standard error; json: a JSON object a line.")
    ] = ProgressForm.auto,
) -> None:
    """Record the streams of all cameras at once: RTSP, HTTP (MJPEG, HLS) or a video device.

    Nothing is decoded or encoded. A connection that breaks is made anew. Ctrl-C ends the recording and keeps it.
    `passerby calibrate OUT/scene.toml` calibrates what was recorded.
    """
    from passerby.cli.terminal import stages
    from passerby.interchange.storage.text_formats import to_json
    from passerby.interchange.storage.transaction import folder_lock
    from passerby.recording.capture import CaptureOptions
    from passerby.recording.capture import record as capture
    from passerby.recording.scene_streams import write_recording, write_scene_file
    from passerby.recording.settings import read_plan

    plan = read_plan(cameras)
    options = CaptureOptions(seconds, piece, timeout, float("inf") if max_gb is None else max_gb * 1e9, without_missing)
    stop = threading.Event()
    with folder_lock(out, "passerby record"):
        scene = write_scene_file(plan, out)
        with stages(form=progress) as tell, stopping(stop):
            found = capture(plan.streams, out, options, tell, stop)
        write_recording(found, out)
    if json:
        print(to_json({**found.to_dict(), "scene": str(scene)}), end="")
    else:
        _show(found)
        print(f"written to {out}; calibrate with: passerby calibrate {scene}")
    if found.ended == "stopped":
        raise typer.Exit(INTERRUPTED)


def _show(found: Recording) -> None:
    """Print a row for each camera, with its gaps, and notes on faults."""
    from passerby.cli.terminal import number, show_table

    rows = []
    for camera in found.cameras:
        lost = sum(gap.until_s - gap.from_s for gap in camera.gaps)
        megabytes = sum(piece.size_bytes for piece in camera.pieces) / 1e6
        rows.append([
            camera.camera, str(len(camera.pieces)), number(camera.seconds, 1, " s"), number(megabytes, 1, " MB"),
            str(len(camera.gaps)), number(lost, 1, " s"), camera.clock or "-",
        ])  # fmt: skip
    show_table("recorded", ("camera", "files", "length", "size", "gaps", "lost", "clock"), rows)
    for camera in found.cameras:
        if camera.unset_s is not None:
            print(f"note: camera {camera.camera}: its clock is off by {camera.unset_s:.0f} s: the time of arrival is used")
        if camera.fault is not None:
            print(f"note: camera {camera.camera}: {camera.fault}")
    if found.ended in _ENDED:
        print(f"note: {_ENDED[found.ended]}")


@contextmanager
def stopping(stop: threading.Event) -> Iterator[None]:
    """Make Ctrl-C and SIGTERM set `stop` during the block, instead of an interruption of the process."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    usual = {number: signal.signal(number, lambda *_: stop.set()) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in usual.items():
            signal.signal(number, handler)


def record_if_needed(streamed: StreamedScene, out: Path, verbose: bool, form: ProgressForm) -> Scene:
    """Return the scene of an existing recording, or record the streams first if there is none.

    Raises `InputError` as `record_scene` and `make_recorded_scene` do, and `typer.Exit` if the recording was stopped.
    """
    from passerby.cli.terminal import stages
    from passerby.common.progress import tell_warning
    from passerby.interchange.storage.transaction import folder_lock
    from passerby.recording.scene_streams import is_recorded, make_recorded_scene, record_scene

    folder, stop = streamed.folder_for(out), threading.Event()
    with stages(verbose, form) as tell, folder_lock(folder, "passerby calibrate"):
        if is_recorded(folder):
            scene = make_recorded_scene(streamed, folder)
            tell_warning(tell, f"{folder}: the recording that is there is used; to record anew, remove that folder")
            return scene
        with stopping(stop):
            ended = record_scene(streamed, folder, tell, stop)
    if ended == "stopped":
        print(f"error: the recording was stopped before its time; what was recorded is kept in {folder}", file=sys.stderr)
        raise typer.Exit(INTERRUPTED)
    return make_recorded_scene(streamed, folder)


def check_streams(path: Path) -> SceneCheck:
    """Check a scene. If its streams are not recorded yet, check everything else, and report the streams to be recorded."""
    from passerby.common.errors import InputError
    from passerby.interchange.storage.safe_parsing import faults_of
    from passerby.recording.scene_streams import is_recorded, make_recorded_scene, read_streamed
    from passerby.scene.check import SceneCheck, check_scene

    try:
        streamed = read_streamed(path)
        if streamed is None:
            return check_scene(path)
        if streamed.folder is not None and is_recorded(streamed.folder):
            return check_scene(make_recorded_scene(streamed, streamed.folder))
    except InputError as error:
        return SceneCheck(path.stem, None, (), faults_of(error), ())
    return check_scene(streamed.plain, streamed.findings(streamed.folder))
