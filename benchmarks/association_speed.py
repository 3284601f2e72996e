"""Wall time on two cores of registering all pairs of cameras: `python association_speed.py SCENE [--repeats N]`.

With the search over clocks that the scene asks for: the recording as it is, and repeated after itself, twice the frames and
twice the people, in turn. Prints one JSON object.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from passerby.association.associate import Tracklets
from passerby.association.camera_tracklets import CameraTracklets, build_camera_tracklets
from passerby.association.initial_association import associate_by_ground_tracks
from passerby.common.parallel import open_local_processes
from passerby.core.observations import Boxes, CameraObservations, Observations
from passerby.scene.inputs import SceneInputs, read_inputs
from passerby.scene.scene import Scene

CORES = 2


def repeated(observations: Observations) -> Observations:
    """All boxes a second time, after the last frame, their tracklets others than before."""
    length = max(int(seen.boxes.frame.max(initial=0)) for seen in observations.cameras.values())
    cameras = {}
    for name, seen in observations.cameras.items():
        boxes = seen.boxes
        again = np.where(boxes.identity < 0, boxes.identity, boxes.identity + boxes.identity.max(initial=0) + 1)
        cameras[name] = CameraObservations(
            Boxes(
                np.concatenate([boxes.frame, boxes.frame + length]),
                np.concatenate([boxes.identity, again]),
                np.concatenate([boxes.ltwh, boxes.ltwh]),
                np.concatenate([boxes.score, boxes.score]),
            )
        )
    return Observations(cameras, observations.fps, observations.clocks)


def prepared(inputs: SceneInputs, observations: Observations, person_height_m: float) -> tuple[float, list[CameraTracklets]]:
    """Seconds of tracking and levelling, and the cameras."""
    began = time.perf_counter()
    rng = np.random.default_rng(0)
    cameras = [
        build_camera_tracklets(camera, observations[camera.name], observations.clocks[camera.name], person_height_m, rng)
        for camera in inputs.rig
    ]
    return time.perf_counter() - began, cameras


def registered(cameras: list[CameraTracklets], search_s: float) -> tuple[float, int]:
    """Seconds of the registration, the start of its processes included, and the number of pairs that it keeps."""
    tracklets = Tracklets.of(cameras)
    began = time.perf_counter()
    # As of a recording so long that processes pay.
    with open_local_processes(sys.maxsize, len(cameras)) as executor:
        initial = associate_by_ground_tracks(cameras, tracklets, search_s, {}, executor)
        seconds = time.perf_counter() - began
    return seconds, len([edge for edge in initial.graph.edges if edge.used]) if initial.graph else 0


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("scene", type=Path)
    parser.add_argument("--repeats", type=int, default=3)
    arguments = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:CORES])
    scene = Scene.load(arguments.scene)
    inputs = read_inputs(scene)
    recordings = {"once": inputs.observations, "twice": repeated(inputs.observations)}
    result: dict[str, Any] = {name: {"preparing": [], "registering": [], "pairs": 0} for name in recordings}
    with threadpool_limits(limits=1, user_api="blas"):
        for _ in range(arguments.repeats):
            for name, observations in recordings.items():
                preparing, cameras = prepared(inputs, observations, scene.scale.person_height_m)
                registering, pairs = registered(cameras, scene.association.search_s)
                result[name]["preparing"].append(preparing)
                result[name]["registering"].append(registering)
                result[name]["pairs"] = pairs
    print(json.dumps(result))


if __name__ == "__main__":
    main()
