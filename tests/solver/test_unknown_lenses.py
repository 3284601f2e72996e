"""Lenses that are guesses or unknown: people in several views tell them, and what a guess is off by is in every sigma."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Rig
from passerby.core.figures import adjusted
from passerby.core.observations import Observations
from passerby.core.scale_cues import ScaleCues
from passerby.core.solution import Solution
from passerby.evaluation.metrics import compare
from passerby.interchange.rig_toml import read_rig, write_rig
from passerby.scene.check import check_scene
from passerby.simulation import SimulatedScene
from passerby.simulation.options import SimulationOptions
from passerby.simulation.scene import simulate
from passerby.solver.evidence import gather_evidence
from passerby.solver.focal_search import search_focals
from passerby.solver.lens_unknowns import FOCAL_CORE, LENS_PARTS, LensUnknowns
from passerby.solver.people import PeopleOptions, solve_people
from passerby.solver.systematic import covariance_of_guesses
from support.scenes.handmade_files import lens, write_scene
from support.scenes.people_and_rigs import LENS, part, simulated, solve, without_poses
from support.tiers import thinned

UNKNOWN = LensUnknowns(LENS_PARTS)
REFINED = PeopleOptions(refine_lens=LENS_PARTS)


@cache
def made(preset: str = "terrace", seed: int = 40, seconds: float = 30.0, **faults: object) -> SimulatedScene:
    return simulate(SimulationOptions(preset=preset, seed=seed, seconds=seconds, **faults))


def noisy(preset: str = "terrace", seed: int = 40, **faults: object) -> SimulatedScene:
    return made(preset, seed, box_noise=0.02, missing=0.1, **faults)


def unknown(rig, *known):
    return Rig(tuple(Camera(c.name, c.lens if c.name in known else Lens.unknown(c.lens.size)) for c in rig))


def factors(found, true):
    return np.array([found[camera.name].lens.focal / camera.lens.focal for camera in true])


def solved_unknown(rig: Rig, observations: Observations) -> Solution:
    return solve_people(rig, observations, ScaleCues(), REFINED, rng=np.random.default_rng(0))


@pytest.mark.slow
@pytest.mark.parametrize(("known", "sightings"), [((), 4000), (("C1", "C3"), 2000)])
def test_the_grounds_of_pairs_tell_first_focal_lengths_and_known_lenses_stay(known: tuple[str, ...], sightings: int) -> None:
    truth, rng = noisy(), np.random.default_rng(0)
    stated = unknown(truth.rig, *known)
    evidence = gather_evidence(stated, part(truth.observations), rng, max_sightings=sightings)
    found = search_focals(evidence, stated, UNKNOWN, 1.72, rng)
    assert np.abs(np.log(factors(stated, truth.rig))).max() > 0.15, "the guess is far off"
    assert np.abs(np.log(factors(found, truth.rig))).max() < 0.15
    for camera in found:
        assert camera.name not in known or camera.lens is stated[camera.name].lens
        assert camera.name in known or camera.lens.uncalibrated, "the search is not the last word"


@pytest.mark.slow
@pytest.mark.parametrize("known", [(), ("C2",)])
def test_lenses_and_rig_are_found_together(known):
    truth = noisy()
    solution = solved_unknown(unknown(truth.rig, *known), part(truth.observations))
    assert len(solution.rig.posed()) == 4
    off = np.log(factors(solution.rig, truth.rig))
    assert np.abs(off).max() < 0.06
    lenses = adjusted(solution.figures).lenses
    assert sorted(lenses) == [name for name in truth.rig.names if name not in known], "known lenses are held"
    for name, parts in lenses.items():
        error = abs(np.log(parts.focal.refined_px / truth.rig[name].lens.focal))
        assert error < 3 * parts.focal.sigma_px / parts.focal.refined_px
        assert not solution.rig[name].lens.uncalibrated
    assert np.exp(off[np.isin(truth.rig.names, known)]) == pytest.approx(1.0, abs=1e-4)


@pytest.mark.slow
def test_keypoints_tell_lenses_better_and_a_search_that_went_wrong_does_not_hold_focal_lengths():
    """A search is a start. Joints determine focal lengths that it missed by a factor of two."""
    truth = noisy("basketball", 41, joint_noise_px=2.0)
    solution = solved_unknown(unknown(truth.rig), truth.observations)
    assert np.abs(np.log(factors(solution.rig, truth.rig))).max() < 0.02
    for camera in truth.rig:
        assert solution.rig[camera.name].lens.distortions[0] == pytest.approx(camera.lens.distortions[0], abs=0.05)
    truth = made(seed=43, seconds=15.0, cameras=3, people=3, joint_noise_px=1.0)
    start = [
        replace(c, pose=None, lens=Lens.unknown(c.lens.size).started(0.5 * c.lens.focal / c.lens.size[0], 0.1))
        for c in truth.rig
    ]
    solution = solved_unknown(Rig(tuple(start)), truth.observations)
    assert len(solution.rig.posed()) == 3
    assert np.abs(np.log(factors(solution.rig, truth.rig))).max() < 0.02


def test_a_searched_focal_length_is_a_start_and_only_free_parts_leave_what_is_stated():
    lens = Lens.unknown((1000, 800))
    started = Rig((Camera("A", lens.started(2.0, 0.1)),))
    assert started["A"].lens.focal == pytest.approx(2 * lens.focal)
    assert UNKNOWN.core(started)[0, 0] == UNKNOWN.core(Rig((Camera("A", lens),)))[0, 0]
    assert UNKNOWN.core(started, near_start=True)[0, 0] == pytest.approx(0.1)
    rig = Rig((Camera("A", lens), Camera("B", replace(lens, uncalibrated=False))))
    free, focal_only = UNKNOWN.core(rig), UNKNOWN.core(rig, free=("focal",))
    assert (free[0] > 1e-3).all()
    assert (focal_only[0, 1:] < 0.02).all()
    assert focal_only[0, 0] == free[0, 0]
    assert (free[1, 1:] < 0.02).all(), "a lens with intrinsics is held beside one without"


@pytest.mark.slow
def test_cameras_of_one_model_share_their_lens():
    """Four views of one lens say more of it than one view of each of four."""
    truth, sigma = noisy(seed=42, lenses="shared"), {}
    for group in (None, "dome"):
        rig = Rig(tuple(Camera(c.name, Lens.unknown(c.lens.size, group=group)) for c in truth.rig))
        solution = solved_unknown(rig, part(truth.observations))
        focals = [parts.focal for parts in adjusted(solution.figures).lenses.values()]
        sigma[group] = np.median([focal.sigma_px / focal.refined_px for focal in focals])
    off = np.log(factors(solution.rig, truth.rig))
    assert np.abs(off).max() < 0.02
    assert np.ptp(off) < 0.003, "but for what one unit differs from another"
    assert np.ptp([camera.lens.distortions[0] for camera in solution.rig]) < 0.01
    assert sigma["dome"] < 0.5 * sigma[None]


@pytest.mark.slow
def test_fisheye_lenses_are_found(monkeypatch):
    def fisheye(picture, rng):
        focal = picture[0] * rng.uniform(0.35, 0.6)
        matrix = np.array([[focal, 0, picture[0] / 2], [0, focal, picture[1] / 2], [0, 0, 1.0]])
        return Lens(picture, matrix, np.array([rng.uniform(-0.05, 0.05), 0, 0, 0]), fisheye=True)

    monkeypatch.setattr("passerby.simulation.lenses._make_typical_lens", fisheye)
    truth = simulate(SimulationOptions(preset="terrace", seed=43, seconds=30.0, box_noise=0.02, missing=0.1))
    rig = Rig(tuple(Camera(c.name, Lens.unknown(c.lens.size, fisheye=True)) for c in truth.rig))
    solution = solved_unknown(rig, part(truth.observations))
    assert len(solution.rig.posed()) == 4
    assert all(camera.lens.fisheye for camera in solution.rig)
    assert np.abs(np.log(factors(solution.rig, truth.rig))).max() < 0.04


def guessed(rig: Rig, factors: tuple[float, ...], sd: float | None) -> Rig:
    wrong = LensUnknowns(("focal",)).rig(rig, np.log(np.array(factors))[:, None])
    cameras = (replace(camera, lens=replace(camera.lens, focal_sd=sd)) for camera in without_poses(wrong))
    return Rig(tuple(cameras))


@cache
def solved(preset: str, factors: tuple[float, ...], sd: float | None, refine: tuple[str, ...] = ()) -> Solution:
    truth = simulated(preset)
    options = PeopleOptions(max_sightings=4000, coarse_people=200, refine_lens=refine)  # type: ignore[arg-type]
    return solve(guessed(truth.rig, factors, sd), part(truth.observations), options=options)


@pytest.mark.slow
@thinned("preset", ["terrace", "basketball"])
@thinned("factors", [(1.1,) * 4, (1.0, 1.1, 1.0, 1.0), (1.1, 0.9, 1.05, 0.95)])
def test_sigmas_cover_what_a_guess_is_off_by(preset: str, factors: tuple[float, ...]) -> None:
    """Ten per cent wrong with a sigma of ten: errors of one sigma or two, where without it they are of many."""
    truth, solution = simulated(preset).rig, solved(preset, factors, 0.1)
    comparison = compare(solution.rig, truth)
    errors = {
        "position": list(comparison.stated.position_sigmas.values()),
        "orientation": list(comparison.stated.orientation_sigmas.values()),
        "scale": [np.log(comparison.scale_ratio) / solution.figures.scale.relative_sigma],
        "distance": [
            (row.metres - np.linalg.norm(truth[row.cameras[0]].centre - truth[row.cameras[1]].centre)) / row.sigma_m
            for row in solution.figures.distances
        ],
    }  # fmt: skip
    for kind, sigmas in errors.items():
        assert np.abs(sigmas).max() < 2.5, kind
    exact = solved(preset, factors, None)
    assert exact.figures.vertical_sigma_deg < solution.figures.vertical_sigma_deg
    for before, after in zip(exact.rig, solution.rig, strict=True):
        np.testing.assert_array_equal(before.pose.R_cw, after.pose.R_cw)  # only what is said of them differs
        assert 2 * before.sigma.position_m < after.sigma.position_m
    for own, wide in zip(exact.figures.cameras, solution.figures.cameras, strict=True):
        assert wide.shape_position_sigma_mm > own.shape_position_sigma_mm


@pytest.mark.slow
def test_a_guess_that_makes_a_camera_too_uncertain_is_a_doubt() -> None:
    right = (1.0,) * 4
    exact, guessed = solved("terrace", right, 0.002), solved("terrace", right, 0.05)
    assert solved("terrace", right, None).verdict == exact.verdict == guessed.verdict == "accepted"
    points = [one.figures.measuring.points.median_mm for one in (exact, guessed)]
    assert points[1] > 1.5 * points[0], "what the guess costs is in the uncertainty"
    doubtful = solved("terrace", right, 0.45)
    assert doubtful.verdict == "doubtful"
    assert all(" are uncertain by " in reason for reason in doubtful.reasons)


@pytest.mark.slow
def test_the_stated_sigma_is_the_prior_of_the_refinement() -> None:
    refined, truth = solved("basketball", (1.1,) * 4, 0.15, ("focal",)), simulated("basketball").rig
    for camera in refined.rig:
        assert camera.lens.focal_sd < 0.15
        assert abs(np.log(camera.lens.focal / truth[camera.name].lens.focal)) < 3 * camera.lens.focal_sd


def test_guesses_are_priors_that_may_err_alike_or_each_on_its_own_and_files_hold_them(tmp_path: Path) -> None:
    sd = np.array([0.1, 0.0, 0.2, 0.15])
    found = covariance_of_guesses(sd)
    for covariance in (np.diag(sd**2), np.outer(sd, sd)):
        assert np.linalg.eigvalsh(found - covariance).min() > -1e-12
    np.testing.assert_allclose(covariance_of_guesses(np.array([0.0, 0.1])), np.diag([0.0, 0.01]))
    rig = Rig((Camera("A", replace(LENS, focal_sd=0.125)), Camera("B", LENS)))
    unknowns = LensUnknowns(("focal", "principal_point"))
    np.testing.assert_allclose(unknowns.core(rig)[:, 0], [0.6745 * 0.125, FOCAL_CORE])
    np.testing.assert_allclose(unknowns.uncalibrated_sd(rig)[:, 0], [0.125, 0.1])
    path = tmp_path / "rig.toml"
    write_rig(path, rig)
    assert path.read_text().count("focal_sd_percent") == 1
    assert [camera.lens.focal_sd for camera in read_rig(path)] == [0.125, None]
    with pytest.raises(InputError, match="is out of range"):
        replace(LENS, focal_sd=0.6)


def test_check_warns_of_guesses_and_the_scene_file_overrides(tmp_path: Path) -> None:
    files = {"rig.toml": lens("A") + "focal_sd_percent = 15\n" + lens("B") + "focal_sd_percent = 15\n"}
    path = write_scene(tmp_path, files=files)

    def guesses() -> list[str]:
        return [text for text in check_scene(path).findings if "is a guess" in text]

    (warning,) = guesses()
    assert "the focal length of cameras A, B is a guess with 1 sigma of 15 %" in warning
    path.write_text(path.read_text().replace("[cameras.A]\n", "[cameras.A]\nfocal_sd_percent = 4\n"))
    assert len(guesses()) == 2
    path.write_text(path.read_text() + '[solver]\nrefine = ["focal"]\n')
    assert all("prior of the refinement" in text for text in guesses())
    for fault, named in (("4", "[cameras.A] states focal_sd_percent"), ("60", "focal_sd_percent")):
        text = path.read_text().replace('refine = ["focal"]', 'method = "geopose"\nreference = "A"')
        path.write_text(text.replace("focal_sd_percent = 4", f"focal_sd_percent = {fault}"))
        assert named in check_scene(path).faults[0]
    json.dumps(check_scene(path).to_dict(), allow_nan=False)
