"""A focal length that is a guess: its stated uncertainty is in every sigma, and is the prior of a refinement."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Rig
from passerby.core.solution import Solution
from passerby.evaluation.metrics import compare
from passerby.interchange.rig_toml import read_rig, write_rig
from passerby.scene.check import check_scene
from passerby.solver.lens_unknowns import FOCAL_CORE, LensUnknowns
from passerby.solver.people import PeopleOptions
from passerby.solver.systematic import covariance_of_guesses
from support.scenes.handmade_files import lens, write_scene
from support.scenes.people_and_rigs import LENS, part, simulated, solve, without_poses
from support.tiers import thinned

OPTIONS = PeopleOptions(max_sightings=4000, coarse_people=200)


def guessed(rig: Rig, factors: tuple[float, ...], sd: float | None) -> Rig:
    wrong = LensUnknowns(("focal",)).rig(rig, np.log(np.array(factors))[:, None])
    cameras = (replace(camera, lens=replace(camera.lens, focal_sd=sd)) for camera in without_poses(wrong))
    return Rig(tuple(cameras))


@cache
def solved(preset: str, factors: tuple[float, ...], sd: float | None, refine: tuple[str, ...] = ()) -> Solution:
    truth = simulated(preset)
    options = replace(OPTIONS, refine_lens=refine)  # type: ignore[arg-type]
    return solve(guessed(truth.rig, factors, sd), part(truth.observations), options=options)


@pytest.mark.slow
@thinned("preset", ["terrace", "basketball"])
@thinned("factors", [(1.1,) * 4, (1.0, 1.1, 1.0, 1.0), (1.1, 0.9, 1.05, 0.95)])
def test_sigmas_cover_what_a_guess_is_off_by(preset: str, factors: tuple[float, ...]) -> None:
    """Ten per cent wrong with a sigma of ten: errors of one sigma or two, where without it they are of many."""
    truth, solution = simulated(preset).rig, solved(preset, factors, 0.1)
    comparison = compare(solution.rig, truth)
    assert comparison.stated is not None
    assert comparison.scale_ratio is not None
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
        assert before.pose is not None
        assert after.pose is not None
        np.testing.assert_array_equal(before.pose.R_cw, after.pose.R_cw)  # only what is said of them differs
        assert before.sigma is not None
        assert after.sigma is not None
        assert 2 * before.sigma.position_m < after.sigma.position_m
    sigmas = [camera.shape_position_sigma_mm for camera in exact.figures.cameras]
    assert all(wide.shape_position_sigma_mm > own for wide, own in zip(solution.figures.cameras, sigmas, strict=True))


@pytest.mark.slow
def test_a_guess_that_makes_a_camera_too_uncertain_is_a_doubt() -> None:
    right = (1.0,) * 4
    assert solved("terrace", right, None).verdict == "accepted"
    exact, guessed = solved("terrace", right, 0.002), solved("terrace", right, 0.05)
    assert guessed.verdict == "accepted"
    points = [one.figures.measuring.points.median_mm for one in (exact, guessed)]
    assert points[1] > 1.5 * points[0], "what the guess costs is in the uncertainty"
    doubtful = solved("terrace", right, 0.45)
    assert doubtful.verdict == "doubtful"
    assert all(" are uncertain by " in reason for reason in doubtful.reasons)
    assert solved("terrace", right, 0.002).verdict == "accepted"


def test_guesses_may_err_alike_or_each_on_its_own() -> None:
    sd = np.array([0.1, 0.0, 0.2, 0.15])
    found = covariance_of_guesses(sd)
    for covariance in (np.diag(sd**2), np.outer(sd, sd)):
        assert np.linalg.eigvalsh(found - covariance).min() > -1e-12
    np.testing.assert_allclose(covariance_of_guesses(np.array([0.0, 0.1])), np.diag([0.0, 0.01]))


@pytest.mark.slow
def test_the_stated_sigma_is_the_prior_of_the_refinement() -> None:
    rig = Rig((Camera("A", replace(LENS, focal_sd=0.2)), Camera("B", LENS)))
    unknowns = LensUnknowns(("focal", "principal_point"))
    np.testing.assert_allclose(unknowns.core(rig)[:, 0], [0.6745 * 0.2, FOCAL_CORE])
    np.testing.assert_allclose(unknowns.uncalibrated_sd(rig)[:, 0], [0.2, 0.1])
    refined = solved("basketball", (1.1,) * 4, 0.15, ("focal",))
    truth = simulated("basketball").rig
    for camera in refined.rig:
        sd = camera.lens.focal_sd
        assert sd is not None
        assert sd < 0.15
        assert abs(np.log(camera.lens.focal / truth[camera.name].lens.focal)) < 3 * sd


def test_files_hold_it(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    write_rig(path, Rig((Camera("A", replace(LENS, focal_sd=0.125)), Camera("B", LENS))))
    assert path.read_text().count("focal_sd_percent") == 1
    assert [camera.lens.focal_sd for camera in read_rig(path)] == [0.125, None]
    with pytest.raises(InputError, match="is out of range"):
        replace(LENS, focal_sd=0.6)


def test_check_tells_of_guesses_and_the_scene_file_overrides(tmp_path: Path) -> None:
    files = {"rig.toml": lens("A") + "focal_sd_percent = 15\n" + lens("B") + "focal_sd_percent = 15\n"}
    path = write_scene(tmp_path, files=files)

    def guesses() -> list[str]:
        return [text for text in check_scene(path).findings if "is a guess" in text]

    (told,) = guesses()
    assert "the focal length of cameras A, B is a guess with 1 sigma of 15 %" in told
    path.write_text(path.read_text().replace("[cameras.A]\n", "[cameras.A]\nfocal_sd_percent = 4\n"))
    assert len(guesses()) == 2
    path.write_text(path.read_text() + '[solver]\nrefine = ["focal"]\n')
    assert all("prior of the refinement" in text for text in guesses())
    for fault, named in (("4", "[cameras.A] states focal_sd_percent"), ("60", "focal_sd_percent")):
        text = path.read_text().replace('refine = ["focal"]', 'method = "geopose"\nreference = "A"')
        path.write_text(text.replace("focal_sd_percent = 4", f"focal_sd_percent = {fault}"))
        assert named in check_scene(path).faults[0]
    json.dumps(check_scene(path).to_dict(), allow_nan=False)
