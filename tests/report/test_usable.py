"""What a doubtful rig is still good for."""

from __future__ import annotations

import pytest

from passerby.core.measuring import MeasuringFigures, MeasuringSigma
from passerby.findings.finding import Finding, doubt
from passerby.report.recommendations import good_for

POINTS = MeasuringSigma(median_mm=31.0, p90_mm=60.0)
MEASURING = MeasuringFigures(places=9, points=POINTS, ground=POINTS.scaled(3.0), ground_height_mm=34.0, cameras={})
NAMES = ("C1", "C2", "C3")


def uncertain(what: str, *cameras: str, sigma: float | None = None, lacks: tuple[str, ...] = ()) -> Finding:
    return doubt("rig_uncertain", *cameras, what=what, sigma=sigma, lacks=list(lacks), why=None)


SCALE, UP = uncertain("scale", sigma=14.0), uncertain("ground", lacks=("vertical",))
FEW = uncertain("points", "C1", sigma=600.0)
LAYOUT = "Still good for the rough layout of the cameras and for counting people."


@pytest.mark.parametrize(
    ("doubts", "text"),
    [
        ([FEW], "Still good for what cameras C2, C3 see: points to 3 cm, positions on the ground to 9 cm (1 sigma)."),
        ([SCALE], "Still good for what the cameras see, up to the scale; not for the scale."),
        ([UP], "Still good for what the cameras see: points to 3 cm (1 sigma); not for the up direction and the ground."),
        ([FEW, uncertain("points", "C2", sigma=700.0)], LAYOUT),
        ([uncertain("points")], LAYOUT),
    ],
)
def test_one_line_says_it(doubts: list[Finding], text: str) -> None:
    assert good_for(doubts, NAMES, MEASURING) == text
