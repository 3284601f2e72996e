"""A rig that was monitored: a calibration's folder with its films, and footage in which C2 is turned.

C1 and C2 have films of plain greys; C3 and C4 have boxes only.
"""

import json

import numpy as np

from passerby.cli.main import run
from passerby.core.observations import Clock
from passerby.interchange.calibration_json import CalibrationDocument, CameraEntry, write_document
from passerby.interchange.video_writer import VideoWriter
from support.scenes.walkers_for_monitor import FPS, calibrated, knocked, true_rig, walkers, write_watched

CALIBRATED, BEFORE, AFTER = 40, 110, 200
"""Grey values of the films: at the calibration, and before and after C2 was turned."""
MOVED_S, SECONDS = 90.0, 160


def monitored(folder, *, turned=True):
    """Write all into a folder and monitor the rig; returns the folder of `passerby monitor`."""
    rig = true_rig()
    (folder / "then").mkdir(parents=True)
    (folder / "today").mkdir()
    sizes = {camera.name: camera.lens.size for camera in rig}
    filmed = {"C1": 3, "C2": 0}  # brighter by: two cameras never have the same film
    after = knocked(rig["C2"].pose, (0, 2, 0))
    seen = walkers(rig, SECONDS, knocks={"C2": (MOVED_S, after)} if turned else None)
    given, scene = write_watched(folder / "today", calibrated(rig), seen)
    lines = scene.read_text()
    then = "[scene]\n"
    for name, brighter in filmed.items():
        film(folder / "then" / f"{name}.mp4", sizes[name], [CALIBRATED + brighter] * 20)
        greys = [BEFORE if k / FPS < MOVED_S or name != "C2" else AFTER for k in range(int(SECONDS * FPS))]
        film(folder / "today" / f"{name}.mp4", sizes[name], [grey + brighter for grey in greys])
        lines = lines.replace(f'tracks = "{name}.txt"', f'tracks = "{name}.txt"\nvideo = "{name}.mp4"')
        then += f'[cameras.{name}]\nvideo = "{name}.mp4"\n'
    scene.write_text(lines)
    (folder / "then" / "scene.toml").write_text(then)
    (folder / "out").mkdir()
    given.rename(folder / "out" / "rig.toml")
    (folder / "today" / "rig.toml").write_bytes((folder / "out" / "rig.toml").read_bytes())
    clock = Clock(FPS)
    write_document(
        folder / "out",
        CalibrationDocument(
            verdict="accepted",
            scene_file=str(folder / "then" / "scene.toml"),
            cameras=tuple(CameraEntry(name=name, fps=clock.fps, time_offset_s=clock.offset_s) for name in sizes),
        ),
    )
    status = run(["monitor", str(folder / "out"), str(scene), "-o", str(folder / "checked")])
    assert status == (3 if turned else 0)
    return folder / "checked"


def film(path, size, greys):
    with VideoWriter(path, size, FPS) as video:
        for grey in greys:
            video.write(np.full((size[1], size[0], 3), grey, np.uint8))


def rewrite(folder, change):
    path = folder / "monitor.json"
    told = json.loads(path.read_text())
    change(told)
    path.write_text(json.dumps(told))
