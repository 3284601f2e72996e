"""Memory and time of watching one video: `python perception_memory.py VIDEO --detector NAME --shelf FOLDER [--models FOLDER]`.

Prints one JSON object: peak memory before the first picture, after it, and at the end, 10^6 bytes; pictures; seconds by stage.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

from threadpoolctl import threadpool_limits

from passerby.perception.plan import make_plan
from passerby.perception.video import probe
from passerby.perception.watching import CameraJob, watch_camera
from passerby.scene.tables import WATCHED_FPS


def peak_mb() -> float:
    """Largest resident memory of this program so far. Linux only: elsewhere 0."""
    status = Path("/proc/self/status")
    lines = status.read_text().splitlines() if status.is_file() else []
    return sum(float(line.split()[1]) * 1024 / 1e6 for line in lines if line.startswith("VmHWM:"))


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("video", type=Path)
    parser.add_argument("--detector", required=True)
    parser.add_argument("--shelf", type=Path, required=True)
    parser.add_argument("--models", type=Path)
    arguments = parser.parse_args()
    plan = make_plan(arguments.detector, "none", "none", models=arguments.models, base=None)
    info = probe(arguments.video)
    marks = {"start_mb": peak_mb()}

    def tell(done: int, total: int) -> None:
        if done >= 1 and "first_picture_mb" not in marks:
            marks["first_picture_mb"] = peak_mb()

    with threadpool_limits(limits=1, user_api="blas"):
        watched = watch_camera(CameraJob("camera", info, WATCHED_FPS, replace(plan, tiles="auto"), arguments.shelf), tell)
    result = {**marks, "peak_mb": peak_mb(), "pictures": watched.pictures, "boxes": len(watched.boxes), **watched.seconds}
    print(json.dumps(result))


if __name__ == "__main__":
    main()
