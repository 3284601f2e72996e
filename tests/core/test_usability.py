"""One doubt about what a rig measures too vaguely, with what explains it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.figures import AdjustedFigures, AdjustmentRound, SolvedCamera
from passerby.core.measuring import CameraMeasuring, MeasuringFigures, MeasuringSigma
from passerby.core.usability import (
    ON_GROUND,
    USABLE_M,
    USABLE_SCALE,
    add_uncertainty_doubts,
    doubts_of_uncertainty,
    find_usable_m,
)
from passerby.findings.finding import Finding, notice

LENS = Lens((800, 600), np.array([[700.0, 0, 400], [0, 700, 300], [0, 0, 1]]), np.zeros(0))
CENTRES = np.array([[0.0, 0, 3], [8.0, 0, 3], [0.0, 8, 3]])


def rig(factor: float = 1.0) -> Rig:
    cameras = (Pose.from_centre(np.eye(3), factor * centre) for centre in CENTRES)
    return Rig(tuple(Camera(f"C{k}", LENS, pose) for k, pose in enumerate(cameras, start=1)))


def measuring(*across_m: float, ground_m: float | None = None) -> MeasuringFigures:
    """Cameras whose rays pass places so far beside them, metres, one sigma."""
    sigmas = [MeasuringSigma(median_mm=1000 * one, p90_mm=2000 * one) for one in across_m]
    ground = None if ground_m is None else MeasuringSigma(median_mm=1000 * ground_m, p90_mm=2000 * ground_m)
    cameras = {f"C{k}": CameraMeasuring(points=one, across=one, ground=ground) for k, one in enumerate(sigmas, start=1)}
    return MeasuringFigures(places=10, points=sigmas[0], ground=ground, ground_height_mm=None, cameras=cameras)


def figures(own: MeasuringFigures | None = None, **others: object) -> AdjustedFigures:
    cameras = tuple(SolvedCamera(name=f"C{k}", shape_position_sigma_mm=10.0) for k in (1, 2, 3))
    return replace(AdjustedFigures(cameras=cameras, measuring=own), **others)  # type: ignore[arg-type]


SOUND = figures(measuring(0.01, 0.01, 0.01, ground_m=0.1))


def test_nothing_is_said_of_a_rig_that_measures_well_or_not_at_all() -> None:
    assert doubts_of_uncertainty(rig(), SOUND, [notice("few_observations", "C1", agreeing=12)]) == []
    nowhere = Rig(tuple(replace(camera, pose=None) for camera in rig()))
    assert doubts_of_uncertainty(nowhere, figures(), []) == []


def test_a_camera_that_measures_points_too_vaguely() -> None:
    (doubt,) = doubts_of_uncertainty(rig(), figures(measuring(0.01, 1.0, 0.01)), [])
    assert (doubt.cameras, doubt.values["what"], doubt.values["sigma"]) == (("C2",), "points", pytest.approx(1000.0))
    # One that sees no shared place counts by its position.
    cameras = tuple(SolvedCamera(name=f"C{k}", shape_position_sigma_mm=10.0 if k < 3 else 900.0) for k in (1, 2, 3))
    (doubt,) = doubts_of_uncertainty(rig(), figures(None, cameras=cameras), [])
    assert (doubt.cameras, doubt.values["sigma"]) == (("C3",), 900.0)


@pytest.mark.parametrize(("factor", "usable"), [(0.5, 0.05), (4.0, USABLE_M), (40.0, 0.005)])
def test_how_well_points_have_to_be_known_goes_by_the_size_of_the_rig(factor: float, usable: float) -> None:
    """A share of the extent in small and in large rigs, and metres between them."""
    limit = find_usable_m(rig(factor))
    extent = float(np.max(np.linalg.norm(factor * (CENTRES - CENTRES.mean(axis=0)), axis=1))) + 1.0
    assert limit == pytest.approx(usable if usable == USABLE_M else usable * extent)


@pytest.mark.parametrize("reach", [None, 0.5, 1.0, 8.0])
def test_the_height_of_the_ground_counts_not_how_flat_a_camera_looks(reach: float | None) -> None:
    limit = ON_GROUND * max(find_usable_m(rig()), USABLE_M) * max(reach or 1.0, 1.0)
    for ground_m, count in ((0.9 * limit, 0), (1.1 * limit, 3)):
        own = measuring(0.01, 0.01, 0.01, ground_m=ground_m)
        own = replace(own, cameras={name: replace(one, reach=reach) for name, one in own.cameras.items()})
        found = doubts_of_uncertainty(rig(), figures(own), [])
        assert [one.values["what"] for one in found] == count * ["ground"]
        assert all(one.values["sigma"] == pytest.approx(1000 * ground_m) for one in found)


@pytest.mark.parametrize(("share", "whats"), [(0.9, []), (1.1, ["scale"])])
def test_lengths(share: float, whats: list[str]) -> None:
    scaled = replace(SOUND, scale=replace(SOUND.scale, relative_sigma=share * USABLE_SCALE))
    assert [one.values["what"] for one in doubts_of_uncertainty(rig(), scaled, [])] == whats


def test_what_nothing_fixes_has_no_sigma() -> None:
    free = replace(SOUND, undetermined=("scale", "vertical", "camera C2"))
    found = doubts_of_uncertainty(rig(), free, [])
    assert [(one.values["what"], one.values["sigma"], one.values["lacks"], one.cameras) for one in found] == [
        ("world", None, ["scale", "vertical"], ()), ("points", None, [], ("C2",)),
    ]  # fmt: skip


@pytest.mark.parametrize(("lacks", "what"), [("scale", "scale"), ("vertical", "ground"), ("height of the ground", "ground")])
def test_what_nothing_fixes_is_of_the_scale_or_of_the_ground(lacks: str, what: str) -> None:
    (doubt,) = doubts_of_uncertainty(rig(), replace(SOUND, undetermined=(lacks,)), [])
    assert (doubt.values["what"], doubt.values["lacks"]) == (what, [lacks])


def test_an_adjustment_that_ended_too_early_says_nothing_of_how_well_it_measures() -> None:
    rounds = (AdjustmentRound(sightings=9, renamed=0, joints=0, iterations=200, converged=False, cost=None),)
    (doubt,) = doubts_of_uncertainty(rig(), replace(SOUND, rounds=rounds), [notice("adjustment_not_converged")])
    assert (doubt.values["sigma"], doubt.values["why"]["code"]) == (None, "adjustment_not_converged")


@pytest.mark.parametrize(
    "why", [notice("people_not_spread", shape="line", length_m=14.2), notice("boxes_noisy", noise_percent=40.0)]
)
def test_beside_these_the_sigmas_say_too_little(why: Finding) -> None:
    (doubt,) = doubts_of_uncertainty(rig(), SOUND, [why])
    assert (doubt.cameras, doubt.values["what"], doubt.values["sigma"]) == ((), "points", None)
    assert doubt.values["why"]["code"] == why.code


def test_a_doubt_says_why_and_the_notice_is_not_said_twice() -> None:
    uneven, few = notice("ground_uneven", rise_m=0.4, at=None), notice("few_observations", "C2", agreeing=12)
    vague = figures(measuring(0.01, 1.0, 0.01))
    found = add_uncertainty_doubts(rig(), vague, [uneven, few])
    assert [one.code for one in found] == ["ground_uneven", "rig_uncertain"]
    assert found[-1].values["why"]["code"] == "few_observations"
    # A notice of another camera explains nothing of this one.
    found = add_uncertainty_doubts(rig(), vague, [notice("few_observations", "C1", agreeing=12)])
    assert found[-1].values["why"] is None
    # Said again with other figures, it is not said twice.
    assert add_uncertainty_doubts(rig(), vague, found) == found
