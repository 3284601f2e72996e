"""One calibration against the truth, as plain values."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from passerby.calibration.calibration import Calibration
from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.core.figures import adjusted
from passerby.core.measuring import measuring_errors
from passerby.core.observations import Boxes
from passerby.evaluation.metrics import compare


def timed_outcome(calibrate: Callable[[], Calibration], truth: Rig, withheld: Sequence[str] = ()) -> dict[str, Any]:
    """Calibrate, and compare with the truth: plain values, with the processor time of this process."""
    began = time.process_time()
    try:
        found = calibrate()
    except InputError as error:
        seconds = time.process_time() - began
        return {"verdict": "refused", "codes": [str(error)], "registered": 0, "cpu_s": seconds, "lenses": {}}
    seconds = time.process_time() - began
    people = {name: found.observations[name].boxes for name in truth.names}
    measuring = adjusted(found.figures).measuring
    sigmas = {}
    if measuring is not None and measuring.ground is not None:
        sigmas = {"points_sigma_mm": measuring.points.median_mm, "ground_sigma_mm": measuring.ground.median_mm}
    return outcome(found.rig, truth, withheld, people) | sigmas | {
        "verdict": found.verdict, "codes": [finding.code for finding in found.doubts], "cpu_s": seconds,
    }  # fmt: skip


def outcome(rig: Rig, truth: Rig, withheld: Sequence[str], people: Mapping[str, Boxes] | None = None) -> dict[str, Any]:
    """Errors of a rig and of those lenses that were withheld; no `mm` and `deg` where the rig has no similarity.

    What it measures is tested where `people` walked, or else on a grid: `points_mm` and `ground_mm`, medians.
    """
    posed = rig.posed()
    if not len(posed):
        return {"registered": 0, "lenses": {}}
    comparison = compare(posed, truth)
    lenses = {
        name: error.to_dict() | {"sigma_percent": 100 * (posed[name].lens.focal_sd or 0.0)}
        for name, error in comparison.lenses.items()
        if name in withheld
    }
    figures: dict[str, Any] = {"registered": len(posed), "lenses": lenses}
    walked = None if people is None or not any(len(boxes) for boxes in people.values()) else people
    measured = measuring_errors(posed, truth, walked)
    if measured is not None and measured.ground is not None:
        figures |= {"points_mm": measured.points.median_mm, "ground_mm": measured.ground.median_mm}
    similarity = comparison.similarity
    if similarity.mean_position_mm is not None and similarity.mean_orientation_deg is not None:
        figures |= {"mm": similarity.mean_position_mm, "deg": similarity.mean_orientation_deg}
    return figures


def off_centre_deg(truth: Rig, names: Sequence[str]) -> float:
    """Mean angle between the optical axes of some cameras and the rays of their image centres, degrees.

    So much a camera is turned whose principal point is taken to be the image centre.
    """
    centres = np.array([truth[name].lens.size for name in names]) / 2
    off = [np.linalg.norm(truth[name].lens.matrix[:2, 2] - centre) for name, centre in zip(names, centres, strict=True)]
    return float(np.degrees(np.mean([np.arctan(px / truth[name].lens.focal) for px, name in zip(off, names, strict=True)])))
