"""What is said of a lens that people contradict: which part, of which camera, and where it should be."""

from __future__ import annotations

import numpy as np
import pytest

from passerby.core.cameras import Camera, Lens, Rig
from passerby.solver.contradicted_lenses import ContradictedLens, _along_surest, contradictions_of
from passerby.solver.lens_scores import LensHypothesis, LensScore

LENS = Lens((1000, 500), np.array([[800.0, 0, 500], [0, 800, 250], [0, 0, 1]]), np.zeros(5))
RIG = Rig((Camera("A", LENS), Camera("B", LENS)))


@pytest.mark.parametrize(
    ("hypothesis", "change", "sigma", "code", "cameras", "values"),
    [
        (LensHypothesis("focal", (1,)), (np.log(1.2),), (0.01,), "focal_contradicted", ("B",), {"change": 0.2}),
        (LensHypothesis("focal", (0, 1)), (np.log(0.9),), (0.01,), "all_focals_contradicted", (), {"change": -0.1}),
        # The axis that is known best decides: the other one turns with the vertical.
        (
            LensHypothesis("principal_point", (0,)), (-60.0, 200.0), (5.0, 100.0), "image_seems_cropped", ("A",),
            {"side": "left", "moved_px": 60.0},
        ),
        (
            LensHypothesis("principal_point", (0,)), (60.0, 0.0), (5.0, 5.0), "image_seems_cropped", ("A",),
            {"side": "right", "moved_px": 60.0},
        ),
        (
            LensHypothesis("principal_point", (1,)), (0.0, -40.0), (5.0, 5.0), "image_seems_cropped", ("B",),
            {"side": "top", "moved_px": 40.0},
        ),
        (
            LensHypothesis("principal_point", (1,), axis=1), (40.0,), (5.0,), "image_seems_cropped", ("B",),
            {"side": "bottom", "moved_px": 40.0},
        ),
        (
            LensHypothesis("principal_point", (0,)), (25.0, 1.0), (2.0, 2.0), "lens_part_contradicted", ("A",),
            {"part": "principal point"},
        ),
        (LensHypothesis("distortion", (1,)), (0.1,), (0.01,), "lens_part_contradicted", ("B",), {"part": "distortion"}),
    ],
)  # fmt: skip
def test_what_is_said(
    hypothesis: LensHypothesis,
    change: tuple[float, ...],
    sigma: tuple[float, ...],
    code: str,
    cameras: tuple[str, ...],
    values: dict[str, object],
) -> None:
    (finding,) = contradictions_of(RIG, [ContradictedLens(hypothesis, change, sigma)])
    assert (finding.code, finding.severity, finding.cameras) == (code, "doubt", cameras)
    assert finding.values == {key: pytest.approx(one) if isinstance(one, float) else one for key, one in values.items()}


def score(hypothesis: LensHypothesis, change: tuple[float, ...], sd: tuple[float, ...], gain: float) -> LensScore:
    return LensScore(hypothesis, change, sd, gain)


def test_a_principal_point_is_also_tried_along_its_surest_axis_where_that_is_worth_it() -> None:
    whole = score(LensHypothesis("principal_point", (0,)), (30.0, 90.0), (2.0, 60.0), 60.0)
    alone = [
        score(LensHypothesis("principal_point", (0,), axis), (30.0,), (2.0,), gain) for axis, gain in ((0, 40.0), (1, 55.0))
    ]
    focal = score(LensHypothesis("focal", (0,)), (0.2,), (0.01,), 90.0)
    scores = [focal, whole, *alone]
    assert _along_surest(scores, whole, 20.0) is alone[0]
    assert _along_surest(scores, whole, 41.0) is None
    assert _along_surest(scores, alone[0], 20.0) is None
    assert _along_surest(scores, focal, 20.0) is None
