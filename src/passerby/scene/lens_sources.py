"""The lens with which a camera begins: its source, and whether it belongs to the images.

Sources are a file of intrinsics; keys of the scene file for a lens that was not calibrated; the metadata of the video; the lens
of another camera of the same model; or only the image size. For cameras without intrinsics, a network of the user can estimate
the field of view from the videos.

Checks: whether a camera's picture size and its matrix are of one picture, and whether people were found in a smaller picture.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import shortened
from passerby.core.cameras import Lens
from passerby.core.lens import LARGEST_FOCAL_SD
from passerby.core.quarter_turns import turn_lens, turn_size
from passerby.findings.finding import notice
from passerby.findings.texts import text_of
from passerby.perception.video_probe import fit_of_size
from passerby.scene.camera_input import CameraInput, KnownLens
from passerby.scene.lens_keys import STATEMENTS, stating_camera
from passerby.scene.scene import Scene

FULL_FRAME_MM = float(np.hypot(36.0, 24.0))
"""Diagonal of the picture to which 35 mm equivalents refer."""
UNIT_SPREAD = 0.01
"""Standard deviation of the focal length between units of one model, as a share: by the tolerance of the lens and by its
focus."""
FILLED_ROWS = 100
"""Minimum number of people's boxes for a test of the picture size."""
STRAY_SHARE = 0.001
"""Share of boxes that are ignored, because a tracker may predict boxes beyond the border."""
SUB_STREAMS = (1 / 4, 1 / 3, 3 / 8, 1 / 2, 2 / 3, 3 / 4)
"""Usual ratios of the width and height of a second stream to those of the main one."""
STRIP = 0.0125
"""Boxes that are cut by a border end within this distance from it, on either side, as a share of the picture's size."""
CUT_ROWS, CUT_SHARE = 10, 0.003
"""Minimum number of boxes, and minimum share of all boxes, that end at the border of a smaller picture."""
CUT_SPREAD = 0.1
"""Minimum standard deviation of these boxes' positions along the border, as a share of its length, and of their heights, as a
share of the mean: else they may be one person who stands there."""
REACHED = 0.7
"""Minimum share of the smaller picture's size to which people must reach along both axes."""
PRINCIPAL_SHARE = 0.25
"""A cropped picture can have its principal point outside. If it is farther outside than this share of the size, matrix and size
contradict each other."""


def find_lens(scene: Scene, reading: CameraInput, model: CameraInput | None) -> None:
    """Give a camera without intrinsics of its own its initial lens; errors become faults of the camera.

    Args:
        scene: the scene.
        reading: the camera; the metadata of its video have been read.
        model: the camera that has the same lens, with this lens; None: no other camera has it.
    """
    if model is None:
        _find_own_lens(scene, reading)
    elif model.lens is not None:
        _take_lens(scene, reading, model, turn_lens(model.lens, -model.rotate))


def _find_own_lens(scene: Scene, reading: CameraInput) -> None:
    """Set the lens that the scene file states, or else the video. A statement for one camera holds for all of its model."""
    size = scene.cameras[reading.name].image_size or _read_filmed_size(reading)
    if size is None:
        return
    names = scene.models[reading.name]
    group = reading.name if len(names) > 1 else None
    holder = stating_camera(scene.cameras, names, ("lens_model",))
    fisheye = holder is not None and scene.cameras[holder].lens_model == "fisheye"
    stating = stating_camera(scene.cameras, names, STATEMENTS)
    focal_35mm = None if reading.video is None else reading.video.camera.focal_35mm
    try:
        if stating is not None:
            reading.lens = replace(_make_stated_lens(scene, stating, size, fisheye), group=group)
            (key,) = (key for key in STATEMENTS if getattr(scene.cameras[stating], key) is not None)
            reading.lens_source = KnownLens(key, str(scene.place))
        elif focal_35mm is not None and reading.video is not None:
            reading.lens = Lens.unknown(size, focal_px=equivalent_px(focal_35mm, size), fisheye=fisheye, group=group)
            place = str(reading.video.path)
            reading.lens_source = KnownLens("metadata", place)
            values = {
                "focal_35mm": focal_35mm,
                "focal_px": reading.lens.focal,
                "sd_percent": 100 * (reading.lens.focal_sd or 0),
            }
            reading.findings.append(notice("focal_from_metadata", reading.name, place=place, **values))
        else:
            reading.lens = Lens.unknown(size, fisheye=fisheye, group=group)
            reading.lens_source = KnownLens("people", str(scene.place))
    except InputError as error:
        reading.faults.append(f"{scene.place}: [cameras.{stating or reading.name}] {error}")
    if reading.lens is not None:
        reading.lens = turn_lens(replace(reading.lens, rotate=reading.rotate), reading.rotate)


def _read_filmed_size(reading: CameraInput) -> tuple[int, int] | None:
    """Return (width, height) of the video's images as filmed; None without a video."""
    return None if reading.video is None else turn_size(reading.video.size, reading.rotate)


def _make_stated_lens(scene: Scene, camera: str, size: tuple[int, int], fisheye: bool) -> Lens:
    """Make the lens from the keys of a camera in the scene file. Raises `InputError` for values that no lens has."""
    table = scene.cameras[camera]
    sd = None if table.focal_sd_percent is None else table.focal_sd_percent / 100
    if table.hfov_deg is not None:
        return Lens.unknown(size, table.hfov_deg, sd, fisheye=fisheye)
    if table.focal_mm is not None and table.sensor_width_mm is not None:
        # An upright image of a camera that was turned shows the width of the sensor as its height.
        focal_px, key = max(size) * table.focal_mm / table.sensor_width_mm, "focal_mm and sensor_width_mm"
    else:
        assert table.focal_35mm is not None
        focal_px, key = equivalent_px(table.focal_35mm, size), "focal_35mm"
    try:
        return Lens.unknown(size, focal_sd=sd, focal_px=focal_px, fisheye=fisheye)
    except InputError as error:
        raise InputError(f"{key}: {error}") from None


def equivalent_px(focal_35mm: float, size: tuple[int, int]) -> float:
    """Convert a 35 mm equivalent to a focal length, pixels, with the same field of view over the diagonal of the image."""
    return float(focal_35mm * np.hypot(*size) / FULL_FRAME_MM)


def _take_lens(scene: Scene, reading: CameraInput, model: CameraInput, lens: Lens) -> None:
    """Set the lens of another camera of the same model: shared if it was not calibrated, else with the deviation of a unit.

    `lens` is of the images as filmed.
    """
    table, place = scene.cameras[reading.name], f"{scene.place}: [cameras.{reading.name}] lens"
    size = table.image_size or _read_filmed_size(reading) or lens.size
    try:
        same = size == lens.size or (not lens.uncalibrated and fit_of_size(size, lens.size) == "cropped")
    except InputError:
        same = False
    if not same:
        reading.faults.append(
            f"{place}: the images of {reading.name} are {size[0]} x {size[1]}, those of {model.name}, whose lens it shares, "
            f"{lens.size[0]} x {lens.size[1]}: one lens holds for one image size; give both the same size, or delete lens"
        )
        return
    source = model.lens_source
    if not lens.uncalibrated:
        own = UNIT_SPREAD if table.focal_sd_percent is None else table.focal_sd_percent / 100
        sd = min(float(np.hypot(own, lens.focal_sd or 0.0)), LARGEST_FOCAL_SD)
        lens = replace(lens, focal_sd=sd, uncalibrated=True)
    reading.lens = turn_lens(replace(lens, rotate=reading.rotate), reading.rotate)
    if source is not None:
        reading.lens_source = replace(source, same_as=model.name)


def group_faults(scene: Scene, readings: Sequence[CameraInput]) -> list[str]:
    """Return a fault for each lens that differs within its group. Only lenses from memory can: those of a scene file agree."""
    first: dict[str, tuple[str, Lens, str]] = {}
    faults = []
    for reading in readings:
        lens = reading.lens
        if lens is None or lens.group is None or not lens.uncalibrated:
            continue
        camera, other, first_size = first.setdefault(lens.group, (reading.name, lens, _size_of(reading, lens)))
        for what, own, others in (
            ("image size", _size_of(reading, lens), first_size),
            ("lens model", "fisheye" if lens.fisheye else "pinhole", "fisheye" if other.fisheye else "pinhole"),
            ("focal length", f"{lens.focal:.6g} px", f"{other.focal:.6g} px"),
        ):
            if own != others:
                faults.append(
                    f"{scene.place}: cameras {camera} and {reading.name} are of the group {shortened(lens.group)}, but their "
                    f"{what}s differ: {others} and {own}; give lenses of one group the same, or no group"
                )
                break
    return faults


def _size_of(reading: CameraInput, lens: Lens) -> str:
    """Return the size of the images as filmed, as text: a camera on its side can share the lens of an upright one."""
    width, height = turn_size(lens.size, reading.rotate)
    return f"{width} x {height}"


def add_seen_lenses(scene: Scene, readings: Sequence[CameraInput]) -> None:
    """Give uncalibrated lenses the focal lengths that `[perception] lens_network` estimates; stated focal lengths stay.

    Cameras of one model get the median of the estimates from their videos.

    Raises `InputError` if the network cannot be used.
    """
    path = scene.perception.lens_network
    wanting = [one for one in readings if _lacks_focal(one)]
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


def _lacks_focal(reading: CameraInput) -> bool:
    """Return whether the focal length of a pinhole camera is unknown, so that a network can estimate it."""
    lens, source = reading.lens, reading.lens_source
    unknown = source is not None and source.source == "people"
    return lens is not None and lens.uncalibrated and not lens.fisheye and unknown


def source_of_size(scene: Scene, camera: str) -> str:
    """Return the file that states a camera's image size: its intrinsics, or else the scene file or its video."""
    table = scene.cameras[camera]
    if table.intrinsics is not None:
        return str(scene.resolve(table.intrinsics))
    return str(scene.place if table.image_size is not None or not table.videos else scene.resolve(table.videos[0]))


def check_principal_point(scene: Scene, reading: CameraInput, lens: Lens) -> None:
    """Add a notice if the principal point lies outside the picture, and a fault if it lies far outside."""
    beyond = float((np.abs(lens.matrix[:2, 2] / lens.size - 0.5) - 0.5).max())
    if beyond > 0:
        place, point = source_of_size(scene, reading.name), lens.matrix[:2, 2].round(1).tolist()
        finding = notice("principal_point_outside_image", reading.name, place=place, point=point, size=list(lens.size))
        if beyond > PRINCIPAL_SHARE:
            reading.faults.append(text_of(finding))
        else:
            reading.findings.append(finding)


def smaller_picture(extent: Floats, size: tuple[int, int]) -> tuple[int, tuple[int, int]] | None:
    """Find the smaller picture in which people were found; None if there is none.

    No person reaches beyond it, and people of different heights at different places end exactly at its border. If people only
    stay in a corner of the stated picture, no border cuts them off there.

    Args:
        extent: (N, 4) left, top, right, bottom of people, pixels.
        size: (width, height) of the stated picture.

    Returns:
        The number of people whom its right and lower borders cut off, and (width, height) of the smaller picture.
    """
    if len(extent) < FILLED_ROWS:
        return None
    ends = extent[:, 2:] / size
    most = np.quantile(ends, 1 - STRAY_SHARE, axis=0)
    for share in SUB_STREAMS:
        reach = most / share
        if reach.max() > 1 + STRIP or reach.min() < REACHED:
            continue
        count = 0
        for axis in range(2):
            cut = np.abs(ends[:, axis] / share - 1) <= STRIP
            along = 0.5 * (extent[cut, 1 - axis] + extent[cut, 3 - axis]) / (share * size[1 - axis])
            tall = extent[cut, 3] - extent[cut, 1]
            if cut.sum() < max(CUT_ROWS, CUT_SHARE * len(extent)):
                continue
            if np.std(along) >= CUT_SPREAD and np.std(tall) >= CUT_SPREAD * np.mean(tall):
                count += int(cut.sum())
        if count:
            return count, (round(share * size[0]), round(share * size[1]))
    return None
