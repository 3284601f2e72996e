"""The model of people and boxes as `calibration.json` tells of it."""

from __future__ import annotations

import numpy as np

from passerby.core.figures import AdjustedFigures, heights_of
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.people.model import Noise, Priors
from passerby.people.upright_bodies import BodyModel

SLACK_RANGE = 0.7
"""Boxes are believed to be at most twice as tall as people, or half as tall."""


def body_model(figures: AdjustedFigures, person_height_m: float | None) -> BodyModel:
    """The model as the solver's figures have it, as far as it can be believed; the solver's own defaults for the rest.

    Args:
        figures: of the solver.
        person_height_m: how tall people were taken to be; None where that was not written.
    """
    usually = Noise()
    noise = figures.noise
    slack = {one.name: _believed(one.slack, 0.0, -SLACK_RANGE, SLACK_RANGE) for one in figures.cameras}
    heights = {int(who): height for who, height in heights_of(figures).items() if who.isdecimal() and 0.3 <= height <= 3.0}
    assumed = _believed(person_height_m, PERSON_HEIGHT_M, 0.5, 2.5)
    usual = float(np.mean(list(heights.values()))) if heights else assumed
    return BodyModel(
        Noise(
            floor_px=_believed(noise.box_px, usually.box_px, 0.01, 100.0),
            centre=_believed(noise.centre, usually.centre, 1e-3, 1.0),
            height=_believed(noise.height, usually.height, 1e-3, 1.0),
        )
        if noise is not None
        else Noise(floor_px=usually.box_px),
        _believed(figures.foot_shift, Priors().foot_shift, -0.5, 0.5),
        slack,
        heights,
        usual,
    )


def _believed(value: float | None, otherwise: float, low: float, high: float) -> float:
    """A number within a range, or else the usual one."""
    return otherwise if value is None or not low <= value <= high else value
