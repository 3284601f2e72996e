"""WILDTRACK: seven real cameras over a square, 400 annotated instants at 2 per second (Chavdarova et al., CVPR 2018).

Layout as published (https://www.epfl.ch/labs/cvlab/data/data-wildtrack/): `annotations_positions/00000000.json`, 00000005, ...;
`Image_subsets/C1/00000000.png`, ...; `calibrations/extrinsic/extr_CVLab1.xml` (`rvec` and `tvec` as bare text, centimetres),
`calibrations/intrinsic_zero/intr_CVLab1.xml` (OpenCV storage). Its README states: the cells are 2.5 cm, 480 along x and 1440
along y, from (-3, -9) m; `intrinsic_zero` belongs to the pictures, which are already undistorted, `intrinsic_original` to the
raw videos. The annotations are of the pictures, so `intrinsic_zero` is read. CVLab1 to 4 and IDIAP1 to 3 are C1 to C7 (as in
https://github.com/hou-yz/MVDet, multiview_detector/datasets/Wildtrack.py).

The world is right-handed with z up; the ground is z = 0.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from passerby.common.errors import InputError
from passerby.core.cameras import Lens
from passerby.datasets.grid_annotations import GridLayout, read_grid
from passerby.datasets.parsing import xml_numbers
from passerby.datasets.published import Published, PublishedCamera
from passerby.geometry.rotations import exp_rotation

LAYOUT = GridLayout(
    name="wildtrack",
    labels=("CVLab1", "CVLab2", "CVLab3", "CVLab4", "IDIAP1", "IDIAP2", "IDIAP3"),
    cells=(480, 1440),
    cell_m=0.025,
    origin_m=(-3.0, -9.0),
    numbers_per_frame=5,
    fps=2.0,
    size=(1920, 1080),
)
METRES_PER_UNIT = 0.01


def read(folder: Path) -> Published:
    """Read WILDTRACK. Raises `InputError` for missing, broken or contradictory files."""
    note = "The lenses are those of the undistorted images of Image_subsets; the raw videos of the set need intrinsic_original."
    return read_grid(folder, LAYOUT, _camera, (note,))


def _camera(calibrations: Path, label: str, name: str) -> PublishedCamera:
    """Read one camera of the undistorted pictures, metres."""
    intrinsic = calibrations / "intrinsic_zero" / f"intr_{label}.xml"
    extrinsic = calibrations / "extrinsic" / f"extr_{label}.xml"
    matrix = xml_numbers(intrinsic, "camera_matrix", (3, 3))
    distortions = xml_numbers(intrinsic, "distortion_coefficients", (-1,), needed=False)
    if distortions.any():
        raise InputError(
            f"{intrinsic}: <distortion_coefficients> is {distortions.tolist()}, but images without distortion have zeros: "
            "was intrinsic_original copied over intrinsic_zero? Take the folder from the set again"
        )
    try:
        lens = Lens(LAYOUT.size, matrix, np.zeros(0))
    except InputError as error:
        raise InputError(f"{intrinsic}: {error}") from None
    turned = exp_rotation(xml_numbers(extrinsic, "rvec", (3,)))
    return PublishedCamera(name, lens, turned, METRES_PER_UNIT * xml_numbers(extrinsic, "tvec", (3,)))
