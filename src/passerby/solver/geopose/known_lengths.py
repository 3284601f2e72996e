"""Known lengths between marked image points, measured in a reconstruction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.core.scale_cues import KnownLength
from passerby.geometry.triangulation import triangulate


def measured_lengths(
    rig: Rig, lengths: Sequence[KnownLength], cameras: Ints, rotations: Floats, translations: Floats
) -> list[tuple[KnownLength, float]]:
    """Return each known length that two or more posed cameras see, with its measured length in the reconstruction.

    Args:
        rig: names and lenses.
        lengths: the cues.
        cameras: (C,) indices in the rig of the cameras that have a pose.
        rotations: (C, 3, 3) world to camera.
        translations: (C, 3) world to camera, in the unit of the reconstruction.

    Raises:
        InputError: a mark has no ray in the camera's lens model, or its camera is not in the rig.
    """
    found = []
    for cue in lengths:
        unknown = sorted(set(cue.points) - set(rig.names))
        if unknown:
            raise InputError(f"a known length is marked in camera {unknown[0]}: the rig has {', '.join(rig.names)}")
        seen = [(k, rig.cameras[camera]) for k, camera in enumerate(cameras) if rig.names[camera] in cue.points]
        if len(seen) < 2:
            continue
        rays = [camera.lens.bearings(cue.points[camera.name]) for _, camera in seen]
        for (_, camera), ray in zip(seen, rays, strict=True):
            if not np.isfinite(ray).all():
                raise InputError(
                    f"a known length is marked in camera {camera.name} at {np.asarray(cue.points[camera.name]).tolist()}, "
                    "outside what its lens can see: mark it inside the image"
                )
        ends = triangulate(
            np.repeat([k for k, _ in seen], 2), np.tile([0, 1], len(seen)), np.concatenate(rays), rotations, translations, 2
        )
        measured = float(np.linalg.norm(ends[1] - ends[0]))
        if np.isfinite(measured) and measured > 0:
            found.append((cue, measured))
    return found
