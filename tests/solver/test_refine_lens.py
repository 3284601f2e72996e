"""Lenses as unknowns: derivatives, what people tell of them, and what they do not."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from passerby.core.cameras import Camera, Lens, Rig
from passerby.core.figures import AdjustedFigures, SolvedCamera
from passerby.core.lens_figures import DistortionFigures, FocalFigures, LensFigures, LensRefinement
from passerby.core.measuring import MeasuringFigures, MeasuringSigma
from passerby.core.solution import Solution
from passerby.evaluation.metrics import compare
from passerby.interchange.rig_toml import read_rig, write_rig
from passerby.solver.lens_sigmas import posterior_sd
from passerby.solver.lens_unknowns import FAR_PRINCIPAL_POINT, LensUnknowns
from passerby.solver.people import PeopleOptions
from passerby.solver.refined_lenses import RefinedLenses, far_lenses, lens_figures, lens_notes
from support.scenes.people_and_rigs import LENS, part, simulated, solve, without_poses
from support.tiers import thinned


def spoilt(rig: Rig, focal: dict[int, float]) -> Rig:
    """The rig without poses, some cameras' focal lengths stated wrong by a factor."""
    change = np.array([[np.log(focal.get(c, 1.0))] for c in range(len(rig))])
    return without_poses(LensUnknowns(("focal",)).rig(rig, change))


def factors(found: Rig, truth: Rig) -> np.ndarray:
    """(C,) refined over true focal lengths."""
    return np.array([found[name].lens.focal / truth[name].lens.focal for name in truth.names])


@cache
def solved(focal: tuple[tuple[int, float], ...], refine: tuple[str, ...], preset: str = "basketball") -> tuple[Solution, Rig]:
    """Boxes with 2 % noise, cameras' focal lengths stated wrong by factors."""
    truth = simulated(preset)
    options = PeopleOptions(max_sightings=4000, coarse_people=200, refine_lens=refine)  # type: ignore[arg-type]
    return solve(spoilt(truth.rig, dict(focal)), part(truth.observations), options=options), truth.rig


def error_mm(solution: Solution, truth: Rig) -> float:
    found = compare(solution.rig, truth).similarity.mean_position_mm
    assert found is not None
    return found


@pytest.mark.parametrize("parts", [("principal_point",), ("focal", "principal_point", "distortion")])
@pytest.mark.parametrize("fisheye", [False, True])
def test_pixels_of_fixed_rays_move_with_the_lens_as_their_columns_say(parts: tuple[str, ...], fisheye: bool) -> None:
    unknowns = LensUnknowns(parts)  # type: ignore[arg-type]
    lens = Lens(LENS.size, LENS.matrix, LENS.distortions[:4], fisheye)
    rays = lens.bearings(np.random.default_rng(0).uniform([100, 100], [1100, 600], (20, 2)))
    columns = unknowns.by_pixel(lens, lens.project_rays(rays))
    assert columns.shape == (20, 2, unknowns.size)
    for column in range(unknowns.size):
        step = 1e-5 * np.eye(unknowns.size)[column]
        moved = unknowns.moved(lens, step).project_rays(rays) - unknowns.moved(lens, -step).project_rays(rays)
        np.testing.assert_allclose(columns[:, :, column], moved / 2e-5, rtol=1e-5, atol=1e-4)


@pytest.mark.slow
def test_a_wrong_focal_length_is_found_and_the_cameras_with_it() -> None:
    stated, truth = solved(((1, 1.1),), ())
    refined, _ = solved(((1, 1.1),), ("focal",))
    parts = refined.figures.lenses[truth.names[1]].focal
    assert parts.stated_px == pytest.approx(1.1 * truth[truth.names[1]].lens.focal)
    assert abs(parts.refined_px - truth[truth.names[1]].lens.focal) < 3 * parts.sigma_px
    assert error_mm(refined, truth) < error_mm(stated, truth) / 3
    assert refined.verdict == "accepted"


def test_the_rig_file_holds_the_refined_lens(tmp_path: Path) -> None:
    refined, truth = solved(((1, 1.1),), ("focal",))
    name = truth.names[1]
    write_rig(tmp_path / "rig.toml", refined.rig)
    lens = read_rig(tmp_path / "rig.toml")[name].lens
    assert lens.focal == pytest.approx(refined.figures.lenses[name].focal.refined_px)
    np.testing.assert_array_equal(lens.distortions, truth[name].lens.distortions)


@pytest.mark.slow
def test_a_focal_length_wrong_by_a_fifth_in_all_cameras_is_found() -> None:
    everywhere = tuple((c, 1.2) for c in range(4))
    stated, truth = solved(everywhere, ())
    refined, _ = solved(everywhere, ("focal",))
    assert abs(factors(refined.rig, truth) - 1).max() < 0.05
    assert error_mm(refined, truth) < error_mm(stated, truth) / 3
    assert compare(refined.rig, truth).scale_ratio == pytest.approx(1, abs=0.07)


@thinned(("refine", "preset"), [(("focal",), "basketball"), (("principal_point",), "terrace"),
                                (("focal", "principal_point"), "basketball")], quick=0)  # fmt: skip
def test_right_lenses_stay_and_the_rig_is_the_one_without_refinement(refine: tuple[str, ...], preset: str) -> None:
    stated, truth = solved((), (), preset)
    refined, _ = solved((), refine, preset)
    outcome = refined.figures.refinement
    assert (outcome.asked, outcome.kept, outcome.why) == (refine, (), "prediction")
    assert refined.figures.lenses == {}
    assert refined.verdict == stated.verdict
    for name in truth.names:
        np.testing.assert_array_equal(refined.rig[name].lens.matrix, truth[name].lens.matrix)
        np.testing.assert_array_equal(refined.rig[name].pose.R_cw, stated.rig[name].pose.R_cw)
        np.testing.assert_array_equal(refined.rig[name].pose.t_cw, stated.rig[name].pose.t_cw)
    (note,) = lens_notes(refined.figures)
    assert (note.severity, note.code, note.values["parts"]) == ("notice", "refinement_dropped", list(refine))


@pytest.mark.slow
def test_a_principal_point_wrong_by_a_twentieth_of_the_width_is_found() -> None:
    truth = simulated("basketball")
    width = truth.rig.cameras[1].lens.size[0]
    change = np.zeros((len(truth.rig), 2))
    change[1, 0] = 0.05 * width
    stated = without_poses(LensUnknowns(("principal_point",)).rig(truth.rig, change))
    options = PeopleOptions(max_sightings=4000, coarse_people=200, refine_lens=("principal_point",))
    refined = solve(stated, part(truth.observations), options=options)
    assert refined.figures.refinement.kept == ("principal_point",)
    name = truth.rig.names[1]
    moved = refined.rig[name].lens.matrix[:2, 2] - truth.rig[name].lens.matrix[:2, 2]
    assert abs(moved[0]) < 0.01 * width


def test_notes_tell_what_was_dropped_what_was_refined_and_what_is_assumed() -> None:
    for kept, parts in (((), ["focal", "principal_point"]), (("focal",), ["principal_point"])):
        outcome = LensRefinement(asked=("focal", "principal_point"), kept=kept, why="diverged")
        (note,) = lens_notes(AdjustedFigures(refinement=outcome))
        assert (note.code, note.values) == ("refinement_dropped", {"parts": parts, "why": "diverged"})
    assert lens_notes(AdjustedFigures(refinement=LensRefinement(asked=("focal",), kept=("focal",)))) == []
    focal = FocalFigures(stated_px=1000.0, refined_px=1043.0, sigma_px=4.2, people_sigma_px=5.0, far=False, told=True)
    (note,) = lens_notes(AdjustedFigures(lenses={"C2": LensFigures(focal=focal)}))
    percents = {"change_percent": pytest.approx(4.3), "sigma_percent": pytest.approx(100 * 4.2 / 1043)}
    refined = {"refined_px": 1043.0, "stated_px": 1000.0, "constrained": True, **percents}
    assert (note.code, note.cameras, note.values) == ("focal_refined", ("C2",), refined)
    # Without intrinsics the principal point stands for rotations: what the rig measures all the same is said.
    lens = LensFigures(distortion=DistortionFigures(refined=0.0, sigma=0.05))
    measured = MeasuringSigma(median_mm=30.0, p90_mm=60.0)
    figures = AdjustedFigures(
        cameras=tuple(SolvedCamera(name=n, shape_orientation_sigma_deg=deg) for n, deg in (("C1", 0.1), ("C2", 1.7))),
        lenses={"C2": lens},
        measuring=MeasuringFigures(places=9, points=measured, ground=measured.scaled(2.5), ground_height_mm=34.0, cameras={}),
    )
    (note,) = lens_notes(figures)
    assert (note.code, note.cameras) == ("principal_points_assumed", ("C2",))
    assert note.values == {"orientation_deg": 1.7, "ground_mm": 75.0, "points_mm": 30.0}
    assert far_lenses({"C2": lens}) == []


@pytest.mark.slow
def test_without_refinement_nothing_is_told_of_lenses() -> None:
    solution, truth = solved((), ())
    assert solution.figures.lenses == {}
    assert lens_notes(solution.figures) == []
    np.testing.assert_array_equal(solution.rig[truth.names[0]].lens.matrix, truth[truth.names[0]].lens.matrix)


def test_figures_give_each_prior_and_how_much_people_count_beside_it():
    lens = Lens.unknown((1000, 600), hfov_deg=60.0, focal_sd=0.05)
    stated = Rig((Camera("A", lens), Camera("B", LENS)))
    unknowns = LensUnknowns(("focal", "principal_point", "distortion"))
    change = np.array([[0.02, 3.0, -1.0, -0.1], [0.0] * 4])
    people, prior = np.array([0.025, 30.0, np.inf, 0.05]), np.array([0.05, 20.0, 20.0, 0.15])
    sigma = 1 / np.sqrt(1 / people**2 + 1 / prior**2)
    refined = RefinedLenses(unknowns, np.stack([sigma, sigma]), np.stack([people, people]))
    figures = lens_figures(refined, stated, unknowns.rig(stated, change))
    assert list(figures) == ["A"], "a calibrated lens beside it is held"
    focal, point, distortion = figures["A"].focal, figures["A"].principal_point, figures["A"].distortion
    assert (focal.stated_px, focal.prior_sigma_px) == pytest.approx((lens.focal, 0.05 * lens.focal))
    assert focal.people_share == pytest.approx(0.8)  # twice as sure, four times as much
    assert point.prior_sigma_px == pytest.approx((20.0, 20.0))
    assert point.people_share == pytest.approx((4 / 13, 0.0))
    assert point.people_sigma_px == (pytest.approx(30.0), None)
    assert (distortion.refined, distortion.stated, distortion.prior_sigma) == pytest.approx((-0.1, 0.0, 0.15))
    assert (distortion.people_sigma, distortion.people_share) == pytest.approx((0.05, 0.9))


@pytest.mark.parametrize("axis", [0, 1])
def test_a_principal_point_is_far_where_it_moved_by_more_than_unknown_ones_are_off(axis: int) -> None:
    """Three sigmas of a lens that was never calibrated, either way; it is told where people know it better than that."""
    unknowns = LensUnknowns(("principal_point",))
    stated = Rig((Camera("A", LENS),))
    usual = FAR_PRINCIPAL_POINT * LENS.size[0]
    for moved, far in ((-2.9, False), (2.9, False), (-3.1, True), (3.1, True)):
        change = np.zeros((1, 2))
        change[0, axis] = moved * usual
        sigmas = np.full((1, 2), 0.5 * usual)
        sigmas[0, axis] = 0.9 * usual if far else 0.5 * usual
        found = lens_figures(RefinedLenses(unknowns, sigmas, sigmas), stated, unknowns.rig(stated, change))["A"].principal_point
        assert (found.far, found.told) == (far, not far)


def test_the_prior_of_a_stated_value_is_given_as_a_sigma():
    """A Cauchy distribution has half of itself within its scale, a normal one within 0.67 sigma."""
    stated = Rig((Camera("A", replace(LENS, focal_sd=0.08)),))
    focal = lens_figures(RefinedLenses(LensUnknowns(("focal",)), np.array([[0.03]]), np.array([[0.04]])), stated, stated)[
        "A"
    ].focal
    assert (focal.prior_sigma_px, focal.people_share) == (pytest.approx(0.08 * LENS.focal), pytest.approx(0.5625))


def test_posteriors_of_a_stated_value() -> None:
    """A stated value that is seen to be right is as sure as stated; one that is far off is as sure as it is seen."""
    assert posterior_sd(0.0, 0.001, 0.005, 0.0) == pytest.approx(0.001, rel=0.05)
    assert posterior_sd(0.3, 0.01, 0.005, 0.3) == pytest.approx(0.01, rel=0.05)
    assert 0.005 < posterior_sd(0.0, 0.05, 0.005, 0.0) < 0.05
