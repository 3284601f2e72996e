"""Findings on lenses, readings and box formats that people contradict, as typed values."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from passerby.findings.finding import Finding, doubt, notice
from passerby.hypotheses.alternatives import LENS
from passerby.hypotheses.box_formats import ShiftedBoxes
from passerby.hypotheses.lenses import FoundLenses, LensResult
from passerby.hypotheses.observations import ReadCamera

CROPPED = 0.03
"""If a principal point is off by more than this share of the width, the image was probably cropped."""

Why = Literal["several", "implausible", "not_better"]
"""Reasons why a contradicted lens is not corrected: several explanations fit equally well; the change is larger than usual
errors of lenses; the rig with the corrected lens predicts people worse, or loses cameras."""


def lens_corrected(found: FoundLenses) -> Finding:
    """Return the notice on a lens that was corrected."""
    return notice("lens_corrected", *_about(found), **_values(found))


def lens_differs(found: FoundLenses) -> Finding:
    """Return the notice on a wrongly stated lens that changes the rig's measurements by less than their uncertainty."""
    return notice("lens_differs", *_about(found), **_values(found))


def lens_doubtful(result: LensResult, why: Why | None = None) -> Finding:
    """Return the finding on contradicted lenses that are not corrected: a notice if the sigmas include the possible error."""
    found = result.found
    assert found is not None
    if why is None:
        several = len({one.alternative.cameras for one in result.suspects}) > 1
        why = "several" if several else "implausible"
    names = found.stated.names
    if why != "several":
        return doubt("lens_doubtful", *_about(found), why=why, **_values(found))
    suspects = [
        {"part": one.alternative.code, "cameras": [] if one.alternative.alike else [names[c] for c in one.alternative.cameras]}
        for one in result.suspects
    ]
    cameras = dict.fromkeys(name for one in suspects for name in one["cameras"])
    said = notice if result.decision == "unsettled" else doubt
    return said("lens_doubtful", *cameras, why=why, suspects=suspects, moved_mm=_moved_mm(found))


def misread(found: ReadCamera, *, corrected: bool = False) -> Finding:
    """Return the finding on a camera that another reading explains better; `corrected`: the rig was computed with it."""
    reading = found.reading
    said = doubt if not corrected and found.effect > 1 else notice
    if reading.late_s is not None:
        return said("clock_late", found.name, late_s=reading.late_s, corrected=corrected)
    if reading.share is not None:
        return said(
            "smaller_image_fits",
            found.name,
            seen_size=list(found.lens.size),
            size=[round(size / reading.share) for size in found.lens.size],
            cut=None,
        )
    return said("image_misread", found.name, how=reading.code.removeprefix("image_"), rotate=None)


def boxes_in_other_format(found: ShiftedBoxes) -> Finding:
    """Return the doubt about boxes that are off by half their height: centres read as corners, or corners as centres."""
    box_format, stated = ("centres", "ltwh") if found.shift > 0 else ("ltwh", "centres")
    return doubt("boxes_by_centres", *found.cameras, beyond=None, box_format=box_format, stated=stated, shift=found.shift)


def _about(found: FoundLenses) -> tuple[str, ...]:
    """Return the cameras of a finding; none if it is about all."""
    return () if found.alternative.alike else tuple(found.stated.names[c] for c in found.alternative.cameras)


def _moved_mm(found: FoundLenses) -> float | None:
    return None if found.moved is None else found.moved.points.median_mm


def _values(found: FoundLenses) -> dict[str, Any]:
    """Return the stated and the fitted values of the free parts; for several cameras the shared factor."""
    c = found.alternative.cameras[0]
    stated, change, sigma = found.stated.cameras[c].lens, found.change[c], found.sigma[c]
    lens = LENS.moved(stated, change)
    out: dict[str, Any] = {"moved_mm": _moved_mm(found)}
    for part in found.alternative.parameters:
        columns = LENS.columns_of(part)
        if part == "focal":
            out["focal"] = {
                "change": float(np.expm1(change[columns][0])), "sigma": float(sigma[columns][0]),
                "stated_px": stated.focal, "found_px": lens.focal,
            }  # fmt: skip
        elif part == "principal_point":
            by = change[columns]
            # The most significant direction: with boxes, the vertical shift is correlated with the camera's tilt.
            axis = int(np.argmax(np.abs(by) / np.maximum(sigma[columns], 1e-9)))
            side = ("left", "right") if axis == 0 else ("top", "bottom")
            cropped = abs(by[axis]) > CROPPED * stated.size[0]
            out["principal_point"] = {
                "stated_px": stated.matrix[:2, 2].tolist(), "found_px": lens.matrix[:2, 2].tolist(),
                "sigma_px": float(sigma[columns].max()), "moved_px": float(abs(by[axis])),
                "cropped": side[int(by[axis] > 0)] if cropped else None,
            }  # fmt: skip
        else:
            before = float(stated.distortions[0]) if len(stated.distortions) else 0.0
            out["distortion"] = {
                "stated": before, "found": float(lens.distortions[0]), "change": float(change[columns][0]),
                "sigma": float(sigma[columns][0]),
            }  # fmt: skip
    return out
