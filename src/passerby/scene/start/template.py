"""A rig file to be filled in: the picture sizes are known, the lenses are not, and no number is invented for them."""

from __future__ import annotations

import math
from collections.abc import Sequence

from passerby.interchange.storage import toml_text
from passerby.scene.start.folders import FoundCamera

FIELDS_OF_VIEW = (50, 60, 70, 80, 90, 110)
"""Degrees along the longer side: from a camcorder to a wide angle lens. Wider ones need a calibration with a pattern."""

GUESS_SD = 15.0
"""Per cent: what a focal length from a data sheet's field of view is off by, one sigma. A field of view that is told for the
diagonal of 16:9 makes it 13 % too small, and what cameras crop when they film 5 to 20 %."""

HEAD = f"""The intrinsics of the cameras, to be filled in: `passerby check` rejects this file until numbers replace FX and FY.

FX, FY   focal length in pixels. Best from a calibration with a pattern (OpenCV, Caliscope, Pose2Sim, ...).
         Otherwise from the field of view along the longer side: FX = longer side / 2 / tan(field of view / 2), and FY = FX;
         or from a focal length of f mm as for 35 mm film: FX = longer side * f / 36, and FY = FX.
         They must fit the video: many cameras crop when they film, and the zoom must not change.
CX, CY   the principal point, the third column of the matrix. The image centre is written: right within a few per cent.
distortions   k1, k2, p1, p2, k3 as OpenCV has them. Zeros: straight lines are straight in the image.
fisheye  true for OpenCV's fisheye model, with four distortions.

focal_sd_percent   the uncertainty of FX and FY: 1 sigma, in per cent. Every sigma of the result includes it.
         {GUESS_SD:g} suits a field of view from a data sheet: one stated for the diagonal of 16:9 makes FX 13 % too small,
         and cropping by the video 5 to 20 %. Delete the line for a camera that was calibrated with a pattern.

An error of 1 % in the focal length causes an error of about 1 % in the distances between the cameras.
"""


def template_text(cameras: Sequence[FoundCamera]) -> str:
    """The text of a rig file that `read_lens` refuses until the focal lengths are filled in.

    Args:
        cameras: Those without a lens. Where one has no video, its picture's size is to be filled in too.
    """
    return toml_text.comment(HEAD) + "".join(_table(camera) for camera in cameras)


def _table(camera: FoundCamera) -> str:
    """One camera's table."""
    head = f"\n[{toml_text.key(camera.name)}]\nname = {toml_text.value(camera.name)}\n"
    if camera.info is None:
        size = 'size = ["WIDTH", "HEIGHT"]   # pixels\n'
        matrix, hint = '[["FX", 0.0, "CX"], [0.0, "FY", "CY"], [0.0, 0.0, 1.0]]', ""
    else:
        width, height = camera.info.size
        size = f"size = [{width}, {height}]   # of the video\n"
        matrix = f'[["FX", 0.0, {width / 2:.1f}], [0.0, "FY", {height / 2:.1f}], [0.0, 0.0, 1.0]]'
        views = ", ".join(
            f"{angle}: {max(width, height) / 2 / math.tan(math.radians(angle / 2)):.0f}" for angle in FIELDS_OF_VIEW
        )
        hint = f"# FX by degrees of the field of view along the longer side: {views}\n"
    guess = f"focal_sd_percent = {GUESS_SD:g}   # of a guess; delete it for a lens that was calibrated\n"
    return f"{head}{size}{hint}matrix = {matrix}\n{guess}distortions = [0.0, 0.0, 0.0, 0.0, 0.0]\nfisheye = false\n"
