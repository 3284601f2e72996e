"""Lenses as unknowns: derivatives, what people tell of them, and what they do not."""

from __future__ import annotations

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
from passerby.findings.texts import texts_of
from passerby.geometry.triangulation import PointObservations
from passerby.interchange.rig_toml import read_rig, write_rig
from passerby.people.sightings import Sightings
from passerby.scene.tables import SolverTable
from passerby.solver.lens_sigmas import posterior_sd
from passerby.solver.lens_unknowns import FAR_PRINCIPAL_POINT, LensUnknowns
from passerby.solver.optimizer.least_squares import Step
from passerby.solver.people import PeopleOptions
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import CAMERA_SIZE, PeopleProblem
from passerby.solver.refined_lenses import RefinedLenses, far_lenses, lens_figures, lens_notes
from support.scenes.people_and_rigs import LENS, looking_at, part, simulated, solve, without_poses
from support.tiers import thinned

BOTH = LensUnknowns(("focal", "principal_point"))


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


@pytest.mark.parametrize("parts", [("focal",), ("principal_point",), ("focal", "principal_point")])
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


@pytest.fixture(scope="module")
def problem_of_lenses() -> tuple[PeopleProblem, AdjustmentState]:
    """Two cameras, three person-instants, two joints; lenses between those of the rays and those stated."""
    rng = np.random.default_rng(3)
    poses = [looking_at((6.0, 0, 2.5), (0, 0, 1)), looking_at((-5, 3, 3.0), (0, 0, 1))]
    R, centre = np.array([p.R_cw for p in poses]), np.array([p.centre for p in poses])
    people = np.column_stack([rng.uniform(-1.5, 1.5, (3, 2)), rng.normal(0, 0.05, 3), rng.normal(1.7, 0.1, 3)])
    points = rng.uniform([-1, -1, 0], [1, 1, 1.8], (2, 3))
    lens = np.column_stack([[0.03, -0.02], rng.normal(0, 5, (2, 2))])

    def rays(camera: np.ndarray, world: np.ndarray) -> np.ndarray:
        d = np.einsum("mij,mj->mi", R[camera], world - centre[camera])
        return LENS.bearings(LENS.project_rays(d) + rng.normal(0, 3, (len(world), 2)))

    camera, block = np.repeat([0, 1], 3), np.tile(np.arange(3), 2)
    top = rays(camera, np.column_stack([people[block, :2], people[block, 3]]))
    bottom = rays(camera, np.column_stack([people[block, :2], people[block, 2]]))
    n = len(camera)
    sightings = Sightings(
        camera, np.zeros(n, np.int64), block, block=block, top=top, bottom=bottom, top_tangent=LENS.tangents(top),
        bottom_tangent=LENS.tangents(bottom), extent_px=rng.uniform(150, 250, n), top_fraction=np.ones(n),
        bottom_fraction=np.zeros(n), has_foot=np.ones(n),
    )  # fmt: skip
    of, point = np.repeat([0, 1], 2), np.tile(np.arange(2), 2)
    bearing = rays(of, points[point])
    joints = PointObservations(of, point, bearing, LENS.tangents(bearing), rng.uniform(1, 2, 4))
    stated, at = _pair(), np.zeros((2, 3))
    problem = PeopleProblem(
        2, BOTH.sightings(sightings, stated, at), BOTH.points(joints, stated, at), np.array([0, 0, 1]), 2, np.full(2, 1.72),
        np.full(2, 0.09), rng.uniform(0.2, 1, 3), lens_core=BOTH.core(stated), lens_weight=rng.uniform(1, 5, (2, 3)),
    )  # fmt: skip
    state = AdjustmentState(
        R, centre, rng.normal(0, 0.02, 2), np.array([0.12]), np.array([1.7, 1.8]), people, points, lens=lens
    )  # fmt: skip
    return problem, state


def _pair() -> Rig:
    return Rig((Camera("A", LENS), Camera("B", LENS)))


def test_derivatives_by_the_lenses_match_central_differences(problem_of_lenses: tuple[PeopleProblem, AdjustmentState]) -> None:
    problem, state = problem_of_lenses
    layout = problem.layout
    assert layout.camera_size == CAMERA_SIZE + 3
    terms = problem.terms(state, jacobians=True)
    seen = 0
    for camera in range(2):
        for unknown in range(3):
            index = camera * layout.camera_size + CAMERA_SIZE + unknown
            shared = 1e-6 * np.eye(layout.n_shared)[index]
            blocks = tuple(np.zeros((f.count, f.size)) for f in layout.families)
            ends = [
                problem.terms(problem.retract(state, Step(sign * shared, np.zeros(2), blocks)), jacobians=False)
                for sign in (1, -1)
            ]
            for term, plus, minus in zip(terms, *ends, strict=True):
                expected = (plus.residual - minus.residual) / 2e-6
                found = np.zeros_like(term.residual)
                if term.by_shared is not None:
                    found += term.by_shared[:, :, index]
                if term.by_camera is not None:
                    assert term.camera is not None
                    found[term.camera == camera] += term.by_camera[term.camera == camera][:, :, CAMERA_SIZE + unknown]
                np.testing.assert_allclose(found, expected, rtol=2e-5, atol=2e-5)
                seen += bool(np.abs(expected).max() > 1e-3)
    # Centres, joints and a prior follow every unknown; heights do not follow a principal point, which moves both ends alike.
    assert seen == 6 * 3 + 2


def test_rays_are_made_anew_and_residuals_stay(problem_of_lenses: tuple[PeopleProblem, AdjustmentState]) -> None:
    """The linear columns and rays of the moved lens agree to first order."""
    problem, state = problem_of_lenses
    s = problem.sightings
    little = 1e-4 * state.lens
    anew = replace(problem, sightings=BOTH.sightings(s, _pair(), little), joints=BOTH.points(problem.joints, _pair(), little))
    near = replace(state, lens=little)
    for linear, exact in zip(problem.terms(near, jacobians=False), anew.terms(near, jacobians=False), strict=True):
        np.testing.assert_allclose(linear.residual, exact.residual, atol=1e-3)
    assert np.abs(anew.sightings.top - s.top).max() > 0


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


def test_what_was_dropped_is_said_once_with_what_was_kept() -> None:
    for kept, parts in (((), ["focal", "principal_point"]), (("focal",), ["principal_point"])):
        outcome = LensRefinement(asked=("focal", "principal_point"), kept=kept, why="diverged")
        (note,) = lens_notes(AdjustedFigures(refinement=outcome))
        assert (note.code, note.values) == ("refinement_dropped", {"parts": parts, "why": "diverged"})
    assert lens_notes(AdjustedFigures(refinement=LensRefinement(asked=("focal",), kept=("focal",)))) == []


@pytest.mark.slow
def test_without_refinement_nothing_is_told_of_lenses() -> None:
    solution, truth = solved((), ())
    assert solution.figures.lenses == {}
    assert lens_notes(solution.figures) == []
    np.testing.assert_array_equal(solution.rig[truth.names[0]].lens.matrix, truth[truth.names[0]].lens.matrix)


def test_notes_say_what_was_refined() -> None:
    focal = FocalFigures(stated_px=1000.0, refined_px=1043.0, sigma_px=4.2, people_sigma_px=5.0, far=False, told=True)
    assert texts_of(lens_notes(AdjustedFigures(lenses={"C2": LensFigures(focal=focal)}))) == (
        "camera C2: focal length 1043 px instead of 1000 (+4.3 %, sigma 0.4 %)",
    )


def test_without_intrinsics_the_notice_says_what_the_rig_measures() -> None:
    lens = LensFigures(distortion=DistortionFigures(refined=0.0, sigma=0.05))
    measured = MeasuringSigma(median_mm=30.0, p90_mm=60.0)
    figures = AdjustedFigures(
        cameras=(
            SolvedCamera(name="C1", shape_orientation_sigma_deg=0.1),
            SolvedCamera(name="C2", shape_orientation_sigma_deg=1.7),
        ),
        lenses={"C2": lens},
        measuring=MeasuringFigures(places=9, points=measured, ground=measured.scaled(2.5), ground_height_mm=34.0, cameras={}),
    )
    assert texts_of(lens_notes(figures)) == (
        "camera C2 without intrinsics: the principal point is not observable; rotations are uncertain by 1.7 degrees, "
        "positions on the ground by 8 cm, points by 3.0 cm (1 sigma): for exact rotations, state the intrinsics",
    )
    assert far_lenses({"C2": lens}) == []


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
        assert found is not None
        assert (found.far, found.told) == (far, not far)


def test_the_prior_of_a_stated_value_is_given_as_a_sigma():
    """A Cauchy distribution has half of itself within its scale, a normal one within 0.67 sigma."""
    stated = Rig((Camera("A", replace(LENS, focal_sd=0.08)),))
    refined = RefinedLenses(LensUnknowns(("focal",)), np.array([[0.03]]), np.array([[0.04]]))
    focal = lens_figures(refined, stated, stated)["A"].focal
    assert focal.prior_sigma_px == pytest.approx(0.08 * LENS.focal)
    assert focal.people_share == pytest.approx(0.5625)


def test_posteriors_of_a_stated_value() -> None:
    """A stated value that is seen to be right is as sure as stated; one that is far off is as sure as it is seen."""
    assert posterior_sd(0.0, 0.001, 0.005, 0.0) == pytest.approx(0.001, rel=0.05)
    assert posterior_sd(0.3, 0.01, 0.005, 0.3) == pytest.approx(0.01, rel=0.05)
    assert 0.005 < posterior_sd(0.0, 0.05, 0.005, 0.0) < 0.05


def test_geopose_refuses() -> None:
    with pytest.raises(ValueError, match="refines nothing"):
        SolverTable(method="geopose", reference="A", refine=("focal",))


def test_residuals_follow_a_lens_to_first_order_however_large_they_are(
    problem_of_lenses: tuple[PeopleProblem, AdjustmentState],
) -> None:
    """Half the change leaves a quarter of the difference to rays made anew: none is of the size of residual times change."""
    problem, state = problem_of_lenses
    misses = []
    for size in (0.02, 0.01):
        change = size * np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
        anew = replace(
            problem, sightings=BOTH.sightings(problem.sightings, _pair(), change),
            joints=BOTH.points(problem.joints, _pair(), change),
        )  # fmt: skip
        near = replace(state, lens=change)
        pairs = zip(problem.terms(near, jacobians=False), anew.terms(near, jacobians=False), strict=True)
        misses.append(max(float(np.abs(linear.residual - exact.residual).max()) for linear, exact in pairs))
    assert misses[0] > 1e-6
    assert misses[1] < 0.35 * misses[0]
