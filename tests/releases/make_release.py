"""Files as this release writes them, for all later ones to read: `python tests/releases/make_release.py VERSION`.

Run once for each release; what is there is never written again.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

from passerby.cli.main import run  # noqa: E402
from passerby.core.cameras import Camera, Lens, Pose, PoseSigma, Rig  # noqa: E402
from passerby.interchange.motchallenge import write_boxes  # noqa: E402
from passerby.interchange.rig_toml import write_rig  # noqa: E402
from passerby.interchange.storage.text_formats import to_json  # noqa: E402
from passerby.interchange.video_writer import VideoWriter  # noqa: E402
from passerby.recording.capture import CameraRecording, Recording  # noqa: E402
from passerby.recording.scene_streams import RECORDING_FILE, write_recording  # noqa: E402
from releases.kinds import KINDS  # noqa: E402
from support.scenes.puppet_videos import pictures, puppets  # noqa: E402

SIMULATE = ("--preset", "terrace", "--seed", "970", "--seconds", "16", "--people", "4", "--box-noise", "0.01")
MADE_IN = Path("/tmp/passerby-release")
"""One and the same place for all, since the monitor keeps a digest of its files' paths."""
SOMEWHERE = "/somewhere"
"""Stands in the files for that place."""
WRITTEN = 1_800_000_000
"""When all files were written, seconds since 1970: the monitor states it."""


def make_release(folder: Path) -> None:
    """Write all kinds of files into a folder that does not exist yet."""
    for path in (folder, MADE_IN):
        if path.exists():
            sys.exit(f"{path}: is there already: files of a release stay as they are")
    _write_all(MADE_IN)
    shutil.move(MADE_IN, folder)


def _write_all(folder: Path) -> None:
    _calibrate(folder)
    _write_lenses(folder / "lenses")
    (folder / "handwritten").mkdir()
    shutil.copy(HERE / "handwritten.toml", folder / "handwritten" / "scene.toml")
    _write_plan(folder / "plan")
    _write_recording(folder / "recorded")
    _film(folder / "filmed")
    for path in folder.rglob("*.json"):
        path.write_text(path.read_text().replace(str(folder.resolve()), SOMEWHERE))
    expected = {name: {path: kind.read(folder / path) for path in kind.files(folder)} for name, kind in KINDS.items()}
    (folder / "expected.json").write_text(to_json(json.loads(json.dumps(expected))))


def _calibrate(folder: Path) -> None:
    """A scene, its calibration with the kept tracklets, trajectories, and what the monitor finds in the same footage."""
    scene, out = folder / "scene" / "scene.toml", folder / "out"
    assert run(["simulate", "-o", str(folder / "scene"), *SIMULATE]) == 0
    for name in ("truth", "ground_positions.csv", "heights.csv"):
        path = folder / "scene" / name
        shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
    for path in folder.rglob("*"):
        os.utime(path, (WRITTEN, WRITTEN))
    unknown = folder / "scene" / "unknown.toml"
    unknown.write_text(scene.read_text().replace('mode = "given"', 'mode = "trajectory"'))
    assert run(["calibrate", str(unknown), "-o", str(folder / "kept"), "--no-report"]) in (0, 3)
    for path in folder.joinpath("kept").iterdir():
        if path.name != "association":
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    assert run(["calibrate", str(scene), "-o", str(out), "--no-report"]) == 0
    assert run(["track", str(out)]) == 0
    for path in (out / "trajectories").iterdir():
        if path.name != "trajectories.csv":
            path.unlink()
    _thin(out / "trajectories" / "trajectories.csv")
    assert run(["monitor", str(out), str(scene), "-o", str(folder / "monitored")]) in (0, 3)


def _thin(path: Path, lines: int = 40) -> None:
    """Only the first lines: the others are alike."""
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:lines]))


def _write_lenses(folder: Path) -> None:
    """Lenses of every kind: C1 and C2 pinholes, one with eight coefficients, C3 a fisheye, C4 unknown, C5 stated on a sheet."""
    matrix = np.array([[500.0, 0, 360], [0, 500, 288], [0, 0, 1]])
    pose = Pose(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.array([0.5, 2.25, 0.125]))
    plain, rational = np.array([-0.1, 0.02, 0.0, 0.0, 0.01]), np.array([-0.1, 0.02, 0.0, 0.0, 0.01, 0.1, 0.0, 0.003])
    covariance = np.diag([1e-4, 1e-4, 2e-4, 1e-6, 1e-6, 1e-6])
    rig = Rig((
        Camera("C1", Lens((720, 576), matrix, plain), pose, PoseSigma(0.02, 0.3, covariance)),
        Camera("C2", Lens((720, 576), matrix, rational), pose, PoseSigma(0.02, 0.3, None)),
        Camera("C3", Lens((720, 576), matrix, np.array([0.01, -0.002, 0.0, 0.0]), True), pose),
        Camera("C4", Lens((720, 576), matrix, np.zeros(4), False, 0.3, True)),
        Camera("C5", Lens((720, 576), matrix, np.zeros(4), False, 0.05)),
    ))  # fmt: skip
    folder.mkdir()
    write_rig(folder / "rig.toml", rig)


def _write_plan(folder: Path) -> None:
    folder.mkdir()
    cv2.imwrite(str(folder / "plan.png"), np.full((60, 80, 3), 255, np.uint8))
    (folder / "plan.toml").write_text(
        'format_version = 1\nimage = "plan.png"\nmetres_per_pixel = 0.5\nsd_px = 1.0\n[cameras]\nC1 = [10, 20]\nC3 = [40, 20]\n'
    )


def _write_recording(folder: Path) -> None:
    """A finished recording of two cameras that sent nothing, and the scene that it is of."""
    write_recording(
        Recording(tuple(CameraRecording(name, (), None, None, None) for name in ("C1", "C2")), "time"), folder / "recording"
    )
    assert (folder / "recording" / RECORDING_FILE).is_file()
    cameras = "".join(f'[cameras.{name}]\nvideo = "rtsp://camera.invalid/{name}"\n' for name in ("C1", "C2"))
    (folder / "scene.toml").write_text(f'{cameras}[recording]\nseconds = 60\nfolder = "recording"\n')


FILMED = """
[cameras.C1]
intrinsics = "rig.toml"
video = "C1.mp4"
detections = "C1.txt"

[cameras.C2]
intrinsics = "rig.toml"
detections = "C2.txt"
fps = 4.0

[perception]
detector = "background"
embedder = "stripes"
keypoints = "none"

[association]
max_offset_s = 0
"""


def _film(folder: Path) -> None:
    """A short video with its boxes, and what was kept of it: without the empty scene, which is too large."""
    folder.mkdir()
    made = puppets(2.0, 4.0, 2, 2)
    write_rig(folder / "rig.toml", made.rig)
    for name in made.rig.names:
        write_boxes(folder / f"{name}.txt", replace(made.boxes[name], identity=np.full(len(made.boxes[name]), -1)))
    with VideoWriter(folder / "C1.mp4", made.rig["C1"].lens.size, made.fps, crf=34) as video:
        for picture in pictures(made, "C1", noise=0.0):
            video.write(picture, None)
    scene = folder / "scene.toml"
    scene.write_text(FILMED.lstrip())
    assert run(["calibrate", str(scene), "-o", str(folder / "out"), "--no-report"]) in (0, 3)
    for path in (folder / "out").iterdir():
        if path.name != "perception":
            shutil.rmtree(path) if path.is_dir() else path.unlink()


if __name__ == "__main__":
    make_release(HERE / sys.argv[1])
