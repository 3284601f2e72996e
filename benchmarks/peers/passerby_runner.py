"""Passerby itself under the same conditions: a fresh process, one thread; the input is a scene file."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from protocol import Poses, write_result

from passerby import EvidenceError, calibrate


def main() -> None:
    """Calibrate the scene that the command line names; reading its files counts, as with the peers."""
    source, target = Path(sys.argv[1]), Path(sys.argv[2])
    poses: Poses = {}
    failure, began = None, time.process_time()
    try:
        made = calibrate(source)
        poses = {camera.name: (camera.pose.R_cw, camera.pose.t_cw) for camera in made.rig if camera.pose is not None}
        if not poses:
            failure = "; ".join(made.reasons)
    except EvidenceError as error:
        failure = str(error)
    write_result(target, poses, time.process_time() - began, failure, "passerby")


if __name__ == "__main__":
    main()
