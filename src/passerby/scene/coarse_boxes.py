"""Do a camera's boxes lie on a grid that is coarse beside people? Then their sizes are those of blocks, not of bodies.

Recorders that find motion in blocks of a compressed video, and detectors that tell cells, round boxes outwards: people seem
larger, the smaller they are seen. A rig of such boxes fits well and has a wrong scale.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from passerby.core.figures import AdjustedFigures
from passerby.core.observations import Boxes
from passerby.findings.finding import Finding, notice

FEWEST, MOST = 50, 2000
"""Boxes that are looked at, spread over all."""
ON_GRID = 0.98
"""Share of the edges on multiples of the step: boxes that are clipped at the border of the image need not be."""
COARSE = 0.1
"""Step of a grid as a share of the boxes' median height: rounding outwards adds one step to a height on average, and that is
twice what a metre by people's stature is known to."""


def notice_of_coarse_boxes(name: str, boxes: Boxes) -> Finding | None:
    """A notice where a camera's boxes lie on a coarse grid; None where they do not, or where there are too few.

    Args:
        name: of the camera.
        boxes: all of its boxes.
    """
    step = grid_step(boxes)
    if step is None:
        return None
    height = float(np.median(boxes.ltwh[:, 3]))
    return notice("boxes_coarse", name, step_px=step, height_px=height) if step > COARSE * height else None


def with_coarse_boxes(figures: AdjustedFigures, findings: Iterable[Finding]) -> AdjustedFigures:
    """The figures with what coarse boxes do to the scale, as far as it depends on how tall people are.

    Args:
        figures: of the adjustment.
        findings: those about its input.
    """
    steps = [one.values["step_px"] / one.values["height_px"] for one in findings if one.code == "boxes_coarse"]
    sigma = figures.scale.relative_sigma
    if not steps or sigma is None:
        return figures
    share = sum(cue.share for cue in figures.scale.cues if cue.kind in ("population", "person"))
    return replace(figures, scale=replace(figures.scale, relative_sigma=float(np.hypot(sigma, share * max(steps)))))


def grid_step(boxes: Boxes) -> int | None:
    """The largest integer above 1, pixels, of which nearly all edges are multiples; None if there is none."""
    if len(boxes) < FEWEST:
        return None
    boxes = boxes.take(np.linspace(0, len(boxes) - 1, min(len(boxes), MOST)).astype(np.int64))
    edges = np.concatenate([boxes.ltwh[:, :2], boxes.ltwh[:, :2] + boxes.ltwh[:, 2:]]).ravel()
    whole = np.rint(edges).astype(np.int64)
    if np.mean(np.abs(edges - whole) < 1e-6) < ON_GRID:
        return None
    most = int(np.median(boxes.ltwh[:, 3]))
    steps = (step for step in range(most, 1, -1) if np.mean(whole % step == 0) >= ON_GRID)
    return next(steps, None)
