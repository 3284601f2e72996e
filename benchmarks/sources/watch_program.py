"""Watch one video: `python watch_program.py VIDEO --detector NAME --shelf FOLDER [--models FOLDER]`.

Run with the package of one version or another, so it uses nothing that only the newest one has. Prints one JSON object: the
package's folder, processor seconds of watching, pictures, boxes, and seconds by stage.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

from threadpoolctl import threadpool_limits

import passerby
from passerby.perception.plan import make_plan
from passerby.perception.video import probe
from passerby.perception.watching import CameraJob, watch_camera

RATE = 5.0  # pictures a second that a calibration looks at


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("video", type=Path)
    parser.add_argument("--detector", required=True)
    parser.add_argument("--shelf", type=Path, required=True)
    parser.add_argument("--models", type=Path)
    arguments = parser.parse_args()
    plan = replace(make_plan(arguments.detector, "none", "none", models=arguments.models, base=None), tiles="auto")
    began = time.process_time()
    with threadpool_limits(limits=1, user_api="blas"):
        job = CameraJob("camera", probe(arguments.video), RATE, plan, arguments.shelf)
        watched = watch_camera(job, lambda done, total: None)
    told = {
        "package": str(Path(passerby.__file__).parent), "cpu_s": time.process_time() - began,
        "pictures": watched.pictures, "boxes": len(watched.boxes), "stages_s": watched.seconds,
    }  # fmt: skip
    print(json.dumps(told))


if __name__ == "__main__":
    main()
