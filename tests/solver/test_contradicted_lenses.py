"""What is said of a lens that people contradict: which part, of which camera, and where it should be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from passerby.core.cameras import Camera, Lens, Rig
from passerby.solver.contradicted_lenses import (
    LEAST_AGREEING,
    LEAST_CHANGE,
    LEAST_SIGMAS,
    MIN_INSTANTS,
    MOST_LEFT,
    ContradictedLens,
    _along_surest,
    _holds,
    contradictions_of,
)
from passerby.solver.freed_lenses import FreedLens
from passerby.solver.lens_scores import MOST_CHANGE, LensHypothesis, LensScore
from passerby.solver.lens_sigmas import BOXES_MISLEAD

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


FREED = LensHypothesis("focal", (1,))


def freed(
    change: float = 0.1, sd: float = 0.01, gain: float = 0.1, agreeing: float = 0.95, people: int = MIN_INSTANTS
) -> FreedLens:
    """The second camera's focal length freed; of the first one little agrees."""
    scores = (score(LensHypothesis("focal", (0,)), (0.5,), (0.01,), 90.0), score(FREED, (0.0,), (sd,), gain))
    return FreedLens({FREED: (change,)}, scores, np.array([0.1, agreeing]), np.array([3, people]))


def test_a_freed_lens_is_believed_where_it_is_far_and_its_people_agree() -> None:
    assert _holds(RIG, freed())
    assert _holds(RIG, freed(change=-0.1))
    assert not _holds(RIG, freed(sd=0.99 * 0.1 / (LEAST_SIGMAS * BOXES_MISLEAD) + 0.001)), "not far by its sigmas"
    assert not _holds(RIG, freed(change=0.99 * LEAST_CHANGE["focal"], sd=1e-4)), "nor by itself"
    assert not _holds(RIG, freed(change=1.01 * MOST_CHANGE["focal"])), "farther than lenses are wrong"
    assert not _holds(RIG, freed(agreeing=LEAST_AGREEING - 0.01)), "where it is, people disagree"
    assert not _holds(RIG, freed(people=MIN_INSTANTS - 1)), "or are few"
    assert not _holds(RIG, freed(gain=MOST_LEFT)), "and it would go on"


def test_of_two_freed_lenses_both_have_to_hold() -> None:
    also = LensHypothesis("focal", (0,))
    one = freed()
    both = replace(one, changes={**one.changes, also: (0.2,)})
    assert not _holds(RIG, both)
    settled = (score(also, (0.0,), (0.01,), 0.2), one.scores[1])
    assert _holds(RIG, replace(both, scores=settled, agreeing=np.full(2, 0.9), people=np.full(2, MIN_INSTANTS)))
