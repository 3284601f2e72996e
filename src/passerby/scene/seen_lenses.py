"""Fields of view that a network of the user's sees in the videos of cameras without intrinsics."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence

from passerby.common.errors import InputError
from passerby.findings.finding import notice
from passerby.scene.camera_input import CameraInput, KnownLens
from passerby.scene.scene import Scene


def add_seen_lenses(scene: Scene, readings: Sequence[CameraInput]) -> None:
    """Give uncalibrated lenses the focal lengths that `[perception] lens_network` sees; what is stated of them stays.

    Cameras of one model have the median of what is seen in their videos.

    Raises `InputError` where the network cannot be used.
    """
    path = scene.perception.lens_network
    wanting = [one for one in readings if _wants(one)]
    if path is None or not wanting:
        return
    from passerby.perception.lens_network import FOCAL_SD, LensNetwork, lens_from_video

    models: dict[str, list[CameraInput]] = {}
    for reading in wanting:
        group = None if reading.lens is None else reading.lens.group
        models.setdefault(f"group {group}" if group is not None else f"camera {reading.name}", []).append(reading)
    try:
        network = LensNetwork(scene.resolve(path))
        for of_model in models.values():
            seen = [
                lens_from_video(network, one.video, one.lens).focal
                for one in of_model if one.video is not None and one.lens is not None
            ]  # fmt: skip
            for reading in of_model if seen else ():
                assert reading.lens is not None
                reading.lens = reading.lens.with_focal(statistics.median(seen) / reading.lens.focal, FOCAL_SD)
                reading.lens_source = KnownLens("lens_network", str(path))
                hfov = 2 * math.degrees(math.atan(0.5 * reading.lens.size[0] / reading.lens.focal))
                reading.findings.append(
                    notice("field_of_view_seen", reading.name, network=path.name, hfov_deg=hfov, sd_percent=100 * FOCAL_SD)
                )
    except InputError as error:
        raise InputError(f"{scene.place}: [perception] lens_network: {error}") from None


def _wants(reading: CameraInput) -> bool:
    """Whether nothing is known of a camera's focal length, which one image can show."""
    lens, source = reading.lens, reading.lens_source
    unknown = source is not None and source.source == "people"
    return lens is not None and lens.uncalibrated and not lens.fisheye and unknown
