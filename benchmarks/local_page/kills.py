"""The server, and the calibration that it has begun, killed while somebody marks and while it solves."""

from __future__ import annotations

import json
import os
import shutil
import signal
import tempfile
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from command import ONE_THREAD, passerby
from local_page.hand import ends_of
from local_page.serving import Served, served
from passerby.common.errors import InputError
from passerby.interchange.calibration_json import CALIBRATION_FILE, read_document
from passerby.interchange.rig_toml import read_rig
from passerby.page.work import FOLDER, RUN_FILE
from passerby.scene.scene import Scene

KILLS = 30
MARKING_S, SOLVING_S = 1.5, 6.0
"""The kill comes at random within so long after the first act, and after the start of a calibration."""
OPTIONS = ("--people", "4", "--seconds", "10", "--box-noise", "0.02", "--seed", "713", "--unrelated-ids")


@dataclass(frozen=True)
class KillCase:
    """A calibrated scene of boxes, and the seed of the moment."""

    folder: Path
    seed: int


def scene_folder(folder: Path) -> Path:
    """A small scene and its calibration, made once."""
    if not (folder / "out" / "rig.toml").is_file():
        passerby("simulate", "-o", str(folder / "scene"), *OPTIONS, environment=ONE_THREAD)
        passerby("calibrate", str(folder / "scene" / "scene.toml"), "-o", str(folder / "out"), environment=ONE_THREAD)
    return folder


def cases(folder: Path, kills: int) -> dict[str, KillCase]:
    """By key; every second one while it solves."""
    return {f"kill {seed}": KillCase(folder, seed) for seed in range(kills)}


def work(case: KillCase) -> dict[str, Any]:
    """Mark lengths one after another, be killed, and see what is in the files."""
    solving = case.seed % 2 == 1
    rng = np.random.default_rng(case.seed)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "copy"
        shutil.copytree(scene_folder(case.folder), folder)
        scene, out = folder / "scene" / "scene.toml", folder / "out"
        marked: list[float] = []
        with served(scene, out) as server:
            version = server.ask("/api/state")[1]["version"]
            marker = threading.Thread(target=_mark, args=(server, scene, rng, version, marked), daemon=True)
            marker.start()
            if solving:
                while not marked:
                    time.sleep(0.005)
                server.ask("/api/start", {})
            time.sleep(float(rng.uniform(0, SOLVING_S if solving else MARKING_S)))
            server.process.send_signal(signal.SIGKILL)
            if solving:
                _kill_calibration(out)
            server.process.wait()
            marker.join()
        return {"solving": solving, **_left(scene, out, marked)}


def _mark(server: Served, scene: Path, rng: np.random.Generator, version: str, marked: list[float]) -> None:
    """Mark lengths until the server is gone; `marked` has those that were acknowledged."""
    truth = read_rig(scene.parent / "truth.toml")
    ends, names = ends_of(truth), truth.names[:2]
    for number in range(10_000):
        metres = round(3.0 + 0.001 * number, 3)
        points = {name: (truth[name].project(ends) + rng.normal(size=(2, 2))).tolist() for name in names}
        with suppress(OSError):
            status, told = server.ask("/api/act", {"act": "length", "version": version, "metres": metres, "points": points})
            if status != 200:
                raise RuntimeError(told)
            marked.append(metres)
            version = told["version"]
            continue
        return


def _kill_calibration(out: Path) -> None:
    with suppress(OSError, ValueError):
        os.killpg(int(json.loads((out / FOLDER / RUN_FILE).read_text(encoding="utf-8"))["pid"]), signal.SIGKILL)


def _left(scene: Path, out: Path, marked: list[float]) -> dict[str, Any]:
    """Acknowledged marks that are missing, files that are broken, and temporary files that were left."""
    broken = []
    present: list[float] = []
    try:
        present = [one.metres for one in Scene.load(scene).scale.lengths]
    except InputError as error:
        broken.append(f"scene.toml: {error}")
    for name, read in ((CALIBRATION_FILE, lambda: read_document(out)), ("rig.toml", lambda: read_rig(out / "rig.toml"))):
        try:
            read()
        except InputError as error:
            broken.append(f"{name}: {error}")
    parts = [path.name for path in (*scene.parent.rglob("*.part"), *out.rglob("*.part"))]
    missing = sorted(set(marked) - set(present))
    unasked = len(set(present) - set(marked))
    return {"marked": len(marked), "missing": missing, "unacknowledged": unasked, "broken": broken, "temporary": len(parts)}
