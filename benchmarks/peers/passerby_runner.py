"""Passerby itself under the same conditions: a fresh process, one thread; the input is a scene file."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from protocol import Poses, write_result

from passerby import EvidenceError, calibrate


def main() -> None:
    """Calibrate the scene that the command line names; reading its files does not count as solving."""
    source, target = Path(sys.argv[1]), Path(sys.argv[2])
    poses: Poses = {}
    failure, seconds, began = None, 0.0, time.perf_counter()
    try:
        made = calibrate(source)
        seconds = made.seconds["solving"]
        poses = {camera.name: (camera.pose.R_cw, camera.pose.t_cw) for camera in made.rig if camera.pose is not None}
        if not poses:
            failure = "; ".join(made.reasons)
    except EvidenceError as error:
        failure, seconds = str(error), time.perf_counter() - began
    write_result(target, poses, seconds, failure, "passerby")


if __name__ == "__main__":
    main()
