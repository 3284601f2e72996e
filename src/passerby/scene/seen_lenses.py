"""Fields of view that a network of the user's sees in the videos of cameras without intrinsics."""

from __future__ import annotations

import math
from collections.abc import Sequence

from passerby.common.errors import InputError
from passerby.findings.finding import notice
from passerby.scene.camera_input import CameraInput
from passerby.scene.scene import Scene


def add_seen_lenses(scene: Scene, readings: Sequence[CameraInput]) -> None:
    """Give uncalibrated lenses the focal lengths that `[perception] lens_network` sees; a stated field of view stays.

    Raises `InputError` where the network cannot be used.
    """
    path = scene.perception.lens_network
    wanting = [one for one in readings if _wants(scene, one)]
    if path is None or not wanting:
        return
    from passerby.perception.lens_network import FOCAL_SD, LensNetwork, lens_from_video

    try:
        network = LensNetwork(scene.resolve(path))
        for reading in wanting:
            assert reading.video is not None
            assert reading.lens is not None
            reading.lens = lens_from_video(network, reading.video, reading.lens)
            hfov = 2 * math.degrees(math.atan(0.5 * reading.lens.size[0] / reading.lens.focal))
            reading.findings.append(
                notice("field_of_view_seen", reading.name, network=path.name, hfov_deg=hfov, sd_percent=100 * FOCAL_SD)
            )
    except InputError as error:
        raise InputError(f"{scene.place}: [perception] lens_network: {error}") from None


def _wants(scene: Scene, reading: CameraInput) -> bool:
    """Whether nothing is stated of a camera's focal length, and its video can show it."""
    lens, stated = reading.lens, scene.cameras[reading.name].hfov_deg is not None
    return reading.video is not None and lens is not None and lens.uncalibrated and not lens.fisheye and not stated
