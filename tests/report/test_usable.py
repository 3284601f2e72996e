"""What a doubtful rig is still good for."""

from __future__ import annotations

import pytest

from passerby.core.measuring_figures import MeasuringFigures, MeasuringSigma
from passerby.findings.finding import Finding, doubt
from passerby.report.usable import good_for

POINTS = MeasuringSigma(median_mm=31.0, p90_mm=60.0)
MEASURING = MeasuringFigures(places=9, points=POINTS, ground=POINTS.scaled(3.0), ground_height_mm=34.0, cameras={})
NAMES = ("C1", "C2", "C3")
SCALE, UP = doubt("boxes_noisy", noise_percent=40.0), doubt("vertical_uncertain", sigma_deg=6.0)
FEW = doubt("few_observations", "C1", agreeing=12)


LAYOUT = "Still good for the rough layout of the cameras and for counting people."


@pytest.mark.parametrize(
    ("doubts", "text"),
    [
        ([FEW], "Still good for what cameras C2, C3 see: points to 3 cm, positions on the ground to 9 cm (1 sigma)."),
        ([SCALE], "Still good for what the cameras see, up to the scale; not for the scale."),
        ([UP], "Still good for what the cameras see: points to 3 cm (1 sigma); not for the up direction and the ground."),
        (
            [FEW, doubt("few_observations", "C2", agreeing=3)],
            "Still good for the rough layout of the cameras and for counting people.",
        ),
        ([doubt("adjustment_not_converged")], LAYOUT),
    ],
)
def test_one_line_says_it(doubts: list[Finding], text: str) -> None:
    assert good_for(doubts, NAMES, MEASURING) == text
