"""A small generated example of CMC, in the layout that its own scripts read."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from scipy.io import savemat

from passerby.core.cameras import Lens
from support.scenes.walking_area import HEIGHT_M, MIRROR, RADIUS_M, Walk, around, paths

SIZE = (1920, 1024)
MIDDLE = (3.8, 1.7)


def write_cmc(folder: Path, frames: int = 30, left_handed: bool = False, scale: float = 1.0, matrices: str = "mat") -> Walk:
    """A sequence, named like its folder: CMC1 say. `matrices`: mat (MATLAB files above the folder) or txt (in it)."""
    folder.mkdir(parents=True)
    lens = Lens(SIZE, np.array([[950.0, 0, 955], [0, 950, 515], [0, 0, 1]]), np.zeros(0))
    rig = around([f"Cam_{number}" for number in range(1, 5)], lens, MIDDLE, 4.5, seed=6)
    walk = Walk(rig, paths(5, frames, MIDDLE, 1.6, 1e-5, seed=7))
    mirror = MIRROR if left_handed else np.ones(3)
    for number, camera in enumerate(rig, start=1):
        assert camera.pose is not None
        matrix = scale * camera.lens.matrix @ np.column_stack([camera.pose.R_cw * mirror, camera.pose.t_cw])
        key = f"cam{number}_cam_mat" + ("__" if folder.name == "CMC5" and number > 2 else "")
        if matrices == "mat":
            savemat(folder.parent / f"{key}.mat", {key: matrix})
        else:
            (folder / f"{key}.txt").write_text("\n".join(" ".join(map(repr, row)) for row in matrix.tolist()))
        # Sorted by identity, as a tool that goes from person to person writes them.
        lines = []
        for person in range(walk.positions.shape[1]):
            for frame, xy in enumerate(walk.positions[:, person]):
                box = walk.cylinder_box(camera, xy, whole=True)
                if box is not None:
                    left, top, right, bottom = box
                    lines.append(f"{frame + 1} {person + 1} {left} {top} {right - left} {bottom - top} 1 -1 -1 -1\n")
        (folder / f"GT_{folder.name}_Cam{number}.txt").write_text("".join(lines))
        for frame in range(2):
            path = folder / camera.name / f"{frame + 1:06d}.png"
            path.parent.mkdir(exist_ok=True)
            cv2.imwrite(str(path), np.full((SIZE[1], SIZE[0], 3), 90, np.uint8))
    half = HEIGHT_M / 2
    rows = [
        f"{frame + 1} {person + 1} -1 -1 -1 -1 -1 {xy[0] * mirror[0]:.5f} {xy[1]:.5f} {half:.5f} "
        f"{RADIUS_M:.5f} {RADIUS_M:.5f} {half:.5f}\n"
        for frame, here in enumerate(walk.positions)
        for person, xy in enumerate(here)
    ]
    (folder / f"GT_{folder.name}_WORLD_CENTROID.txt").write_text("".join(rows))
    return walk
