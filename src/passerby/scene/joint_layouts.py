"""Joints that stand in a file under the names of another layout, recognised by where they lie in the images.

OpenPose writes 25 joints in two orders, BODY_25 and BODY_25B, and no file of it says which. A tool that assumes one names the
joints of the other wrongly: a knee is called a hip. The right names order the joints of people from head to feet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from passerby.findings.finding import notice
from passerby.interchange.formats.skeletons import other_layouts
from passerby.people.segments import MIN_ORDER_CORRELATION, order_correlations
from passerby.scene.camera_input import CameraInput


def correct_layouts(readings: Sequence[CameraInput]) -> None:
    """Give joints the names of the layout that fits the images; their first reading gets a notice of it.

    The cameras whose joints have the same names are taken together: one tool made them. Names are corrected only where the
    stated ones do not fit and those of another layout of as many joints do.
    """
    by_names: dict[tuple[str, ...], list[CameraInput]] = {}
    for reading in readings:
        if len(reading.keypoints):
            by_names.setdefault(reading.keypoints.joints, []).append(reading)
    for names, cameras in by_names.items():
        known = other_layouts(names)
        if known is None or _order(cameras, names) >= MIN_ORDER_CORRELATION:
            continue
        stated, layouts = known
        order, layout = max((_order(cameras, renamed), layout) for layout, renamed in layouts.items())
        if order < MIN_ORDER_CORRELATION:
            continue
        for reading in cameras:
            reading.keypoints = replace(reading.keypoints, joints=layouts[layout])
        who = [reading.name for reading in cameras]
        found = notice("keypoint_layout_corrected", *who, stated=stated, layout=layout, correlation=order)
        cameras[0].findings.append(found)


def _order(cameras: Sequence[CameraInput], names: tuple[str, ...]) -> float:
    """How well names order the joints of the median person from head to feet; 1 where no person shows it."""
    found = [correlation for reading in cameras for correlation in order_correlations(reading.keypoints, names)]
    return float(np.median(found)) if found else 1.0
