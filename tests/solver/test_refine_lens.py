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
from passerby.geometry.triangulation import PointObservations
from passerby.interchange.rig_toml import read_rig, write_rig
from passerby.people.model import Noise
from passerby.solver.lens_sigmas import BOXES_COUNT_LESS, LensEvidence, lens_evidence, posterior_sd
from passerby.solver.lens_unknowns import LensUnknowns
from passerby.solver.people import PeopleOptions
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import PeopleProblem
from passerby.solver.refined_lenses import RefinedLenses, far_lenses, lens_figures, lens_notes
from passerby.solver.systematic import ConsiderParameters
from support.scenes.exact_sightings import poses_of, standing
from support.scenes.people_and_rigs import LENS, part, ring, simulated, solve, without_poses
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
    return compare(solution.rig, truth).similarity.mean_position_mm


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


def test_a_wrong_focal_length_is_found_and_the_rig_file_holds_it(tmp_path: Path) -> None:
    refined, truth = solved(((1, 1.1),), ("focal",))
    name = truth.names[1]
    parts = refined.figures.lenses[name].focal
    assert parts.stated_px == pytest.approx(1.1 * truth[name].lens.focal)
    for camera, lens in refined.figures.lenses.items():
        assert abs(lens.focal.refined_px - truth[camera].lens.focal) < 3 * lens.focal.sigma_px < 25
        assert (lens.focal.people_share > 0.9) == (camera == name)
    assert abs(factors(refined.rig, truth) - 1).max() < 0.02
    assert error_mm(refined, truth) < 80
    assert compare(refined.rig, truth).scale_ratio == pytest.approx(1, abs=0.07)
    assert refined.verdict == "accepted"
    write_rig(tmp_path / "rig.toml", refined.rig)
    lens = read_rig(tmp_path / "rig.toml")[name].lens
    assert lens.focal == pytest.approx(parts.refined_px)
    np.testing.assert_array_equal(lens.distortions, truth[name].lens.distortions)


@pytest.mark.slow
@pytest.mark.parametrize("focal", [((1, 1.1),), tuple((c, 1.2) for c in range(4))], ids=["one", "all"])
def test_focal_lengths_wrong_by_up_to_a_fifth_are_found_and_the_cameras_with_them(focal: tuple[tuple[int, float], ...]) -> None:
    stated, truth = solved(focal, ())
    refined, _ = solved(focal, ("focal",))
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
    assert refined.figures.lenses == stated.figures.lenses == {}
    assert lens_notes(stated.figures) == []
    assert refined.verdict == stated.verdict
    for name in truth.names:
        for found in (stated, refined):
            np.testing.assert_array_equal(found.rig[name].lens.matrix, truth[name].lens.matrix)
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


def test_notes_say_what_was_dropped_what_was_refined_and_what_is_assumed() -> None:
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


def test_figures_give_each_prior_and_how_much_people_count_beside_it():
    """As a sigma: a Cauchy distribution has half of itself within its scale, a normal one within 0.67 sigma."""
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
    stated = Rig((Camera("A", replace(LENS, focal_sd=0.08)),))
    refined = RefinedLenses(LensUnknowns(("focal",)), np.array([[0.03]]), np.array([[0.04]]))
    focal = lens_figures(refined, stated, stated)["A"].focal
    assert (focal.prior_sigma_px, focal.people_share) == pytest.approx((0.08 * LENS.focal, 0.5625))


@pytest.mark.parametrize("axis", [0, 1])
def test_a_principal_point_is_far_where_it_moved_by_more_than_unknown_ones_are_off(axis: int) -> None:
    """A seventh of the width, either way; it is given where people know it better than unknown ones are off."""
    unknowns = LensUnknowns(("principal_point",))
    stated = Rig((Camera("A", LENS),))
    for share, far in ((-0.1, False), (0.1, False), (-0.15, True), (0.15, True)):
        change, sigmas = np.zeros((1, 2)), np.full((1, 2), 0.01 * LENS.size[0])
        change[0, axis] = share * LENS.size[0]
        sigmas[0, axis] = (0.05 if far else 0.01) * LENS.size[0]
        found = lens_figures(RefinedLenses(unknowns, sigmas, sigmas), stated, unknowns.rig(stated, change))["A"].principal_point
        assert (found.far, found.told) == (far, not far)


def test_posteriors_of_a_stated_value() -> None:
    """A stated value that is seen to be right is as sure as stated; one that is far off is as sure as it is seen."""
    assert posterior_sd(0.0, 0.001, 0.005, 0.0) == pytest.approx(0.001, rel=0.05)
    assert posterior_sd(0.3, 0.01, 0.005, 0.3) == pytest.approx(0.01, rel=0.05)
    assert 0.005 < posterior_sd(0.0, 0.05, 0.005, 0.0) < 0.05


UNKNOWNS = LensUnknowns(("focal", "principal_point"))
RIG = ring(4)


def exact(instants: int = 60) -> tuple[PeopleProblem, AdjustmentState]:
    """Eight people, each at many places, seen without any error."""
    rng = np.random.default_rng(0)
    person = np.arange(instants) % 8
    heights = rng.normal(1.72, 0.06, 8)
    ground = rng.uniform(-2, 2, (instants, 2))
    nothing = np.zeros((4, UNKNOWNS.size))
    sightings = replace(standing(RIG, ground, heights[person]), has_foot=np.zeros(4 * instants))
    unseen = PointObservations(np.zeros(0, int), np.zeros(0, int), np.zeros((0, 3)), np.zeros((0, 2, 3)), np.zeros(0))
    problem = PeopleProblem(
        4, UNKNOWNS.sightings(sightings, RIG, nothing), UNKNOWNS.points(unseen, RIG, nothing), person, 0, np.full(8, 1.72),
        np.full(8, 0.09), np.ones(instants), Noise(), lens_core=UNKNOWNS.core(RIG), lens_normal=True,
    )  # fmt: skip
    R, centre = poses_of(RIG)
    people = np.column_stack([ground, np.zeros(instants), heights[person]])
    state = AdjustmentState(R, centre, np.zeros(4), np.array([0.08]), heights, people, np.zeros((0, 3)), lens=nothing)
    return problem, state


def evidence_of(problem: PeopleProblem, state: AdjustmentState, held_sd: float = 0.0, inflation: float = 2.0) -> LensEvidence:
    """With held distortions that are off by 0.01 times `held_sd`."""
    held = ConsiderParameters.of_lenses(RIG, problem, state, UNKNOWNS.parts)
    return lens_evidence(problem, state, inflation, None, replace(held, root=held_sd * held.root))


@pytest.mark.parametrize("unknown", range(3))
def test_what_people_say_of_a_lens_does_not_go_by_what_was_stated_of_it(unknown: int) -> None:
    problem, state = exact()
    found = []
    for looser in (30.0, 100.0, 1e4):
        core = problem.lens_core.copy()
        core[1, unknown] *= looser
        found.append(evidence_of(replace(problem, lens_core=core), state).sd[1, unknown])
    np.testing.assert_allclose(found, found[-1], rtol=1e-3)


def test_priors_count_by_what_boxes_are_off_by_beyond_chance() -> None:
    """Next to nothing beyond it here: sixty instants leave much to chance, and the factor that boxes count less by is left."""
    problem, state = exact()
    excess = evidence_of(problem, state, inflation=1.0).prior_weight
    assert (excess >= BOXES_COUNT_LESS**2).all()
    np.testing.assert_allclose(excess, BOXES_COUNT_LESS**2, rtol=0.1)
    # Where sightings that follow one another count as independent, the priors count more, but barely where other priors tell
    # (how high a principal point is, by how upright people are).
    alone = evidence_of(problem, state, inflation=2.0)
    assert (alone.prior_weight[:, 0] > 1.7 * excess[:, 0]).all()
    assert (alone.prior_weight < 2 * excess).all()
    # What is held of a lens adds to what is refined.
    with_held = evidence_of(problem, state, 100.0)
    assert (with_held.sd >= alone.sd).all()
    assert (with_held.sd[:, 0] > 1.05 * alone.sd[:, 0]).any(), "a distortion looks like a focal length where people walk"
    assert (with_held.prior_weight >= alone.prior_weight).all()


def test_a_wrong_person_far_beyond_a_picture_says_nothing_of_its_lens() -> None:
    problem, state = exact()
    before = ConsiderParameters.of_lenses(RIG, problem, state).columns["centres"]
    people = state.people.copy()
    people[0, :2] = (state.centre[0] + 8.0 * state.R[0, 0] + 0.3 * state.R[0, 2])[:2]  # nearly beside the first camera
    after = ConsiderParameters.of_lenses(RIG, problem, replace(state, people=people)).columns["centres"]
    own = (problem.sightings.block == 0) & (problem.sightings.camera == 0)
    assert np.abs(before[own]).max() > 0
    assert not after[own].any()
    others = problem.sightings.block > 0
    np.testing.assert_array_equal(after[others], before[others])
