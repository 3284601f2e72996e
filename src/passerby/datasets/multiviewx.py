"""MultiviewX: six cameras rendered with Unity, 400 annotated instants at 2 per second (Hou et al., ECCV 2020).

Layout as published (https://github.com/hou-yz/MultiviewX, whose scripts wrote it): the layout of WILDTRACK, with these
differences: `calibrations/intrinsic/intr_Camera1.xml` to `Camera6` (OpenCV storage; lenses with distortion, which the pictures
have), `calibrations/extrinsic/extr_Camera1.xml` (OpenCV storage), all lengths in metres, cells of 2.5 cm, 1000 along x and 640
along y, from the origin on.

The world is Unity's: z up, but left-handed. The set's calibration was fitted to its points by `cv2.calibrateCamera`, which
finds only proper rotations. Therefore all people are behind its cameras. Here x is negated.
"""

from __future__ import annotations

from pathlib import Path

from passerby.common.errors import InputError
from passerby.core.cameras import Lens
from passerby.datasets.grid_annotations import GridLayout, read_grid
from passerby.datasets.parsing import xml_numbers
from passerby.datasets.published import Published, PublishedCamera
from passerby.geometry.rotations import exp_rotation

LAYOUT = GridLayout(
    name="multiviewx",
    labels=tuple(f"Camera{number}" for number in range(1, 7)),
    cells=(1000, 640),
    cell_m=0.025,
    origin_m=(0.0, 0.0),
    numbers_per_frame=1,
    fps=2.0,
    size=(1920, 1080),
)


def read(folder: Path) -> Published:
    """Read MultiviewX. Raises `InputError` for missing, broken or contradictory files."""
    note = "The boxes are projections of a cylinder 1.8 m high and 0.32 m wide at each position, not outlines of the people."
    return read_grid(folder, LAYOUT, _camera, (note,))


def _camera(calibrations: Path, label: str, name: str) -> PublishedCamera:
    """Read one camera as published: in metres, with all people behind it."""
    intrinsic = calibrations / "intrinsic" / f"intr_{label}.xml"
    extrinsic = calibrations / "extrinsic" / f"extr_{label}.xml"
    matrix = xml_numbers(intrinsic, "camera_matrix", (3, 3))
    distortions = xml_numbers(intrinsic, "distortion_coefficients", (-1,))
    try:
        lens = Lens(LAYOUT.size, matrix, distortions)
    except InputError as error:
        raise InputError(f"{intrinsic}: {error}") from None
    turned = exp_rotation(xml_numbers(extrinsic, "rvec", (3,)))
    return PublishedCamera(name, lens, turned, xml_numbers(extrinsic, "tvec", (3,)))
