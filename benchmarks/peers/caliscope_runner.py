"""caliscope's extrinsic calibration of people as points: every person is an object, its points are the object's keypoints.

The documented pipeline, `caliscope.api.calibrate_extrinsics`: bootstrap by essential matrices, bundle adjustment, robust
refinement, the worst 2.5 % of the sightings filtered, bundle adjustment. The lenses are known, so they are held.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from caliscope.api import CameraArray, CameraData, ImagePoints, calibrate_extrinsics
from protocol import Points, Poses, run


def solve(source: Path, option: str) -> Poses:
    """The poses of all cameras that were placed; caliscope takes the distorted pixels and the distortion."""
    points = Points.read(source)
    cameras = {
        index: CameraData(
            cam_id=index,
            size=(int(points.size[index, 0]), int(points.size[index, 1])),
            matrix=points.matrix[index],
            distortions=points.distortions[index],
        )
        for index in range(len(points.names))
    }
    table = pd.DataFrame(
        {
            "sync_index": points.instant,
            "cam_id": points.camera,
            "object_id": points.person,
            "keypoint_id": points.part,
            "img_loc_x": points.pixel[:, 0],
            "img_loc_y": points.pixel[:, 1],
        }
    )
    made = calibrate_extrinsics(ImagePoints(table), CameraArray(cameras), None, refine_intrinsics=False)
    posed = made.capture_volume.camera_array.posed_cameras
    return {str(points.names[index]): (np.array(one.rotation), np.array(one.translation)) for index, one in posed.items()}


if __name__ == "__main__":
    run(solve, "caliscope")
